//! All images of a drive, one after the other: what each shows, and how the
//! camera moved between them.

use std::borrow::Cow;
use std::path::Path;
use std::time::Instant;

use crate::Result;
use crate::config::Config;
use crate::drive::{Drive, Seen, Source};
use crate::odometry::{OdometryConfig, OdometryLog};
use crate::run::FrameFeatures;
use crate::vision::Plane;
use crate::visual_odometry::VisualOdometer;

/// What the images of a drive show.
#[derive(Debug, Clone, PartialEq)]
pub struct Watched {
    /// What each frame shows.
    pub frames: Vec<FrameFeatures>,
    /// How the camera moved, where the images say so.
    pub motion: MotionOfImages,
}

/// How the camera moved, as the images say.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MotionOfImages {
    /// What they say.
    pub log: OdometryLog,
    /// How well they know it.
    pub accuracy: OdometryConfig,
}

/// What is known of the motion: what a log of wheels says, and of pitch and roll the
/// images; all of it the images where there is none, who set how well in the settings.
pub fn odometry(wheels: Option<OdometryLog>, images: &MotionOfImages, config: &mut Config) -> OdometryLog {
    if images.log.is_empty() {
        return wheels.unwrap_or_default();
    }
    let Some(wheels) = wheels else {
        config.odometry = images.accuracy;
        return images.log.clone();
    };
    wheels.swaying_as(&images.log)
}

/// Looks at frames of a drive, in their order; `seen` is called for each. Where wheels
/// tell the motion, label images are not asked for it: beside those, what they say of
/// pitch and roll made poses no better.
///
/// # Errors
/// As [`Drive::see`], and what `seen` says.
pub fn watch(
    drive: &Drive,
    frames: impl IntoIterator<Item = usize, IntoIter: Send>,
    source: &Source,
    has_wheels: bool,
    config: &Config,
    mut seen: impl FnMut(usize, &Seen) -> Result<()>,
) -> Result<Watched> {
    let moves_by_images = drive.moves_by_images();
    let is_on = config.visual_odometry.is_on && (moves_by_images || !has_wheels);
    let mut watcher = is_on.then(|| Watcher::new(drive, !moves_by_images, config));
    let mut seen_frames = Vec::new();
    drive.see_all(frames, source, &config.vision, |frame, found| {
        seen(frame, &found)?;
        let time_s = drive.times_s[frame];
        let started = Instant::now();
        if let Some(watcher) = &mut watcher {
            watcher.look(&found, time_s);
        }
        seen_frames.push(FrameFeatures {
            frame,
            time_s,
            features: found.features,
            maps_ms: found.maps_ms,
            features_ms: found.features_ms + started.elapsed().as_secs_f64() * 1e3,
        });
        Ok(())
    })?;
    let motion = watcher.map(|watcher| watcher.motion).unwrap_or_default();
    Ok(Watched { frames: seen_frames, motion })
}

/// An image as it comes, which need not be the one that was taken then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Delivery {
    /// The time that it says, seconds.
    pub time_s: f64,
    /// The frame of the drive that it shows; none where it is black.
    pub frame: Option<usize>,
}

/// How the camera moved, as images say that come so; label images from a folder
/// where the drive has no others.
///
/// # Errors
/// Where an image cannot be read.
pub fn motion(
    drive: &Drive,
    labels: Option<&Path>,
    deliveries: &[Delivery],
    config: &Config,
) -> Result<MotionOfImages> {
    let labels = labels.filter(|_| !drive.moves_by_images());
    let is_told = |frame: usize| labels.is_some() || drive.has_image(frame);
    let mut shown = deliveries.iter().filter_map(|delivery| delivery.frame).filter(|frame| is_told(*frame));
    let Some(first) = shown.next().filter(|_| config.visual_odometry.is_on) else {
        return Ok(MotionOfImages::default());
    };
    let shown = drive.plane(first, labels)?;
    let black = Plane::zeros(shown.width(), shown.height());
    let mut watcher = Watcher::new(drive, labels.is_some(), config);
    for delivery in deliveries {
        match delivery.frame {
            Some(frame) if !is_told(frame) => {}
            Some(frame) => watcher.step(&drive.plane(frame, labels)?, delivery.time_s),
            None => watcher.step(&black, delivery.time_s),
        }
    }
    Ok(watcher.motion)
}

/// Looks at how the camera moves: at the images of a drive, or at its label
/// images.
struct Watcher {
    odometer: VisualOdometer,
    is_of_labels: bool,
    motion: MotionOfImages,
}

impl Watcher {
    fn new(drive: &Drive, is_of_labels: bool, config: &Config) -> Self {
        let (odometer, mut accuracy) = if is_of_labels {
            (drive.label_odometer(config), config.visual_odometry.accuracy_of_labels())
        } else {
            (drive.odometer(config), config.visual_odometry.accuracy)
        };
        accuracy.seen_from_m = config.vision.height_over_road_m();
        let motion = MotionOfImages { log: OdometryLog::default(), accuracy };
        Self { odometer, is_of_labels, motion }
    }

    fn look(&mut self, seen: &Seen, time_s: f64) {
        let plane: Option<Cow<'_, Plane>> = if self.is_of_labels {
            Some(Cow::Owned(seen.maps.largest()))
        } else {
            seen.grey.as_ref().map(Cow::Borrowed)
        };
        if let Some(plane) = plane {
            self.step(&plane, time_s);
        }
    }

    fn step(&mut self, plane: &Plane, time_s: f64) {
        let before_s = self.odometer.last_s();
        if let Some((shown, before_s)) = self.odometer.step(plane, time_s).zip(before_s) {
            self.motion.log.push(before_s, time_s, shown);
        }
    }
}
