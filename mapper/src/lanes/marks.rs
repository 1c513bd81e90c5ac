//! Where the marks of a dashed line begin and end.

use common::map::LaneKind;
use serde::{Deserialize, Serialize};

use super::LaneConfig;
use super::decision::MOST_PAINTED;
use super::paint::{Paint, between};
use super::profile::{Bin, Share, Shares, runs};

/// How the marks of dashed lines are measured.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MarkConfig {
    /// How far around the bin in which a mark ends its end is sought, metres: two
    /// bins, as a bin that is painted in part may be taken for either.
    pub search_m: f64,
    /// Least number of road points within the search before and behind an end:
    /// with fewer, it lies anywhere between them.
    pub fewest_points: usize,
    /// By how much a mark may be longer than the median of its line's, metres:
    /// machines paint them alike, and what is longer are two, with a gap that was
    /// not seen. Shorter ones are worn.
    pub within_m: f64,
    /// Length of the shortest of them, as a share of the median: what is left
    /// of a more worn one tells neither of its ends.
    pub least_length_share: f64,
}

impl Default for MarkConfig {
    fn default() -> Self {
        Self { search_m: 0.5, fewest_points: 3, within_m: 0.5, least_length_share: 0.5 }
    }
}

/// Step in which ends are sought, metres: a tenth of what the points of one beam
/// lie apart along the line.
const STEP_M: f64 = 0.01;

/// The marks along the bins of a dashed line, as stations, metres: each end is
/// the likeliest border between the share of bright points that paint has and
/// that of bare road. Where one end was not seen, the mark is as long as most of
/// its line.
pub fn marks(kind: LaneKind, bins: &[Bin], shares: Shares, paint: &Paint, config: &LaneConfig) -> Vec<[f64; 2]> {
    if kind != LaneKind::Dashed {
        return Vec::new();
    }
    let half_bin_m = config.profile_m / 2.0;
    // Worn paint has a share of its own, which is that next to the end.
    let near = (2.0 * config.marks.search_m / config.profile_m).ceil() as usize;
    let painted = |bins: &[Bin]| {
        let share = bins.iter().map(|b| b.core).sum::<Share>().value();
        share.min(shares.painted).max(2.0 * shares.bare).min(MOST_PAINTED)
    };
    let ends_m = |run: std::ops::Range<usize>| {
        let on = bins.get(run)?;
        let (first, last) = (on.first()?, on.last()?);
        let (begins, ends) = (painted(&on[..near.min(on.len())]), painted(&on[on.len().saturating_sub(near)..]));
        let begin_m = border(first, first.station_m - half_bin_m, [shares.bare, begins], paint, config);
        Some((begin_m, border(last, last.station_m + half_bin_m, [ends, shares.bare], paint, config)))
    };
    let ends: Vec<(Option<f64>, Option<f64>)> = runs(bins, config).into_iter().filter_map(ends_m).collect();
    let length_m = |ends: &(Option<f64>, Option<f64>)| Some(ends.1? - ends.0?);
    let is_dash = |length_m: &f64| (config.shortest_dash_m..config.longest_dash_m).contains(length_m);
    let mut lengths_m: Vec<f64> = ends.iter().filter_map(length_m).filter(is_dash).collect();
    lengths_m.sort_by(f64::total_cmp);
    let Some(&usual_m) = lengths_m.get(lengths_m.len() / 2) else { return Vec::new() };
    let mark = |ends: (Option<f64>, Option<f64>)| match ends {
        (Some(begin_m), Some(end_m)) => Some([begin_m, end_m]),
        (Some(begin_m), None) => Some([begin_m, begin_m + usual_m]),
        (None, Some(end_m)) => Some([end_m - usual_m, end_m]),
        (None, None) => None,
    };
    // Worn marks are shorter, and end where lidar and camera see them end.
    let lengths_m = config.marks.least_length_share * usual_m..usual_m + config.marks.within_m;
    let is_like = |mark: &[f64; 2]| lengths_m.contains(&(mark[1] - mark[0]));
    let mut marks: Vec<[f64; 2]> = ends.into_iter().filter_map(mark).filter(is_like).collect();
    marks.dedup_by(|next, before| next[0] <= before[1]);
    marks
}

/// The station around `about_m` at which the share of bright points on a line
/// most likely changes from the first of `shares` to the second.
fn border(bin: &Bin, about_m: f64, shares: [f64; 2], paint: &Paint, config: &LaneConfig) -> Option<f64> {
    let MarkConfig { search_m, fewest_points, .. } = config.marks;
    let (from_m, to_m) = (about_m - search_m, about_m + search_m);
    let is_on = |offset_m: f64| (offset_m - bin.offset_m).abs() <= config.half_core_m;
    let road = paint.road.near([from_m, to_m], [bin.offset_m - config.half_core_m, bin.offset_m + config.half_core_m]);
    // A bright point is among the road's, too: with it the likelihood of a
    // dark one, which is taken back below.
    let [dark, bright] = [shares.map(|share| (1.0 - share).ln()), shares.map(|share| (share / (1.0 - share)).ln())];
    let mut points: Vec<(f64, f64)> = road
        .filter(|p| is_on(f64::from(p.offset_m)) && (from_m..to_m).contains(&f64::from(p.station_m)))
        .map(|p| (f64::from(p.station_m), dark[0] - dark[1]))
        .collect();
    let count = |points: &[(f64, f64)], is_before: bool| points.iter().filter(|p| (p.0 < about_m) == is_before).count();
    if count(&points, true) < fewest_points || count(&points, false) < fewest_points {
        return None;
    }
    let on = between(&paint.bright, from_m, to_m).iter().filter(|p| is_on(p.offset_m));
    points.extend(on.map(|p| (p.station_m, bright[0] - bright[1])));
    // By value, too: the order in which points come depends on the scans.
    points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    // How much likelier all points before a border are under the first share
    // than under the second; the rest is the same for every border.
    let steps = (2.0 * search_m / STEP_M).round() as usize;
    let (mut best, mut sum_m, mut ties) = (f64::NEG_INFINITY, 0.0, 0.0);
    let (mut next, mut score) = (0, 0.0);
    for step in 0..=steps {
        let station_m = from_m + step as f64 * STEP_M;
        while let Some(point) = points.get(next).filter(|p| p.0 < station_m) {
            score += point.1;
            next += 1;
        }
        if score > best + 1e-9 {
            (best, sum_m, ties) = (score, 0.0, 0.0);
        }
        if score > best - 1e-9 {
            (sum_m, ties) = (sum_m + station_m, ties + 1.0);
        }
    }
    Some(sum_m / ties)
}
