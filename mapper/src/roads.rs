//! Stretches of the driven road, so that the localizer looks near by.

use common::geometry::Pose;
use common::map::Road;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use crate::lanes::simplify;

/// How the drive is cut into roads and windows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RoadConfig {
    /// Length of a road stretch, metres: what a camera sees landmarks over.
    pub length_m: f64,
    /// Tolerance of the path of a stretch, metres: it tells the camera's
    /// height and place to a localizer that starts.
    pub tolerance_m: f64,
    /// Number of stretches whose cloud is held in memory at a time.
    pub per_window: usize,
}

impl Default for RoadConfig {
    fn default() -> Self {
        Self { length_m: 50.0, tolerance_m: 0.1, per_window: 3 }
    }
}

/// A stretch of the drive: its frames and where it begins.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// First frame.
    pub first: usize,
    /// Last frame: the first of the next stretch, but for the last one.
    pub last: usize,
}

/// Cuts the frames `first..=last` into stretches of about the same length.
pub fn stretches(map_from_camera: &[Pose], first: usize, last: usize, config: &RoadConfig) -> Vec<Stretch> {
    let step = |f: usize| (map_from_camera[f].translation.vector - map_from_camera[f - 1].translation.vector).norm();
    let whole: f64 = (first + 1..=last).map(step).sum();
    let count = (whole / config.length_m).round().max(1.0);
    let each = whole / count;
    let mut cuts = vec![first];
    let mut driven = 0.0;
    for f in first + 1..=last {
        driven += step(f);
        if driven >= each * cuts.len() as f64 - 1e-9 && (cuts.len() as f64) < count {
            cuts.push(f);
        }
    }
    cuts.push(last);
    cuts.windows(2).map(|w| Stretch { first: w[0], last: w[1] }).collect()
}

/// The road of a stretch.
pub fn road(map_from_camera: &[Pose], stretch: &Stretch, config: &RoadConfig) -> Road {
    let centres: Vec<Point3<f64>> =
        map_from_camera[stretch.first..=stretch.last].iter().map(|p| p.translation.vector.into()).collect();
    let kept = simplify(&centres, config.tolerance_m);
    Road { path_map: kept.into_iter().map(|i| centres[i]).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_cover_the_drive_without_a_gap() {
        let poses: Vec<Pose> = (0..271).map(|i| Pose::translation(0.0, 0.0, f64::from(i) * 1.46)).collect();
        let cut = stretches(&poses, 0, 270, &RoadConfig::default());
        assert_eq!(cut.len(), 8);
        assert_eq!((cut[0].first, cut[7].last), (0, 270));
        assert!(cut.windows(2).all(|w| w[0].last == w[1].first));
    }

    #[test]
    fn a_vehicle_that_stands_still_has_one_stretch() {
        let cut = stretches(&[Pose::identity(); 4], 0, 3, &RoadConfig::default());
        assert_eq!(cut, vec![Stretch { first: 0, last: 3 }]);
    }
}
