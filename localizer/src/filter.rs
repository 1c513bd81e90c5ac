//! The error-state filter: a pose and its velocity with their covariance.
//!
//! The velocity is constant but for random accelerations; how strong these
//! are, and how soon a swaying dies out, stands in [`MotionConfig`] for each
//! axis of a road vehicle.

use common::geometry::{Pose, Tangent, local, retract};
use nalgebra::{Cholesky, Matrix6, SMatrix, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

type Matrix12 = SMatrix<f64, 12, 12>;

/// How a velocity component wanders.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisMotion {
    /// Standard deviation of its change after one second of free wandering,
    /// m/s or rad/s.
    pub walk: f64,
    /// Time after which it has fallen to 37 % by itself, seconds: springs and
    /// dampers end a swaying, nothing ends driving on.
    pub memory_s: f64,
}

/// Motion of the camera on a road vehicle, in the camera's axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MotionConfig {
    /// Sideways: yaw rate times the lever to the rear axle (0.6 rad/s times 1
    /// to 2 m), mounting angle times speed.
    pub right: AxisMotion,
    /// Vertical: bumps of some centimetres at 1 to 2 Hz, mounting pitch times
    /// speed.
    pub down: AxisMotion,
    /// Forward: accelerations of 1 to 2 m/s^2 that last a second; hard braking
    /// is followed through the images.
    pub forward: AxisMotion,
    /// Pitching: half a degree at 1 to 2 Hz.
    pub pitch: AxisMotion,
    /// Turning: a corner is entered within half a second at up to 0.6 rad/s.
    pub yaw: AxisMotion,
    /// Rolling: as pitching.
    pub roll: AxisMotion,
}

impl Default for MotionConfig {
    fn default() -> Self {
        let axis = |walk, memory_s| AxisMotion { walk, memory_s };
        Self {
            right: axis(0.6, 1.0),
            down: axis(0.4, 1.0),
            forward: axis(1.0, 60.0),
            pitch: axis(0.08, 0.5),
            yaw: axis(0.8, 3.0),
            roll: axis(0.08, 0.5),
        }
    }
}

impl MotionConfig {
    fn axes(&self) -> [AxisMotion; 6] {
        [self.right, self.down, self.forward, self.pitch, self.yaw, self.roll]
    }
}

/// A belief about where the camera is and how it moves.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Mean pose.
    pub map_from_camera: Pose,
    /// Mean velocity in the camera's axes: m/s, then rad/s.
    pub velocity: Tangent,
    /// Covariance of the pose's local tangent, then of the velocity.
    pub covariance: Matrix12,
}

impl State {
    /// Independent beliefs about pose and velocity.
    pub fn new(
        map_from_camera: Pose,
        pose_covariance: &Matrix6<f64>,
        velocity: Tangent,
        velocity_covariance: &Matrix6<f64>,
    ) -> Self {
        let mut covariance = Matrix12::zeros();
        covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(pose_covariance);
        covariance.fixed_view_mut::<6, 6>(6, 6).copy_from(velocity_covariance);
        Self { map_from_camera, velocity, covariance }
    }

    /// Covariance of the pose alone.
    pub fn pose_covariance(&self) -> Matrix6<f64> {
        self.covariance.fixed_view::<6, 6>(0, 0).into_owned()
    }

