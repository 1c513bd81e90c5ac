//! The error-state filter: a pose and its velocity with their covariance.
//!
//! The velocity is constant but for random accelerations; how strong these
//! are, and how soon a swaying dies out, stands in [`MotionConfig`] for each
//! axis of a road vehicle. Speeding up and braking last (Singer, *Estimating
//! optimal tracking filter performance for manned maneuvering targets*, 1970).
//! What does not change along a drive (how the camera sits on the vehicle, what
//! its odometry is off by) is estimated along.

mod mix;
mod motion;
mod springs;
mod vehicle;

use common::geometry::{Pose, Tangent, local, retract};
use nalgebra::{Cholesky, Matrix6, SMatrix, SVector, UnitQuaternion, Vector3};

use crate::odometry::OdometryConfig;
pub use motion::{AxisMotion, MotionConfig};

/// Pose (0 to 5), velocity (6 to 11), what the odometry is off by (12, 13), how
/// the camera sits on the vehicle (14 to 16), how that lies (17, 18), and how it
/// speeds up (19).
const STATES: usize = 20;
/// All but the pose.
const REST: usize = STATES - 6;
/// The velocity to the right.
const RIGHT: usize = 6;
/// The forward velocity.
const FORWARD: usize = 8;
/// The turn rate about the axis to the right.
const PITCH_RATE: usize = 9;
/// The turn rate about the down axis, positive to the right.
const YAW_RATE: usize = 10;
/// The turn rate about the forward axis.
const ROLL_RATE: usize = 11;
/// The scale of the wheels.
const SCALE: usize = 12;
/// The bias of the gyroscope.
const BIAS: usize = 13;
/// How far the camera is ahead of the axle that does not steer.
const LEVER: usize = 14;
/// The angle of the driving direction to the right of the camera's axis.
const MOUNTING: usize = 15;
/// How much higher the camera is than the survey's.
const HEIGHT: usize = 16;
/// The pitch that springs return to.
const REST_PITCH: usize = 17;
/// The roll that springs return to.
const REST_ROLL: usize = 18;
/// The forward acceleration.
const ACCELERATION: usize = 19;

type MatrixN = SMatrix<f64, STATES, STATES>;
type VectorN = SVector<f64, STATES>;

/// Share of what fades that is left `dt_s` later.
fn kept_after(dt_s: f64, memory_s: f64) -> f64 {
    (-dt_s / memory_s.max(1e-3)).exp()
}

/// A belief about where the camera is and how it moves.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Mean pose.
    pub map_from_camera: Pose,
    /// Mean velocity in the camera's axes: m/s, then rad/s.
    pub velocity: Tangent,
    /// By which share the wheels show more than the true speed.
    pub wheel_scale: f64,
    /// By how much the gyroscope shows more than the true turn rate, rad/s,
    /// positive to the left.
    pub yaw_bias_rad_s: f64,
    /// How far the camera is ahead of the axle that does not steer, metres.
    pub lever_m: f64,
    /// The driving direction to the right of the camera's axis, radians.
    pub mounting_rad: f64,
    /// How much higher the camera is over the road than the survey's, metres.
    pub higher_m: f64,
    /// Pitch and roll that the springs return to, beyond those of a level
    /// camera on the survey's path, radians: the crossfall of the road, the
    /// mounting of the camera, axes of a map that were not level.
    pub rest_rad: [f64; 2],
    /// Mean forward acceleration, m/s^2.
    pub acceleration_m_s2: f64,
    /// By how much it was shown to pitch and roll since the last image, radians.
    pub swayed_rad: Option<[f64; 2]>,
    /// What odometry, wheels and road have said against it since the last
    /// image: half the sum of the squared Mahalanobis distances.
    pub surprise: f64,
    /// Covariance of the pose's local tangent, then of the velocity, the
    /// wheels' scale, the gyroscope's bias, lever, mounting, height, rest and
    /// acceleration.
    pub covariance: SMatrix<f64, STATES, STATES>,
}

