//! One scan with what can be said of each of its points.

use common::kitti::ScanPoint;
use nalgebra::Point3;

use super::ground::Profile;
use super::patches::Patches;

/// A scan, ring by ring.
pub struct View {
    /// Points, Velodyne frame, metres.
    pub points: Vec<Point3<f64>>,
    /// Distance of each from the sensor, metres.
    pub range_m: Vec<f64>,
    /// Reflectance of each, 0 to 1.
    pub reflectance: Vec<f64>,
    /// Height of each above the ground, metres.
    pub height_m: Vec<f64>,
    /// First point of each ring, from the top, and the number of points.
    pub rings: Vec<usize>,
    /// Cubic metres above the ground with enough points for a plane.
    pub patches: Patches,
}

/// Nearer to the ground than this is ground, metres.
const GROUND_M: f64 = 0.15;

impl View {
    /// Prepares the points of a scan in the order of the file.
    pub fn new(scan: &[ScanPoint]) -> Self {
        let points: Vec<Point3<f64>> =
            scan.iter().map(|p| Point3::new(f64::from(p.x_m), f64::from(p.y_m), f64::from(p.z_m))).collect();
        let profile = Profile::grow(&points);
        let height_m: Vec<f64> = points.iter().map(|p| p.z - profile.height_m(p)).collect();
        let patches = Patches::new(&points, &height_m);
        Self {
            range_m: points.iter().map(|p| p.coords.norm()).collect(),
            reflectance: scan.iter().map(|p| f64::from(p.reflectance)).collect(),
            rings: rings(&points),
            height_m,
            patches,
            points,
        }
    }

    /// Whether a point is ground.
    pub fn is_ground(&self, index: usize) -> bool {
        self.height_m[index].abs() < GROUND_M
    }

    /// The points of each ring, from the top.
    pub fn each_ring(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        self.rings.windows(2).map(|ends| ends[0]..ends[1])
    }
}

/// KITTI's files hold one ring after the other, each anticlockwise from straight
/// ahead: a ring begins where the azimuth falls back.
fn rings(points: &[Point3<f64>]) -> Vec<usize> {
    let azimuth = |p: &Point3<f64>| p.y.atan2(p.x).rem_euclid(std::f64::consts::TAU);
    let begins = (1..points.len()).filter(|i| azimuth(&points[*i]) < azimuth(&points[i - 1]) - 3.0);
    std::iter::once(0).chain(begins).chain(std::iter::once(points.len())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_begins_where_the_azimuth_falls_back() {
        let scan: Vec<ScanPoint> = (0..3)
            .flat_map(|ring| {
                (1..100).map(move |i| {
                    let azimuth = i as f32 * 0.063;
                    ScanPoint {
                        x_m: 9.0 * azimuth.cos(),
                        y_m: 9.0 * azimuth.sin(),
                        z_m: -ring as f32,
                        reflectance: 0.2,
                    }
                })
            })
            .collect();
        assert_eq!(View::new(&scan).rings, [0, 99, 198, 297]);
    }
}
