//! Through the time between two images, where it is long.
//!
//! One mean speed and one turn from an image to the next are an arc. In some seconds a
//! vehicle drives round a corner, which is none: there each line of a log is followed. Where
//! there is none, what braking and turning do in a second they do not go on doing for ten.

use super::Tracker;
use super::believed::Believed;
use crate::Result;
use crate::odometry::{Odometry, OdometryLog};

impl Tracker<'_> {
    /// Follows a log from the last frame on to a time before the next one, seconds, where
    /// that is far off (`unseen.step_s`); returns since when the log is to be asked
    /// for the motion up to that frame, none before the first.
    ///
    /// # Errors
    /// Where the map cannot be read; only a map in memory cannot fail.
    pub fn coast(&mut self, until_s: f64, log: &OdometryLog) -> Result<Option<f64>> {
        let Some(mut at_s) = self.last_time_s else { return Ok(None) };
        for end_s in log.ends_between(at_s, until_s, self.config.unseen.step_s) {
            let shown = log.between(at_s, end_s);
            let rest_s = self.drift(end_s - at_s, shown)?;
            self.roll(rest_s, shown)?;
            at_s = end_s;
        }
        self.last_time_s = Some(at_s);
        Ok(Some(at_s))
    }

    /// Goes through a time of which nothing tells the speed, seconds, as far as poses are
    /// moved on, but for the last step; returns how long that is, seconds.
    pub(super) fn drift(&mut self, dt_s: f64, odometry: Option<Odometry>) -> Result<f64> {
        let step_s = self.config.unseen.step_s;
        if odometry.is_some_and(|shown| shown.tells_speed()) || dt_s <= step_s {
            return Ok(dt_s);
        }
        let moved_s = self.moved_on_s(dt_s, None);
        let steps = (moved_s / step_s).ceil();
        for _ in 1..steps as usize {
            self.roll(moved_s / steps, odometry)?;
        }
        self.untold_s += dt_s - moved_s;
        Ok(moved_s / steps)
    }

    /// Moves on by `dt_s` as the odometry shows, where it is believed.
    fn roll(&mut self, dt_s: f64, shown: Option<Odometry>) -> Result<()> {
        self.map.next_frame()?;
        let moved_s = self.moved_on_s(dt_s, shown.as_ref());
        let odometry = self.believed(moved_s, shown).shown;
        self.since_image_s += moved_s;
        // Whether what nothing tells was long shows once an image comes.
        self.untold_s += if odometry.is_some_and(|shown| shown.tells_speed()) { 0.0 } else { dt_s };
        self.unfollowed_s += moved_s;
        // No image tells which of two is right.
        self.predict(moved_s, &Believed { shown: odometry, usual: odometry });
        self.go_unseen(0.0, dt_s, odometry.as_ref());
        self.follow_region(moved_s, odometry.as_ref(), None)?;
        if let Some((centre, reach)) = self.bank_reach() {
            self.select(&centre, &reach)?;
            self.constrain(moved_s, None);
            self.see_nothing(true);
        }
        Ok(())
    }
}
