//! Two lines side by side in a window: a double line, or a line and the border
//! of a hatched area.

use super::LaneConfig;
use super::paint::PathPoint;
use super::windows::{CELL_M, Votes, WindowLine, bin_of, more_than_beside, refine, votes_on};

/// A strip of paint as wide as the core of a line.
#[derive(Debug, Clone, Copy, Default)]
struct Strip {
    votes: Votes,
    /// Its first and last bins with paint, from 1.
    ends: Option<(u16, u16)>,
}

impl Strip {
    fn count(&mut self, bin: u16, config: &LaneConfig) {
        self.votes.count(bin, config.most_bin_points);
        let (first, last) = self.ends.unwrap_or((bin, bin));
        self.ends = Some((first.min(bin), last.max(bin)));
    }

    /// Whether two are painted side by side over half of the shorter one: a
    /// line that swerves is painted here and then there.
    fn is_beside(&self, other: &Self) -> bool {
        let (Some(a), Some(b)) = (self.ends, other.ends) else { return false };
        let shorter = (a.1 - a.0).min(b.1 - b.0) + 1;
        let both = (a.1.min(b.1) + 1).saturating_sub(a.0.max(b.0));
        2 * both >= shorter
    }
}

/// The two lines that a line found in a window runs between or on one of; none
/// where it is the only one there. One line that fits both halves is on
/// neither, and leads a chain over from one to the other.
///
/// Points are those on the line and beside it, in the order of their stations.
pub fn pair(points: &[PathPoint], line: &WindowLine, config: &LaneConfig) -> Option<[WindowLine; 2]> {
    let reach_m = config.apart_m + config.beside_line_m;
    let near: Vec<PathPoint> =
        points.iter().filter(|p| (p.offset_m - line.offset_m(p.station_m)).abs() <= reach_m).copied().collect();
    // A step of the slope moves the ends of the window by half a core; from one
    // line's begin to the other's end it is at most the distance of both.
    let step = config.half_core_m / config.window_m;
    let steps = (config.apart_m / config.half_core_m).ceil() as i32;
    let mut best: Option<(u16, [WindowLine; 2])> = None;
    for slope in (-steps..=steps).map(|k| line.slope + f64::from(k) * step) {
        let turned = WindowLine { slope, ..*line };
        let Some((votes, middles_m)) = side_by_side(&near, &turned, reach_m, config) else { continue };
        if best.is_none_or(|(most, _)| votes > most) {
            best = Some((votes, middles_m.map(|off_m| WindowLine { middle_m: line.middle_m + off_m, ..turned })));
        }
    }
    // Turned far enough, two strips take apart what one line explains as well.
    let [single, ..] = votes_on(&near, line, config);
    let is_more = |both: u16| f64::from(both) >= (1.0 + config.least_pair_share) * f64::from(single.all);
    best.filter(|(both, _)| is_more(*both)).map(|(_, lines)| {
        // As wide as may be, but each to its own side.
        let half_m = config.half_line_m.min(0.5 * (lines[1].middle_m - lines[0].middle_m));
        lines.map(|line| refine(&near, line, half_m, config))
    })
}

/// The two strips of one direction with most paint that have a gap between
/// them: the points of both, and their distances from a line, metres.
fn side_by_side(points: &[PathPoint], line: &WindowLine, reach_m: f64, config: &LaneConfig) -> Option<(u16, [f64; 2])> {
    let start_m = line.centre_m - config.window_m / 2.0;
    let half = (config.half_core_m / CELL_M) as usize;
    let beside = (config.beside_line_m / CELL_M).round() as usize;
    let cell_of = |off_m: f64| ((off_m + reach_m) / CELL_M) as usize + half;
    let mut strips = vec![Strip::default(); cell_of(reach_m) + half + 1];
    for p in points {
        let off_m = p.offset_m - line.offset_m(p.station_m);
        if off_m.abs() <= reach_m {
            let cell = cell_of(off_m);
            for strip in &mut strips[cell - half..=cell + half] {
                strip.count(bin_of(p.station_m - start_m, config), config);
            }
        }
    }
    let is_peak = |k: &usize| {
        let all = |i: Option<usize>| i.and_then(|i| strips.get(i)).map_or(0, |s| s.votes.all);
        let here = strips[*k].votes.all;
        here > 0 && here >= all(k.checked_sub(1)) && here >= all(Some(k + 1))
    };
    let peaks: Vec<usize> = (0..strips.len()).filter(is_peak).collect();
    let mut best: Option<(u16, [f64; 2])> = None;
    for (i, &a) in peaks.iter().enumerate() {
        for &b in &peaks[i + 1..] {
            let apart_m = (b - a) as f64 * CELL_M;
            if !(config.least_pair_m..config.apart_m).contains(&apart_m) || !strips[a].is_beside(&strips[b]) {
                continue;
            }
            let lower = strips[a].votes.all.min(strips[b].votes.all);
            let between = strips[a..b].iter().map(|s| s.votes.all).min().unwrap_or(lower);
            let both = strips[a].votes.all.saturating_add(strips[b].votes.all);
            let is_gap = f64::from(between) <= config.largest_between_share * f64::from(lower);
            let beyond = |k: Option<usize>| k.and_then(|k| strips.get(k)).map_or(Votes::default(), |s| s.votes);
            let are_lines = is_line(strips[a].votes, beyond(a.checked_sub(beside)), config)
                && is_line(strips[b].votes, beyond(Some(b + beside)), config);
            if is_gap && are_lines && best.is_none_or(|(most, _)| both > most) {
                let off_m = |cell: usize| (cell as f64 - half as f64 + 0.5) * CELL_M - reach_m;
                best = Some((both, [off_m(a), off_m(b)]));
            }
        }
    }
    best
}

/// Whether a strip has so much more paint than one beyond it that it is a line.
fn is_line(on: Votes, beyond: Votes, config: &LaneConfig) -> bool {
    more_than_beside(on, [beyond; 2], config).is_some()
}
