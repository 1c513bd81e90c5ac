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
}

impl Default for SpacingConfig {
    fn default() -> Self {
        Self { within_m: 0.75, least_even_share: 0.6, dense_share: 0.4 }
    }
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
        let runs: Vec<Range<usize>> = dashes_m
            .iter()
            .map(|[from_m, to_m]| (from_m / config.profile_m) as usize..(to_m / config.profile_m) as usize)
            .collect();
        are_even(&runs, &config)
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
