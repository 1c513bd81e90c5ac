//! From a chain to the polylines that go into the map.

use common::map::LaneKind;
use nalgebra::{Point2, Point3};
use rayon::prelude::*;

use super::chains::join;
use super::decision::clear_share;
use super::fords::barred_share;
use super::kinds::{Stretch, stretches};
use super::marks::marks;
use super::piece::without_doubles;
use super::profile::{Bin, Share, local_line, profile, runs, step_m};
use super::symbols::without_symbols;
use super::windows::find_lines;
use super::{Chain, LaneConfig, LanePiece, Paint, fitted, simplify};
use crate::cloud::{Cloud, CloudPoint};
use crate::path::Path;

/// The lane lines along a path, whose stations are those of the paint.
pub fn lines_along(path: &Path, paint: &Paint, cloud: &Cloud, config: &LaneConfig) -> Vec<LanePiece> {
    let windows = find_lines(paint, path.start_station_m(), path.end_station_m(), config);
    let chains = join(&windows, config);
    let pieces = chains.par_iter().map(|chain| describe(chain, paint, path, cloud, config)).collect();
    without_symbols(without_doubles(pieces, config), config)
}

/// Finds what is painted along a chain, cuts it where that changes and at
/// long gaps, and describes it as polylines.
fn describe(chain: &Chain, paint: &Paint, path: &Path, cloud: &Cloud, config: &LaneConfig) -> Vec<LanePiece> {
    let (bins, shares) = profile(chain, paint, config);
    let stretches = stretches(&bins, config);
    let painted_m: f64 = stretches.iter().map(|(_, range)| range.len() as f64 * config.profile_m).sum();
    let least = config.least_bright_share.max(config.least_share_ratio * shares.bare);
    let is_dashed = stretches.iter().all(|(kind, _)| *kind == LaneKind::Dashed);
    let shortest_m = if is_dashed { config.shortest_dashed_m.max(config.shortest_m) } else { config.shortest_m };
    let length_m = painted_m + if is_dashed { usual_gap_m(&bins, &stretches, config) } else { 0.0 };
    let clear_share = clear_share(stretches.iter().flat_map(|(_, range)| &bins[range.clone()]));
    if shares.painted < least || length_m < shortest_m || clear_share < config.least_clear_share {
        return Vec::new();
    }
    let described = |(kind, range): (LaneKind, std::ops::Range<usize>)| {
        let marks_m = marks(kind, &bins[range.clone()], shares, paint, config);
        Some(LanePiece { marks_m, ..piece(kind, &bins[range], path, paint, cloud, config)? })
    };
    stretches.into_iter().filter_map(described).collect()
}

/// Median gap between the dashes of a line, metres: with it, a line from its
/// first to its last dash is as long as its periods are, and so hardly longer or
/// shorter where it happens to begin or end.
fn usual_gap_m(bins: &[Bin], stretches: &[Stretch], config: &LaneConfig) -> f64 {
    let of_stretch = |(_, range): &Stretch| {
        let runs = runs(&bins[range.clone()], config);
        runs.windows(2).map(|pair| pair[1].start - pair[0].end).collect::<Vec<usize>>()
    };
    let mut gaps: Vec<usize> = stretches.iter().flat_map(of_stretch).collect();
    gaps.sort_unstable();
    gaps.get(gaps.len() / 2).map_or(0.0, |gap| *gap as f64 * config.profile_m)
}

