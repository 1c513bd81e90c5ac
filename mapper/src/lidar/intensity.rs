//! How bright things look to a lidar: what is paint and what is sheeting is told by
//! reflectances as the HDL-64E of KITTI reports them, and others report others. Of the
//! road it reports 0.28 and of what is brightest, sheeting aside, 0.55; calibrated
//! lidars (100 of 255 for what scatters all light, more for what sends it back) report
//! 0.03 and 0.25. What one reports is scaled, so that what is bright is as bright as to
//! KITTI's.

use std::ops::RangeInclusive;

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::MeasureConfig;
use crate::quantile::quantile;
use crate::scan::LidarScan;

/// What a lidar reports of the road and of what is bright.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IntensityConfig {
    /// Reflectance that it reports of the road near the vehicle (median). Default:
    /// KITTI's, 0.28 to 0.31 along its sequences 00 and 04.
    pub road: f64,
    /// Reflectance that one in fifty of its points exceeds. Default: KITTI's, 0.53 to
    /// 0.66 there.
    pub bright: f64,
}

impl Default for IntensityConfig {
    fn default() -> Self {
        Self { road: 0.28, bright: 0.55 }
    }
}

/// Largest value of reflectances, where they are whole numbers of 8, 12 and 16 bits.
const FULL: [f32; 4] = [1.0, 255.0, 4095.0, 65535.0];

/// The value that counts as a reflectance of 1, where the largest one seen is `largest`:
/// of floats from 0 to 1, and of whole numbers of 8, 12 and 16 bits.
pub fn full_scale(largest: f32) -> f32 {
    FULL.into_iter().find(|full| largest <= *full).unwrap_or(largest)
}

impl IntensityConfig {
    /// By how much what this lidar reports is brighter than what KITTI's does.
    pub fn times_as_bright(&self) -> f32 {
        (self.bright / Self::default().bright) as f32
    }

    /// Whether both are so far from each other that they are of two lidars.
    fn is_other(&self, said: &Self, most_times: f64) -> bool {
        let times = |shown: f64, said: f64| (shown / said).ln().abs();
        times(self.road, said.road).max(times(self.bright, said.bright)) > most_times.ln()
    }
}

/// What scans show; none where they show no road, or nothing that is brighter.
fn shown(scans: &[LidarScan], full: f32, config: &MeasureConfig) -> Option<IntensityConfig> {
    let of = |value: fn(&IntensityConfig) -> f64| {
        let shown = scans.iter().filter_map(|scan| by(scan, full, config));
        let mut values: Vec<f64> = shown.map(|shown| value(&shown)).collect();
        quantile(&mut values, 0.5)
    };
    Some(IntensityConfig { road: of(|shown| shown.road)?, bright: of(|shown| shown.bright)? })
}

/// What was said, but for what scans contradict, in which `full` counts as a reflectance
/// of 1; none where that is nothing.
pub(super) fn against(
    scans: &[LidarScan],
    full: f32,
    said: &IntensityConfig,
    config: &MeasureConfig,
) -> Option<IntensityConfig> {
    let other = shown(scans, full, config).filter(|shown| shown.is_other(said, config.most_times_as_bright))?;
    // What is bright differs from street to street, and where sheeting begins is agreed on.
    let is_calibrated = other.road < config.calibrated_road_share * other.bright && other.bright < SCATTERS_ALL;
    Some(if is_calibrated { IntensityConfig { bright: CALIBRATED_BRIGHT, ..other } } else { other })
}

/// What calibrated lidars report of what scatters all light: nothing but sheeting and
/// glints is brighter.
const SCATTERS_ALL: f64 = 100.0 / 255.0;
/// What is bright to them, for sheeting to be brighter by as much as to KITTI's: that calls
/// nothing else brighter than 0.7.
const CALIBRATED_BRIGHT: f64 = SCATTERS_ALL * 0.55 / 0.7;

