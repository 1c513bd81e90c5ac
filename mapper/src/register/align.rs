//! Aligns one scan with the local map: Gauss-Newton over distances to the
//! surfaces of voxels, robustly weighted.

use common::geometry::{Pose, Tangent, retract};
use nalgebra::{Matrix6, Point3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::local_map::Target;
use super::{LocalMap, Surface, SurfaceConfig};
use crate::voxel::Moments;

/// How a scan is aligned with the local map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AlignConfig {
    /// Edge of the voxels of the local map, metres: smaller than the objects
    /// that tell scans apart, larger than the error of the first guess.
    pub map_voxel_m: f64,
    /// Edge of the voxels that a scan is reduced to, metres.
    pub scan_voxel_m: f64,
    /// What counts as a surface.
    pub surface: SurfaceConfig,
    /// Nearest range used, metres: the carrier vehicle itself is nearer.
    pub nearest_m: f64,
    /// Farthest range used, metres: farther voxels hold too few points.
    pub farthest_m: f64,
    /// Scale of the Cauchy weight, in standard deviations of a residual.
    pub robust_sigmas: f64,
    /// The same in the first iteration, halved in each until `robust_sigmas` is
    /// reached: what the first guess may be off by.
    pub first_sigmas: f64,
    /// Number of past scans in the local map.
    pub keep_scans: usize,
    /// Most iterations.
    pub max_iterations: usize,
    /// Least share of a scan's surfaces that lie on the scans before it, for these
    /// to tell how it moved: along generated drives it is more than half of every
    /// fifth scan, more than a quarter of every twentieth.
    pub least_overlap: f64,
}

impl Default for AlignConfig {
    fn default() -> Self {
        Self {
            map_voxel_m: 1.0,
            scan_voxel_m: 0.65,
            surface: SurfaceConfig::default(),
            nearest_m: 3.0,
            farthest_m: 60.0,
            robust_sigmas: 1.0,
            first_sigmas: 32.0,
            keep_scans: 10,
            max_iterations: 20,
            least_overlap: 0.1,
        }
    }
}

/// A scan's place in the local map.
#[derive(Debug, Clone, Copy)]
pub struct Alignment {
    /// The pose found.
    pub map_from_velodyne: Pose,
    /// Normal matrix at the solution, in the tangent of the Velodyne frame:
    /// its inverse is the covariance as far as voxels are independent.
    pub information: Matrix6<f64>,
    /// Share of the scan's surfaces that lie on a surface of the map.
    pub overlap: f64,
    /// Weighted root mean square distance at the pose found, metres.
    pub rms_m: f64,
    /// The same at the first guess, metres.
    pub first_rms_m: f64,
    /// Iterations used.
    pub iterations: usize,
}

/// A surface of the scan with its mean in the Velodyne frame.
#[derive(Debug, Clone, Copy)]
pub struct ScanSurface {
    /// The surface.
    pub surface: Surface,
}

/// The surfaces of a scan reduced to voxels.
pub fn scan_surfaces(cells: &[Moments], config: &SurfaceConfig) -> Vec<ScanSurface> {
    cells.iter().filter_map(|cell| Surface::of(cell, config)).map(|surface| ScanSurface { surface }).collect()
}

#[derive(Clone)]
struct Normal {
    h: Matrix6<f64>,
    g: Tangent,
    weight: f64,
    cost_m2: f64,
    matched: usize,
}

impl Normal {
    fn zero() -> Self {
        Self { h: Matrix6::zeros(), g: Tangent::zeros(), weight: 0.0, cost_m2: 0.0, matched: 0 }
    }

    fn rms_m(&self) -> f64 {
        (self.cost_m2 / self.weight.max(1e-12)).sqrt()
    }

    fn plus(mut self, o: &Self) -> Self {
        self.h += o.h;
        self.g += o.g;
        self.weight += o.weight;
        self.cost_m2 += o.cost_m2;
        self.matched += o.matched;
        self
    }
}