fn piece(
    kind: LaneKind,
    bins: &[Bin],
    path: &Path,
    paint: &Paint,
    cloud: &Cloud,
    config: &LaneConfig,
) -> Option<LanePiece> {
    let painted: Vec<&Bin> = bins.iter().filter(|b| b.painted && b.bright > 0.0).collect();
    let mean = |of: &dyn Fn(&Bin) -> f64| painted.iter().map(|b| of(b)).sum::<f64>() / painted.len().max(1) as f64;
    let spread_m = mean(&|b| b.off_m * b.off_m).sqrt();
    if spread_m > config.largest_spread_m {
        return None;
    }
    if barred_share(bins, config) > config.fords.largest_barred_share {
        return None;
    }
    let contrast = mean(&|b| b.contrast);
    let striped = [0, 1].map(|side| striped_share(&painted, side, config));
    let (most, least) = (striped[0].max(striped[1]), striped[0].min(striped[1]));
    if (if kind == LaneKind::Dashed { most } else { least }) > config.largest_striped_share {
        return None;
    }
    let is_kerb = || step_m(&painted, paint, config).is_some_and(|step_m| step_m > config.least_kerb_m);
    let (is_pale, is_ragged) = (contrast < config.least_walled_contrast, least > config.ragged_share);
    if is_pale && is_kerb() {
        return None;
    }
    let largest_walled_share = match (is_ragged, is_pale) {
        (true, _) => config.ragged_walled_share,
        (false, true) => config.largest_walled_share,
        (false, false) => 1.0,
    };
    if largest_walled_share < 1.0 && walled_share(&painted, path, cloud, config) > largest_walled_share {
        return None;
    }
    let points = on_ground(bins, path, cloud, config);
    // Heights count less than sideways errors: scaled, one tolerance serves both.
    let scale = config.tolerance_m / config.height_tolerance_m;
    let scaled: Vec<Point3<f64>> = points.iter().map(|(_, p)| Point3::new(p.x, p.y * scale, p.z)).collect();
    let kept = simplify(&scaled, config.tolerance_m);
    if kept.len() < 2 {
        return None;
    }
    // Between vertices on a bend the chords lie to its inner side: the
    // vertices are moved so that the line runs amid its places.
    let points_map = fitted(&points, &kept);
    let stations_m = kept.iter().map(|i| points[*i].0).collect();
    let painted_share = painted.len() as f64 / bins.len() as f64;
    Some(LanePiece { kind, points_map, stations_m, spread_m, contrast, painted_share, marks_m: Vec::new() })
}

/// Share of the painted bins with paint right beside the line, on its left (0)
/// or right (1) side.
fn striped_share(painted: &[&Bin], side: usize, config: &LaneConfig) -> f64 {
    // A stray is no stripe, and where scans lie close there are several.
    let is_striped = |share: &Share| share.bright >= 2.0 && share.value() >= config.least_striped_share;
    let striped = painted.iter().filter(|b| is_striped(&b.beside[side])).count();
    striped as f64 / painted.len().max(1) as f64
}

/// Share of the painted bins with something standing right beside the line: a
/// strip of grass before a wall or a fence is as bright between two darker
/// things as paint is.
fn walled_share(painted: &[&Bin], path: &Path, cloud: &Cloud, config: &LaneConfig) -> f64 {
    let is_walled = |bin: &&&Bin| {
        let at = path.beside(bin.station_m, bin.offset_m);
        let stands = |p: &&CloudPoint| {
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
/// Each with its station.
fn on_ground(bins: &[Bin], path: &Path, cloud: &Cloud, config: &LaneConfig) -> Vec<(f64, Point3<f64>)> {
    // Every second bin, and the last: the line is smooth over several.
    let kept = bins.iter().enumerate().filter(|(i, _)| i % 2 == 0 || i + 1 == bins.len()).map(|(_, b)| b);
    let at: Vec<(f64, Point3<f64>)> = kept.map(|b| (b.station_m, path.beside(b.station_m, b.offset_m))).collect();
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stripes_are_paint_and_a_few_grains_among_many_points_are_none() {
        let config = LaneConfig::default();
        let share = |bright: f64, road: f64| {
            let beside = [Share { bright, road }, Share { bright: 1.0, road: 4.0 }];
            let bins = [Bin { beside, ..Bin::default() }];
            striped_share(&bins.iter().collect::<Vec<_>>(), 0, &config)
        };
        assert!(share(4.0, 12.0) > 0.9 && share(40.0, 120.0) > 0.9);
        assert!(share(1.0, 3.0) < 0.1 && share(3.0, 100.0) < 0.1);
    }
}
