//! The localizer in a vehicle: everything comes when it comes, and each image is
//! answered before the next one.
//!
//! A drive that is told so gives the same poses as [`crate::run::localize`] gives it as a
//! whole, for neither looks ahead.

use std::time::Instant;

use nalgebra::{Point3, Vector3};

use crate::Result;
use crate::camera::{ScaledCamera, Seen};
use crate::config::Config;
use crate::estimate::Status;
use crate::gps::GpsFix;
use crate::local_map::LocalMap;
use crate::odometry::{Odometry, OdometryConfig, OdometryLog, RunningLog, WheelLines};
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
    before: Option<Before>,
}

/// What came from other sensors, and no image has come for yet.
#[derive(Debug, Default)]
pub struct Received {
    wheels: WheelLines,
    /// The last fix, and its time, seconds.
    fix: Option<(f64, GpsFix)>,
}

impl Received {
    /// The mean motion since the line before, as wheels, m/s, and a gyroscope, rad/s
    /// (positive to the left), say, up to `time_s`; false, and not taken in, where that is
    /// no later than the line before.
    pub fn odometry(&mut self, time_s: f64, speed_m_s: f64, yaw_rate_rad_s: f64) -> bool {
        self.wheels.push(time_s, Odometry::of_wheels(speed_m_s, yaw_rate_rad_s))
    }

    /// A rough position at `time_s`, seconds: the next image that is no older starts, or is
    /// bound, by the last that came.
    pub fn gps(&mut self, time_s: f64, fix: GpsFix) {
        self.fix = Some((time_s, fix));
    }
}

/// Where the camera was, and how it moved there.
#[derive(Debug, Clone, Copy)]
struct Before {
    time_s: f64,
    position_map: Point3<f64>,
    /// Since the image before, metres per second.
    velocity_map: Vector3<f64>,
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
            before: None,
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
        self.log.forget(time_s);
        self.sway.forget(time_s);
        self.before = result.as_ref().and_then(|result| self.now(result));
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

    /// The last fix that came, moved on to the time of an image; none where it is later
    /// than that, or too old.
    fn fix_for(&mut self, time_s: f64) -> Option<GpsFix> {
        let (fix_s, fix) = self.received.fix.take_if(|(fix_s, _)| *fix_s <= time_s + ROUNDING_S)?;
        let age_s = (time_s - fix_s).max(0.0);
        let moved_m = self.before.map_or_else(Vector3::zeros, |before| before.velocity_map * age_s);
        (age_s <= self.oldest_fix_s).then(|| GpsFix { position_map: fix.position_map + moved_m, ..fix })
    }

    /// Where it is, and how it moved there; none where that is not known.
    fn now(&self, result: &FrameResult) -> Option<Before> {
        let FrameResult { time_s, estimate, .. } = result;
        if estimate.status == Status::Lost {
            return None;
        }
        let position_map = Point3::from(estimate.map_from_camera.translation.vector);
        let velocity_map = match self.before {
            Some(before) if *time_s > before.time_s => (position_map - before.position_map) / (time_s - before.time_s),
            Some(before) => before.velocity_map,
            None => Vector3::zeros(),
        };
        Some(Before { time_s: *time_s, position_map, velocity_map })
    }
}

#[cfg(test)]
mod tests;
