//! A rough belief about the pose: from a fix, with what the map knows of roads.

use std::f64::consts::FRAC_PI_2;

use common::geometry::{Pose, PoseParameters};
use nalgebra::{Matrix6, Point3, Vector6};

use super::StartConfig;
use crate::filter::State;
use crate::local_map::{LocalMap, PathPlace, RoadKey};
use crate::preselect::Reach;

/// How a camera stands on the survey's path: the same all along it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stance {
    /// Height above the survey's camera, metres.
    pub above_m: f64,
    /// Pitch against that of the path, radians.
    pub pitch_rad: f64,
    /// Roll, radians.
    pub roll_rad: f64,
}

impl Stance {
    /// That of the survey's rig, as high as `config` says.
    pub fn of_survey(config: &StartConfig) -> Self {
        Self { above_m: config.height_above_path_m, pitch_rad: 0.0, roll_rad: 0.0 }
    }

    /// That of a vehicle whose camera is known to sit higher than the survey's, and askew.
    pub fn of_vehicle(state: &State, config: &StartConfig) -> Self {
        let [pitch_rad, roll_rad] = state.rest_rad;
        Self { above_m: config.height_above_path_m + state.higher_m, pitch_rad, roll_rad }
    }

    /// That of a pose whose place on the path this is.
    pub fn of(pose: &PoseParameters, place: &PathPlace) -> Self {
        Self {
            above_m: place.point_map.y - pose.y_m,
            pitch_rad: pose.pitch_rad - place.pitch_rad(pose.yaw_rad),
            roll_rad: pose.roll_rad,
        }
    }

    /// The pose as high and as level as this at a place, where and whither it is.
    pub fn on(&self, place: &PathPlace, pose: &PoseParameters) -> PoseParameters {
        PoseParameters {
            y_m: place.point_map.y - self.above_m,
            pitch_rad: place.pitch_rad(pose.yaw_rad) + self.pitch_rad,
            roll_rad: self.roll_rad,
            ..*pose
        }
    }
}

/// A rough belief about the pose, in the axes of a level camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rough {
    /// Its mean.
    pub map_from_camera: Pose,
    /// Standard deviations: right, down, forward (m), pitch, yaw, roll (rad).
    pub sigmas: Vector6<f64>,
}

impl Rough {
    /// From a horizontal position and perhaps a heading (radians, about the
    /// down axis), with their standard deviations; the rest from the survey's
    /// path where one is near, else from the position itself. A heading that is
    /// further off the road's than a search around it reaches is as uncertain as
    /// that.
    pub fn from_fix(
        map: &LocalMap,
        roads: &[RoadKey],
        position_map: &Point3<f64>,
        horizontal_sigma_m: f64,
        heading: Option<(f64, f64)>,
        config: &StartConfig,
    ) -> Self {
        let place = map.path_within(roads, position_map, config.path_reach_m);
        let (yaw_rad, yaw_sigma_rad) = match (heading, place) {
            // Far off the road's it is wrong, or it turns: both are searched for.
            (Some((yaw_rad, sigma_rad)), Some(place)) => {
                let off_rad = to_road_rad(yaw_rad, &place).abs().min(config.path_heading_sigma_rad);
                (yaw_rad, if off_rad > config.reach_sigmas * sigma_rad { off_rad } else { sigma_rad })
            }
            (Some(told), None) => told,
            (None, Some(place)) => (place.forward_map.x.atan2(place.forward_map.z), config.path_heading_sigma_rad),
            (None, None) => (0.0, FRAC_PI_2),
        };
        let [x_m, y_m, z_m] = position_map.coords.into();
        let level = PoseParameters { x_m, y_m, z_m, yaw_rad, pitch_rad: 0.0, roll_rad: 0.0 };
        let (pose, height_sigma_m) = match place {
            Some(place) => (Stance::of_survey(config).on(&place, &level), config.height_sigma_m),
            // GPS heights are two to three times worse than positions.
            None => (level, 2.5 * horizontal_sigma_m),
        };
        let tilt = config.tilt_sigma_rad;
        Self {
            map_from_camera: pose.to_pose(),
            sigmas: Vector6::new(horizontal_sigma_m, height_sigma_m, horizontal_sigma_m, tilt, yaw_sigma_rad, tilt),
        }
    }

