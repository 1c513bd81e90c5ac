//! How input is read that is not KITTI's.

use serde::{Deserialize, Serialize};

use super::deal::DealConfig;
use crate::lidar::full_scale;

/// How input is read that is not KITTI's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InputConfig {
    /// Longest time between two poses over which the pose of a scan is
    /// interpolated, and over which a point belongs to a place, seconds: a car
    /// turns by a few degrees in it.
    pub longest_gap_s: f64,
    /// Intensity that counts as a reflectance of 1; 0 takes the least of 1,
    /// 255, 4095 and 65535 that no point of a few scans exceeds.
    pub full_intensity: f32,
    /// Time that the lidar takes for a turn, seconds: over it a scan is
    /// distorted by the motion, which `--deskew` takes out.
    pub turn_s: f64,
    /// Points of a stitched cloud that are held in memory before they go to
    /// the disk.
    pub held_points: usize,
    /// Width of the strips across the way into which the points of a stitched cloud are put
    /// that are in no order in which a lidar may have taken them, metres: less than
    /// a line is broad, and so broad that points in them are closer together than lines are broad.
    pub strip_m: f32,
    /// Who saw the points of a stitched cloud without times.
    pub deal: DealConfig,
}

impl Default for InputConfig {
    fn default() -> Self {
        Self {
            longest_gap_s: 0.5,
            full_intensity: 0.0,
            turn_s: 0.1,
            held_points: 4_000_000,
            strip_m: 0.09,
            deal: DealConfig::default(),
        }
    }
}

impl InputConfig {
    /// The intensity that counts as a reflectance of 1, where the largest one
    /// seen is `largest`.
    pub fn full_scale(&self, largest: f32) -> f32 {
        if self.full_intensity > 0.0 {
            return self.full_intensity;
        }
        full_scale(largest)
    }
}