/// Adds the surfaces of a piece of a scan. `targets` are those that they were
/// matched with last, which mostly are the same again.
fn accumulate<'a>(
    map: &'a LocalMap,
    pose: &Pose,
    scan: &[ScanSurface],
    targets: &mut [Option<Target<'a>>],
    robust_sigmas: f64,
    same_plane_cos: f64,
) -> Normal {
    let rotation = *pose.rotation.to_rotation_matrix().matrix();
    let (back, up) = (rotation.transpose(), rotation.column(2).into_owned());
    let mut sum = Normal::zero();
    for (ScanSurface { surface }, last) in scan.iter().zip(targets) {
        let moved = Point3::from(rotation * surface.mean.coords + pose.translation.vector);
        let Some(target) = map.surface_again(&moved, last) else { continue };
        let tells = match (surface.normal, target.normal) {
            (Some(a), Some(b)) => (rotation * a).dot(&b).abs() >= same_plane_cos,
            (None, Some(_)) => true,
            (_, None) => target.is_rod_across_beams(&(moved.coords - pose.translation.vector), &up),
        };
        if !tells {
            continue;
        }
        sum.matched += 1;
        let off = moved - target.mean;
        let normals = target.normals();
        let off_m = target.constrained.map(|axis| axis.dot(&off));
        let squared_m2 = off_m[0] * off_m[0] + off_m[1] * off_m[1];
        let variance = target.sigma_m.powi(2) + surface.sigma_m.powi(2);
        let scaled = squared_m2 / (variance * robust_sigmas.powi(2));
        let weight = 1.0 / (variance * (1.0 + scaled));
        for (axis, off_m) in normals.iter().zip(off_m) {
            // n^T d(T (+) delta) p / d delta = n^T R [I | -p^], and with
            // b = R^T n that is [b^T | (p x b)^T].
            let turned = back * axis;
            let arm = surface.mean.coords.cross(&turned);
            let row = Tangent::new(turned.x, turned.y, turned.z, arm.x, arm.y, arm.z);
            let weighted = row * weight;
            // Both halves are the same: the lower one is filled.
            for k in 0..6 {
                for i in k..6 {
                    sum.h[(i, k)] += row[i] * weighted[k];
                }
            }
            sum.g += weighted * off_m;
        }
        sum.weight += weight;
        sum.cost_m2 += squared_m2 * weight;
    }
    sum.h.fill_upper_triangle_with_lower_triangle();
    sum
}

/// Surfaces per parallel piece; pieces are summed in order, so that the
/// result does not depend on the number of threads.
const PIECE: usize = 1024;