    /// The same of a camera that sits so much higher, metres.
    #[must_use]
    pub fn raised(&self, higher_m: f64) -> Self {
        let mut raised = *self;
        raised.map_from_camera.translation.vector.y -= higher_m;
        raised
    }

    /// How far around its mean a search goes.
    pub fn reach(&self, config: &StartConfig) -> Reach {
        Reach {
            position_m: config.reach_sigmas * self.sigmas[0].hypot(self.sigmas[2]),
            angle_rad: config.reach_sigmas * self.sigmas[4],
        }
    }

    /// Its covariance in the camera's tangent.
    pub fn covariance(&self) -> Matrix6<f64> {
        Matrix6::from_diagonal(&self.sigmas.component_mul(&self.sigmas))
    }
}

/// The turn from a heading to that of the road, whichever way it is driven.
fn to_road_rad(yaw_rad: f64, place: &PathPlace) -> f64 {
    let (sin, cos) = (place.forward_map.x.atan2(place.forward_map.z) - yaw_rad).sin_cos();
    (sin * cos.signum()).atan2(cos.abs())
}

/// Takes in that vehicles stay on roads and head along them, either way, where
/// the state itself knows less.
pub fn keep_on_road(state: &mut State, place: &PathPlace, config: &StartConfig) {
    let own = PoseParameters::from_pose(&state.map_from_camera);
    state.constrain(4, to_road_rad(own.yaw_rad, place), config.road_heading_sigma_rad);
    let pose = &state.map_from_camera;
    let off = pose.rotation.inverse() * (place.point_map.coords - pose.translation.vector);
    state.constrain(0, off.x, config.road_half_width_m);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Recipe, World};
    use common::geometry::local;

    #[test]
    fn height_and_slope_come_from_the_path() {
        let world = World::new(Recipe::default());
        let config = StartConfig::default();
        let truth = world.truth[100];
        let mut position = Point3::from(truth.translation.vector);
        let yaw_rad = PoseParameters::from_pose(&truth).yaw_rad;
        position.y += 30.0;
        let (map, roads) = world.local_map();
        let rough = |heading| Rough::from_fix(&map, &roads, &position, 1.5, heading, &config);
        let along = rough(Some((yaw_rad, 0.03)));
        let off = local(&truth, &along.map_from_camera);
        assert!(off[1].abs() < 0.1 && off[3].abs() < 0.02, "{off}");
        // Without a heading: that of the survey, less certain.
        let blind = rough(None);
        assert!(local(&truth, &blind.map_from_camera)[4].abs() < 0.1 && blind.sigmas[4] > 0.2);
        // One that is far off the road's may be wrong, and so wide it is searched.
        let lying = rough(Some((yaw_rad + 0.3, 0.03)));
        assert!(lying.sigmas[4] > 0.1 && (along.sigmas[4] - 0.03).abs() < 1e-9);
        // Driven against the survey the slope turns round.
        let against = rough(Some((yaw_rad + std::f64::consts::PI, 0.03)));
        let pitch = |r: &Rough| PoseParameters::from_pose(&r.map_from_camera).pitch_rad;
        assert!((pitch(&along) + pitch(&against)).abs() < 1e-6 && (against.sigmas[4] - 0.03).abs() < 1e-9);
    }

    #[test]
    fn far_from_every_path_the_height_is_that_of_the_fix() {
        let world = World::new(Recipe::default());
        let position = Point3::new(500.0, 12.0, 0.0);
        let (map, roads) = world.local_map();
        let rough = Rough::from_fix(&map, &roads, &position, 1.5, None, &StartConfig::default());
        assert!((rough.map_from_camera.translation.y - 12.0).abs() < 1e-9);
        assert!(rough.sigmas[1] > 1.5 && rough.sigmas[4] > 1.0);
    }
}
