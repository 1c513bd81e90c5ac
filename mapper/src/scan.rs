//! One lidar scan, read and prepared.

use std::path::Path as FilePath;

use common::kitti::{Scan, ScanPoint, read_scan};
use nalgebra::Point3;

/// Points of a scan in the Velodyne frame.
#[derive(Debug, Clone, Default)]
pub struct LidarScan {
    /// Positions, Velodyne frame, metres.
    pub points: Vec<Point3<f64>>,
    /// Reflectance of each point, 0 to 1.
    pub reflectance: Vec<f32>,
    /// Whether points that follow each other are not one step of the lidar apart: they are of
    /// several scans.
    pub is_uneven: bool,
    /// Points dropped because a coordinate was not finite.
    pub dropped_not_finite: usize,
    /// Points dropped because they lay out of range.
    pub dropped_out_of_range: usize,
    /// Points dropped because their file says that they are withheld or noise.
    pub dropped_as_noise: usize,
}

impl LidarScan {
    /// Reads a scan and turns every point by `vertical_angle_rad` upwards
    /// about the horizontal axis across its ray.
    ///
    /// # Errors
    /// As [`read_scan`].
    pub fn read(path: &FilePath, max_range_m: f32, vertical_angle_rad: f64) -> common::Result<Self> {
        Ok(Self::prepare(&read_scan(path, max_range_m)?, vertical_angle_rad))
    }

    /// As [`Self::read`], from a scan already in memory.
    pub fn prepare(scan: &Scan, vertical_angle_rad: f64) -> Self {
        let points = if vertical_angle_rad == 0.0 {
            scan.points.iter().map(position).collect()
        } else {
            let turn = vertical_angle_rad.sin_cos();
            scan.points.iter().map(|p| raised(&position(p), turn)).collect()
        };
        Self {
            points,
            reflectance: scan.points.iter().map(|p| p.reflectance).collect(),
            is_uneven: false,
            dropped_not_finite: scan.dropped_not_finite,
            dropped_out_of_range: scan.dropped_out_of_range,
            dropped_as_noise: scan.dropped_as_noise,
        }
    }
}

/// Where a point of a scan is, Velodyne frame, metres.
pub fn position(p: &ScanPoint) -> Point3<f64> {
    Point3::new(f64::from(p.x_m), f64::from(p.y_m), f64::from(p.z_m))
}

/// A point (Velodyne frame) whose ray is turned up by an angle of given sine and cosine, about
/// the horizontal axis across it.
pub fn raised(p: &Point3<f64>, (sin, cos): (f64, f64)) -> Point3<f64> {
    // Metres of a lidar neither overflow nor vanish when squared: `hypot` guards
    // against that, slowly.
    let level = (p.x * p.x + p.y * p.y).sqrt();
    if level < 1e-9 {
        return *p;
    }
    let scale = (level * cos - p.z * sin) / level;
    Point3::new(p.x * scale, p.y * scale, p.z * cos + level * sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_raised_point_keeps_its_range_and_bearing() {
        let p = Point3::new(8.0, -3.0, -1.7);
        let q = raised(&p, 0.01_f64.sin_cos());
        assert!((q.coords.norm() - p.coords.norm()).abs() < 1e-12);
        assert!((q.y.atan2(q.x) - p.y.atan2(p.x)).abs() < 1e-12);
        let elevation = |r: &Point3<f64>| (r.z / r.coords.norm()).asin();
        assert!((elevation(&q) - elevation(&p) - 0.01).abs() < 1e-12);
    }
}
