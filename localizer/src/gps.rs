//! Rough positions from outside: a fix file, or noise on a known pose.

use common::geometry::{Pose, PoseParameters};
use nalgebra::Point3;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Standard deviations of GPS fixes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GpsConfig {
    /// Horizontal position, metres, along each of the two axes.
    pub horizontal_sigma_m: f64,
    /// Heading, degrees.
    pub heading_sigma_deg: f64,
    /// Fixes that are simulated, from the first frame on; the paper's 2.
    pub simulated_fixes: usize,
}

impl Default for GpsConfig {
    fn default() -> Self {
        Self { horizontal_sigma_m: 1.5, heading_sigma_deg: 2.0, simulated_fixes: 2 }
    }
}

/// A rough position. Only its horizontal part and its heading are used: the
/// height of a GPS is worse than the map's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GpsFix {
    /// Position of the reference camera, map frame, metres.
    pub position_map: Point3<f64>,
    /// Standard deviation of the position along each horizontal axis, metres.
    pub horizontal_sigma_m: f64,
    /// Heading about the down axis and its standard deviation, radians.
    pub heading: Option<(f64, f64)>,
}

impl GpsFix {
    /// A fix with the configured standard deviations; the heading is the
    /// pose's.
    pub fn from_pose(map_from_camera: &Pose, config: &GpsConfig) -> Self {
        let parameters = PoseParameters::from_pose(map_from_camera);
        Self {
            position_map: Point3::from(map_from_camera.translation.vector),
            horizontal_sigma_m: config.horizontal_sigma_m,
            heading: Some((parameters.yaw_rad, config.heading_sigma_deg.to_radians())),
        }
    }

    /// Half the squared Mahalanobis distance of a pose from the fix.
    pub fn surprise(&self, map_from_camera: &Pose) -> f64 {
        let off = map_from_camera.translation.vector - self.position_map.coords;
        let mut square = (off.x * off.x + off.z * off.z) / self.horizontal_sigma_m.powi(2).max(1e-12);
        if let Some((yaw_rad, sigma_rad)) = self.heading {
            let (sin, cos) = (PoseParameters::from_pose(map_from_camera).yaw_rad - yaw_rad).sin_cos();
            square += (sin.atan2(cos) / sigma_rad.max(1e-9)).powi(2);
        }
        0.5 * square
    }
}

/// Fixes with Gaussian noise on true poses: the same for the same seed.
pub fn simulate(truth: &[Pose], config: &GpsConfig, seed: u64) -> Vec<GpsFix> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut normal = move || -> f64 { StandardNormal.sample(&mut random) };
    truth
        .iter()
        .map(|pose| {
            let mut fix = GpsFix::from_pose(pose, config);
            fix.position_map.x += config.horizontal_sigma_m * normal();
            fix.position_map.z += config.horizontal_sigma_m * normal();
            let turn_rad = config.heading_sigma_deg.to_radians() * normal();
            fix.heading = fix.heading.map(|(yaw_rad, sigma_rad)| (yaw_rad + turn_rad, sigma_rad));
            fix
        })
        .collect()
}
