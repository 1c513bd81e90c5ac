//! Rough positions from outside: a fix file, or noise on a known pose.

mod file;

pub use self::file::{FixFile, read};
pub(crate) use self::file::{bad_number, is_of_names, numbers};

use common::earth::{Geodetic, OnEarth};
use common::geometry::{Pose, PoseParameters};
use nalgebra::{Point3, Quaternion, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::filter::State;

/// Norm of a quaternion below which it is no heading.
const LEAST_NORM: f64 = 0.1;
/// No map reaches farther from its origin, metres, and no fix in it: latitude and longitude
/// in the wrong order mostly do.
const FARTHEST_M: f64 = 2e6;

/// Standard deviations of GPS fixes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GpsConfig {
    /// Horizontal position, metres, along each of the two axes.
    pub horizontal_sigma_m: f64,
    /// Heading, degrees.
    pub heading_sigma_deg: f64,
    /// Where the heading is the course over ground (TUM lines): standard
    /// deviation of the velocity across the vehicle, metres per second. The
    /// receiver's is 0.1 to 0.2, and a camera 1.5 m ahead of the axle goes
    /// sideways by 0.3 where the vehicle turns at 0.2 rad/s. 0 for headings that
    /// are measured.
    pub course_sigma_m_s: f64,
    /// Fixes that are simulated, from the first frame on; the paper's 2.
    pub simulated_fixes: usize,
    /// Oldest that a fix may be when an image comes, seconds, where both are taken in as
    /// they come: it is moved on as the camera moved, and that changes meanwhile.
    pub oldest_s: f64,
    /// Fixes bound the pose wherever it is known less well than they are.
    /// Without, they only say where to search and which pose is the likelier.
    pub fuse: bool,
    /// A fix further from what is expected than this is refused, standard
    /// deviations of both: reflections put it tens of metres off.
    pub refused_sigmas: f64,
    /// So many fixes in a row that are refused may be right, and what was
    /// expected wrong: both places are believed until the images tell.
    pub believed_after: usize,
    /// A way from fix to fix says whither a vehicle heads where it is so many standard
    /// deviations of the positions at its ends long.
    pub way_sigmas: f64,
    /// A heading that is off the way by more contradicts it, radians: no corner is as
    /// sharp from one fix to the next.
    pub way_contradicts_rad: f64,
    /// Standard deviation of a heading about the way that led there, radians: half of
    /// what a car turns within a second.
    pub way_turned_rad: f64,
}

