//! A map within a byte budget: the landmarks that localize best.
//!
//! Along the roads stand [`Places`]; what a forward camera sees from each of
//! them, and how much it tells about its pose, is linearised once (`sight`);
//! with too few in view it may take a wrong pose for the right one (`doubt`).
//! `select` then takes the landmarks one after the other that tell most per
//! byte, where least is known, until the bytes are used up.

mod accuracy;
mod config;
mod cost;
mod detail;
mod doubt;
mod places;
mod select;
mod sight;
mod stored;

use common::map::{EncodeOptions, SemanticMap};
use serde::Serialize;

pub use accuracy::{Accuracy, Figure, predict};
pub use config::{BudgetConfig, Camera, Found};
pub use cost::Coder;
pub use detail::Detail;
pub use places::Places;
pub use stored::Stored;

use crate::error::{Error, Result};
use crate::evidence::MapEvidence;
use crate::extent;

/// A map and how well its landmarks are known, in the map's order.
#[derive(Debug, Clone, Copy)]
pub struct Known<'a> {
    /// As decoded from its file.
    pub map: &'a SemanticMap,
    /// One entry for each of its landmarks.
    pub evidence: &'a MapEvidence,
    /// Step of its coordinates, metres.
    pub quantum_m: f64,
}

/// How many landmarks of each class a map has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Poles.
    pub poles: usize,
    /// Signs and lights.
    pub signs: usize,
    /// Lane lines.
    pub lanes: usize,
}

impl Counts {
    /// Those of a map.
    pub fn of(map: &SemanticMap) -> Self {
        Self { poles: map.poles.len(), signs: map.signs.len(), lanes: map.lanes.len() }
    }

    /// All of them.
    pub fn sum(&self) -> usize {
        self.poles + self.signs + self.lanes
    }
}

/// A map that fits.
#[derive(Debug, Clone)]
pub struct Reduced {
    /// The bytes of its file.
    pub bytes: Vec<u8>,
    /// The map in them.
    pub map: SemanticMap,
    /// How well its landmarks are known.
    pub evidence: MapEvidence,
    /// How finely it was written.
    pub detail: Detail,
    /// How well a camera is expected to be localized in it.
    pub predicted: Accuracy,
}

/// The map within `budget_bytes` that localizes best: all of it where it fits.
///
/// # Errors
/// [`Error::TooLong`] where roads and lines are longer than those of a country,
/// [`Error::BudgetTooSmall`] where the roads alone take more, and as
/// [`SemanticMap::encode`].
pub fn reduce(whole: Known<'_>, budget_bytes: usize, config: &BudgetConfig) -> Result<Reduced> {
    extent::check(whole.map, "the map")?;
    let places = Places::along(&whole.map.roads, config);
    let unchanged = Detail::unchanged(whole.quantum_m);
    let coarser = config.coarser.iter().map(|level| Detail::from(*level)).filter(|d| d.quantum_m >= whole.quantum_m);
    let mut best: Option<(f64, Reduced)> = None;
    let mut least_bytes = usize::MAX;
    let has_marks = whole.map.lanes.iter().any(|lane| !lane.marks_m.is_empty());
    let both = |detail: Detail| std::iter::once(detail).chain(has_marks.then(|| detail.without_marks()));
    for detail in std::iter::once(unchanged).chain(coarser).flat_map(both) {
        let (map, evidence) = detail.applied(whole);
        let options = EncodeOptions { quantum_m: detail.quantum_m };
        let empty = cost::without_landmarks(&map).encode(&options)?.len();
        least_bytes = least_bytes.min(empty);
        if empty > budget_bytes {
            continue;
        }
        let chosen = select::select(&map, &evidence, &places, detail.quantum_m, budget_bytes, config)?;
        let everything = chosen.kept == Counts::of(&map).sum();
        if best.as_ref().is_none_or(|(left, _)| chosen.left < *left) {
            let bytes = chosen.map.encode(&options)?;
            let map = SemanticMap::decode(&bytes)?;
            let evidence = cost::in_order_of(&map, &chosen.map, &chosen.evidence, detail.quantum_m);
            let predicted = predict(&map, &evidence, &places, config);
            best = Some((chosen.left, Reduced { bytes, map, evidence, detail, predicted }));
        }
        if everything && (detail.marks || !has_marks) {
            break;
        }
    }
    best.map(|(_, reduced)| reduced).ok_or(Error::BudgetTooSmall {
        budget_bytes,
        least_bytes,
        roads: whole.map.roads.len(),
    })
}

#[cfg(test)]
mod tests;
