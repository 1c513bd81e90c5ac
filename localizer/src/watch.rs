//! All images of a drive, one after the other: what each shows, and how the
//! camera moved between them.

use std::borrow::Cow;
use std::time::Instant;

use crate::Result;
use crate::config::Config;
use crate::drive::{Drive, Seen, Source, image_size};
use crate::odometry::{OdometryConfig, OdometryLog};
use crate::projection::ImageSize;
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
    /// Size of the images, pixels; zero without any.
    pub image: ImageSize,
}

/// How the camera moved, as the images say.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MotionOfImages {
    /// What they say.
    pub log: OdometryLog,
    /// How well they know it.
    pub accuracy: OdometryConfig,
}

/// What is known of the motion: what a log of wheels says, else the images. Sets
/// how well in the settings.
pub fn odometry(wheels: Option<OdometryLog>, images: &MotionOfImages, config: &mut Config) -> OdometryLog {
    wheels.unwrap_or_else(|| {
        if !images.log.is_empty() {
            config.odometry = images.accuracy;
        }
        images.log.clone()
    })
}

/// Looks at frames of a drive, in their order; `seen` is called for each.
///
/// # Errors
/// As [`Drive::see`], and what `seen` says.
pub fn watch(
    drive: &Drive,
    frames: impl IntoIterator<Item = usize, IntoIter: Send>,
    source: &Source,
    config: &Config,
    mut seen: impl FnMut(usize, &Seen) -> Result<()>,
) -> Result<Watched> {
    let mut image = image_size(0, 0);
    let mut watcher: Option<Watcher> = None;
    let mut seen_frames = Vec::new();
    drive.see_all(frames, source, &config.vision, |frame, found| {
        image = image_size(found.maps.width(), found.maps.height());
        seen(frame, &found)?;
        let time_s = drive.times_s[frame];
        let started = Instant::now();
        if config.visual_odometry.is_on {
            watcher.get_or_insert_with(|| Watcher::of(drive, &found, config)).step(&found, time_s);
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
    Ok(Watched { frames: seen_frames, motion, image })
}

/// Looks at how the camera moves: at the images of a drive, or at its label images
/// where the first frame has no other.
struct Watcher {
    odometer: VisualOdometer,
    is_of_labels: bool,
    before_s: Option<f64>,
    motion: MotionOfImages,
}

impl Watcher {
    fn of(drive: &Drive, first: &Seen, config: &Config) -> Self {
        let is_of_labels = first.grey.is_none();
        let (odometer, accuracy) = if is_of_labels {
            (drive.label_odometer(config), config.visual_odometry.accuracy_of_labels())
        } else {
            (drive.odometer(config), config.visual_odometry.accuracy)
        };
        let motion = MotionOfImages { log: OdometryLog::default(), accuracy };
        Self { odometer, is_of_labels, before_s: None, motion }
    }

    fn step(&mut self, seen: &Seen, time_s: f64) {
        let plane: Option<Cow<'_, Plane>> = if self.is_of_labels {
            Some(Cow::Owned(seen.maps.largest()))
        } else {
            seen.grey.as_ref().map(Cow::Borrowed)
        };
        let Some(plane) = plane else { return };
        if let Some((shown, before_s)) = self.odometer.step(&plane, time_s).zip(self.before_s) {
            self.motion.log.push(before_s, time_s, shown);
        }
        self.before_s = Some(time_s);
    }
}
