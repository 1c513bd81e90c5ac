//! Straight lines of paint in windows along an axis.

use std::ops::Range;

use rayon::prelude::*;

use super::LaneConfig;
use super::contrast::rounded;
use super::paint::{Paint, PathPoint, between};
use super::pairs::pair;
use super::poll::Poll;

/// A straight line of paint in a window: `offset = middle + slope * (station - centre)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowLine {
    /// Station of the window's centre, metres.
    pub centre_m: f64,
    /// Offset at the centre, metres.
    pub middle_m: f64,
    /// Change of the offset along the path.
    pub slope: f64,
}

impl WindowLine {
    /// Offset at a station, metres.
    pub fn offset_m(&self, station_m: f64) -> f64 {
        self.middle_m + self.slope * (station_m - self.centre_m)
    }
}

/// Most lines in one window: four lanes with double lines and kerbs.
const MOST_LINES: usize = 12;
/// Most candidates that are looked at again in one window: hundreds lie on the
/// paint of every line, and few of them are tried.
const MOST_CANDIDATES: usize = 2000;
/// Edge of the cells of offset in which lines are sought, metres: a third of
/// the width of a line.
pub(super) const CELL_M: f64 = 0.04;

/// The lines in all windows, window by window.
pub fn find_lines(paint: &Paint, from_m: f64, to_m: f64, config: &LaneConfig) -> Vec<Vec<WindowLine>> {
    let count = ((to_m - from_m) / config.step_m).ceil().max(0.0) as usize + 1;
    (0..count)
        .into_par_iter()
        .map(|k| {
            let centre = from_m + k as f64 * config.step_m;
            let half = config.window_m / 2.0;
            lines_in_window(between(&paint.bright, centre - half, centre + half), centre, config)
        })
        .collect()
}

/// The lines in the window around a station, best first: what is explained by
/// one is no evidence for the next. Points are in the order of their stations.
fn lines_in_window(all: &[PathPoint], centre_m: f64, config: &LaneConfig) -> Vec<WindowLine> {
    let mut points = all.to_vec();
    let most = most_in_bin(all.len(), config);
    let mut thinned = thinned(all, centre_m, most, config);
    let mut lines: Vec<WindowLine> = Vec::new();
    for (candidate, _) in candidates(&thinned, centre_m, most, config).iter().take(MOST_CANDIDATES) {
        if lines.len() >= MOST_LINES {
            break;
        }
        let is_known = |line: &WindowLine| {
            let apart_m = |share: f64| {
                let station_m = centre_m + share * config.window_m;
                (line.offset_m(station_m) - candidate.offset_m(station_m)).abs()
            };
            apart_m(-0.25) < config.apart_m && apart_m(0.25) < config.apart_m
        };
        if lines.iter().any(is_known) || significance(&thinned, candidate, most, config).is_none() {
            continue;
        }
        let line = refine(&points, *candidate, config.half_line_m, config);
        let found = pair(&thinned, &line, most, config).map_or_else(|| vec![line], Vec::from);
        // What is explained, or too near to be another line, is spent.
        let is_other =
            |p: &PathPoint| found.iter().all(|line| (p.offset_m - line.offset_m(p.station_m)).abs() > config.apart_m);
        points.retain(is_other);
        thinned.retain(is_other);
        lines.extend(found);
    }
    lines
}

/// Most points of paint on a line that one bin counts for, in a window that has so
/// many of them. Where scans lie close grains alone fill the bins: no more would
/// count on a line than beside it.
fn most_in_bin(points: usize, config: &LaneConfig) -> u16 {
    let share = config.bin_m * config.half_line_m / (config.window_m * config.half_width_m);
    let usual = points as f64 * share;
    config.most_bin_points.max((config.most_bin_ratio * usual) as u16)
}

/// The points but those that no vote counts: more than a bin counts for in one
/// cell of offset. Near the path that is most of them.
fn thinned(points: &[PathPoint], centre_m: f64, most: u16, config: &LaneConfig) -> Vec<PathPoint> {
    let start_m = centre_m - config.window_m / 2.0;
    let low = points.iter().map(|p| p.offset_m).fold(f64::INFINITY, f64::min);
    let high = points.iter().map(|p| p.offset_m).fold(f64::NEG_INFINITY, f64::max);
    let mut cells = vec![Votes::default(); ((high - low).max(0.0) / CELL_M) as usize + 1];
    let mut is_counted = |p: &PathPoint| {
        let cell = &mut cells[((p.offset_m - low) / CELL_M) as usize];
        let before = cell.all;
        cell.count(bin_of(p.station_m - start_m, config), most);
        cell.all > before
    };
    points.iter().filter(|p| is_counted(p)).copied().collect()
}

