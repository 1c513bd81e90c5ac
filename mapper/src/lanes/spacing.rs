//! How far apart the dashes of a line are: evenly, as machines paint them. Bars
//! of the crossings on both sides of a junction, an arrow and a stop line lie on
//! one line by chance, and at any distance from each other.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::LaneConfig;

/// How evenly the dashes of a line follow each other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpacingConfig {
    /// By how much distances of dashes that follow each other may differ and be
    /// the same, metres: three bins, as either end is told to one or two of them.
    pub within_m: f64,
    /// Least share of the distances that have to be the same: of three dashes both
    /// are, of four one may differ, as where one is worn off.
    pub least_even_share: f64,
    /// Painted share of a line from which on its dashes may lie as they like: two
    /// fifths; broad and narrow gaps alternate where dashes are worn into pieces,
    /// and what lies there by chance is far apart.
    pub dense_share: f64,
    /// Longest gap of such a line, metres: patterns of which two fifths are painted
    /// have gaps of 6 m at most.
    pub longest_dense_gap_m: f64,
    /// Least share of its gaps that have to be no longer: one dash in five may be
    /// worn off or hidden.
    pub least_dense_gap_share: f64,
}

impl Default for SpacingConfig {
    fn default() -> Self {
        Self {
            within_m: 0.75,
            least_even_share: 0.6,
            dense_share: 0.4,
            longest_dense_gap_m: 6.0,
            least_dense_gap_share: 0.8,
        }
    }
}

/// Whether so much is painted between the gaps of a line that its dashes may be
/// worn into pieces of any length.
pub fn are_dense(runs: &[Range<usize>], config: &LaneConfig) -> bool {
    let spacing = &config.spacing;
    let (Some(first), Some(last)) = (runs.first(), runs.last()) else { return false };
    let painted = runs.iter().map(ExactSizeIterator::len).sum::<usize>() as f64;
    let gaps: Vec<usize> = runs.windows(2).map(|pair| pair[1].start - pair[0].end).collect();
    let is_short = |gap: &&usize| **gap as f64 * config.profile_m <= spacing.longest_dense_gap_m;
    let short = gaps.iter().filter(is_short).count() as f64;
    painted >= spacing.dense_share * (last.end - first.start) as f64
        && short >= spacing.least_dense_gap_share * gaps.len() as f64
}

/// Whether runs of painted bins follow each other as the dashes of a line do. Of a
/// worn dash one end or its middle is where it should be: of their distances those
/// count that are the most even.
pub fn are_even(runs: &[Range<usize>], config: &LaneConfig) -> bool {
    let spacing = &config.spacing;
    let places: [fn(&Range<usize>) -> usize; 3] = [|run| 2 * run.start, |run| run.start + run.end, |run| 2 * run.end];
    let same = |a: usize, b: usize| a.abs_diff(b) as f64 * config.profile_m / 2.0 <= spacing.within_m;
    let even_share = |place: fn(&Range<usize>) -> usize| {
        let apart: Vec<usize> = runs.windows(2).map(|pair| place(&pair[1]) - place(&pair[0])).collect();
        let alike = |a: &usize| apart.iter().filter(|b| same(*a, **b)).count();
        apart.iter().map(alike).max().unwrap_or(0) as f64 / apart.len().max(1) as f64
    };
    places.into_iter().map(even_share).fold(0.0, f64::max) >= spacing.least_even_share
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether dashes that begin and end so are even, metres.
    fn even(dashes_m: &[[f64; 2]]) -> bool {
        let config = LaneConfig::default();
        are_even(&runs(dashes_m, &config), &config)
    }

    fn runs(dashes_m: &[[f64; 2]], config: &LaneConfig) -> Vec<Range<usize>> {
        let bins = |m: f64| (m / config.profile_m) as usize;
        dashes_m.iter().map(|[from_m, to_m]| bins(*from_m)..bins(*to_m)).collect()
    }

    #[test]
    fn dashes_in_pieces_lie_close_and_one_may_be_worn_off() {
        let config = LaneConfig::default();
        let dense = |dashes_m: &[[f64; 2]]| are_dense(&runs(dashes_m, &config), &config);
        let pieces = [[0.0, 4.0], [4.75, 6.0], [9.0, 12.0], [14.5, 18.0], [21.0, 23.0], [26.0, 30.0], [33.0, 35.0]];
        assert!(dense(&pieces));
        // The third of seven is worn off. Of three gaps a long one is no exception.
        let without = [&pieces[..2], &pieces[3..]].concat();
        assert!(dense(&without) && !dense(&without[..4]));
        // Blots along a house front: as much of them is painted, and they lie anywhere.
        assert!(!dense(&[[0.0, 9.0], [13.25, 15.0], [22.5, 23.5], [25.0, 25.75], [37.75, 44.0], [46.5, 48.0]]));
    }

    #[test]
    fn dashes_are_as_far_apart_as_each_other_and_bars_of_crossings_are_not() {
        assert!(even(&[[0.0, 3.0], [9.0, 12.0], [18.0, 21.0]]));
        // The second one is worn to half of its length.
        assert!(even(&[[0.0, 3.0], [10.5, 12.0], [18.0, 21.0]]));
        // The third of five is worn off.
        assert!(even(&[[0.0, 3.0], [9.0, 12.0], [27.0, 30.0], [36.0, 39.0]]));
        // Two crossings and a stop line, an arrow behind one of them.
        assert!(!even(&[[0.0, 3.5], [15.5, 19.0], [25.5, 27.0]]));
        assert!(!even(&[[0.0, 0.5], [2.0, 4.5], [17.25, 18.5]]));
    }
}
