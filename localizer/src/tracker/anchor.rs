//! Where a pose would be without what was seen in the last seconds.

use crate::config::Config;
use crate::filter::State;
use crate::odometry::Odometry;
use crate::solver::Prior;

/// A state of some seconds ago, driven on by wheels or by the motion that the images
/// show: no match since then has moved it, so it can bear witness against them. It
/// takes turns with a younger one.
#[derive(Debug, Clone, Default)]
pub(super) struct Anchor {
    older: Option<State>,
    younger: Option<State>,
    /// Time since the younger was taken, seconds.
    since_s: f64,
}

impl Anchor {
    /// Drives on for `dt_s`, from what the state `was` before, where that is to be kept.
    pub fn drive(&mut self, was: Option<&State>, dt_s: f64, odometry: Option<&Odometry>, config: &Config) {
        self.since_s += dt_s;
        if let Some(was) = was
            && (self.younger.is_none() || self.since_s >= config.separation.anchor_s)
        {
            self.older = self.younger.replace(was.clone());
            self.since_s = dt_s;
        }
        for state in self.older.iter_mut().chain(&mut self.younger) {
            *state = state.driven(dt_s, odometry, &config.motion, &config.odometry);
        }
    }

    /// What it says of the pose at a time that is known to a variance; none where it is
    /// too young.
    pub fn prior(&self, time_variance_s2: f64) -> Option<Prior> {
        let older = self.older.as_ref()?;
        let covariance = older.pose_covariance() + older.time_covariance(time_variance_s2);
        Prior::new(older.map_from_camera, &covariance)
    }
}

#[cfg(test)]
mod tests {
    use common::geometry::{Pose, Tangent, local, retract};
    use nalgebra::Matrix6;

    use super::*;

    const DT_S: f64 = 0.1;
    const SPEED_M_S: f64 = 12.0;

    /// The anchor of a way after so many frames, and where that ends: matches hold the
    /// pose on it at first, and 0.4 m to the right of it from the frame `pulled_from` on.
    fn anchored(frames: usize, pulled_from: usize, config: &Config) -> (Anchor, Pose) {
        let (known, velocity) = (Matrix6::identity() * 1e-4, Tangent::new(0.0, 0.0, SPEED_M_S, 0.0, 0.0, 0.0));
        let mut way = State::new(Pose::identity(), &known, velocity, &known, &config.motion, &config.odometry);
        let shown = Odometry::of_wheels(SPEED_M_S, 0.0);
        let mut anchor = Anchor::default();
        for frame in 0..frames {
            let aside = Tangent::x() * if frame >= pulled_from { 0.4 } else { 0.0 };
            let was = way.moved_to(retract(&way.map_from_camera, &aside), &known);
            anchor.drive(Some(&was), DT_S, Some(&shown), config);
            way = way.driven(DT_S, Some(&shown), &config.motion, &config.odometry);
            way.covariance = was.covariance;
        }
        (anchor, way.map_from_camera)
    }

    /// How far to the right of the way the anchor is, metres.
    fn right_m(frames: usize, pulled_from: usize, config: &Config) -> Option<f64> {
        let (anchor, way) = anchored(frames, pulled_from, config);
        anchor.prior(0.0).map(|prior| local(&way, &prior.map_from_camera)[0])
    }

    #[test]
    fn what_was_matched_in_the_last_seconds_does_not_move_it() {
        let config = Config::default();
        let kept = (config.separation.anchor_s / DT_S).round() as usize - 1;
        assert_eq!(right_m(kept, kept, &config), None);
        // Pulled for as long as it is kept, and for three times as long.
        for start in [kept + 2, 2 * kept, 3 * kept + 5] {
            let unmoved_m = right_m(start + kept, start, &config).unwrap();
            assert!(unmoved_m.abs() < 0.01, "{unmoved_m} m");
            let moved_m = right_m(start + 3 * kept, start, &config).unwrap();
            assert!((moved_m - 0.4).abs() < 0.01, "{moved_m} m");
        }
    }
    #[test]
    fn where_times_are_off_it_tells_less_of_how_far_along_it_is() {
        let (anchor, _) = anchored(60, 60, &Config::default());
        let forward_m2 = |time_s: f64| {
            let information = anchor.prior(time_s * time_s).unwrap().information;
            information.try_inverse().unwrap()[(2, 2)]
        };
        let more_m = (forward_m2(0.05) - forward_m2(0.0)).sqrt();
        assert!((more_m - 0.05 * SPEED_M_S).abs() < 0.03, "{more_m} m");
    }
}