/// Number of the bin at a distance from the window's start, from 1.
pub(super) fn bin_of(from_start_m: f64, config: &LaneConfig) -> u16 {
    (from_start_m / config.bin_m).max(0.0) as u16 + 1
}

/// Lines with significantly more paint on them than beside them, and how
/// significantly, most first, by voting over all slopes and offsets (Hough
/// 1962).
fn candidates(points: &[PathPoint], centre_m: f64, most: u16, config: &LaneConfig) -> Vec<(WindowLine, f64)> {
    let start_m = centre_m - config.window_m / 2.0;
    let steepest = config.largest_angle_rad.tan();
    // A step of the slope moves the ends of a window by half a line.
    let slopes = (steepest * config.window_m / config.half_line_m).ceil().max(1.0) as i32;
    let lean_m = steepest * config.window_m / 2.0;
    let low = points.iter().map(|p| p.offset_m).fold(f64::INFINITY, f64::min) - lean_m;
    let high = points.iter().map(|p| p.offset_m).fold(f64::NEG_INFINITY, f64::max) + lean_m;
    // Half a line, and how far beside it the same width is looked at.
    let half = (config.half_line_m / CELL_M).round().max(1.0) as usize;
    let beside = (config.beside_line_m / CELL_M).round() as usize;
    let margin = half + beside;
    let cells = ((high - low) / CELL_M).ceil() as usize + 2 * margin + 1;
    let mut poll = Poll::new(cells, half, most);
    let bins: Vec<Bin> = points
        .chunk_by(|a, b| bin_of(a.station_m - start_m, config) == bin_of(b.station_m - start_m, config))
        .map(|bin| Bin::new(bin, centre_m, low - margin as f64 * CELL_M, lean_m))
        .collect();
    let mut at: Vec<u32> = Vec::new();
    // Less of it is no line, whatever is beside it.
    let least = least_votes(config);
    let mut found: Vec<(WindowLine, f64)> = Vec::new();
    for step in -slopes..=slopes {
        let slope = steepest * f64::from(step) / f64::from(slopes);
        poll.clear();
        for bin in &bins {
            bin.cells(slope, &mut at);
            poll.count(bin.range.clone(), at.iter().map(|cell| *cell as usize));
        }
        let votes = poll.votes();
        for c in margin..cells - margin {
            // The middle of a line is a peak among its cells.
            if f64::from(votes[c]) < least || votes[c] < votes[c - 1] || votes[c] < votes[c + 1] {
                continue;
            }
            if let Some(score) = more_than_beside(votes[c], [votes[c - beside], votes[c + beside]], config) {
                let middle_m = low + ((c - margin) as f64 + 0.5) * CELL_M;
                found.push((WindowLine { centre_m, middle_m, slope }, score));
            }
        }
    }
    // Stable: of equals the first.
    found.sort_by(|a, b| b.1.total_cmp(&a.1));
    found
}

/// By how many standard deviations a line has more paint on it than beside it;
/// none where that is too little for a line.
fn significance(points: &[PathPoint], line: &WindowLine, most: u16, config: &LaneConfig) -> Option<f64> {
    let [on, left, right] = votes_on(points, line, most, config).map(|votes| votes.all);
    more_than_beside(on, [left, right], config)
}

/// What is counted on a line, and to the left and to the right of it, at most so much
/// of each bin.
pub(super) fn votes_on(points: &[PathPoint], line: &WindowLine, most: u16, config: &LaneConfig) -> [Votes; 3] {
    let start_m = line.centre_m - config.window_m / 2.0;
    let mut votes = [Votes::default(); 3];
    for p in points {
        let off_m = p.offset_m - line.offset_m(p.station_m);
        let bin = bin_of(p.station_m - start_m, config);
        for (vote, middle_m) in votes.iter_mut().zip([0.0, -config.beside_line_m, config.beside_line_m]) {
            if (off_m - middle_m).abs() <= config.half_line_m {
                vote.count(bin, most);
            }
        }
    }
    votes
}

/// Fewest points that a line has more than there are beside it.
fn least_votes(config: &LaneConfig) -> f64 {
    config.least_painted * config.window_m / config.bin_m * config.fewest_bin_points
}

/// The same of what was counted on a line and on both of its sides.
pub(super) fn more_than_beside(on: u16, beside: [u16; 2], config: &LaneConfig) -> Option<f64> {
    let least = least_votes(config);
    let sides = f64::midpoint(f64::from(beside[0]), f64::from(beside[1]));
    let more = f64::from(on) - sides;
    let score = more / (sides + 1.0).sqrt();
    (more >= least && score > config.least_significance).then_some(score)
}

