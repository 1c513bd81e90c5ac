//! Made-up streets for the tests of this crate.

use nalgebra::{Point3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::cloud::{Cloud, CloudConfig, CloudPoint, Corridor};
use crate::ground::GroundConfig;
use crate::lidar::Sensor;

/// A straight drive along map z on a level road 1.65 m below the camera, with
/// points added by hand. The lidar is at the camera's place.
pub struct Street {
    points: Vec<CloudPoint>,
    sensors: Vec<Point3<f64>>,
    noise: Pcg64Mcg,
}

/// Height of the camera above the road, metres.
pub const CAMERA_HEIGHT_M: f64 = 1.65;

impl Street {
    /// A road of 60 m, 16 m wide, seen from ten places.
    pub fn new() -> Self {
        Self::shaped(0.2, |_| 0.0)
    }

    /// The same with points so far apart across it, metres, each so much higher as its x says.
    pub fn shaped(apart_m: f64, up_m: impl Fn(f64) -> f64) -> Self {
        let sensors = (0..10).map(|i| Point3::new(0.0, 0.0, f64::from(i) * 6.0)).collect();
        let mut street = Self { points: Vec::new(), sensors, noise: Pcg64Mcg::seed_from_u64(7) };
        let half = (16.0 / apart_m).round() as i32;
        for x in (-half..=half).map(|x| f64::from(x) * apart_m) {
            for z in -100..=800 {
                let p = Point3::new(x, CAMERA_HEIGHT_M - up_m(x), f64::from(z) * 0.1);
                street.add(p, (z / 60).clamp(0, 9) as u16, 0.25, Some(0.0));
            }
        }
        street
    }

    /// Adds a point as it is.
    pub fn add(&mut self, position: Point3<f64>, scan: u16, reflectance: f32, contrast: Option<f32>) {
        let range_m = (position - self.sensors[usize::from(scan)]).norm() as f32;
        self.points.push(CloudPoint { position, height_m: 0.0, reflectance, range_m, contrast, scan });
    }

    /// Adds the hits on an upright cylinder from every scan within 30 m: even
    /// over the visible width, with 1 cm of range noise.
    pub fn add_cylinder(&mut self, foot: Point3<f64>, top: Point3<f64>, radius_m: f64) {
        self.add_passing_cylinder(foot, top, radius_m, 0..self.sensors.len() as u16);
    }

    /// The same from some scans only: in the others it is elsewhere.
    pub fn add_passing_cylinder(
        &mut self,
        foot: Point3<f64>,
        top: Point3<f64>,
        radius_m: f64,
        scans: std::ops::Range<u16>,
    ) {
        for scan in scans {
            let sensor = self.sensors[usize::from(scan)];
            let view = Vector3::new(foot.x - sensor.x, 0.0, foot.z - sensor.z);
            if view.norm() > 30.0 {
                continue;
            }
            let ahead = view.normalize();
            let across = Vector3::new(ahead.z, 0.0, -ahead.x);
            for k in 0..120 {
                let on_axis = foot + (top - foot) * (f64::from(k) / 119.0);
                let side: f64 = self.noise.random_range(-1.0..1.0);
                let before = radius_m * (1.0 - side * side).sqrt();
                let range = self.noise.random_range(-0.017..0.017);
                self.add(on_axis + across * (side * radius_m) + ahead * (range - before), scan, 0.3, None);
            }
        }
    }

    /// Adds hits of a scan on what is half as far again behind a place, with
    /// beams that go through it from half a metre above its foot up to `height_m`.
    pub fn add_behind(&mut self, foot: Point3<f64>, height_m: f64, scan: u16) {
        let sensor = self.sensors[usize::from(scan)];
        for k in 0..20 {
            let up_m = 0.5 + (height_m - 0.5) * f64::from(k) / 19.0;
            let through = foot - Vector3::new(0.0, up_m, 0.0);
            self.add(sensor + (through - sensor) * 1.5, scan, 0.3, None);
        }
    }

    /// Adds a wall along z.
    pub fn add_wall(&mut self, x: f64, z: std::ops::Range<f64>, height_m: f64) {
        let steps = ((z.end - z.start) / 0.1) as usize;
        for i in 0..steps {
            for k in 0..(height_m / 0.1) as usize {
                let p = Point3::new(x, CAMERA_HEIGHT_M - k as f64 * 0.1, z.start + i as f64 * 0.1);
                self.add(p, (i % 10) as u16, 0.3, None);
            }
        }
    }

    /// The stitched cloud.
    pub fn cloud(self) -> Cloud {
        let centres: Vec<Point3<f64>> = (0..=60).map(|z| Point3::new(0.0, 0.0, f64::from(z))).collect();
        let config = GroundConfig::default();
        let corridor = Corridor::new(&centres, &CloudConfig::default(), config.cell_m);
        let sensors = self.sensors.into_iter().map(|at_map| Sensor { at_map, rise: Vector2::zeros() }).collect();
        Cloud::over(corridor, self.points, sensors, Vec::new(), &config)
    }
}
