//! The localizer in a vehicle: everything comes when it comes, and each image is
//! answered before the next one.
//!
//! A drive that is told so gives the same poses as [`crate::run::localize`] gives it as a
//! whole, for neither looks ahead.

use std::collections::VecDeque;
use std::time::Instant;

use crate::Result;
use crate::camera::{ScaledCamera, Seen};
use crate::config::Config;
use crate::gps::GpsFix;
use crate::local_map::LocalMap;
use crate::odometry::{Odometry, OdometryConfig, OdometryLog, RunningLog, WheelLines};
use crate::passage::Passage;
use crate::run::{FrameFeatures, FrameResult, Localizer, Method};
use crate::watch::{Sensors, Watcher};

/// A fix is as old as an image but for rounding of the times, seconds.
const ROUNDING_S: f64 = 1e-3;

/// A localizer that is fed with what a vehicle's sensors say.
pub struct LiveLocalizer<'m> {
    localizer: Localizer<'m>,
    odometry: OdometryConfig,
    oldest_fix_s: f64,
    /// What the images say of the motion.
    watcher: Option<Watcher>,
    /// How they sway, for wheels do not say it.
    sway: OdometryLog,
    has_wheels: bool,
    log: RunningLog,
    /// What came since the last image.
    pub received: Received,
    passage: Passage,
}

/// What came from other sensors, and no image has come for yet.
#[derive(Debug, Default)]
pub struct Received {
    wheels: WheelLines,
    /// The last fixes, and their times, seconds, as they came: an image takes a while to
    /// come, and fixes that were taken after it may be here before.
    fixes: VecDeque<(f64, GpsFix)>,
}

/// Fixes that are kept for an image that has not come yet: a second of 100 Hz.
const MOST_FIXES: usize = 100;

impl Received {
    /// The mean motion since the line before, as wheels, m/s, and a gyroscope, rad/s
    /// (positive to the left), say, up to `time_s`; false, and not taken in, where that is
    /// no later than the line before.
    pub fn odometry(&mut self, time_s: f64, speed_m_s: f64, yaw_rate_rad_s: f64) -> bool {
        self.wheels.push(time_s, Odometry::of_wheels(speed_m_s, yaw_rate_rad_s))
    }

    /// A rough position at `time_s`, seconds: an image starts, or is bound, by the last one
    /// that came and was taken before it.
    pub fn gps(&mut self, time_s: f64, fix: GpsFix) {
        if self.fixes.len() >= MOST_FIXES {
            self.fixes.pop_front();
        }
        self.fixes.push_back((time_s, fix));
    }

    /// The last fix that was taken no later than this, and its time, seconds; it and those
    /// that came before it are gone then.
    fn take_fix(&mut self, time_s: f64) -> Option<(f64, GpsFix)> {
        let last = self.fixes.iter().rposition(|(fix_s, _)| *fix_s <= time_s + ROUNDING_S)?;
        self.fixes.drain(..=last).next_back()
    }
}

impl<'m> LiveLocalizer<'m> {
    /// One that knows nothing of its position yet.
    pub fn new(map: &'m mut LocalMap, camera: &ScaledCamera, sensors: Sensors, config: &Config) -> Self {
        let watcher = Watcher::beside(camera, sensors, config);
        let mut config = config.clone();
        if let Some(watcher) = watcher.as_ref().filter(|_| !sensors.wheels) {
            config.odometry = watcher.accuracy;
        }
        Self {
            localizer: Localizer::new(Method::Robust, map, &camera.pinhole, camera.seen_px(), &config),
            odometry: config.odometry,
            oldest_fix_s: config.gps.oldest_s,
            watcher,
            sway: OdometryLog::default(),
            has_wheels: sensors.wheels,
            log: RunningLog::default(),
            received: Received::default(),
            passage: Passage::default(),
        }
    }

    /// The pose at an image: its number, which only comes back with the answer, its time,
    /// seconds, and what it shows. None before the first fix. Times must ascend: an image
    /// no later than the one before is taken as of its time.
    ///
    /// # Errors
    /// Where the map cannot be read; only a map in memory cannot fail.
    pub fn image(&mut self, frame: usize, time_s: f64, seen: Seen) -> Result<Option<FrameResult>> {
        let started = Instant::now();
        self.move_on(time_s, &seen);
        let gps = self.fix_for(time_s);
        let features_ms = seen.features_ms + started.elapsed().as_secs_f64() * 1e3;
        let seen = FrameFeatures { frame, time_s, features: seen.features, maps_ms: seen.maps_ms, features_ms };
        let result = self.localizer.follow(&seen, gps.as_ref(), self.log.log())?;
        // Images that are passed by are gone over again with the next.
        let gone_over_s = self.localizer.gone_over_s().unwrap_or(time_s);
        self.log.forget(gone_over_s);
        self.sway.forget(gone_over_s);
        self.passage.pass(result.as_ref());
        Ok(result)
    }

    /// Takes in how it moved up to an image.
    fn move_on(&mut self, time_s: f64, seen: &Seen) {
        let shown = self.watcher.as_mut().and_then(|watcher| watcher.look(seen, time_s));
        if !self.has_wheels {
            if let Some(shown) = shown {
                self.log.push(shown.began_s, shown.ended_s, shown.mean, &self.odometry);
            }
            return;
        }
        if let Some(shown) = shown {
            self.sway.push(shown.began_s, shown.ended_s, shown.mean);
        }
        self.received.wheels.tell(time_s, |began_s, ended_s, mean| {
            let sway_rad_s = self.sway.between(began_s, ended_s).and_then(|shown| shown.sway_rad_s);
            self.log.push(began_s, ended_s, Odometry { sway_rad_s, ..mean }, &self.odometry);
        });
    }

    /// The last fix that was taken before an image, moved on to its time; none where that is
    /// too old.
    fn fix_for(&mut self, time_s: f64) -> Option<GpsFix> {
        let (fix_s, fix) = self.received.take_fix(time_s)?;
        let age_s = (time_s - fix_s).max(0.0);
        (age_s <= self.oldest_fix_s).then(|| self.passage.moved_on(GpsFix { age_s, ..fix }))
    }
}

#[cfg(test)]
mod tests;