/// Points of paint in a bin of the length of a window, in cells of offset.
struct Bin {
    /// Their offsets from the lowest one that is sought, less half a cell.
    offsets: Vec<f64>,
    /// Their stations from the centre: a slope takes away so much of them.
    stations: Vec<f64>,
    /// In which cells they may be.
    range: Range<usize>,
}

impl Bin {
    /// Of points that slopes move by no more than `lean_m`, metres.
    fn new(points: &[PathPoint], centre_m: f64, low_m: f64, lean_m: f64) -> Self {
        let offsets: Vec<f64> = points.iter().map(|p| (p.offset_m - low_m) / CELL_M - 0.5).collect();
        let stations = points.iter().map(|p| (p.station_m - centre_m) / CELL_M).collect();
        let first = offsets.iter().copied().fold(f64::INFINITY, f64::min) - lean_m / CELL_M;
        let last = offsets.iter().copied().fold(f64::NEG_INFINITY, f64::max) + lean_m / CELL_M;
        Self { offsets, stations, range: first as usize..last as usize + 2 }
    }

    /// The cells in which lines of a slope through the points pass the centre.
    fn cells(&self, slope: f64, cells: &mut Vec<u32>) {
        let places = self.offsets.iter().zip(&self.stations).map(|(offset, station)| offset - slope * station);
        cells.clear();
        cells.extend(places.map(rounded));
    }
}

/// Points on a line, at most so many of each bin: paint is all along a line,
/// and what is bright in one place only is none.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Votes {
    pub(super) all: u16,
    /// The bin of the last point, from 1: points come bin after bin.
    bin: u16,
    /// Points of it.
    here: u16,
}

impl Votes {
    pub(super) fn count(&mut self, bin: u16, most: u16) {
        if self.bin != bin {
            (self.bin, self.here) = (bin, 0);
        }
        if self.here < most {
            self.here += 1;
            self.all = self.all.saturating_add(1);
        }
    }
}

/// Least squares through the points within a half width of a line, twice.
pub(super) fn refine(points: &[PathPoint], start: WindowLine, half_m: f64, config: &LaneConfig) -> WindowLine {
    let mut line = start;
    for _ in 0..2 {
        let (mut n, mut st, mut so, mut stt, mut sto) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for p in points {
            if (p.offset_m - line.offset_m(p.station_m)).abs() <= half_m {
                let t = p.station_m - line.centre_m;
                n += 1.0;
                st += t;
                so += p.offset_m;
                stt += t * t;
                sto += t * p.offset_m;
            }
        }
        // A unit of prior on slope zero, over a length of one window, holds
        // lines that are only a dash long.
        let stt = stt + config.window_m;
        let det: f64 = n * stt - st * st;
        if n < 2.0 || det.abs() < 1e-9 {
            break;
        }
        line.slope = (n * sto - st * so) / det;
        line.middle_m = (so - line.slope * st) / n;
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A window with so many grains in each bin of a line's width, and a line that has
    /// three times as many.
    fn lines(grains: u32, config: &LaneConfig) -> Vec<WindowLine> {
        let point = |station_m: f64, offset_m: f64| PathPoint { station_m, offset_m, height_m: 0.0, contrast: 4.0 };
        let wide_m = 2.0 * config.half_width_m;
        let per_bin = grains * (wide_m / (2.0 * config.half_line_m)) as u32;
        let mut points = Vec::new();
        for bin in 0..(config.window_m / config.bin_m) as u32 {
            let station_m = f64::from(bin) * config.bin_m + 0.2;
            // Even, but at other places in each bin.
            let place = |k: u32| (f64::from(k) * 0.618_034 + f64::from(bin) * 0.377).fract();
            points.extend((0..per_bin).map(|k| point(station_m, (place(k) - 0.5) * wide_m)));
            points.extend((0..2 * grains).map(|k| point(station_m, 3.0 + 0.2 * (place(k) - 0.5))));
        }
        lines_in_window(&points, config.window_m / 2.0, config)
    }

    #[test]
    fn where_scans_lie_close_grains_do_not_hide_a_line() {
        let is_there = |lines: &[WindowLine]| lines.first().is_some_and(|line| (line.middle_m - 3.0).abs() < 0.05);
        let mut config = LaneConfig::default();
        for grains in [2, 8, 30] {
            assert!(is_there(&lines(grains, &config)), "{grains}");
        }
        config.most_bin_ratio = 0.0;
        assert!(!is_there(&lines(30, &config)), "all bins are full");
    }
}
