//! Which landmarks are kept.
//!
//! Greedy: always the landmark next that lowers the weighted variance of the
//! pose, summed over all places, most per byte. What one landmark tells is
//! worth less the more the others tell already, so a landmark whose worth was
//! computed a while ago is worth no more today, and only the best of the list
//! are looked at again (Minoux 1978: the lazy greedy algorithm).

use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};

use common::map::SemanticMap;
use nalgebra::Matrix6;
use rayon::prelude::*;

use super::BudgetConfig;
use super::accuracy::{badness, before, rows};
use super::cost::{Coder, Group};
use super::doubt::Doubt;
use super::places::Places;
use super::sight::Row;
use crate::error::Result;
use crate::evidence::MapEvidence;

/// What was kept of a map.
pub struct Selection {
    /// The map, its landmarks in their old order.
    pub map: SemanticMap,
    /// Their evidence.
    pub evidence: MapEvidence,
    /// Number of landmarks kept.
    pub kept: usize,
    /// Weighted variance that is left, summed over all places.
    pub left: f64,
}

/// A landmark that may be taken, by worth per byte.
#[derive(Debug, Clone, Copy)]
struct Offer {
    worth: f64,
    landmark: usize,
    /// Number of landmarks that had been taken when it was computed.
    at: usize,
}

impl Ord for Offer {
    fn cmp(&self, other: &Self) -> Ordering {
        // The first of two that are worth the same.
        self.worth.total_cmp(&other.worth).then(other.landmark.cmp(&self.landmark))
    }
}

impl PartialOrd for Offer {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Offer {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Offer {}

/// What is known at each place.
struct Belief<'a> {
    information: Vec<Matrix6<f64>>,
    doubt: Vec<Doubt>,
    badness: Vec<f64>,
    config: &'a BudgetConfig,
}

impl<'a> Belief<'a> {
    fn new(places: usize, config: &'a BudgetConfig) -> Self {
        let information = before(config);
        let doubt = Doubt::default();
        let bad = bad(&information, &doubt, config);
        Self { information: vec![information; places], doubt: vec![doubt; places], badness: vec![bad; places], config }
    }

    /// What is known at a place with some rows of one landmark, too.
    fn with(&self, here: &[Row]) -> (Matrix6<f64>, Doubt, f64) {
        let place = here[0].place;
        let information = self.information[place] + told(here);
        let doubt = self.doubt[place].less(here, self.config);
        (information, doubt, bad(&information, &doubt, self.config))
    }

    /// By how much a landmark would lower the sum.
    fn worth(&self, rows: &[Row]) -> f64 {
        rows.chunk_by(|a, b| a.place == b.place).map(|here| self.badness[here[0].place] - self.with(here).2).sum()
    }

