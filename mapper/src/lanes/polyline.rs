//! From a chain to the polyline that goes into the map.

use common::map::LaneKind;
use nalgebra::{Point2, Point3};

use super::windows::between;
use super::{Chain, LaneConfig, Paint, PathPoint};
use crate::cloud::Cloud;

/// A lane line, or a piece of one.
#[derive(Debug, Clone, PartialEq)]
pub struct LanePiece {
    /// How it is painted.
    pub kind: LaneKind,
    /// Vertices, map frame, metres.
    pub points_map: Vec<Point3<f64>>,
    /// Stations of the vertices, metres.
    pub stations_m: Vec<f64>,
    /// Root mean square lateral distance of the paint from the line, metres.
    pub spread_m: f64,
}

struct Bin {
    station_m: f64,
    offset_m: Option<f64>,
    /// Mean contrast of its paint, standard deviations.
    contrast: f64,
    seen: bool,
}

/// Smooths, cuts at long gaps and describes a chain as polylines.
pub fn describe(chain: &Chain, paint: &Paint, cloud: &Cloud, config: &LaneConfig) -> Vec<LanePiece> {
    let (Some(first), Some(last)) = (chain.lines.first(), chain.lines.last()) else {
        return Vec::new();
    };
    let half = config.window_m / 2.0;
    let (from, to) = (first.centre_m - half, last.centre_m + half);
    let count = ((to - from) / config.bin_m).ceil() as usize;
    let bins: Vec<Bin> = (0..count)
        .map(|i| {
            let start = from + i as f64 * config.bin_m;
            let on = |points: &[PathPoint]| {
                let mut sum = (0.0, 0.0, 0.0);
                for p in between(points, start, start + config.bin_m) {
                    let off = p.offset_m - chain.offset_m(p.station_m);
                    if off.abs() <= config.half_line_m {
                        sum = (sum.0 + 1.0, sum.1 + off, sum.2 + f64::from(p.contrast));
                    }
                }
                sum
            };
            let (bright, road) = (on(&paint.bright), on(&paint.road));
            let station_m = start + config.bin_m / 2.0;
            Bin {
                station_m,
                // One point may be a stray; two in half a metre are paint.
                offset_m: (bright.0 >= 2.0).then(|| chain.offset_m(station_m) + bright.1 / bright.0),
                contrast: bright.2 / f64::max(bright.0, 1.0),
                seen: road.0 >= 3.0,
            }
        })
        .collect();
    let painted: Vec<usize> = (0..bins.len()).filter(|i| bins[*i].offset_m.is_some()).collect();
    painted
        .chunk_by(|a, b| (b - a) as f64 * config.bin_m <= config.longest_gap_m)
        .filter(|run| (run.len() as f64) * config.bin_m >= config.shortest_m * config.least_painted)
        .filter_map(|run| piece(&bins[run[0]..=run[run.len() - 1]], cloud, config))
        .collect()
}

fn piece(bins: &[Bin], cloud: &Cloud, config: &LaneConfig) -> Option<LanePiece> {
    let (first, last) = (bins.first()?, bins.last()?);
    if last.station_m - first.station_m < config.shortest_m {
        return None;
    }
    let painted = bins.iter().filter(|b| b.offset_m.is_some()).count() as f64;
    let seen = bins.iter().filter(|b| b.seen || b.offset_m.is_some()).count() as f64;
    let share = painted / seen.max(1.0);
    if share < config.least_painted {
        return None;
    }
    let contrast = mean_contrast(bins);
    if contrast < config.least_walled_contrast && walled_share(bins, cloud, config) > config.largest_walled_share {
        return None;
    }
    let solid = share >= config.solid_share;
    // A bin between two painted ones may have been missed by the beams: a gap
    // is at least a metre, and a dash is longer than a blot.
    let dashes = (0..bins.len())
        .filter(|i| bins[*i].offset_m.is_some())
        .collect::<Vec<_>>()
        .chunk_by(|a, b| (b - a) as f64 * config.bin_m <= 1.0)
        .filter(|dash| dash.len() as f64 * config.bin_m >= config.shortest_dash_m)
        .count();
    if !solid && dashes < config.fewest_dashes {
        return None;
    }
    let mut residuals = (0.0, 0.0);
    let places: Vec<PathPoint> = bins
        .iter()
        .filter_map(|b| {
            let offset_m = smoothed(bins, b.station_m, config)?;
            if let Some(own) = b.offset_m {
                residuals = (residuals.0 + 1.0, residuals.1 + (own - offset_m).powi(2));
            }
            Some(PathPoint { station_m: b.station_m, offset_m, contrast: 0.0 })
        })
        .collect();
    let spread_m = (residuals.1 / f64::max(residuals.0, 1.0)).sqrt();
    if spread_m > config.largest_spread_m {
        return None;
    }
    let points = on_ground(&places, cloud, config);
    // Heights count less than sideways errors: scaled, one tolerance serves both.
    let scale = config.tolerance_m / config.height_tolerance_m;
    let scaled: Vec<Point3<f64>> = points.iter().map(|(_, p)| Point3::new(p.x, p.y * scale, p.z)).collect();
    let kept = simplify(&scaled, config.tolerance_m);
    if kept.len() < 2 {
        return None;
    }
    Some(LanePiece {
        kind: if solid { LaneKind::Solid } else { LaneKind::Dashed },
        points_map: kept.iter().map(|i| points[*i].1).collect(),
        stations_m: kept.iter().map(|i| points[*i].0).collect(),
        spread_m,
    })
}

