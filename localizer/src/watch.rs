//! All images of a drive, one after the other: what each shows, and how the
//! camera moved between them.

use std::borrow::Cow;
use std::path::Path;
use std::time::Instant;

use crate::Result;
use crate::camera::{ScaledCamera, Seen, Source};
use crate::config::Config;
use crate::drive::Drive;
use crate::odometry::{Odometry, OdometryConfig, OdometryLog};
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
    /// Frames that were passed over, and what is wrong with the image of each.
    pub unread: Vec<(usize, String)>,
}

/// How the camera moved, as the images say.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MotionOfImages {
    /// What they say.
    pub log: OdometryLog,
    /// How well they know it.
    pub accuracy: OdometryConfig,
}

impl MotionOfImages {
    /// What is to be filled with what a watcher says.
    fn of(watcher: &Watcher) -> Self {
        Self { log: OdometryLog::default(), accuracy: watcher.accuracy }
    }

    fn push(&mut self, step: MotionStep) {
        self.log.push(step.began_s, step.ended_s, step.mean);
    }
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

/// Looks at frames of a drive, in their order; `seen` is called for each. After the first
/// one that can be read, one of which the image cannot be is passed over: it is as if the
/// camera had missed it.
///
/// # Errors
/// As [`Drive::see`] where no image was read so far, or what is wrong is not one image, and
/// what `seen` says.
pub fn watch(
    drive: &Drive,
    frames: impl IntoIterator<Item = usize, IntoIter: Send>,
    source: &Source,
    has_wheels: bool,
    config: &Config,
    mut seen: impl FnMut(usize, &Seen) -> Result<()>,
) -> Result<Watched> {
    let sensors = Sensors { images: drive.moves_by_images(), wheels: has_wheels };
    let mut watcher = Watcher::beside(&drive.camera, sensors, config);
    let mut motion = watcher.as_ref().map(MotionOfImages::of).unwrap_or_default();
    let (mut seen_frames, mut unread) = (Vec::new(), Vec::new());
    drive.see_all(frames, source, &config.vision, |frame, found| {
        let found = match found {
            Err(error) if error.is_of_an_image() && !seen_frames.is_empty() => {
                unread.push((frame, error.to_string()));
                return Ok(());
            }
            found => found?,
        };
        seen(frame, &found)?;
        let time_s = drive.times_s[frame];
        let started = Instant::now();
        if let Some(step) = watcher.as_mut().and_then(|watcher| watcher.look(&found, time_s)) {
            motion.push(step);
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
    Ok(Watched { frames: seen_frames, motion, unread })
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
    let mut watcher = Watcher::new(&drive.camera, labels.is_some(), config);
    let mut motion = MotionOfImages::of(&watcher);
    for delivery in deliveries {
        let step = match delivery.frame {
            Some(frame) if !is_told(frame) => None,
            Some(frame) => watcher.step(&drive.plane(frame, labels)?, delivery.time_s),
            None => watcher.step(&black, delivery.time_s),
        };
        if let Some(step) = step {
            motion.push(step);
        }
    }
    Ok(motion)
}

/// The mean motion of the camera from one image to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionStep {
    /// Time of the earlier image, seconds.
    pub began_s: f64,
    /// Time of the later one, seconds.
    pub ended_s: f64,
    /// What was seen.
    pub mean: Odometry,
}

/// What tells how a vehicle moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sensors {
    /// Camera images, and not label images alone.
    pub images: bool,
    /// Wheels and gyroscope.
    pub wheels: bool,
}

/// Looks at how a camera moves: at its images, or at label images of them.
pub struct Watcher {
    odometer: VisualOdometer,
    is_of_labels: bool,
    /// How well it knows that.
    pub accuracy: OdometryConfig,
}

impl Watcher {
    /// One for what a vehicle has; none where it is switched off, and for label images
    /// beside wheels: what they say of pitch and roll made poses no better.
    pub fn beside(camera: &ScaledCamera, sensors: Sensors, config: &Config) -> Option<Self> {
        let is_on = config.visual_odometry.is_on && (sensors.images || !sensors.wheels);
        is_on.then(|| Self::new(camera, !sensors.images, config))
    }

    fn new(camera: &ScaledCamera, is_of_labels: bool, config: &Config) -> Self {
        let (odometer, mut accuracy) = if is_of_labels {
            (camera.label_odometer(config), config.visual_odometry.accuracy_of_labels())
        } else {
            (camera.odometer(config), config.visual_odometry.accuracy)
        };
        accuracy.seen_from_m = config.vision.height_over_road_m();
        Self { odometer, is_of_labels, accuracy }
    }

    /// What a frame of this time, seconds, says; none where it has nothing to look at,
    /// and as [`VisualOdometer::step`].
    pub fn look(&mut self, seen: &Seen, time_s: f64) -> Option<MotionStep> {
        let plane: Option<Cow<'_, Plane>> = if self.is_of_labels {
            Some(Cow::Owned(seen.maps.largest()))
        } else {
            seen.grey.as_ref().map(Cow::Borrowed)
        };
        self.step(&*plane?, time_s)
    }

    fn step(&mut self, plane: &Plane, time_s: f64) -> Option<MotionStep> {
        let before_s = self.odometer.last_s();
        let (mean, began_s) = self.odometer.step(plane, time_s).zip(before_s)?;
        Some(MotionStep { began_s, ended_s: time_s, mean })
    }
}
