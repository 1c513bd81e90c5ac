//! What is known of the motion besides the images: wheels and gyroscope, the
//! axle that does not steer, how well times are kept, the height over the road.

use nalgebra::Matrix6;

use super::{BIAS, FORWARD, HEIGHT, LEVER, MOUNTING, MotionConfig, RIGHT, SCALE, State, VectorN, YAW_RATE};
use crate::odometry::{Odometry, OdometryConfig};

/// Least height of a camera as a share of the one that it was taken to have: lower it
/// is no longer told from one that lies on the road.
const LEAST_OF_HEIGHT: f64 = 0.1;

impl State {
    /// The belief `dt_s` later, between which the odometry showed a mean
    /// motion, if there is one: `z = v (1 + s)` of the wheels, of images that of a
    /// camera at height `h`, `z = v (1 + s) h / (h + higher)`; `z = b - w` of the
    /// gyroscope, whose left is the camera's negative turn about down.
    #[must_use]
    pub fn driven(
        &self,
        dt_s: f64,
        odometry: Option<&Odometry>,
        motion: &MotionConfig,
        config: &OdometryConfig,
    ) -> Self {
        let Some(shown) = odometry else { return self.predicted(dt_s, motion) };
        let mut state = self.clone();
        let mut surprise = 0.0;
        state.speed_up(dt_s, motion);
        // The mean of this stretch is not the mean of the one before.
        state.covariance[(YAW_RATE, YAW_RATE)] += motion.yaw.walk * motion.yaw.walk * dt_s;
        let share = config.drift_per_minute * config.drift_per_minute * dt_s / 60.0;
        state.covariance[(SCALE, SCALE)] += share * config.scale_sigma * config.scale_sigma;
        state.covariance[(BIAS, BIAS)] += share * config.yaw_bias_sigma_rad_s * config.yaw_bias_sigma_rad_s;
        if let Some(shown_m_s) = shown.speed_m_s {
            state.covariance[(FORWARD, FORWARD)] += motion.forward.walk * motion.forward.walk * dt_s;
            let mut row = VectorN::zeros();
            let per_height = state.shown_share(config);
            row[FORWARD] = (1.0 + state.wheel_scale) * per_height;
            row[SCALE] = state.velocity[2] * per_height;
            let expected_m_s = state.velocity[2] * row[FORWARD];
            if config.seen_from_m > 0.0 {
                row[HEIGHT] = -expected_m_s * per_height / config.seen_from_m;
            }
            let sigma_m_s = config.sigma_of(shown_m_s, shown.yaw_rate_rad_s);
            surprise += state.absorb(&row, shown_m_s - expected_m_s, sigma_m_s);
        }
        let mut row = VectorN::zeros();
        row[YAW_RATE] = -1.0;
        row[BIAS] = 1.0;
        let expected_rad_s = state.yaw_bias_rad_s - state.velocity[4];
        surprise += state.absorb(&row, shown.yaw_rate_rad_s - expected_rad_s, config.yaw_rate_sigma_rad_s);
        let sway_rad_s = shown.sway_rad_s.filter(|shown_rad_s| state.sway(dt_s, *shown_rad_s, motion, config));
        state.move_on(dt_s, &motion.driven(&Odometry { sway_rad_s, ..*shown }));
        state.swayed_rad = sway_rad_s.map(|rad_s| rad_s.map(|rad_s| rad_s * dt_s));
        state.roll_on_wheels(dt_s, motion);
        state.surprise += surprise;
        state
    }

    /// The share of its way that is shown: all of it by wheels, by images what a camera
    /// of the height that was taken for its own would have gone.
    pub fn shown_share(&self, config: &OdometryConfig) -> f64 {
        let taken_m = config.seen_from_m;
        if taken_m > 0.0 { taken_m / (taken_m + self.higher_m).max(LEAST_OF_HEIGHT * taken_m) } else { 1.0 }
    }

    /// Takes in that an axle that does not steer goes where it points: the
    /// camera's velocity to the right is that of the lever's turning and of
    /// the mounting, but for slip. It is the mean over the last `dt_s`, along the
    /// chord of the arc, in the axes of its beginning, against which the vehicle had
    /// half turned: `v_x = l w + (m + w dt / 2) v_z`.
    pub(super) fn roll_on_wheels(&mut self, dt_s: f64, motion: &MotionConfig) {
        let (speed_m_s, turn_rad_s) = (self.velocity[2], self.velocity[4]);
        let ahead_m = self.ahead_m(dt_s);
        let mut row = VectorN::zeros();
        row[RIGHT] = 1.0;
        row[YAW_RATE] = -ahead_m;
        row[LEVER] = -turn_rad_s;
        row[FORWARD] = -self.mounting_rad - 0.5 * dt_s * turn_rad_s;
        row[MOUNTING] = -speed_m_s;
        let expected_m_s = self.rolled_m_s(dt_s);
        let sigma_m_s = motion.slip_sigma_m_s.hypot(motion.slip_sigma_rad * speed_m_s);
        self.surprise += self.absorb(&row, expected_m_s - self.velocity[0], sigma_m_s);
    }