    /// The belief `dt_s` later.
    #[must_use]
    pub fn predicted(&self, dt_s: f64, motion: &MotionConfig) -> Self {
        let step = self.velocity * dt_s;
        let moved = Vector3::new(step[0], step[1], step[2]);
        let back = UnitQuaternion::from_scaled_axis(-Vector3::new(step[3], step[4], step[5]))
            .to_rotation_matrix()
            .into_inner();
        // (rho, phi, dv, dw) -> (E (rho - [v dt]x phi + dv dt), E phi + dw dt, ..)
        let mut transition = Matrix12::zeros();
        transition.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
        transition.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-back * moved.cross_matrix()));
        transition.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
        transition.fixed_view_mut::<3, 3>(0, 6).copy_from(&(back * dt_s));
        let mut noise = Matrix12::zeros();
        let mut velocity = self.velocity;
        for (i, axis) in motion.axes().into_iter().enumerate() {
            let kept = (-dt_s / axis.memory_s.max(1e-3)).exp();
            if i >= 3 {
                transition[(i, i + 6)] = dt_s;
            }
            transition[(i + 6, i + 6)] = kept;
            velocity[i] *= kept;
            let density = axis.walk * axis.walk;
            noise[(i, i)] = density * dt_s.powi(3) / 3.0;
            noise[(i, i + 6)] = density * dt_s * dt_s / 2.0;
            noise[(i + 6, i)] = noise[(i, i + 6)];
            noise[(i + 6, i + 6)] = density * dt_s;
        }
        let covariance = transition * self.covariance * transition.transpose() + noise;
        Self {
            map_from_camera: retract(&self.map_from_camera, &step),
            velocity,
            covariance: (covariance + covariance.transpose()) * 0.5,
        }
    }

    /// The belief after the pose became known as `map_from_camera` with
    /// `pose_covariance`, this belief's pose having been its prior. The
    /// velocity follows by its correlation with the pose.
    ///
    /// Unchanged where the present pose covariance is not positive definite.
    pub fn update(&mut self, map_from_camera: &Pose, pose_covariance: &Matrix6<f64>) {
        let before = self.pose_covariance();
        let Some(factor) = Cholesky::new(before) else { return };
        let cross: Matrix6<f64> = self.covariance.fixed_view::<6, 6>(6, 0).into_owned();
        // K = P_vp P_pp^-1, by solving P_pp K^T = P_pv.
        let gain = factor.solve(&cross.transpose()).transpose();
        let moved = local(&self.map_from_camera, map_from_camera);
        self.velocity += gain * moved;
        self.map_from_camera = *map_from_camera;
        let velocity: Matrix6<f64> = self.covariance.fixed_view::<6, 6>(6, 6).into_owned();
        let velocity = velocity - gain * (before - pose_covariance) * gain.transpose();
        let cross = gain * pose_covariance;
        self.covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(pose_covariance);
        self.covariance.fixed_view_mut::<6, 6>(6, 0).copy_from(&cross);
        self.covariance.fixed_view_mut::<6, 6>(0, 6).copy_from(&cross.transpose());
        self.covariance.fixed_view_mut::<6, 6>(6, 6).copy_from(&((velocity + velocity.transpose()) * 0.5));
    }

    /// As [`Self::measure`], but only where the state knows the component less
    /// well than `sigma`: the same prejudice said again adds nothing.
    pub fn constrain(&mut self, component: usize, offset: f64, sigma: f64) {
        if self.covariance[(component, component)] > sigma * sigma {
            self.measure(component, offset, sigma);
        }
    }

    /// Takes in that the pose lies `offset` away along one component of its
    /// tangent (0 to 5), known to `sigma` (m or rad).
    pub fn measure(&mut self, component: usize, offset: f64, sigma: f64) {
        let variance = self.covariance[(component, component)];
        let gain = self.covariance.column(component) / (variance + sigma * sigma);
        let delta = gain * offset;
        let step = Tangent::from_fn(|i, _| delta[i]);
        self.map_from_camera = retract(&self.map_from_camera, &step);
        self.velocity += Tangent::from_fn(|i, _| delta[i + 6]);
        let row = self.covariance.row(component).into_owned();
        self.covariance -= gain * row;
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::geometry::PoseParameters;

    fn state() -> State {
        let pose = PoseParameters { x_m: 1.0, y_m: 0.0, z_m: 5.0, yaw_rad: 0.5, pitch_rad: 0.01, roll_rad: 0.0 };
        let velocity = Tangent::new(0.1, 0.0, 12.0, 0.0, 0.2, 0.0);
        State::new(pose.to_pose(), &(Matrix6::identity() * 0.01), velocity, &(Matrix6::identity() * 0.25))
    }

    #[test]
    fn the_transition_is_the_derivative_of_the_motion() {
        let motion = MotionConfig::default();
        let base = state().predicted(0.1, &motion).map_from_camera;
        // Without noise and velocity covariance the predicted covariance is
        // F P F^T; probe it column by column with a thin covariance.
        for axis in 0..6 {
            let mut delta = Tangent::zeros();
            delta[axis] = 1e-5;
            let mut moved = state();
            moved.map_from_camera = retract(&moved.map_from_camera, &delta);
            let numeric = local(&base, &moved.predicted(0.1, &motion).map_from_camera) / 1e-5;
            let mut thin = state();
            thin.covariance = Matrix12::zeros();
            let noise = thin.predicted(0.1, &motion).covariance;
            thin.covariance[(axis, axis)] = 1.0;
            let spread = thin.predicted(0.1, &motion).covariance - noise;
            for i in 0..6 {
                for j in 0..6 {
                    assert!((spread[(i, j)] - numeric[i] * numeric[j]).abs() < 1e-3, "axis {axis} ({i}, {j})");
                }
            }
        }
    }

    #[test]
    fn poses_along_a_drive_teach_the_velocity() {
        let motion = MotionConfig::default();
        let mut truth = state();
        let mut filter = state();
        filter.velocity = Tangent::zeros();
        filter.covariance.fixed_view_mut::<6, 6>(6, 6).copy_from(&(Matrix6::identity() * 100.0));
        for _ in 0..20 {
            truth.map_from_camera = retract(&truth.map_from_camera, &(truth.velocity * 0.1));
            filter = filter.predicted(0.1, &motion);
            let seen = truth.map_from_camera;
            filter.update(&seen, &(Matrix6::identity() * 1e-4));
        }
        assert!((filter.velocity - truth.velocity).norm() < 0.05, "{}", filter.velocity);
        assert!(Cholesky::new(filter.covariance).is_some());
    }

    #[test]
    fn an_update_that_says_nothing_new_changes_nothing() {
        let mut filter = state().predicted(0.1, &MotionConfig::default());
        let before = filter.clone();
        filter.update(&before.map_from_camera, &before.pose_covariance());
        assert!((filter.covariance - before.covariance).norm() < 1e-9);
        assert!((filter.velocity - before.velocity).norm() < 1e-9);
    }

    #[test]
    fn uncertainty_grows_without_images() {
        let motion = MotionConfig::default();
        let soon = state().predicted(0.1, &motion).covariance[(2, 2)];
        let later = state().predicted(2.0, &motion).covariance[(2, 2)];
        assert!(later > 10.0 * soon);
    }
}
