//! Two beliefs made one.

use common::geometry::{local, retract};

use super::{ACCELERATION, BIAS, HEIGHT, LEVER, MOUNTING, REST, REST_PITCH, REST_ROLL, SCALE, STATES, State, VectorN};

impl State {
    /// Becomes mean and covariance of a mixture of this belief and another, which has
    /// `share` of it: `x + s d` and `(1 - s) P + s Q + s (1 - s) d d'`, where the other is `d`
    /// away (Salmond, "Mixture reduction algorithms for target tracking in clutter", 1990).
    pub fn mix(&mut self, other: &Self, share: f64) {
        let off = self.off(other);
        self.covariance = self.covariance * (1.0 - share)
            + other.covariance * share
            + off * off.transpose() * (share * (1.0 - share));
        let shift = off * share;
        self.map_from_camera = retract(&self.map_from_camera, &shift.fixed_rows::<6>(0).into_owned());
        self.shift_rest(&shift.fixed_rows::<REST>(6).into_owned());
    }

    /// How far another belief's mean is from this one's.
    fn off(&self, other: &Self) -> VectorN {
        let mut off = VectorN::zeros();
        off.fixed_rows_mut::<6>(0).copy_from(&local(&self.map_from_camera, &other.map_from_camera));
        off.fixed_rows_mut::<6>(6).copy_from(&(other.velocity - self.velocity));
        let rest: [(usize, f64, f64); STATES - 12] = [
            (SCALE, self.wheel_scale, other.wheel_scale),
            (BIAS, self.yaw_bias_rad_s, other.yaw_bias_rad_s),
            (LEVER, self.lever_m, other.lever_m),
            (MOUNTING, self.mounting_rad, other.mounting_rad),
            (HEIGHT, self.higher_m, other.higher_m),
            (REST_PITCH, self.rest_rad[0], other.rest_rad[0]),
            (REST_ROLL, self.rest_rad[1], other.rest_rad[1]),
            (ACCELERATION, self.acceleration_m_s2, other.acceleration_m_s2),
        ];
        for (i, own, its) in rest {
            off[i] = its - own;
        }
        off
    }
}

#[cfg(test)]
mod tests {
    use common::geometry::{Pose, Tangent};
    use nalgebra::Matrix6;

    use super::super::{FORWARD, MotionConfig};
    use super::*;
    use crate::odometry::OdometryConfig;

    fn state(forward_m: f64, speed_m_s: f64, wheel_scale: f64) -> State {
        let known = Matrix6::identity() * 0.01;
        let pose = retract(&Pose::identity(), &(Tangent::z() * forward_m));
        let velocity = Tangent::z() * speed_m_s;
        let (motion, odometry) = (MotionConfig::default(), OdometryConfig::default());
        State { wheel_scale, ..State::new(pose, &known, velocity, &known, &motion, &odometry) }
    }

    #[test]
    fn two_as_probable_meet_half_way_and_are_as_uncertain_as_they_are_apart() {
        let (mut mixed, other) = (state(0.0, 9.0, 0.0), state(0.4, 10.0, 0.02));
        mixed.mix(&other, 0.5);
        assert!((mixed.map_from_camera.translation.z - 0.2).abs() < 1e-12);
        assert!((mixed.velocity[2] - 9.5).abs() < 1e-12 && (mixed.wheel_scale - 0.01).abs() < 1e-12);
        assert!((mixed.covariance[(2, 2)] - (0.01 + 0.2 * 0.2)).abs() < 1e-12);
        // Who is ahead is faster, or as the other says.
        assert!((mixed.covariance[(2, FORWARD)] - 0.25 * 0.4).abs() < 1e-12);
    }

    #[test]
    fn either_alone_is_left_as_it_is() {
        let (own, other) = (state(0.0, 9.0, 0.0), state(0.4, 10.0, 0.02));
        let (mut none, mut all) = (own.clone(), own.clone());
        none.mix(&other, 0.0);
        all.mix(&other, 1.0);
        assert!(own.off(&none).norm() < 1e-12 && other.off(&all).norm() < 1e-12);
        assert!((none.covariance - own.covariance).norm() < 1e-12);
        assert!((all.covariance - other.covariance).norm() < 1e-12);
    }
}
