//! What the lidar can see: its beams and its field of view.

mod intensity;
mod measure;
mod place;

use common::geometry::Pose;
use nalgebra::{Point3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

pub use crate::sheeting::SheetingConfig;
pub use intensity::IntensityConfig;
pub(crate) use intensity::full_scale;
pub use measure::{MeasureConfig, measured};
pub use place::PlaceConfig;

/// Beam pattern of the lidar. Defaults: Velodyne HDL-64E at 10 Hz, from its
/// manual.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LidarConfig {
    /// Where it is in the frame of its scans, metres: elsewhere than in their origin where
    /// that is of the vehicle.
    pub at_m: [f64; 3],
    /// Angle between neighbouring points of one beam, radians.
    pub azimuth_step_rad: f64,
    /// Mean angle between neighbouring beams, radians.
    pub elevation_step_rad: f64,
    /// Height of the place that the beams come from over the origin of the lidar's
    /// frame, metres: of the upper 32 in KITTI's scans.
    pub apex_m: f64,
    /// Elevation of the highest beam, radians.
    pub highest_rad: f64,
    /// Elevation of the lowest beam, radians.
    pub lowest_rad: f64,
    /// How bright things look to it.
    pub intensity: IntensityConfig,
    /// How retro-reflective sheeting looks to it.
    pub sheeting: SheetingConfig,
    /// How scans say that it is another one.
    pub measure: MeasureConfig,
    /// How they say where it is.
    pub place: PlaceConfig,
}

impl Default for LidarConfig {
    fn default() -> Self {
        Self {
            at_m: [0.0; 3],
            azimuth_step_rad: 0.0030,
            elevation_step_rad: 0.0073,
            apex_m: 0.21,
            highest_rad: 0.035,
            lowest_rad: -0.434,
            intensity: IntensityConfig::default(),
            sheeting: SheetingConfig::default(),
            measure: MeasureConfig::default(),
            place: PlaceConfig::default(),
        }
    }
}

/// Where the lidar was when it took a scan, and how it stood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Its place, map frame, metres.
    pub at_map: Point3<f64>,
    /// How far its level plane rises per metre along map x and z: a vehicle on a
    /// slope looks up and down with it.
    pub rise: Vector2<f64>,
}

impl Sensor {
    /// The lidar at a pose (`map_from_velodyne`).
    pub fn new(map_from_velodyne: &Pose) -> Self {
        let up = map_from_velodyne.rotation * Vector3::z();
        // On its side it has no level plane over the map's.
        let rise = if up.y < -0.1 { Vector2::new(up.x, up.z) / up.y } else { Vector2::zeros() };
        Self { at_map: map_from_velodyne.translation.vector.into(), rise }
    }

    /// Its view of what stands at map (x, z).
    pub fn view_of(&self, place: &Vector2<f64>, lidar: &LidarConfig) -> Viewpoint {
        let view = place - Vector2::new(self.at_map.x, self.at_map.z);
        let direction = view.try_normalize(1e-6).unwrap_or_else(Vector2::zeros);
        self.view_along(&direction, view.norm(), lidar)
    }

    /// The same by its direction, map (x, z) of unit length, and distance (metres).
    pub fn view_along(&self, direction: &Vector2<f64>, distance_m: f64, lidar: &LidarConfig) -> Viewpoint {
        let (height_m, rise) = (lidar.apex_m - self.at_map.y, self.rise.dot(direction));
        Viewpoint { distance_m, height_m, rise, weight: 1.0 }
    }
}

/// A scan from which something may be seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Viewpoint {
    /// Horizontal distance of the lidar, metres.
    pub distance_m: f64,
    /// Height that its beams come from, along -y of the map, metres.
    pub height_m: f64,
    /// How far its level plane rises towards the object, per metre.
    pub rise: f64,
    /// What the scan counts: a vehicle that stands sees the same again.
    pub weight: f64,
}

