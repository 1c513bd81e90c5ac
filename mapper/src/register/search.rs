//! A first guess for a scan of another pass, from which survey drift of
//! metres has to be taken: tried out over a grid of shifts.

use common::geometry::Pose;
use nalgebra::{Point3, Translation3, Vector3};
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};

use super::align::ScanSurface;
use super::local_map::LocalMap;
use crate::quantile::upper_median;

/// How a shift between two passes is searched.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SearchConfig {
    /// Farthest horizontal shift tried, metres along map x and z: what surveys
    /// drift between two passes, where satellites are hidden.
    pub reach_m: f64,
    /// Step of the shifts, metres: half of what a surface's voxel still finds.
    pub step_m: f64,
    /// Distance from a surface at which a shift gets nothing for it any more,
    /// metres.
    pub tolerance_m: f64,
    /// Range of the ground that tells the height between both passes, metres:
    /// farther off, beams lie too flat on it.
    pub ground_range_m: f64,
    /// Shifts farther than this off the best one are other solutions, metres.
    pub apart_m: f64,
    /// Largest score of another solution, as a share of the best: rows of like
    /// posts fit again one post further.
    pub largest_rival: f64,
}

impl Default for SearchConfig {
    fn default() -> Self {
        Self { reach_m: 2.5, step_m: 0.5, tolerance_m: 0.5, ground_range_m: 15.0, apart_m: 1.0, largest_rival: 0.9 }
    }
}

/// Ground is a plane less steep than this, as the cosine of its slope: 18
/// degrees; 30 would take in banks.
const LEVEL_COS: f64 = 0.95;
/// Upright is a plane nearer to the vertical than this, as the sine of the
/// angle between both: 30 degrees.
const UPRIGHT_SIN: f64 = 0.5;

/// The best shift of a guess, and the share of the best score that the next
/// other solution has.
pub(super) fn shifted(map: &LocalMap, scan: &[ScanSurface], guess: &Pose, config: &SearchConfig) -> (Pose, f64) {
    let rise = ground_shift(map, scan, guess, config);
    let rotation = *guess.rotation.to_rotation_matrix().matrix();
    let is_upright = |s: &&ScanSurface| s.surface.normal.is_none_or(|n| (rotation * n).y.abs() < UPRIGHT_SIN);
    let upright: Vec<&ScanSurface> = scan.iter().filter(is_upright).collect();
    let steps = (config.reach_m / config.step_m).floor() as i32;
    let mut scores = Vec::new();
    for x in -steps..=steps {
        for z in -steps..=steps {
            let shift = Vector3::new(f64::from(x) * config.step_m, rise, f64::from(z) * config.step_m);
            let pose = Translation3::from(shift) * guess;
            let score: f64 = upright.iter().map(|s| closeness(map, s, &pose, config.tolerance_m)).sum();
            scores.push((score, shift));
        }
    }
    // Of equal scores the first: no order of threads comes in.
    let none = (0.0, Vector3::new(0.0, rise, 0.0));
    let best = scores.iter().fold(none, |best, s| if s.0 > best.0 { *s } else { best });
    let rival = scores.iter().filter(|s| (s.1 - best.1).norm() > config.apart_m).map(|s| s.0).fold(0.0, f64::max);
    (Translation3::from(best.1) * guess, if best.0 > 0.0 { rival / best.0 } else { 1.0 })
}

/// 1 for a surface on a surface of the map, 0 from `tolerance_m` off it on.
fn closeness(map: &LocalMap, ScanSurface { surface }: &ScanSurface, pose: &Pose, tolerance_m: f64) -> f64 {
    let moved = pose * surface.mean;
    map.surface_at(&moved)
        .map_or(0.0, |target| (1.0 - target.squared_distance_m2(&moved) / tolerance_m.powi(2)).max(0.0))
}

/// How far the scan's ground has to be moved along map y to lie on the map's:
/// the median over columns that both see.
fn ground_shift(map: &LocalMap, scan: &[ScanSurface], guess: &Pose, config: &SearchConfig) -> f64 {
    let column = |p: &Point3<f64>| ((p.x).floor() as i64, (p.z).floor() as i64);
    let mut lowest: FxHashMap<(i64, i64), f64> = FxHashMap::default();
    for surface in map.surfaces().filter(|s| s.normal.is_some_and(|n| n.y.abs() > LEVEL_COS)) {
        let y = lowest.entry(column(&surface.mean)).or_insert(f64::NEG_INFINITY);
        // y points down.
        *y = y.max(surface.mean.y);
    }
    let rotation = *guess.rotation.to_rotation_matrix().matrix();
    let near = |s: &&ScanSurface| s.surface.mean.coords.norm() < config.ground_range_m;
    let level = |s: &&ScanSurface| s.surface.normal.is_some_and(|n| (rotation * n).y.abs() > LEVEL_COS);
    let off: Vec<f64> = scan
        .iter()
        .filter(near)
        .filter(level)
        .filter_map(|s| {
            let moved = guess * s.surface.mean;
            lowest.get(&column(&moved)).map(|y| y - moved.y)
        })
        .collect();
    upper_median(off)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::register::{SurfaceConfig, scan_surfaces};
    use crate::voxel::voxel_moments;

    /// A road with a wall that has a corner, and posts every `period_m`.
    fn world(period_m: f64, walls: bool) -> Vec<Point3<f64>> {
        let mut points = Vec::new();
        for i in 0..300 {
            let along = f64::from(i) * 0.1 - 15.0;
            for k in -60..60 {
                points.push(Point3::new(f64::from(k) * 0.15, 1.6, along));
            }
            for k in 0..30 {
                let up = 1.6 - f64::from(k) * 0.1;
                if walls {
                    points.push(Point3::new(6.0, up, along));
                    points.push(Point3::new(-10.0 + f64::from(i) * 0.02, up, 9.0));
                }
                if (along / period_m).fract().abs() < 0.1 / period_m {
                    points.push(Point3::new(4.0 + f64::from(k % 3) * 0.03, up, along));
                }
            }
        }
        points
    }

    fn searched(world: &[Point3<f64>], shift: Vector3<f64>) -> (Pose, f64) {
        let mut map = LocalMap::new(1.0, 10, SurfaceConfig::default());
        map.insert(0, &voxel_moments(world, 0.5), &Pose::identity());
        let surfaces = scan_surfaces(&voxel_moments(world, 0.5), &SurfaceConfig::default());
        shifted(
            &map,
            &surfaces,
            &Pose::from_parts(shift.into(), nalgebra::UnitQuaternion::identity()),
            &SearchConfig::default(),
        )
    }

    #[test]
    fn a_drift_of_metres_is_taken_off() {
        let (found, rival) = searched(&world(4.0, true), Vector3::new(1.6, 0.7, -2.1));
        assert!(found.translation.vector.norm() < 0.5, "{found}");
        assert!(rival < SearchConfig::default().largest_rival, "{rival}");
    }

    #[test]
    fn posts_in_a_row_alone_do_not_tell_which_is_which() {
        let (_, rival) = searched(&world(1.5, false), Vector3::new(0.1, 0.0, 0.1));
        assert!(rival > SearchConfig::default().largest_rival, "{rival}");
    }
}
