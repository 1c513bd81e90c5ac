//! Images of a camera that takes more of them than tell anything new.
//!
//! What a network takes for a post in one image it takes for one in the next, 30 ms later: such
//! errors are not independent, and whoever counts them as if they were is sure of what is wrong.

use common::geometry::Pose;
use nalgebra::Matrix6;

use super::{ClockConfig, FrameInput, Tracker};
use crate::estimate::PoseEstimate;
use crate::gps::GpsFix;
use crate::pace::Pace;

/// Which images are gone through, and what came with the others.
#[derive(Debug, Default)]
pub(super) struct Choice {
    /// How often images come.
    pace: Pace,
    /// When the last one came, seconds.
    last_s: Option<f64>,
    /// When the last one that was gone through came, seconds.
    gone_through_s: Option<f64>,
    /// The pose of that, and its covariance, once one was passed by.
    said: Option<(Pose, Matrix6<f64>)>,
    /// The last fix of those that were passed by, and when they came, seconds.
    fix: Option<(f64, GpsFix)>,
}

impl Choice {
    /// Whether an image is passed by, for its camera takes them so often, and it comes so soon
    /// after the last that was not (`clock.nearest_s`).
    pub(super) fn passes_by(&mut self, time_s: f64, config: &ClockConfig) -> bool {
        if let Some(last_s) = self.last_s.replace(time_s) {
            self.pace.tick(time_s - last_s);
        }
        let is_fast = self.pace.usual_s().is_some_and(|usual_s| usual_s < config.nearest_s);
        // A clock that is set back must not make all that follow too soon.
        let is_soon = self.gone_through_s.is_some_and(|last_s| (0.0..config.nearest_s).contains(&(time_s - last_s)));
        if !(is_fast && is_soon) {
            self.gone_through_s = Some(time_s);
            self.said = None;
        }
        is_fast && is_soon
    }
}

impl Tracker<'_> {
    /// The pose to which the motion leads up to an image that is passed by, `dt_s` after the
    /// last that was not: nothing of it is matched, and nothing of what is tracked is moved.
    pub(super) fn pass_by(&mut self, dt_s: f64, input: &FrameInput<'_>) -> Option<&PoseEstimate> {
        if let Some(fix) = input.gps {
            self.choice.fix = Some((input.time_s, *fix));
        }
        // What is not believed of this time is asked again with the next image.
        let doubts = self.doubts;
        let odometry = self.believed(dt_s, input.odometry).shown;
        self.doubts = doubts;
        let state = &self.bank.first()?.state;
        let driven = state.driven(dt_s, odometry.as_ref(), &self.config.motion, &self.config.odometry);
        let said = self.said.as_mut()?;
        let (pose, covariance) = *self.choice.said.get_or_insert((said.map_from_camera, said.covariance));
        let grown = covariance + driven.pose_covariance() - state.pose_covariance();
        said.map_from_camera = pose * state.map_from_camera.inverse() * driven.map_from_camera;
        said.covariance = if grown.cholesky().is_some() { grown } else { covariance };
        said.correspondences.clear();
        (said.residual_rms_px, said.iterations) = (0.0, 0);
        Some(said)
    }

    /// The fix of an image, or else the last one of those before it that were passed by, moved
    /// on as the best hypothesis goes.
    pub(super) fn fix_for(&mut self, input: &FrameInput<'_>) -> Option<GpsFix> {
        let passed = self.choice.fix.take();
        input.gps.copied().or_else(|| {
            let (time_s, fix) = passed?;
            let state = &self.bank.first()?.state;
            let velocity_map = state.map_from_camera.rotation * state.velocity.fixed_rows::<3>(0).into_owned();
            Some(GpsFix { age_s: input.time_s - time_s, ..fix }.moved_on(&velocity_map))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many of a hundred images at such times are gone through.
    fn gone_through(time_s: impl Fn(usize) -> f64) -> usize {
        let mut choice = Choice::default();
        (0..100).filter(|i| !choice.passes_by(time_s(*i), &ClockConfig::default())).count()
    }

    #[test]
    fn of_a_fast_camera_ten_images_a_second_are_gone_through() {
        for (rate_hz, every) in [(30.0, 3), (20.0, 2), (60.0, 5), (15.0, 2)] {
            let count = gone_through(|i| i as f64 / rate_hz);
            assert!(count.abs_diff(100 / every) <= 3, "{rate_hz} Hz: {count}");
        }
        // One whose clock is set back by an hour.
        let count = gone_through(|i| i as f64 / 30.0 - if i < 50 { 0.0 } else { 3600.0 });
        assert!(count.abs_diff(33) <= 4, "{count}");
        // One of 10 Hz, of which the times are off by 30 ms in turn, and one of 2 Hz.
        let off = |i: usize| if i.is_multiple_of(2) { 0.03 } else { -0.03 };
        assert_eq!(gone_through(|i| i as f64 * 0.1 + off(i)), 100);
        assert_eq!(gone_through(|i| i as f64 * 0.5), 100);
    }
}