    fn take(&mut self, rows: &[Row]) {
        for here in rows.chunk_by(|a, b| a.place == b.place) {
            let place = here[0].place;
            (self.information[place], self.doubt[place], self.badness[place]) = self.with(here);
        }
    }
}

fn told(rows: &[Row]) -> Matrix6<f64> {
    rows.iter().map(|row| row.whitened * row.whitened.transpose()).sum()
}

fn bad(information: &Matrix6<f64>, doubt: &Doubt, config: &BudgetConfig) -> f64 {
    // Positive definite, for what was known before is in it.
    let covariance = information.cholesky().map_or_else(Matrix6::zeros, |factor| factor.inverse());
    badness(&(covariance + doubt.spread(config)), config)
}

/// Bytes by which the sum of the groups may differ from the file: its bounds,
/// the empty groups of roads without a kind, the lengths of lists.
const EXACT_WITHIN_BYTES: usize = 256;
/// So many landmarks one after the other that no longer fit are the end.
const MOST_MISSES: usize = 200;

/// The landmarks of a map that fit and localize best.
pub fn select(
    map: &SemanticMap,
    evidence: &MapEvidence,
    places: &Places,
    quantum_m: f64,
    budget_bytes: usize,
    config: &BudgetConfig,
) -> Result<Selection> {
    let coder = Coder::new(map, quantum_m);
    let rows = rows(map, evidence, places, config);
    let mut belief = Belief::new(places.list.len(), config);
    let mut taken = Taken::new(&coder)?;
    let all: Vec<usize> = (0..coder.count()).collect();
    if coder.file_bytes(&all)? <= budget_bytes {
        for rows in &rows {
            belief.take(rows);
        }
        return Ok(selection(&coder, &all, evidence, &belief));
    }
    let offer = |belief: &Belief, taken: &Taken, landmark: usize| -> Result<(Offer, usize)> {
        let bytes = taken.cost(landmark)?;
        let worth = belief.worth(&rows[landmark]) / bytes.max(1) as f64;
        Ok((Offer { worth, landmark, at: taken.list.len() }, bytes))
    };
    let first: Result<Vec<Offer>> = all.par_iter().map(|landmark| Ok(offer(&belief, &taken, *landmark)?.0)).collect();
    let mut heap: BinaryHeap<Offer> = first?.into();
    let mut misses = 0;
    while let Some(best) = heap.pop() {
        let (now, bytes) = offer(&belief, &taken, best.landmark)?;
        if best.at < taken.list.len() && heap.peek().is_some_and(|next| now < *next) {
            heap.push(now);
            continue;
        }
        if taken.fits(best.landmark, bytes, budget_bytes)? {
            taken.take(best.landmark)?;
            belief.take(&rows[best.landmark]);
            misses = 0;
        } else {
            misses += 1;
            if misses > MOST_MISSES {
                break;
            }
        }
    }
    let Taken { mut list, .. } = taken;
    // The budget is a bound, whatever the estimates were.
    while !list.is_empty() && coder.file_bytes(&list)? > budget_bytes {
        list.pop();
    }
    list.sort_unstable();
    Ok(selection(&coder, &list, evidence, &belief))
}

/// What has been taken so far.
struct Taken<'a> {
    coder: &'a Coder<'a>,
    list: Vec<usize>,
    groups: BTreeMap<Group, (Vec<usize>, usize)>,
    /// About the bytes of the file.
    bytes: usize,
    /// Bytes of a group of nothing, which are in those of the file already.
    empty_group: usize,
}

impl<'a> Taken<'a> {
    fn new(coder: &'a Coder<'a>) -> Result<Self> {
        let bytes = coder.file_bytes(&[])?;
        let empty_group = coder.group_bytes(&[])?;
        Ok(Self { coder, list: Vec::new(), groups: BTreeMap::new(), bytes, empty_group })
    }

    /// Bytes that a landmark adds to its group.
    fn cost(&self, landmark: usize) -> Result<usize> {
        let (mut members, before) = self.groups.get(&self.coder.group(landmark)).cloned().unwrap_or_default();
        members.push(landmark);
        Ok(self.coder.group_bytes(&members)?.saturating_sub(before))
    }

    /// Whether the file stays within the budget with this landmark in it.
    fn fits(&self, landmark: usize, bytes: usize, budget_bytes: usize) -> Result<bool> {
        if self.bytes + bytes + EXACT_WITHIN_BYTES + self.list.len() / 16 < budget_bytes {
            return Ok(true);
        }
        let mut list = self.list.clone();
        list.push(landmark);
        Ok(self.coder.file_bytes(&list)? <= budget_bytes)
    }

    fn take(&mut self, landmark: usize) -> Result<()> {
        self.list.push(landmark);
        let group = self.groups.entry(self.coder.group(landmark)).or_default();
        let before = if group.0.is_empty() { self.empty_group } else { group.1 };
        group.0.push(landmark);
        group.1 = self.coder.group_bytes(&group.0)?;
        self.bytes += group.1.saturating_sub(before);
        Ok(())
    }
}

fn selection(coder: &Coder, kept: &[usize], evidence: &MapEvidence, belief: &Belief) -> Selection {
    let (poles, signs) = (evidence.poles.len(), evidence.signs.len());
    let mut own = MapEvidence::default();
    for landmark in kept {
        own.poles.extend(evidence.poles.get(*landmark));
        own.signs.extend(landmark.checked_sub(poles).and_then(|i| evidence.signs.get(i)));
        own.lanes.extend(landmark.checked_sub(poles + signs).and_then(|i| evidence.lanes.get(i)));
    }
    Selection { map: coder.map_of(kept), evidence: own, kept: kept.len(), left: belief.badness.iter().sum() }
}
