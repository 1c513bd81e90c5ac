//! Straight lines of paint in windows along the path.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::LaneConfig;
use crate::cloud::Cloud;

/// A ground point by its place beside the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Station along the path, metres.
    pub station_m: f64,
    /// Offset to the right of the path, metres.
    pub offset_m: f64,
    /// How much brighter than its beam on both sides, standard deviations.
    pub contrast: f32,
}

/// The road's points beside the path, each list sorted by station.
pub struct Paint {
    /// Points of paint.
    pub bright: Vec<PathPoint>,
    /// All road points in range, for where paint could have been seen.
    pub road: Vec<PathPoint>,
}

impl Paint {
    /// The paint in a stitched cloud.
    pub fn of(cloud: &Cloud, config: &LaneConfig) -> Self {
        let range = config.contrast.farthest_m as f32;
        let on_road = |p: &&crate::cloud::CloudPoint| {
            f64::from(p.height_m.abs()) < config.thickness_m && p.range_m < range && p.contrast.is_some()
        };
        let placed: Vec<PathPoint> = cloud
            .points
            .par_iter()
            .filter(on_road)
            .filter_map(|p| {
                let place = cloud.place(&p.position);
                let contrast = p.contrast.unwrap_or(0.0);
                (place.offset_m.abs() < config.half_width_m).then_some(PathPoint {
                    station_m: place.station_m,
                    offset_m: place.offset_m,
                    contrast,
                })
            })
            .collect();
        let sorted = |mut v: Vec<PathPoint>| {
            v.sort_by(|a, b| a.station_m.total_cmp(&b.station_m));
            v
        };
        Self {
            bright: sorted(placed.iter().filter(|p| p.contrast >= config.least_contrast).copied().collect()),
            road: sorted(placed),
        }
    }
}

/// Points with stations in a range, of a list sorted by station.
pub(super) fn between(points: &[PathPoint], from_m: f64, to_m: f64) -> &[PathPoint] {
    let a = points.partition_point(|p| p.station_m < from_m);
    let b = points.partition_point(|p| p.station_m < to_m);
    &points[a..b.max(a)]
}

/// A straight line of paint in a window: `offset = middle + slope * (station - centre)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowLine {
    /// Station of the window's centre, metres.
    pub centre_m: f64,
    /// Offset at the centre, metres.
    pub middle_m: f64,
    /// Change of the offset along the path.
    pub slope: f64,
    /// Bins of the window with paint.
    pub painted: usize,
}

impl WindowLine {
    /// Offset at a station, metres.
    pub fn offset_m(&self, station_m: f64) -> f64 {
        self.middle_m + self.slope * (station_m - self.centre_m)
    }
}

/// Trials for each line: with a tenth of the points on it, two of 400 pairs
/// lie on it.
const TRIALS: usize = 400;
/// Most lines in one window: four lanes with double lines and kerbs.
const MOST_LINES: usize = 12;

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

/// How well a line explains points: painted bins, and paint on and beside it.
struct Support {
    bins: usize,
    on: usize,
    beside: usize,
}

fn support(points: &[PathPoint], line: &WindowLine, config: &LaneConfig) -> Support {
    let mut bits = [0_u64; 4];
    let (mut on, mut beside) = (0, 0);
    let start = line.centre_m - config.window_m / 2.0;
    for p in points {
        let off = (p.offset_m - line.offset_m(p.station_m)).abs();
        if off <= config.half_line_m {
            on += 1;
            let bin = ((p.station_m - start) / config.bin_m).clamp(0.0, 255.0) as usize;
            bits[bin / 64] |= 1 << (bin % 64);
        } else if off <= 3.0 * config.half_line_m {
            beside += 1;
        }
    }
    Support { bins: bits.iter().map(|b| b.count_ones() as usize).sum(), on, beside }
}

