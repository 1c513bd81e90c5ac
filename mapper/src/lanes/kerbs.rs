//! Kerbs of roads on which nothing is painted: where the surface of the road ends in a
//! step, or in a gutter. Networks for lane lines see them there.

use std::ops::Range;

use common::map::LaneKind;
use nalgebra::Point3;
use rayon::prelude::*;

use super::profile::local_line;
use super::{LanePiece, Paint, fitted, simplify};
use crate::path::Path;

mod config;

pub use config::KerbConfig;

/// A step at the edge of the road, seen in one bin of stations.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Step {
    /// Number of the bin.
    bin: usize,
    /// Station of its middle, metres.
    station_m: f64,
    /// Offset to the right of the path, metres.
    offset_m: f64,
    /// Height of the road at its foot, map frame, metres, up.
    height_m: f64,
}

/// The kerbs along a path, none beside the lines that are painted there.
pub fn kerbs_along(path: &Path, paint: &Paint, painted: &[LanePiece], config: &KerbConfig) -> Vec<LanePiece> {
    let bins = ((path.end_station_m() - path.start_station_m()) / config.bin_m).floor().max(0.0) as usize;
    let steps: Vec<[Vec<Step>; 2]> = (0..bins)
        .into_par_iter()
        .map(|bin| {
            let middle_m = path.start_station_m() + (bin as f64 + 0.5) * config.bin_m;
            let stations_m = middle_m - 0.5 * config.window_m..middle_m + 0.5 * config.window_m;
            [-1.0, 1.0].map(|side| {
                let mut steps = steps_in(bin, stations_m.clone(), side, paint, config);
                steps.retain(|step| !is_near_paint(step, path, painted, config));
                steps
            })
        })
        .collect();
    (0..2)
        .flat_map(|side| tracks(steps.iter().map(|sides| sides[side].as_slice()), config))
        .collect::<Vec<_>>()
        .iter()
        .filter_map(|track| piece(track, path, config))
        .collect()
}

/// Whether a line is painted so near, beside it or along the road, that networks see that.
fn is_near_paint(step: &Step, path: &Path, painted: &[LanePiece], config: &KerbConfig) -> bool {
    let at = path.beside(step.station_m, step.offset_m);
    let is_beside = |p: Point3<f64>| (p.x - at.x).hypot(p.z - at.z) < config.paint_within_m;
    let is_near = |line: &LanePiece| {
        let Some((from_m, to_m)) = line.ends_m() else { return false };
        if (from_m..=to_m).contains(&step.station_m) {
            return line.at(step.station_m).is_some_and(is_beside);
        }
        let end_m = if step.station_m < from_m { from_m } else { to_m };
        (end_m - step.station_m).abs() < config.paint_along_m
    };
    painted.iter().any(is_near)
}

/// The places on one side of the path, from it outwards, where the road ends in a step.
fn steps_in(bin: usize, stations_m: Range<f64>, side: f64, paint: &Paint, config: &KerbConfig) -> Vec<Step> {
    let heights = heights(&stations_m, side, paint, config);
    let cells = |metres: f64| (metres / config.cell_m).round() as usize;
    let (inner, outer, beyond) = (cells(config.inner_m), cells(config.outer_m), cells(config.beyond_m));
    // Rise over the road as it goes on outwards from the inner side of a cell, and the road there.
    let rise = |cell: usize| {
        let road = line_through(heights.get(cell.checked_sub(inner)?..cell)?)?;
        if road.off > config.largest_roughness_m {
            return None;
        }
        // The cell itself may lie on the face of the step.
        let over: Vec<f64> = (cell + 1..=cell + outer)
            .filter_map(|k| Some(heights.get(k).copied()?? - road.at((k + inner - cell) as f64)))
            .collect();
        let seen_beyond = heights.get(cell + outer..cell + outer + beyond)?.iter().flatten().count();
        (over.len() * 2 > outer && seen_beyond * 2 >= beyond)
            .then(|| (over.iter().sum::<f64>() / over.len() as f64, road))
    };
    let rises: Vec<Option<(f64, Line)>> = (0..heights.len()).map(rise).collect();
    let rise_of = |cell: usize| rises.get(cell).and_then(Option::as_ref).map_or(0.0, |(rise_m, _)| *rise_m);
    let is_step = |cell: &usize| {
        let rise_m = rise_of(*cell);
        (config.rise_m[0]..config.rise_m[1]).contains(&rise_m)
            && cell.checked_sub(1).is_none_or(|before| rise_m > rise_of(before))
            && rise_m >= rise_of(cell + 1)
    };
    let step = |cell: usize| {
        let (_, road) = rises.get(cell)?.as_ref()?;
        Some(Step {
            bin,
            station_m: f64::midpoint(stations_m.start, stations_m.end),
            offset_m: side * (config.nearest_m + (cell as f64 + 0.5) * config.cell_m),
            height_m: road.at(inner as f64),
        })
    };
    (0..heights.len()).filter(is_step).filter_map(step).collect()
}