impl State {
    /// Independent beliefs about pose, velocity and odometry.
    pub fn new(
        map_from_camera: Pose,
        pose_covariance: &Matrix6<f64>,
        velocity: Tangent,
        velocity_covariance: &Matrix6<f64>,
        motion: &MotionConfig,
        odometry: &OdometryConfig,
    ) -> Self {
        let mut covariance = MatrixN::zeros();
        covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(pose_covariance);
        covariance.fixed_view_mut::<6, 6>(6, 6).copy_from(velocity_covariance);
        covariance[(SCALE, SCALE)] = odometry.scale_sigma * odometry.scale_sigma;
        covariance[(BIAS, BIAS)] = odometry.yaw_bias_sigma_rad_s * odometry.yaw_bias_sigma_rad_s;
        covariance[(LEVER, LEVER)] = motion.lever_sigma_m * motion.lever_sigma_m;
        covariance[(HEIGHT, HEIGHT)] = motion.height_sigma_m * motion.height_sigma_m;
        covariance[(MOUNTING, MOUNTING)] = motion.mounting_sigma_rad * motion.mounting_sigma_rad;
        for i in [REST_PITCH, REST_ROLL] {
            covariance[(i, i)] = motion.rest_sigma_rad * motion.rest_sigma_rad;
        }
        covariance[(ACCELERATION, ACCELERATION)] = motion.acceleration_sigma_m_s2 * motion.acceleration_sigma_m_s2;
        Self {
            map_from_camera,
            velocity,
            wheel_scale: 0.0,
            yaw_bias_rad_s: 0.0,
            lever_m: motion.lever_m,
            mounting_rad: 0.0,
            higher_m: 0.0,
            rest_rad: [0.0; 2],
            acceleration_m_s2: 0.0,
            swayed_rad: None,
            surprise: 0.0,
            covariance,
        }
    }

    /// The same motion at another place: the pose is known to
    /// `pose_covariance` there, whatever was known of it here.
    #[must_use]
    pub fn moved_to(&self, map_from_camera: Pose, pose_covariance: &Matrix6<f64>) -> Self {
        let mut covariance = self.covariance;
        covariance.fixed_view_mut::<6, REST>(0, 6).fill(0.0);
        covariance.fixed_view_mut::<REST, 6>(6, 0).fill(0.0);
        covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(pose_covariance);
        Self { map_from_camera, covariance, ..self.clone() }
    }

    /// Covariance of the pose alone.
    pub fn pose_covariance(&self) -> Matrix6<f64> {
        self.covariance.fixed_view::<6, 6>(0, 0).into_owned()
    }

    /// The belief `dt_s` later.
    #[must_use]
    pub fn predicted(&self, dt_s: f64, motion: &MotionConfig) -> Self {
        let mut state = self.clone();
        state.speed_up(dt_s, motion);
        state.move_on(dt_s, motion);
        state.roll_on_wheels(dt_s, motion);
        state
    }

    /// From the mean speed of one stretch to that of the next, `dt_s` later:
    /// `v' = v + a dt`, `a' = k a + n`, `k` what is kept.
    fn speed_up(&mut self, dt_s: f64, motion: &MotionConfig) {
        let kept = kept_after(dt_s, motion.acceleration_memory_s);
        self.velocity[2] += dt_s * self.acceleration_m_s2;
        self.acceleration_m_s2 *= kept;
        self.take_along(FORWARD, ACCELERATION, dt_s);
        self.sharpen(ACCELERATION, kept);
        self.covariance[(ACCELERATION, ACCELERATION)] +=
            motion.acceleration_sigma_m_s2 * motion.acceleration_sigma_m_s2 * (1.0 - kept * kept);
    }