fn lines_in_window(all: &[PathPoint], centre_m: f64, config: &LaneConfig) -> Vec<WindowLine> {
    let mut points = all.to_vec();
    let mut lines = Vec::new();
    let mut rng = Pcg64Mcg::seed_from_u64(points.len() as u64);
    let least = config.least_painted * config.window_m / config.bin_m;
    let steepest = config.largest_angle_rad.tan();
    for _ in 0..MOST_LINES {
        if (points.len() as f64) < least {
            break;
        }
        let mut best: Option<WindowLine> = None;
        for _ in 0..TRIALS {
            let a = points[rng.random_range(0..points.len())];
            let b = points[rng.random_range(0..points.len())];
            let run = b.station_m - a.station_m;
            let slope = if run.abs() > 2.0 { (b.offset_m - a.offset_m) / run } else { 0.0 };
            if slope.abs() > steepest {
                continue;
            }
            let middle_m = a.offset_m + slope * (centre_m - a.station_m);
            let mut line = WindowLine { centre_m, middle_m, slope, painted: 0 };
            line.painted = support(&points, &line, config).bins;
            if best.is_none_or(|l| line.painted > l.painted) {
                best = Some(line);
            }
        }
        let Some(line) = best else { break };
        if (line.painted as f64) < least {
            break;
        }
        let line = refine(&points, line, config);
        let found = support(all, &line, config);
        if (found.beside as f64) < config.largest_clutter * found.on as f64 {
            lines.push(line);
        }
        // What is explained, or too near to be another line, is spent.
        points.retain(|p| (p.offset_m - line.offset_m(p.station_m)).abs() > config.apart_m);
    }
    lines
}

/// Least squares through the points on a line, twice.
fn refine(points: &[PathPoint], start: WindowLine, config: &LaneConfig) -> WindowLine {
    let mut line = start;
    for _ in 0..2 {
        let (mut n, mut st, mut so, mut stt, mut sto) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for p in points {
            if (p.offset_m - line.offset_m(p.station_m)).abs() <= config.half_line_m {
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
    line.painted = support(points, &line, config).bins;
    line
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::{describe, join};
    use crate::testing::{CAMERA_HEIGHT_M, Street};
    use common::map::LaneKind;
    use nalgebra::Point3;

    fn paint_line(street: &mut Street, x: f64, dash_m: f64, period_m: f64) {
        for i in 0..1500 {
            let z = f64::from(i) * 0.04;
            if z % period_m < dash_m {
                let wobble = 0.04 * (f64::from(i) * 1.7).sin();
                street.add(Point3::new(x + wobble, CAMERA_HEIGHT_M, z), (i / 150) as u16, 0.5, Some(8.0));
            }
        }
    }

    #[test]
    fn solid_and_dashed_lines_are_told_apart_and_an_arrow_is_neither() {
        let mut street = Street::new();
        paint_line(&mut street, 1.75, 60.0, 60.0);
        paint_line(&mut street, -1.75, 4.0, 12.0);
        for i in 0..200 {
            // An arrow 5 m long in the middle of the lane.
            let (along, side) = (f64::from(i) * 0.025, f64::from(i % 7) * 0.05 - 0.15);
            street.add(Point3::new(side, CAMERA_HEIGHT_M, 20.0 + along), 3, 0.5, Some(8.0));
        }
        let cloud = street.cloud();
        let config = LaneConfig::default();
        let paint = Paint::of(&cloud, &config);
        let windows = find_lines(&paint, cloud.path.start_station_m(), cloud.path.end_station_m(), &config);
        let mut pieces: Vec<_> =
            join(&windows, &config).iter().flat_map(|c| describe(c, &paint, &cloud, &config)).collect();
        pieces.sort_by(|a, b| a.points_map[0].x.total_cmp(&b.points_map[0].x));
        let kinds: Vec<LaneKind> = pieces.iter().map(|p| p.kind).collect();
        assert_eq!(kinds, [LaneKind::Dashed, LaneKind::Solid]);
        for (piece, x) in pieces.iter().zip([-1.75, 1.75]) {
            assert!(piece.points_map.len() <= 4, "a straight line needs no more vertices");
            assert!(piece.points_map.iter().all(|p| (p.x - x).abs() < 0.03 && (p.y - CAMERA_HEIGHT_M).abs() < 0.03));
            let length = piece.stations_m[piece.stations_m.len() - 1] - piece.stations_m[0];
            assert!(length > 50.0, "{length}");
        }
    }

    #[test]
    fn a_bright_strip_before_a_wall_is_no_line_and_paint_before_it_is() {
        for (contrast, lines) in [(4.5, 0), (8.0, 1)] {
            let mut street = Street::new();
            for i in 0..1500 {
                let (z, wobble) = (f64::from(i) * 0.04, 0.04 * (f64::from(i) * 1.7).sin());
                let at = Point3::new(5.0 + wobble, CAMERA_HEIGHT_M, z);
                street.add(at, (i % 10) as u16, 0.4, Some(contrast));
            }
            street.add_wall(5.3, 0.0..60.0, 1.5);
            let cloud = street.cloud();
            let found = crate::build::find_lanes(&cloud, &crate::Config::default());
            assert_eq!(found.len(), lines, "{contrast}");
        }
    }
}