/// Mean heights of the road's points in cells from the path outwards, metres, up; none
/// where too few were seen.
fn heights(stations_m: &Range<f64>, side: f64, paint: &Paint, config: &KerbConfig) -> Vec<Option<f64>> {
    let count = ((config.half_width_m - config.nearest_m) / config.cell_m).max(0.0) as usize;
    let mut sums = vec![(0.0, 0_u32); count];
    let ends_m = [side * config.nearest_m, side * config.half_width_m];
    let offsets_m = [ends_m[0].min(ends_m[1]), ends_m[0].max(ends_m[1])];
    for point in paint.road.near([stations_m.start, stations_m.end], offsets_m) {
        let out_m = side * f64::from(point.offset_m) - config.nearest_m;
        if out_m < 0.0 || !stations_m.contains(&f64::from(point.station_m)) {
            continue;
        }
        if let Some(sum) = sums.get_mut((out_m / config.cell_m) as usize) {
            sum.0 += f64::from(point.height_m);
            sum.1 += 1;
        }
    }
    sums.into_iter().map(|(sum, n)| (n >= config.fewest_points).then(|| sum / f64::from(n))).collect()
}

/// A straight line through samples.
struct Line {
    start: f64,
    slope: f64,
    /// Root mean square distance of the samples from it.
    off: f64,
}

impl Line {
    fn at(&self, place: f64) -> f64 {
        self.start + self.slope * place
    }
}

/// The straight line through the heights of cells; none where half of them were not seen.
fn line_through(heights: &[Option<f64>]) -> Option<Line> {
    let seen: Vec<(f64, f64)> = heights.iter().enumerate().filter_map(|(k, h)| Some((k as f64, (*h)?))).collect();
    (seen.len() * 2 >= heights.len()).then(|| fit(&seen)).flatten()
}

/// The straight line through three samples or more, by least squares.
fn fit(samples: &[(f64, f64)]) -> Option<Line> {
    if samples.len() < 3 {
        return None;
    }
    let n = samples.len() as f64;
    let (mx, my) = samples.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0 / n, s.1 + p.1 / n));
    let (xx, xy) =
        samples.iter().fold((0.0, 0.0), |s, p| (s.0 + (p.0 - mx) * (p.0 - mx), s.1 + (p.0 - mx) * (p.1 - my)));
    let slope = xy / xx;
    let squares = samples.iter().map(|p| (p.1 - my - slope * (p.0 - mx)).powi(2)).sum::<f64>();
    Some(Line { start: my - slope * mx, slope, off: (squares / n).sqrt() })
}

/// Steps that follow on each other along one side of the path; where two such tracks
/// run side by side, the one that is nearer to the path.
fn tracks<'a>(bins: impl Iterator<Item = &'a [Step]>, config: &KerbConfig) -> Vec<Vec<Step>> {
    let mut open: Vec<Vec<Step>> = Vec::new();
    let mut done: Vec<Vec<Step>> = Vec::new();
    for (here, steps) in bins.enumerate() {
        // What has ended is not taken up again.
        let is_over = |track: &mut Vec<Step>| {
            track.last().is_none_or(|last| (here - last.bin) as f64 * config.bin_m > config.longest_gap_m)
        };
        done.extend(open.extract_if(.., is_over));
        for step in steps {
            let off_m = |track: &&mut Vec<Step>| {
                let last = track.last()?;
                let bins = step.bin - last.bin;
                let off_m = (expected_m(track, step.station_m)? - step.offset_m).abs();
                (bins > 0 && off_m < config.aside_m * (bins as f64).sqrt()).then_some(off_m)
            };
            let nearest =
                open.iter_mut().filter_map(|track| Some((off_m(&track)?, track))).min_by(|a, b| a.0.total_cmp(&b.0));
            match nearest {
                Some((_, track)) => track.push(*step),
                None => open.push(vec![*step]),
            }
        }
    }
    done.extend(open);
    done.retain(|track| is_kerb(track, config));
    // From the path outwards: what is behind a kerb is not the road's.
    let mean_m = |track: &[Step]| track.iter().map(|step| step.offset_m.abs()).sum::<f64>() / track.len() as f64;
    done.sort_by(|a, b| mean_m(a).total_cmp(&mean_m(b)));
    let mut kept: Vec<Vec<Step>> = Vec::new();
    for mut track in done {
        track.retain(|step| {
            kept.iter().all(|inner| {
                let ends = inner.first().zip(inner.last());
                ends.is_none_or(|(first, last)| !(first.bin..=last.bin).contains(&step.bin))
            })
        });
        // What is left of it may be two parts.
        let parts = track.chunk_by(|a, b| (b.bin - a.bin) as f64 * config.bin_m <= config.longest_gap_m);
        let parts: Vec<Vec<Step>> = parts.filter(|part| is_kerb(part, config)).map(<[Step]>::to_vec).collect();
        kept.extend(parts);
    }
    kept
}

