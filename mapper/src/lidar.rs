//! What the lidar can see: its beams and its field of view.

use serde::{Deserialize, Serialize};

/// Beam pattern of the lidar. Defaults: Velodyne HDL-64E at 10 Hz, from its
/// manual.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LidarConfig {
    /// Angle between neighbouring points of one beam, radians.
    pub azimuth_step_rad: f64,
    /// Mean angle between neighbouring beams, radians.
    pub elevation_step_rad: f64,
    /// Elevation of the highest beam, radians.
    pub highest_rad: f64,
    /// Elevation of the lowest beam, radians.
    pub lowest_rad: f64,
}

impl Default for LidarConfig {
    fn default() -> Self {
        Self { azimuth_step_rad: 0.0030, elevation_step_rad: 0.0073, highest_rad: 0.035, lowest_rad: -0.434 }
    }
}

/// A scan from which something may be seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Viewpoint {
    /// Horizontal distance of the lidar, metres.
    pub distance_m: f64,
    /// Its height, along -y of the map, metres.
    pub height: f64,
    /// What the scan counts: a vehicle that stands sees the same again.
    pub weight: f64,
}

/// The scans from which a slender upright object may be seen.
pub struct View<'a> {
    from: Vec<Viewpoint>,
    lidar: &'a LidarConfig,
}

impl<'a> View<'a> {
    /// The view of an object from given places, no farther than `farthest_m`.
    pub fn new(from: impl Iterator<Item = Viewpoint>, farthest_m: f64, lidar: &'a LidarConfig) -> Self {
        Self { from: from.filter(|v| v.distance_m <= farthest_m && v.distance_m > 0.5).collect(), lidar }
    }

    /// Number of points expected on a piece of `length_m` at a height, `width_m`
    /// across, were nothing in the way; each counted as its scan.
    pub fn expected(&self, height: f64, length_m: f64, width_m: f64) -> f64 {
        self.from
            .iter()
            .filter(|v| {
                let elevation = (height - v.height).atan2(v.distance_m);
                elevation > self.lidar.lowest_rad && elevation < self.lidar.highest_rad
            })
            .map(|v| {
                let across = width_m / (v.distance_m * self.lidar.azimuth_step_rad);
                v.weight * across * (length_m / (v.distance_m * self.lidar.elevation_step_rad))
            })
            .sum()
    }

    /// Greatest height that any of the scans reaches, along -y of the map.
    pub fn ceiling(&self) -> f64 {
        let reach = |v: &Viewpoint| v.height + v.distance_m * self.lidar.highest_rad.tan();
        self.from.iter().map(reach).fold(f64::NEG_INFINITY, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearer_objects_get_more_points_and_high_ones_none() {
        let lidar = LidarConfig::default();
        let from = |distance_m: f64| Viewpoint { distance_m, height: 1.7, weight: 1.0 };
        let near = View::new([from(5.0)].into_iter(), 60.0, &lidar);
        let far = View::new([from(10.0)].into_iter(), 60.0, &lidar);
        assert!((near.expected(1.0, 0.2, 0.1) / far.expected(1.0, 0.2, 0.1) - 4.0).abs() < 1e-9);
        assert!(near.expected(3.0, 0.2, 0.1).abs() < 1e-12);
        assert!(far.ceiling() > near.ceiling());
    }
}
