//! Two lines side by side in a window: a double line, or a line and the border
//! of a hatched area.

use super::LaneConfig;
use super::paint::PathPoint;
use super::poll::Poll;
use super::windows::{CELL_M, WindowLine, bin_of, more_than_beside, refine, votes_on};
use crate::grid::whole;

/// Whether two strips are painted side by side over half of the shorter one: a
/// line that swerves is painted here and then there. Given are the first and
/// the last bin with paint of each.
fn are_beside(ends: [Option<(u16, u16)>; 2]) -> bool {
    let [Some(a), Some(b)] = ends else { return false };
    let shorter = (a.1 - a.0).min(b.1 - b.0) + 1;
    let both = (a.1.min(b.1) + 1).saturating_sub(a.0.max(b.0));
    2 * both >= shorter
}

/// The two lines that a line found in a window runs between or on one of; none
/// where it is the only one there. One line that fits both halves is on
/// neither, and leads a chain over from one to the other.
///
/// Points are those on the line and beside it, in the order of their stations; of a
/// bin at most so many count.
pub fn pair(points: &[PathPoint], line: &WindowLine, most: u16, config: &LaneConfig) -> Option<[WindowLine; 2]> {
    let reach_m = config.apart_m + config.beside_line_m;
    let near: Vec<PathPoint> =
        points.iter().filter(|p| (p.offset_m - line.offset_m(p.station_m)).abs() <= reach_m).copied().collect();
    let start_m = line.centre_m - config.window_m / 2.0;
    let bin = |p: &PathPoint| bin_of(p.station_m - start_m, config);
    let bins: Vec<(u16, &[PathPoint])> =
        near.chunk_by(|a, b| bin(a) == bin(b)).filter_map(|of_bin| Some((bin(of_bin.first()?), of_bin))).collect();
    // A step of the slope moves the ends of the window by half a core; from one
    // line's begin to the other's end it is at most the distance of both.
    let step = config.half_core_m / config.window_m;
    let steps = (config.apart_m / config.half_core_m).ceil() as i32;
    let mut best: Option<(u16, [WindowLine; 2])> = None;
    for slope in (-steps..=steps).map(|k| line.slope + f64::from(k) * step) {
        let turned = WindowLine { slope, ..*line };
        let Some((votes, middles_m)) = side_by_side(&bins, &turned, reach_m, most, config) else { continue };
        if best.is_none_or(|(best, _)| votes > best) {
            best = Some((votes, middles_m.map(|off_m| WindowLine { middle_m: line.middle_m + off_m, ..turned })));
        }
    }
    // Turned far enough, two strips take apart what one line explains as well.
    let [single, ..] = votes_on(&near, line, most, config);
    let is_more = |both: u16| f64::from(both) >= (1.0 + config.least_pair_share) * f64::from(single.all);
    best.filter(|(both, _)| is_more(*both)).map(|(_, lines)| {
        // As wide as may be, but each to its own side.
        let half_m = config.half_line_m.min(0.5 * (lines[1].middle_m - lines[0].middle_m));
        lines.map(|line| refine(&near, line, half_m, config))
    })
}

/// The two strips of one direction with most paint that have a gap between
/// them: the points of both, and their distances from a line, metres.
fn side_by_side(
    bins: &[(u16, &[PathPoint])],
    line: &WindowLine,
    reach_m: f64,
    most: u16,
    config: &LaneConfig,
) -> Option<(u16, [f64; 2])> {
    // Strips are as wide as the core of a line.
    let half = (config.half_core_m / CELL_M) as usize;
    let beside = (config.beside_line_m / CELL_M).round() as usize;
    let cell_of = |off_m: f64| whole((off_m + reach_m) / CELL_M) + half;
    let mut poll = Poll::new(cell_of(reach_m) + half + 1, half, most);
    // First and last bin with paint of each strip.
    let mut ends: Vec<Option<(u16, u16)>> = vec![None; poll.votes().len()];
    let mut cells: Vec<usize> = Vec::new();
    for (bin, points) in bins {
        let off_m = points.iter().map(|p| p.offset_m - line.offset_m(p.station_m));
        cells.clear();
        cells.extend(off_m.filter(|off_m| off_m.abs() <= reach_m).map(cell_of));
        let (Some(low), Some(high)) = (cells.iter().min(), cells.iter().max()) else { continue };
        let (first, counts) = poll.count(*low..high + 1, cells.iter().copied());
        for (ends, _) in ends[first..].iter_mut().zip(counts).filter(|(_, count)| **count > 0) {
            *ends = Some((ends.map_or(*bin, |ends| ends.0), *bin));
        }
    }
    let votes = poll.votes();
    let is_peak = |k: &usize| {
        let all = |i: Option<usize>| i.and_then(|i| votes.get(i)).copied().unwrap_or(0);
        let here = votes[*k];
        here > 0 && here >= all(k.checked_sub(1)) && here >= all(Some(k + 1))
    };
    let peaks: Vec<usize> = (0..votes.len()).filter(is_peak).collect();
    let mut best: Option<(u16, [f64; 2])> = None;
    for (i, &a) in peaks.iter().enumerate() {
        for &b in &peaks[i + 1..] {
            let apart_m = (b - a) as f64 * CELL_M;
            if !(config.least_pair_m..config.apart_m).contains(&apart_m) || !are_beside([ends[a], ends[b]]) {
                continue;
            }
            let lower = votes[a].min(votes[b]);
            let between = votes[a..b].iter().copied().min().unwrap_or(lower);
            let both = votes[a].saturating_add(votes[b]);
            let is_gap = f64::from(between) <= config.largest_between_share * f64::from(lower);
            let beyond = |k: Option<usize>| k.and_then(|k| votes.get(k)).copied().unwrap_or(0);
            let are_lines = is_line(votes[a], beyond(a.checked_sub(beside)), config)
                && is_line(votes[b], beyond(Some(b + beside)), config);
            if is_gap && are_lines && best.is_none_or(|(best, _)| both > best) {
                let off_m = |cell: usize| (cell as f64 - half as f64 + 0.5) * CELL_M - reach_m;
                best = Some((both, [off_m(a), off_m(b)]));
            }
        }
    }
    best
}

/// Whether a strip has so much more paint than one beyond it that it is a line.
fn is_line(on: u16, beyond: u16, config: &LaneConfig) -> bool {
    more_than_beside(on, [beyond; 2], config).is_some()
}