fn by(scan: &LidarScan, full: f32, config: &MeasureConfig) -> Option<IntensityConfig> {
    if scan.points.len() < config.fewest_points {
        return None;
    }
    let road = road_heights_m(&scan.points, config, 0.0)?;
    let near = |p: &Point3<f64>| is_near(p, config) && road.contains(&p.z);
    let mut all: Vec<f64> = scan.reflectance.iter().map(|reflectance| f64::from(reflectance * full.recip())).collect();
    let of_road = scan.points.iter().zip(&all).filter(|(p, _)| near(p));
    let mut of_road: Vec<f64> = of_road.map(|(_, reflectance)| *reflectance).collect();
    let (road, bright) = (quantile(&mut of_road, 0.5)?, quantile(&mut all, 1.0 - config.bright_share)?);
    // Of what reports no intensities both are nothing.
    (road > 0.0 && bright > road).then_some(IntensityConfig { road, bright })
}

fn is_near(p: &Point3<f64>, config: &MeasureConfig) -> bool {
    let [from_m, to_m] = config.road_m;
    (from_m * from_m..to_m * to_m).contains(&(p.x * p.x + p.y * p.y))
}

/// Heights of the road near the vehicle, lidar frame, metres: those around which most of
/// what lies below `highest_m` does.
pub(super) fn road_heights_m(
    points: &[Point3<f64>],
    config: &MeasureConfig,
    highest_m: f64,
) -> Option<RangeInclusive<f64>> {
    let slice_m = config.road_within_m;
    let mut counts = [0_usize; 64];
    for p in points.iter().filter(|p| p.z < highest_m && is_near(p, config)) {
        if let Some(count) = counts.get_mut(((highest_m - p.z) / slice_m) as usize) {
            *count += 1;
        }
    }
    let (most, count) = counts.iter().enumerate().max_by_key(|(_, count)| **count)?;
    let middle_m = highest_m - slice_m * (most as f64 + 0.5);
    (*count > 0).then_some(middle_m - slice_m..=middle_m + slice_m)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Of a road between walls: what one point in fourteen of either kind reflects.
    fn street(road: f32, wall: f32) -> LidarScan {
        let ring = |i: i32| (f64::from(i % 1000) * 0.006_283).sin_cos();
        let (mut points, mut reflectance) = (Vec::new(), Vec::new());
        for i in 0..12_000 {
            let ((sin, cos), level_m) = (ring(i), 4.0 + f64::from(i % 14));
            points.push(Point3::new(level_m * cos, level_m * sin, -1.7 + 0.02 * sin));
            reflectance.push(road * (0.8 + 0.4 * (i % 14) as f32 / 13.0));
        }
        for i in 0..4_000 {
            let ((sin, cos), level_m) = (ring(i), 12.0);
            points.push(Point3::new(level_m * cos, level_m * sin, f64::from(i % 30) * 0.1));
            reflectance.push(wall * (0.5 + 0.5 * (i % 14) as f32 / 13.0));
        }
        LidarScan { points, reflectance, ..LidarScan::default() }
    }

    fn told(scan: LidarScan) -> Option<IntensityConfig> {
        against(&[scan], 1.0, &IntensityConfig::default(), &MeasureConfig::default())
    }

    #[test]
    fn what_reports_as_kittis_does_is_left_alone() {
        for (road, wall) in [(0.28, 0.6), (0.22, 0.5), (0.31, 0.66)] {
            assert_eq!(told(street(road, wall)), None, "{road} {wall}");
        }
        let kitti = IntensityConfig::default();
        assert_eq!(kitti.times_as_bright().to_bits(), 1.0_f32.to_bits());
        // Nor is what reports nothing.
        assert_eq!((told(street(0.0, 0.0)), told(LidarScan::default())), (None, None));
    }

    #[test]
    fn a_calibrated_lidar_calls_sheeting_what_reflects_more_than_scatters() {
        let lidar = told(street(0.04, 0.25)).unwrap();
        let reported = |of_255: f32| of_255 / 255.0 / lidar.times_as_bright();
        assert!(reported(100.0) < 0.701 && reported(102.0) > 0.7, "{lidar:?}");
    }

    proptest! {
        #[test]
        fn another_scale_is_undone(times in 0.02_f32..0.5) {
            let lidar = told(street(0.28 * times, 0.58 * times)).unwrap();
            prop_assert!((0.85..1.15).contains(&(lidar.times_as_bright() / times)), "{lidar:?}");
        }

        #[test]
        fn whole_numbers_are_parts_of_the_largest_they_can_be(largest in 0.0_f32..70_000.0) {
            let full = full_scale(largest);
            prop_assert!(full >= largest && full >= 1.0 && (full <= 65535.0 || (full - largest).abs() < 1e-3));
        }
    }
}