impl Default for GpsConfig {
    fn default() -> Self {
        Self {
            horizontal_sigma_m: 1.5,
            heading_sigma_deg: 2.0,
            course_sigma_m_s: 0.35,
            simulated_fixes: 2,
            oldest_s: 1.0,
            fuse: false,
            refused_sigmas: 4.0,
            believed_after: 3,
            way_sigmas: 3.0,
            way_contradicts_rad: 1.0,
            way_turned_rad: 0.2,
        }
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
    /// The heading is the course over ground: of little worth at walking pace.
    pub is_course: bool,
    /// How long before the image it was taken, seconds; negative after it.
    pub age_s: f64,
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
            is_course: false,
            age_s: 0.0,
        }
    }

    /// A fix at a position, metres, with a forward direction right and forward.
    fn headed(position: [f64; 3], [forward_x, forward_z]: [f64; 2], config: &GpsConfig) -> Self {
        let heading = Some((forward_x.atan2(forward_z), config.heading_sigma_deg.to_radians()));
        Self { heading, ..Self::at(position, config) }
    }

    /// A fix at a position, metres, that knows no heading.
    fn at(position: [f64; 3], config: &GpsConfig) -> Self {
        let horizontal_sigma_m = config.horizontal_sigma_m;
        Self { position_map: Point3::from(position), horizontal_sigma_m, heading: None, is_course: false, age_s: 0.0 }
    }

    /// The time of a row `t x y z` or `t x y z qx qy qz qw` (TUM), seconds, and its fix;
    /// none of other rows. A heading is the course over ground.
    pub fn of_row(row: &[f64], config: &GpsConfig) -> Option<(f64, Self)> {
        match *row {
            [time_s, x, y, z] => Some((time_s, Self::at([x, y, z], config))),
            [time_s, x, y, z, i, j, k, w] => {
                // Four zeros are how receivers say that they know no heading.
                let rotation = UnitQuaternion::try_new(Quaternion::new(w, i, j, k), LEAST_NORM);
                let forward = rotation.map(|rotation| rotation * Vector3::z());
                let headed = forward.map(|forward| Self::headed([x, y, z], [forward.x, forward.z], config));
                let fix = headed.unwrap_or_else(|| Self::at([x, y, z], config));
                Some((time_s, Self { is_course: true, ..fix }))
            }
            _ => None,
        }
    }

    /// The time of a row `t latitude longitude altitude` or `t latitude longitude altitude
    /// course` of a map that is on the Earth, and its fix: seconds, degrees north and east
    /// (WGS 84), metres, and degrees clockwise from north. None of other rows, nor of a place
    /// that no map with this origin reaches.
    pub fn of_place(row: &[f64], config: &GpsConfig, on_earth: &OnEarth) -> Option<(f64, Self)> {
        let (&[time_s, latitude_deg, longitude_deg, altitude_m], course_deg) = row.split_first_chunk()?;
        let place = Geodetic { latitude_deg, longitude_deg, altitude_m };
        let at_map = on_earth.map_from_place(&place);
        let is_place = latitude_deg.abs() < 90.0 && longitude_deg.abs() <= 180.0 && at_map.coords.norm() <= FARTHEST_M;
        let fix = match *course_deg {
            [] => Self::at(at_map.into(), config),
            [course_deg] => {
                let forward = on_earth.direction_map(&place, course_deg.to_radians());
                Self { is_course: true, ..Self::headed(at_map.into(), [forward.x, forward.z], config) }
            }
            _ => return None,
        };
        is_place.then_some((time_s, fix))
    }

    /// The same at the time of the image, which a camera of this velocity, m/s in the map,
    /// came to.
    #[must_use]
    pub fn moved_on(self, velocity_map: &Vector3<f64>) -> Self {
        Self { position_map: self.position_map + velocity_map * self.age_s, age_s: 0.0, ..self }
    }

    /// The heading at a speed, and how well it is known then, radians.
    pub fn heading_at(&self, speed_m_s: f64, config: &GpsConfig) -> Option<(f64, f64)> {
        let across_m_s = if self.is_course { config.course_sigma_m_s } else { 0.0 };
        let turned_rad = across_m_s.atan2(speed_m_s.abs());
        self.heading.map(|(yaw_rad, sigma_rad)| (yaw_rad, sigma_rad.hypot(turned_rad)))
    }

    /// How far the fix is from a state's position, right and forward, metres;
    /// none where it is further than can be believed.
    pub fn offset(&self, state: &State, config: &GpsConfig) -> Option<[f64; 2]> {
        let pose = &state.map_from_camera;
        let off = pose.rotation.inverse() * (self.position_map.coords - pose.translation.vector);
        let is_near = |component: usize| {
            let own_m2 = state.covariance[(component, component)];
            let sigma_m = (own_m2 + self.horizontal_sigma_m * self.horizontal_sigma_m).sqrt();
            off[component].abs() <= config.refused_sigmas * sigma_m
        };
        (is_near(0) && is_near(2)).then_some([off.x, off.z])
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

#[cfg(test)]
mod tests {
    use common::earth::Projection;

    use super::*;

    #[test]
    fn simulated_fixes_repeat_with_their_seed_and_spread_as_stated() {
        let config = GpsConfig::default();
        let truth = vec![Pose::identity(); 4000];
        let fixes = simulate(&truth, &config, 3);
        assert_eq!(fixes, simulate(&truth, &config, 3));
        assert_ne!(fixes, simulate(&truth, &config, 4));
        let spread = |value: fn(&GpsFix) -> f64| {
            (fixes.iter().map(|f| value(f).powi(2)).sum::<f64>() / fixes.len() as f64).sqrt()
        };
        assert!((spread(|f| f.position_map.x) - 1.5).abs() < 0.1);
        assert!((spread(|f| f.position_map.z) - 1.5).abs() < 0.1);
        assert!((spread(|f| f.heading.unwrap().0) - 2.0_f64.to_radians()).abs() < 0.003);
    }

    #[test]
    fn a_place_on_the_earth_is_one_in_the_map() {
        let config = GpsConfig::default();
        // The map looks east.
        let on_earth = OnEarth::new("49,8,100,90".parse().unwrap(), Projection::Topocentric);
        let of = |row: &[f64]| GpsFix::of_place(row, &config, &on_earth);
        // A hundredth of a degree north is 1,112 m to the left.
        let (time_s, fix) = of(&[5.0, 49.01, 8.0, 100.0]).unwrap();
        assert!((fix.position_map.x + 1112.1).abs() < 0.5 && fix.position_map.z.abs() < 0.5, "{}", fix.position_map);
        assert!((time_s - 5.0).abs() < 1e-12 && fix.heading.is_none());
        let (_, north) = of(&[5.0, 49.0, 8.0, 0.0, 0.0]).unwrap();
        assert!((north.heading.unwrap().0 + std::f64::consts::FRAC_PI_2).abs() < 1e-6 && north.is_course);
        let (_, south_east) = of(&[5.0, 49.0, 8.0, 0.0, 135.0]).unwrap();
        assert!((south_east.heading.unwrap().0 - std::f64::consts::FRAC_PI_4).abs() < 1e-6);
        // The other order, no degrees, other rows.
        for bad in [&[0.0, 8.0, 49.0, 0.0][..], &[0.0, 91.0, 8.0, 0.0], &[0.0, 49.0, 8.0], &[0.0; 8]] {
            assert!(of(bad).is_none(), "{bad:?}");
        }
    }
}
