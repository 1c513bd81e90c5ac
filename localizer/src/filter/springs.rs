//! How the camera sways on the springs of the vehicle, as these do and as images show.

use common::geometry::{Tangent, retract};

use super::{MotionConfig, PITCH_RATE, REST_PITCH, REST_ROLL, ROLL_RATE, State, VectorN, kept_after};
use crate::odometry::OdometryConfig;

impl State {
    /// Takes in how the camera pitched and rolled on the average over `dt_s`, and whether
    /// that is believed: vehicles sway alike wherever they are, so what was not expected
    /// speaks against no pose, and what no spring does, images that show little say.
    pub(super) fn sway(
        &mut self,
        dt_s: f64,
        shown_rad_s: [f64; 2],
        motion: &MotionConfig,
        config: &OdometryConfig,
    ) -> bool {
        let axes = [(PITCH_RATE, motion.pitch, shown_rad_s[0]), (ROLL_RATE, motion.roll, shown_rad_s[1])];
        let off_rad_s = |state: &Self, rate: usize, rad_s: f64| rad_s - state.velocity[rate - 6];
        let is_believed = axes.iter().all(|&(rate, axis, rad_s)| {
            let variance = self.covariance[(rate, rate)] + axis.walk * axis.walk * dt_s;
            let sigma_rad_s = variance.max(0.0).sqrt().hypot(config.sway_sigma_rad_s);
            off_rad_s(self, rate, rad_s).abs() <= config.believed_sigmas * sigma_rad_s
        });
        for (rate, axis, rad_s) in axes.into_iter().filter(|_| is_believed) {
            self.covariance[(rate, rate)] += axis.walk * axis.walk * dt_s;
            let mut row = VectorN::zeros();
            row[rate] = 1.0;
            self.absorb(&row, off_rad_s(self, rate, rad_s), config.sway_sigma_rad_s);
        }
        is_believed
    }

    /// What springs took back in the last `dt_s`. `level_rad` is by how much
    /// pitch and roll of a level camera on the survey's path are more than
    /// this one's: `p' = p + (1 - k) (level + rest)`, `k` what is kept. Where it was
    /// shown how the camera swayed, that is in it, and says where the springs rest.
    pub fn spring_back(&mut self, dt_s: f64, level_rad: [f64; 2], motion: &MotionConfig) {
        let kept = kept_after(dt_s, motion.spring_s);
        let axes = [(3, REST_PITCH, motion.pitch), (5, REST_ROLL, motion.roll)];
        if let Some(swayed_rad) = self.swayed_rad {
            for (i, (swaying, resting, axis)) in axes.into_iter().enumerate() {
                // Before it swayed, a level camera's were more by that.
                let off_rad = level_rad[i] + self.rest_rad[i] + swayed_rad[i];
                let mut row = VectorN::zeros();
                row[swaying] = kept - 1.0;
                row[resting] = 1.0 - kept;
                // How far a sway wanders in that time whose rate is forgotten.
                let sigma_rad = axis.walk * axis.memory_s * dt_s.max(1e-3).sqrt();
                self.absorb(&row, swayed_rad[i] - (1.0 - kept) * off_rad, sigma_rad);
            }
            return;
        }
        let mut back = Tangent::zeros();
        for (i, (swaying, resting, _)) in axes.into_iter().enumerate() {
            back[swaying] = (1.0 - kept) * (level_rad[i] + self.rest_rad[i]);
            self.sharpen(swaying, kept);
            self.take_along(swaying, resting, 1.0 - kept);
        }
        self.map_from_camera = retract(&self.map_from_camera, &back);
    }
}

#[cfg(test)]
mod tests {
    use common::geometry::{Tangent, local};
    use nalgebra::Matrix6;

    use super::super::tests::state;
    use super::*;
    use crate::odometry::Odometry;

    /// One frame of a camera that lies turned by `off` against a level one.
    fn sway(filter: &State, off: &Tangent, motion: &MotionConfig) -> State {
        let mut next = filter.predicted(0.1, motion);
        next.spring_back(0.1, [-off[3], -off[5]], motion);
        next
    }