    /// To the belief `dt_s` later of a body that moves freely.
    fn move_on(&mut self, dt_s: f64, motion: &MotionConfig) {
        let step = self.velocity * dt_s;
        let moved = Vector3::new(step[0], step[1], step[2]);
        let back = UnitQuaternion::from_scaled_axis(-Vector3::new(step[3], step[4], step[5]))
            .to_rotation_matrix()
            .into_inner();
        // (rho, phi, dv, dw) -> (E (rho - [v dt]x phi + dv dt), E phi + dw dt, ..)
        let mut of_pose = Matrix6::zeros();
        of_pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
        of_pose.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-back * moved.cross_matrix()));
        of_pose.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
        let mut of_velocity = Matrix6::identity() * dt_s;
        of_velocity.fixed_view_mut::<3, 3>(0, 0).copy_from(&(back * dt_s));
        let covariance = &mut self.covariance;
        // F P F^T: the rows and columns of the pose, then those that fade.
        let rows = of_pose * covariance.fixed_rows::<6>(0) + of_velocity * covariance.fixed_rows::<6>(6);
        covariance.fixed_rows_mut::<6>(0).copy_from(&rows);
        let columns = covariance.fixed_columns::<6>(0) * of_pose.transpose()
            + covariance.fixed_columns::<6>(6) * of_velocity.transpose();
        covariance.fixed_columns_mut::<6>(0).copy_from(&columns);
        let resting = kept_after(dt_s, motion.rest_memory_s);
        self.rest_rad = self.rest_rad.map(|rad| rad * resting);
        for i in [REST_PITCH, REST_ROLL] {
            self.sharpen(i, resting);
            self.covariance[(i, i)] += motion.rest_sigma_rad * motion.rest_sigma_rad * (1.0 - resting * resting);
        }
        // Who drives along the road is always moved to the right so, and in the axes of a
        // camera that looks down, up.
        let along = [self.rolled_m_s(dt_s), self.velocity[2] * self.rest_rad[0].tan()];
        for (i, axis) in motion.axes().into_iter().enumerate() {
            let kept = kept_after(dt_s, axis.memory_s);
            // What turning and the mounting explain does not fade.
            let lasting = along.get(i).copied().unwrap_or(0.0);
            self.velocity[i] = lasting + kept * (self.velocity[i] - lasting);
            self.sharpen(i + 6, kept);
            let density = axis.walk * axis.walk;
            self.covariance[(i, i)] += density * dt_s.powi(3) / 3.0;
            self.covariance[(i, i + 6)] += density * dt_s * dt_s / 2.0;
            self.covariance[(i + 6, i)] += density * dt_s * dt_s / 2.0;
            self.covariance[(i + 6, i + 6)] += density * dt_s;
        }
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
        self.map_from_camera = retract(&self.map_from_camera, &step);
        (self.surprise, self.swayed_rad) = (0.0, None);
    }

    /// The belief after the pose became known as `map_from_camera` with
    /// `pose_covariance`, this belief's pose having been its prior. The
    /// rest follows by its correlation with the pose.
    ///
    /// Unchanged where the present pose covariance is not positive definite.
    pub fn update(&mut self, map_from_camera: &Pose, pose_covariance: &Matrix6<f64>) {
        let before = self.pose_covariance();
        let Some(factor) = Cholesky::new(before) else { return };
        let cross: SMatrix<f64, REST, 6> = self.covariance.fixed_view::<REST, 6>(6, 0).into_owned();
        // K = P_rp P_pp^-1, by solving P_pp K^T = P_pr.
        let gain = factor.solve(&cross.transpose()).transpose();
        self.shift_rest(&(gain * local(&self.map_from_camera, map_from_camera)));
        self.map_from_camera = *map_from_camera;
        let rest: SMatrix<f64, REST, REST> = self.covariance.fixed_view::<REST, REST>(6, 6).into_owned();
        let rest = rest - gain * (before - pose_covariance) * gain.transpose();
        let cross = gain * pose_covariance;
        self.covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(pose_covariance);
        self.covariance.fixed_view_mut::<REST, 6>(6, 0).copy_from(&cross);
        self.covariance.fixed_view_mut::<6, REST>(0, 6).copy_from(&cross.transpose());
        self.covariance.fixed_view_mut::<REST, REST>(6, 6).copy_from(&((rest + rest.transpose()) * 0.5));
    }

    fn shift_rest(&mut self, delta: &SVector<f64, REST>) {
        self.velocity += delta.fixed_rows::<6>(0);
        self.wheel_scale += delta[SCALE - 6];
        self.yaw_bias_rad_s += delta[BIAS - 6];
        self.lever_m += delta[LEVER - 6];
        self.mounting_rad += delta[MOUNTING - 6];
        self.higher_m += delta[HEIGHT - 6];
        self.rest_rad[0] += delta[REST_PITCH - 6];
        self.rest_rad[1] += delta[REST_ROLL - 6];
        self.acceleration_m_s2 += delta[ACCELERATION - 6];
    }

    /// Takes the standard deviation of one component as this share of what it
    /// was, the correlations as they were.
    pub fn sharpen(&mut self, component: usize, share: f64) {
        for i in 0..STATES {
            self.covariance[(component, i)] *= share;
            self.covariance[(i, component)] *= share;
        }
    }

    /// The covariance of a component after it took on a `share` of another:
    /// `F P F^T` with `F = 1 + share e e'^T`.
    fn take_along(&mut self, component: usize, other: usize, share: f64) {
        for i in 0..STATES {
            self.covariance[(component, i)] += share * self.covariance[(other, i)];
        }
        for i in 0..STATES {
            self.covariance[(i, component)] += share * self.covariance[(i, other)];
        }
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
        let mut row = VectorN::zeros();
        row[component] = 1.0;
        self.absorb(&row, offset, sigma);
    }

    /// The update of a Kalman filter for one number that lies `offset` above
    /// what the state expects, known to `sigma`; `row` is its derivative.
    /// Returns half the squared Mahalanobis distance.
    fn absorb(&mut self, row: &VectorN, offset: f64, sigma: f64) -> f64 {
        let spread = self.covariance * row;
        let variance = row.dot(&spread) + sigma * sigma;
        if variance <= f64::MIN_POSITIVE {
            // Both are certain: settings say that nothing moves.
            return 0.0;
        }
        let delta = spread * (offset / variance);
        self.map_from_camera = retract(&self.map_from_camera, &delta.fixed_rows::<6>(0).into_owned());
        self.shift_rest(&delta.fixed_rows::<REST>(6).into_owned());
        self.covariance -= spread * spread.transpose() / variance;
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
        0.5 * offset * offset / variance
    }
}

#[cfg(test)]
mod tests;
