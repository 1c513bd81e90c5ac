//! Where one map lies against another, before any landmark is known to be the
//! same: all pairs that could be vote for the shift between them.

use nalgebra::{Point3, Vector2};
use rustc_hash::FxHashMap;

use super::config::AlignConfig;
use crate::fuse::Buckets;

/// A landmark that votes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Voter {
    /// Where, map frame, metres.
    pub point_map: Point3<f64>,
    /// Only landmarks of one class can be the same.
    pub class: u32,
}

/// Cells of the votes, metres: a few times the error of a landmark.
const CELL_M: f64 = 0.25;
/// Shifts this near count as the same, metres.
const SAME_M: f64 = 0.4;

/// Pairs of (index here, index there) that agree on one shift seen from above;
/// none where too few agree, or where they agree on several shifts alike.
pub fn agreeing_pairs(here: &[Voter], there: &[Voter], config: &AlignConfig) -> Vec<(usize, usize)> {
    let buckets = Buckets::of(config.reach_m, there.iter().map(|voter| &voter.point_map));
    let mut pairs: Vec<(usize, usize, Vector2<f64>)> = Vec::new();
    for (h, voter) in here.iter().enumerate() {
        for t in buckets.near(&voter.point_map, config.reach_m) {
            let shift = there[t].point_map - voter.point_map;
            let (above, height) = (Vector2::new(shift.x, shift.z), shift.y.abs());
            if voter.class == there[t].class && above.norm() <= config.reach_m && height <= config.reach_m {
                pairs.push((h, t, above));
            }
        }
    }
    let mut cells: FxHashMap<(i64, i64), Vec<usize>> = FxHashMap::default();
    let cell = |shift: &Vector2<f64>| ((shift.x / CELL_M).floor() as i64, (shift.y / CELL_M).floor() as i64);
    for (index, (.., shift)) in pairs.iter().enumerate() {
        cells.entry(cell(shift)).or_default().push(index);
    }
    // The shift of every pair is tried: how many landmarks here agree with it?
    let agree = |shift: &Vector2<f64>| -> Vec<usize> {
        let (x, z) = cell(shift);
        let reach = (SAME_M / CELL_M).ceil() as i64;
        let around = (x - reach..=x + reach).flat_map(|x| (z - reach..=z + reach).map(move |z| (x, z)));
        let all = around.filter_map(|cell| cells.get(&cell)).flatten().copied();
        let mut near: Vec<usize> = all.filter(|&index| (pairs[index].2 - shift).norm() <= SAME_M).collect();
        near.sort_unstable();
        near
    };
    let count = |near: &[usize]| {
        // Pairs are in the order of the landmarks here.
        near.chunk_by(|a, b| pairs[*a].0 == pairs[*b].0).count()
    };
    let tried: Vec<(usize, Vector2<f64>)> = pairs.iter().map(|(.., shift)| (count(&agree(shift)), *shift)).collect();
    let best = tried.iter().max_by(|a, b| a.0.cmp(&b.0).then(b.1.norm().total_cmp(&a.1.norm())));
    let Some(&(votes, shift)) = best else { return Vec::new() };
    let elsewhere = tried.iter().filter(|(_, other)| (other - shift).norm() > 2.0 * SAME_M).map(|t| t.0).max();
    if votes < config.fewest_votes || (votes as f64) < config.least_lead * elsewhere.unwrap_or(0) as f64 {
        return Vec::new();
    }
    let mut agreeing: Vec<(usize, usize)> = Vec::new();
    for group in agree(&shift).chunk_by(|a, b| pairs[*a].0 == pairs[*b].0) {
        let off = |index: &usize| (pairs[*index].2 - shift).norm();
        let nearest = group.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
        agreeing.extend(nearest.map(|&index| (pairs[index].0, pairs[index].1)));
    }
    agreeing
}

#[cfg(test)]
mod tests {
    use super::*;

    fn voters(places: &[(f64, f64)], shift: (f64, f64)) -> Vec<Voter> {
        let voter = |&(x, z): &(f64, f64)| Voter { point_map: Point3::new(x + shift.0, 1.6, z + shift.1), class: 0 };
        places.iter().map(voter).collect()
    }

    const STREET: [(f64, f64); 7] =
        [(5.0, 3.0), (-6.0, 9.0), (5.5, 21.0), (-6.2, 30.0), (5.1, 33.5), (7.0, 44.0), (-5.0, 52.0)];

    #[test]
    fn a_shift_is_found_among_landmarks_that_only_one_map_has() {
        let mut there = voters(&STREET, (1.3, -1.4));
        there.swap(0, 5);
        there.extend(voters(&[(4.0, 12.0), (-7.0, 31.0)], (0.0, 0.0)));
        let pairs = agreeing_pairs(&voters(&STREET, (0.0, 0.0)), &there, &AlignConfig::default());
        assert_eq!(pairs.len(), STREET.len());
        assert!(pairs.contains(&(0, 5)) && pairs.contains(&(5, 0)) && pairs.contains(&(1, 1)));
    }

    #[test]
    fn a_row_of_like_bollards_says_nothing() {
        let row: Vec<(f64, f64)> = (0..20).map(|i| (3.0, f64::from(i) * 1.5)).collect();
        let (here, there) = (voters(&row, (0.0, 0.0)), voters(&row, (0.0, 0.7)));
        assert!(agreeing_pairs(&here, &there, &AlignConfig::default()).is_empty());
    }

    #[test]
    fn too_few_say_nothing() {
        let few = &STREET[..3];
        let pairs = agreeing_pairs(&voters(few, (0.0, 0.0)), &voters(few, (0.5, 0.0)), &AlignConfig::default());
        assert!(pairs.is_empty());
    }
}