    /// How far ahead of the axle what the camera moves in `dt_s` turns about, metres.
    fn ahead_m(&self, dt_s: f64) -> f64 {
        self.lever_m + 0.5 * dt_s * self.velocity[2]
    }

    /// The velocity to the right of a camera whose axle goes where it points, m/s.
    pub(super) fn rolled_m_s(&self, dt_s: f64) -> f64 {
        self.ahead_m(dt_s) * self.velocity[4] + self.mounting_rad * self.velocity[2]
    }

    /// How far the pose is astray for the time being known to `variance_s2`
    /// only: `t` later it is `v t` further.
    pub fn time_covariance(&self, variance_s2: f64) -> Matrix6<f64> {
        self.velocity * self.velocity.transpose() * variance_s2
    }

    /// Takes in that the time since the last image is known to `variance_s2`
    /// only.
    pub fn doubt_time(&mut self, variance_s2: f64) {
        let astray = self.time_covariance(variance_s2);
        let mut pose = self.covariance.fixed_view_mut::<6, 6>(0, 0);
        pose += astray;
    }

    /// Takes in that the survey's camera stood `below_m` below this one in this
    /// place, known to `sigma_m`, but for what the camera always is higher.
    pub fn measure_height(&mut self, below_m: f64, sigma_m: f64) {
        let mut row = VectorN::zeros();
        row[1] = 1.0;
        row[HEIGHT] = 1.0;
        self.surprise += self.absorb(&row, below_m - self.higher_m, sigma_m);
    }
}

#[cfg(test)]
mod tests {
    use common::geometry::{Tangent, local, retract};
    use nalgebra::Matrix6;

    use super::super::tests::state;
    use super::*;

    #[test]
    fn wheels_and_gyroscope_carry_on_in_the_dark_and_are_calibrated_in_the_light() {
        let (motion, config) = (MotionConfig::default(), OdometryConfig::default());
        // The wheels show 1.5 % too much, the gyroscope 0.008 rad/s.
        let shown = Odometry::of_wheels(12.0 * 1.015, 0.008 - 0.2);
        let mut truth = state();
        truth.velocity[0] = 0.0;
        let mut filter = truth.clone();
        let mut frame = |filter: &mut State, is_seen: bool| {
            truth.map_from_camera = retract(&truth.map_from_camera, &(truth.velocity * 0.1));
            *filter = filter.driven(0.1, Some(&shown), &motion, &config);
            if is_seen {
                filter.update(&truth.map_from_camera, &(Matrix6::identity() * 1e-4));
            }
            local(&truth.map_from_camera, &filter.map_from_camera)
        };
        for _ in 0..100 {
            frame(&mut filter, true);
        }
        assert!((filter.wheel_scale - 0.015).abs() < 0.005, "{}", filter.wheel_scale);
        assert!((filter.yaw_bias_rad_s - 0.008).abs() < 0.003, "{}", filter.yaw_bias_rad_s);
        let mut blind = filter.clone();
        let mut off = Tangent::zeros();
        for _ in 0..20 {
            off = frame(&mut filter, false);
            blind = blind.predicted(0.1, &motion);
        }
        let sigma_m = filter.covariance[(2, 2)].sqrt();
        assert!(off[2].abs() < 3.0 * sigma_m && sigma_m < 0.2, "{} of {sigma_m}", off[2]);
        assert!(blind.covariance[(2, 2)] > 25.0 * filter.covariance[(2, 2)]);
    }

    #[test]
    fn a_vehicle_goes_where_its_axle_points_once_lever_and_mounting_are_known() {
        let motion = MotionConfig::default();
        let mut filter = state();
        filter.velocity = Tangent::new(0.0, 0.0, 12.0, 0.0, 0.3, 0.0);
        let (mut turning, mut truth) = (filter.clone(), filter.map_from_camera);
        // The camera is 1.0 m ahead of the axle, and squints by 0.01 rad; the chord of
        // 0.1 s begins half of the turn beside the axle.
        let ahead_m = |lever_m: f64| lever_m + 0.5 * 0.1 * 12.0;
        let twist = Tangent::new(0.3 * ahead_m(1.0) + 0.01 * 12.0, 0.0, 12.0, 0.0, 0.3, 0.0);
        for _ in 0..200 {
            truth = retract(&truth, &(twist * 0.1));
            turning = turning.predicted(0.1, &motion);
            turning.update(&truth, &(Matrix6::identity() * 1e-4));
        }
        // A bend tells their sum.
        let sideways_m_s = ahead_m(turning.lever_m) * 0.3 + turning.mounting_rad * 12.0;
        assert!((sideways_m_s - twist[0]).abs() < 0.05, "{sideways_m_s}");
        assert!(turning.surprise < 1.0, "{}", turning.surprise);
        // Sliding on at 2 m/s more is nothing that a vehicle does.
        let slide = retract(&truth, &((twist + Tangent::x() * 2.0) * 0.1));
        let expected = turning.predicted(0.1, &motion);
        let off_m = local(&expected.map_from_camera, &slide)[0];
        let sigma_m = expected.covariance[(0, 0)].sqrt();
        assert!(off_m > 5.0 * sigma_m, "{off_m} m of {sigma_m} m");
    }