/// Mean contrast of the painted bins.
fn mean_contrast(bins: &[Bin]) -> f64 {
    let of: Vec<f64> = bins.iter().filter(|b| b.offset_m.is_some()).map(|b| b.contrast).collect();
    of.iter().sum::<f64>() / of.len().max(1) as f64
}

/// Share of the painted bins with something standing right beside the line: a
/// strip of grass before a wall or a fence is as bright between two darker
/// things as paint is.
fn walled_share(bins: &[Bin], cloud: &Cloud, config: &LaneConfig) -> f64 {
    let painted: Vec<(f64, f64)> = bins.iter().filter_map(|b| Some((b.station_m, b.offset_m?))).collect();
    let is_walled = |(station_m, offset_m): &&(f64, f64)| {
        let at = cloud.path.beside(*station_m, *offset_m);
        let stands = |p: &&crate::cloud::CloudPoint| {
            let height_m = f64::from(p.height_m);
            height_m > config.wall_m[0]
                && height_m < config.wall_m[1]
                && (p.position.x - at.x).hypot(p.position.z - at.z) < config.wall_within_m
        };
        let scans =
            cloud.near(&Point2::new(at.x, at.z)).filter(stands).fold(0_u64, |scans, p| scans | 1 << (p.scan % 64));
        scans.count_ones() >= config.fewest_wall_scans
    };
    painted.iter().filter(is_walled).count() as f64 / painted.len().max(1) as f64
}

/// Places beside the path put on the ground, its height smoothed along the
/// line like its course; where no ground was seen the line has no height.
fn on_ground(places: &[PathPoint], cloud: &Cloud, config: &LaneConfig) -> Vec<(f64, Point3<f64>)> {
    let at: Vec<(f64, Point3<f64>)> =
        places.iter().map(|p| (p.station_m, cloud.path.beside(p.station_m, p.offset_m))).collect();
    let seen: Vec<(f64, f64)> = at
        .iter()
        .filter_map(|(s, p)| {
            let here = Point2::new(p.x, p.z);
            let height = cloud.ground.height_m(&here)?;
            cloud.ground.is_seen(&here).then_some((*s, height))
        })
        .collect();
    at.into_iter()
        .filter_map(|(s, p)| {
            let height = local_line(&seen, s, 2.0 * config.smooth_m, 5)?;
            Some((s, Point3::new(p.x, -height, p.z)))
        })
        .collect()
}

/// Value at `at` of the straight line through the samples `(place, value)`
/// within `half` of it; none where fewer than `fewest` are near.
fn local_line(samples: &[(f64, f64)], at: f64, half: f64, fewest: usize) -> Option<f64> {
    let near: Vec<(f64, f64)> = samples.iter().map(|(t, v)| (t - at, *v)).filter(|(t, _)| t.abs() <= half).collect();
    if near.len() < fewest {
        return None;
    }
    let n = near.len() as f64;
    let (mt, mv) = near.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0 / n, s.1 + p.1 / n));
    let (tt, tv) = near.iter().fold((0.0, 0.0), |s, p| (s.0 + (p.0 - mt).powi(2), s.1 + (p.0 - mt) * (p.1 - mv)));
    // One squared window of prior on a level line.
    Some(mv - tv / (tt + half * half) * mt)
}

/// Local straight line through the painted bins around a station; the window
/// widens over gaps.
fn smoothed(bins: &[Bin], station_m: f64, config: &LaneConfig) -> Option<f64> {
    let painted: Vec<(f64, f64)> = bins.iter().filter_map(|b| Some((b.station_m, b.offset_m?))).collect();
    // As much paint as a solid line has within the window; the window widens
    // over gaps until it is found.
    let fewest = (config.smooth_m * 1.5 / config.bin_m) as usize;
    [1.0, 2.0, 4.0, 8.0].iter().find_map(|wider| local_line(&painted, station_m, config.smooth_m * wider, fewest))
}

/// Douglas and Peucker (1973): indices of the vertices that describe a
/// polyline within a tolerance, metres.
pub fn simplify(points: &[Point3<f64>], tolerance_m: f64) -> Vec<usize> {
    if points.len() < 3 {
        return (0..points.len()).collect();
    }
    let mut keep = vec![false; points.len()];
    keep[0] = true;
    keep[points.len() - 1] = true;
    let mut open = vec![(0, points.len() - 1)];
    while let Some((a, b)) = open.pop() {
        let along = points[b] - points[a];
        let far = (a + 1..b)
            .map(|i| {
                let d = points[i] - points[a];
                let share = (d.dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
                (i, (d - along * share).norm())
            })
            .max_by(|p, q| p.1.total_cmp(&q.1));
        if let Some((i, distance)) = far
            && distance > tolerance_m
        {
            keep[i] = true;
            open.push((a, i));
            open.push((i, b));
        }
    }
    (0..points.len()).filter(|i| keep[*i]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_needs_two_vertices_and_a_bend_stays_within_tolerance() {
        let straight: Vec<_> = (0..50).map(|i| Point3::new(1.0, 1.6, f64::from(i))).collect();
        assert_eq!(simplify(&straight, 0.03), vec![0, 49]);
        let bend: Vec<_> = (0..100)
            .map(|i| {
                let a = f64::from(i) * 0.01;
                Point3::new(40.0 * (1.0 - a.cos()), 1.6, 40.0 * a.sin())
            })
            .collect();
        let kept = simplify(&bend, 0.03);
        assert!(kept.len() < 20);
        for w in kept.windows(2) {
            let (a, b) = (bend[w[0]], bend[w[1]]);
            for p in &bend[w[0]..w[1]] {
                let d = p - a;
                let u = (b - a).normalize();
                assert!((d - u * d.dot(&u)).norm() <= 0.03 + 1e-9);
            }
        }
    }
}