/// Aligns a scan, reduced to surfaces, with the map from a first guess.
pub fn align(map: &LocalMap, scan: &[ScanSurface], guess: &Pose, config: &AlignConfig) -> Alignment {
    let mut targets: Vec<Option<Target>> = vec![None; scan.len()];
    let mut normal = |pose: &Pose, sigmas: f64| {
        let pieces: Vec<Normal> = scan
            .par_chunks(PIECE)
            .zip(targets.par_chunks_mut(PIECE))
            .map(|(piece, targets)| accumulate(map, pose, piece, targets, sigmas, config.surface.same_plane_cos))
            .collect();
        pieces.iter().fold(Normal::zero(), Normal::plus)
    };
    let first_rms_m = normal(guess, config.robust_sigmas).rms_m();
    let mut pose = *guess;
    let mut last = Normal::zero();
    let mut iterations = 0;
    let mut sigmas = config.first_sigmas.max(config.robust_sigmas);
    while iterations < config.max_iterations {
        iterations += 1;
        last = normal(&pose, sigmas);
        let Some(solver) = last.h.cholesky() else { break };
        let step = -solver.solve(&last.g);
        pose = retract(&pose, &step);
        // A tenth of a millimetre and of a milliradian at 10 m is below every
        // effect on a map of centimetres.
        let annealed = sigmas <= config.robust_sigmas;
        sigmas = (sigmas / 2.0).max(config.robust_sigmas);
        if annealed && step.fixed_rows::<3>(0).norm() < 1e-4 && step.fixed_rows::<3>(3).norm() < 1e-5 {
            break;
        }
    }
    Alignment {
        map_from_velodyne: pose,
        information: last.h,
        overlap: last.matched as f64 / scan.len().max(1) as f64,
        rms_m: last.rms_m(),
        first_rms_m,
        iterations,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel::voxel_moments;

    /// Ground, a wall with a corner and three poles, in the map.
    fn world() -> Vec<Point3<f64>> {
        let mut points = Vec::new();
        let mut grain = 0_u32;
        let mut noise = || {
            grain = grain.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(grain >> 16) / 65536.0 * 0.02 - 0.01
        };
        for i in 0..300 {
            for k in 0..200 {
                let (x, y) = (f64::from(i) * 0.15 - 22.5, f64::from(k) * 0.15 - 15.0);
                points.push(Point3::new(x, y, -1.7 + noise()));
            }
            for k in 0..40 {
                let (along, up) = (f64::from(i) * 0.15 - 22.5, f64::from(k) * 0.1 - 1.7);
                points.push(Point3::new(along, 8.0 + noise(), up));
                if i < 80 {
                    points.push(Point3::new(12.0 + noise(), f64::from(i) * 0.1, up));
                }
            }
        }
        points
    }

    #[test]
    fn a_displaced_scan_is_put_back_within_a_centimetre() {
        let world = world();
        let mut map = LocalMap::new(1.0, 10, SurfaceConfig::default());
        map.insert(0, &voxel_moments(&world, 0.5), &Pose::identity());
        let truth = Pose::new(nalgebra::Vector3::new(0.7, 0.2, 0.05), nalgebra::Vector3::new(0.002, -0.003, 0.01));
        // The scan's own voxels are cut elsewhere than the map's.
        let scan: Vec<Point3<f64>> = world.iter().map(|p| truth.inverse() * p).collect();
        let surfaces = scan_surfaces(&voxel_moments(&scan, 0.5), &SurfaceConfig::default());
        let guess =
            truth * Pose::new(nalgebra::Vector3::new(0.15, -0.1, 0.05), nalgebra::Vector3::new(0.0, 0.002, 0.005));
        let found = align(&map, &surfaces, &guess, &AlignConfig::default());
        let off = common::geometry::local(&truth, &found.map_from_velodyne);
        assert!(off.fixed_rows::<3>(0).norm() < 0.01, "{off}");
        assert!(off.fixed_rows::<3>(3).norm() < 5e-4, "{off}");
        assert!(found.rms_m < found.first_rms_m && found.overlap > 0.8);
    }

    /// What a lidar of 16 beams sees from 1.7 m over rough ground, at `x_m` along a road with
    /// a post every 9 m, in its own frame.
    fn scan_of_few_beams(x_m: f64) -> Vec<Point3<f64>> {
        let rough = |x: f64, y: f64| 0.01 * ((7.1 * x).sin() + (5.3 * y).sin());
        let hit = |beam: u32, around: f64| {
            let (sin, cos) = around.sin_cos();
            let rise = (f64::from(beam) * 2.0 - 15.0).to_radians().tan();
            let ground_m = if rise < 0.0 { -1.7 / rise } else { 60.0 };
            // The nearest post that the ray passes within 8 cm.
            let post = |i: i32| {
                let (x, y) = (9.0 * f64::from(i) - x_m, if i % 2 == 0 { 5.0 } else { -6.0 });
                let along = x * cos + y * sin;
                ((x * sin - y * cos).abs() < 0.08 && along > 0.0).then_some(along - 0.08)
            };
            let post_m = (-4..8).filter_map(post).fold(60.0, f64::min);
            let level_m = ground_m.min(post_m);
            let (x, y) = (level_m * cos, level_m * sin);
            let z = if post_m < ground_m { rise * level_m } else { -1.7 + rough(x + x_m, y) };
            (level_m < 59.0 && z < 4.0).then(|| Point3::new(x, y, z))
        };
        (0..16).flat_map(|beam| (0..1800).filter_map(move |i| hit(beam, f64::from(i) * 0.00349))).collect()
    }

    #[test]
    fn what_single_beams_leave_on_the_ground_does_not_hold_a_scan_back() {
        let config = AlignConfig::default();
        let cells = |x_m: f64| voxel_moments(scan_of_few_beams(x_m), config.scan_voxel_m);
        let mut map = LocalMap::new(config.map_voxel_m, 10, config.surface);
        for (scan, x_m) in [0.0, 4.0, 8.0].into_iter().enumerate() {
            map.insert(scan, &cells(x_m), &Pose::translation(x_m, 0.0, 0.0));
        }
        let scan = scan_surfaces(&cells(12.0), &config.surface);
        let found = align(&map, &scan, &Pose::translation(12.1, 0.0, 0.0), &config);
        let off_m = found.map_from_velodyne.translation.vector.x - 12.0;
        assert!(off_m.abs() < 0.02, "{off_m}");
    }
}