    #[test]
    fn a_corner_ends_in_the_same_place_in_long_steps_and_in_short_ones() {
        let (motion, config) = (MotionConfig::default(), OdometryConfig::default());
        let (speed_m_s, turn_rad_s, lever_m) = (6.0, 0.4, motion.lever_m);
        let shown = Odometry::of_wheels(speed_m_s, -turn_rad_s);
        // From the camera back to the axle, which drives an arc, and to the camera again.
        let axle = Tangent::new(0.0, 0.0, speed_m_s, 0.0, turn_rad_s, 0.0);
        let ahead = Tangent::new(0.0, 0.0, lever_m, 0.0, 0.0, 0.0);
        let begin = state();
        let mut truth = retract(&begin.map_from_camera, &-ahead);
        for _ in 0..3000 {
            truth = retract(&truth, &(axle * 1e-3));
        }
        truth = retract(&truth, &ahead);
        for (dt_s, most_m) in [(0.1, 0.1), (0.5, 0.5)] {
            let mut filter = begin.clone();
            filter.velocity = axle;
            filter.velocity[0] = filter.rolled_m_s(dt_s);
            for _ in 0..(3.0 / dt_s) as usize {
                filter = filter.driven(dt_s, Some(&shown), &motion, &config);
            }
            let off = local(&truth, &filter.map_from_camera);
            assert!(off.norm() < most_m, "{dt_s} s: {off}");
        }
    }

    #[test]
    fn how_much_higher_the_camera_stands_is_learned() {
        let mut filter = state();
        for _ in 0..50 {
            let seen = filter.map_from_camera;
            filter.measure_height(0.12, 0.1);
            filter.update(&seen, &(Matrix6::identity() * 1e-4));
        }
        assert!((filter.higher_m - 0.12).abs() < 0.03, "{}", filter.higher_m);
    }

    #[test]
    fn images_of_a_higher_camera_show_less_of_the_way_and_teach_the_height() {
        let motion = MotionConfig::default();
        let config = OdometryConfig { seen_from_m: 1.65, ..OdometryConfig::default() };
        let mut higher = state();
        higher.velocity = Tangent::new(0.0, 0.0, 12.0, 0.0, 0.0, 0.0);
        let mut unaware = higher.clone();
        higher.higher_m = 0.65;
        assert!((higher.shown_share(&config) - 1.65 / 2.3).abs() < 1e-12);
        assert!((higher.shown_share(&OdometryConfig::default()) - 1.0).abs() < 1e-12);
        // However low, nothing turns round or to infinity.
        assert!((State { higher_m: -5.0, ..higher.clone() }.shown_share(&config) - 10.0).abs() < 1e-9);
        let shown = Odometry::of_wheels(12.0 * 1.65 / 2.3, 0.0);
        let driven = higher.driven(0.1, Some(&shown), &motion, &config);
        assert!((driven.velocity[2] - 12.0).abs() < 0.05 && driven.surprise < 0.1, "{}", driven.velocity[2]);
        // Who sees where it goes learns from that how high it sits.
        let mut truth = unaware.map_from_camera;
        for _ in 0..100 {
            truth = retract(&truth, &(Tangent::z() * 1.2));
            unaware = unaware.driven(0.1, Some(&shown), &motion, &config);
            unaware.update(&truth, &(Matrix6::identity() * 1e-4));
        }
        assert!(unaware.higher_m > 0.3, "{}", unaware.higher_m);
        assert!((unaware.velocity[2] - 12.0).abs() < 0.1, "{}", unaware.velocity[2]);
    }

    #[test]
    fn a_camera_that_looks_down_moves_up_in_its_own_axes_for_as_long_as_it_drives() {
        let motion = MotionConfig::default();
        let mut filter = state();
        filter.rest_rad[0] = -0.17;
        let along = Tangent::new(0.0, -12.0 * 0.17_f64.sin(), 12.0 * 0.17_f64.cos(), 0.0, 0.0, 0.0);
        filter.velocity = along;
        let mut truth = filter.map_from_camera;
        for _ in 0..10 {
            truth = retract(&truth, &(along * 0.1));
            filter = filter.predicted(0.1, &motion);
        }
        // 12 m further on; in a second the rest is forgotten by a tenth.
        let off = local(&truth, &filter.map_from_camera);
        assert!(off[1].abs() < 0.15, "{off}");
    }
}