    #[test]
    fn a_sway_dies_out_and_its_uncertainty_stays_bounded() {
        let motion = MotionConfig::default();
        let level = state();
        let mut filter = level.clone();
        filter.velocity = Tangent::zeros();
        filter.map_from_camera = retract(&level.map_from_camera, &(Tangent::ith(3, 0.03) + Tangent::ith(5, -0.02)));
        for _ in 0..30 {
            let off = local(&level.map_from_camera, &filter.map_from_camera);
            filter = sway(&filter, &off, &motion);
        }
        let off = local(&level.map_from_camera, &filter.map_from_camera);
        assert!(off[3].abs() < 0.002 && off[5].abs() < 0.002, "{off}");
        let sigma_rad = filter.covariance[(3, 3)].sqrt();
        // A sway of 0.6 degrees about a rest that may be off by 1.5.
        assert!(sigma_rad > 0.01 && sigma_rad < 0.035, "{sigma_rad}");
        assert!(nalgebra::Cholesky::new(filter.covariance).is_some());
    }

    #[test]
    fn a_sway_that_is_shown_is_followed_and_tells_where_the_springs_rest() {
        let (motion, config) = (MotionConfig::default(), OdometryConfig::default());
        let level = state();
        let run = |is_shown: bool| {
            let mut filter = level.clone();
            filter.velocity = Tangent::zeros();
            filter.measure(3, 0.0, 1e-3);
            let mut truth_rad = 0.0;
            // Nods once a second about a rest 0.02 up.
            for i in 1..=20 {
                let next_rad = 0.02 * (1.0 - (-f64::from(i) * 0.2).exp()) + 0.01 * (f64::from(i) * 0.628).sin();
                let sway_rad_s = is_shown.then_some([(next_rad - truth_rad) / 0.1, 0.0]);
                truth_rad = next_rad;
                let shown = Odometry { sway_rad_s, ..Odometry::of_wheels(0.0, 0.0) };
                filter = filter.driven(0.1, Some(&shown), &motion, &config);
                let off = local(&level.map_from_camera, &filter.map_from_camera);
                filter.spring_back(0.1, [-off[3], -off[5]], &motion);
            }
            let off_rad = local(&level.map_from_camera, &filter.map_from_camera)[3] - truth_rad;
            (off_rad.abs(), filter.covariance[(3, 3)].sqrt(), filter.rest_rad[0])
        };
        let ((off_rad, sigma_rad, rest_rad), (unseen_rad, unseen_sigma_rad, _)) = (run(true), run(false));
        assert!(off_rad < 0.002 && off_rad < 0.2 * unseen_rad, "{off_rad} {unseen_rad}");
        assert!(sigma_rad < 0.4 * unseen_sigma_rad && sigma_rad > off_rad, "{sigma_rad} {unseen_sigma_rad}");
        assert!((0.005..0.03).contains(&rest_rad), "{rest_rad}");
    }

    #[test]
    fn a_sway_that_no_spring_does_is_not_believed() {
        let (motion, config) = (MotionConfig::default(), OdometryConfig::default());
        let driven = |sway_rad_s| {
            let shown = Odometry { sway_rad_s, ..Odometry::of_wheels(12.0, 0.0) };
            State { velocity: Tangent::z() * 12.0, ..state() }.driven(0.1, Some(&shown), &motion, &config)
        };
        let springs_alone = driven(None);
        assert!(driven(Some([0.05, 0.0])) != springs_alone);
        for refused_rad_s in [[3.0, 0.0], [0.0, -3.0], [f64::MAX, 0.0]] {
            assert!(driven(Some(refused_rad_s)) == springs_alone, "{refused_rad_s:?}");
        }
    }

    #[test]
    fn a_camera_that_looks_down_all_along_teaches_the_rest() {
        let motion = MotionConfig::default();
        let level = state();
        let seen = retract(&level.map_from_camera, &Tangent::ith(3, -0.02));
        let mut filter = level.clone();
        filter.velocity = Tangent::zeros();
        for _ in 0..50 {
            let off = local(&level.map_from_camera, &filter.map_from_camera);
            filter = sway(&filter, &off, &motion);
            filter.update(&seen, &(Matrix6::identity() * 1e-6));
        }
        assert!((filter.rest_rad[0] + 0.02).abs() < 0.006, "{}", filter.rest_rad[0]);
        assert!(filter.rest_rad[1].abs() < 0.002, "{}", filter.rest_rad[1]);
    }
}