/// Where a track is expected at a station: offset, metres.
fn expected_m(track: &[Step], station_m: f64) -> Option<f64> {
    let near = &track[track.len().saturating_sub(TREND)..];
    let last = near.last()?;
    let samples: Vec<(f64, f64)> = near.iter().map(|step| (step.station_m - last.station_m, step.offset_m)).collect();
    // Two steps are as far apart as they are noisy.
    let way_m = station_m - last.station_m;
    Some(fit(&samples).map_or(last.offset_m, |line| line.at(way_m)))
}

/// So many of its last steps tell how a track goes on.
const TREND: usize = 6;

/// Whether a track is long and hardly interrupted.
fn is_kerb(track: &[Step], config: &KerbConfig) -> bool {
    let Some((first, last)) = track.first().zip(track.last()) else { return false };
    let bins = last.bin - first.bin + 1;
    bins as f64 * config.bin_m >= config.shortest_m && track.len() as f64 >= config.least_share * bins as f64
}

/// A track as a line of the map, on the road.
fn piece(track: &[Step], path: &Path, config: &KerbConfig) -> Option<LanePiece> {
    let offsets: Vec<(f64, f64)> = track.iter().map(|step| (step.station_m, step.offset_m)).collect();
    let heights: Vec<(f64, f64)> = track.iter().map(|step| (step.station_m, step.height_m)).collect();
    let smooth = |samples: &[(f64, f64)], at_m: f64| local_line(samples, at_m, config.smooth_m, 3);
    let places: Vec<(f64, Point3<f64>)> = track
        .iter()
        .filter_map(|step| {
            let at = path.beside(step.station_m, smooth(&offsets, step.station_m)?);
            Some((step.station_m, Point3::new(at.x, -smooth(&heights, step.station_m)?, at.z)))
        })
        .collect();
    let off_m2 = |(station_m, offset_m): &(f64, f64)| Some((smooth(&offsets, *station_m)? - offset_m).powi(2));
    let squares: Vec<f64> = offsets.iter().filter_map(off_m2).collect();
    let spread_m = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
    if spread_m > config.largest_spread_m {
        return None;
    }
    let points: Vec<Point3<f64>> = places.iter().map(|(_, p)| *p).collect();
    let kept = simplify(&points, config.tolerance_m);
    let bins = track.last()?.bin - track.first()?.bin + 1;
    (kept.len() >= 2).then(|| LanePiece {
        kind: LaneKind::Kerb,
        points_map: fitted(&places, &kept),
        stations_m: kept.iter().map(|i| places[*i].0).collect(),
        spread_m,
        marks_m: Vec::new(),
        contrast: 0.0,
        painted_share: track.len() as f64 / bins as f64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Config;
    use crate::build::find_lanes;
    use crate::testing::{CAMERA_HEIGHT_M, Street};

    fn found(street: Street) -> Vec<LanePiece> {
        find_lanes(&street.cloud(), &Config::default())
    }

    /// A crowned road with a step of so many metres at x = 4.
    fn kerb(step_m: f64) -> Street {
        Street::shaped(0.1, |x| if x > 4.05 { step_m - 0.12 } else { -0.03 * x.abs() })
    }

    #[test]
    fn a_step_up_at_the_edge_of_a_bare_road_is_a_kerb_and_paint_makes_it_none() {
        for step_m in [0.05, 0.12] {
            let kerbs = found(kerb(step_m));
            assert_eq!(kerbs.iter().map(|k| k.kind).collect::<Vec<_>>(), [LaneKind::Kerb], "{step_m}");
            assert!(kerbs[0].length_m() > 50.0, "{:?}", kerbs[0].stations_m);
            for p in &kerbs[0].points_map {
                // At its foot, on the road.
                assert!((p.x - 4.05).abs() < 0.15 && (p.y - CAMERA_HEIGHT_M - 0.12).abs() < 0.02, "{p}");
            }
        }
        let mut painted = kerb(0.12);
        for k in 0..1500 {
            let at = Point3::new(1.75 + 0.002 * f64::from(k % 40), CAMERA_HEIGHT_M, 0.04 * f64::from(k));
            painted.add(at, (k / 150) as u16, 0.5, Some(8.0));
        }
        assert!(found(painted).iter().all(|line| line.kind == LaneKind::Solid));
    }

    #[test]
    fn a_gutter_is_a_kerb_and_a_drop_or_a_foot_of_a_wall_is_none() {
        let gutter = |x: f64| if x > 4.0 { 0.04 * (x - 4.0).min(1.0) - 0.08 } else { -0.03 * x.abs() };
        assert_eq!(found(Street::shaped(0.1, gutter)).len(), 1);
        let drop = |x: f64| if x > 4.05 { -0.25 + 0.06 * (x - 4.0) } else { -0.03 * x.abs() };
        assert!(found(Street::shaped(0.1, drop)).is_empty());
        let mut walled = Street::new();
        walled.add_wall(4.0, 0.0..60.0, 1.5);
        assert!(found(walled).is_empty());
    }
}