impl Viewpoint {
    /// Elevation of the beam to a height (along -y of the map, metres) of the
    /// object, radians.
    pub fn elevation_rad(&self, height: f64) -> f64 {
        ((height - self.height_m) / self.distance_m - self.rise).atan()
    }

    /// Height of the object, along -y of the map, that the highest beam meets.
    pub fn ceiling(&self, lidar: &LidarConfig) -> f64 {
        self.height_m + self.distance_m * (self.rise + lidar.highest_rad.tan())
    }
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
                let elevation = v.elevation_rad(height);
                elevation > self.lidar.lowest_rad && elevation < self.lidar.highest_rad
            })
            .map(|v| {
                let across = width_m / (v.distance_m * self.lidar.azimuth_step_rad);
                v.weight * across * (length_m / (v.distance_m * self.lidar.elevation_step_rad))
            })
            .sum()
    }

    /// Greatest height that any of the scans reaches, along -y of the map; without
    /// end where none is near enough to tell.
    pub fn ceiling(&self) -> f64 {
        self.from.iter().map(|v| v.ceiling(self.lidar)).reduce(f64::max).unwrap_or(f64::INFINITY)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Translation3, UnitQuaternion};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_place_at_the_ceiling_is_met_by_the_highest_beam(
            pitch in -0.2_f64..0.2, roll in -0.2_f64..0.2, bearing in -3.1_f64..3.1, distance_m in 3.0_f64..50.0,
        ) {
            let lidar = LidarConfig::default();
            // Forward, left and up of the lidar along map z, -x and -y, then tilted.
            let level = UnitQuaternion::from_matrix(&nalgebra::Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0));
            let tilt = UnitQuaternion::from_euler_angles(roll, pitch, 0.0);
            let pose = Pose::from_parts(Translation3::new(4.0, -1.7, 9.0), level * tilt);
            let sensor = Sensor::new(&pose);
            let direction = Vector2::new(bearing.sin(), bearing.cos());
            let along = sensor.view_along(&direction, distance_m, &lidar);
            let height = along.ceiling(&lidar);
            let place = Point3::new(4.0 + distance_m * direction.x, -height, 9.0 + distance_m * direction.y);
            let view = sensor.view_of(&Vector2::new(place.x, place.z), &lidar);
            prop_assert!((view.elevation_rad(height) - lidar.highest_rad).abs() < 1e-9);
            // As the lidar itself has it, but for its apex.
            let own = pose.inverse_transform_point(&(place + Vector3::new(0.0, lidar.apex_m, 0.0)));
            prop_assert!((own.z.atan2(own.x.hypot(own.y)) - lidar.highest_rad).abs() < 0.01);
        }
    }

    #[test]
    fn nearer_objects_get_more_points_and_high_ones_none() {
        let lidar = LidarConfig::default();
        let from = |distance_m: f64| Viewpoint { distance_m, height_m: 1.7, rise: 0.0, weight: 1.0 };
        let near = View::new([from(5.0)].into_iter(), 60.0, &lidar);
        let far = View::new([from(10.0)].into_iter(), 60.0, &lidar);
        assert!((near.expected(1.0, 0.2, 0.1) / far.expected(1.0, 0.2, 0.1) - 4.0).abs() < 1e-9);
        assert!(near.expected(3.0, 0.2, 0.1).abs() < 1e-12);
        assert!(far.ceiling() > near.ceiling());
        // Uphill it sees higher.
        let uphill = View::new([Viewpoint { rise: 0.1, ..from(10.0) }].into_iter(), 60.0, &lidar);
        assert!((uphill.ceiling() - far.ceiling() - 1.0).abs() < 1e-9);
        assert!(uphill.expected(3.0, 0.2, 0.1) > 0.0 && far.expected(3.0, 0.2, 0.1) <= 0.0);
        // From where nothing was near, nothing is known to end.
        assert!(View::new([from(80.0)].into_iter(), 60.0, &lidar).ceiling().is_infinite());
    }
}
