//! All images of a drive, one after the other: what each shows, and how the
//! camera moved between them.

use std::time::Instant;

use crate::Result;
use crate::config::Config;
use crate::drive::{Drive, Seen, Source, image_size};
use crate::odometry::OdometryLog;
use crate::projection::ImageSize;
use crate::run::FrameFeatures;

/// What the images of a drive show.
#[derive(Debug, Clone, PartialEq)]
pub struct Watched {
    /// What each frame shows.
    pub frames: Vec<FrameFeatures>,
    /// How the camera moved, where the images say so.
    pub motion: OdometryLog,
    /// Size of the images, pixels; zero without any.
    pub image: ImageSize,
}

/// What is known of the motion: what a log of wheels says, else the images. Sets
/// how well in the settings.
pub fn odometry(wheels: Option<OdometryLog>, images: &OdometryLog, config: &mut Config) -> OdometryLog {
    wheels.unwrap_or_else(|| {
        if !images.is_empty() {
            config.odometry = config.visual_odometry.accuracy;
        }
        images.clone()
    })
}

/// Looks at frames of a drive, in their order; `seen` is called for each.
///
/// # Errors
/// As [`Drive::see`], and what `seen` says.
pub fn watch(
    drive: &Drive,
    frames: impl IntoIterator<Item = usize>,
    source: &Source,
    config: &Config,
    mut seen: impl FnMut(usize, &Seen) -> Result<()>,
) -> Result<Watched> {
    let mut size = None;
    let mut odometer = config.visual_odometry.is_on.then(|| drive.odometer(config));
    let mut before_s = None;
    let mut watched = Watched { frames: Vec::new(), motion: OdometryLog::default(), image: image_size(0, 0) };
    for frame in frames {
        let found = drive.see(frame, source, size, &config.vision)?;
        size = Some((found.maps.width(), found.maps.height()));
        seen(frame, &found)?;
        let time_s = drive.times_s[frame];
        let started = Instant::now();
        if let Some((odometer, grey)) = odometer.as_mut().zip(found.grey.as_ref()) {
            if let Some((shown, before_s)) = odometer.step(grey, time_s).zip(before_s) {
                watched.motion.push(before_s, time_s, shown);
            }
            before_s = Some(time_s);
        }
        watched.frames.push(FrameFeatures {
            frame,
            time_s,
            features: found.features,
            maps_ms: found.maps_ms,
            features_ms: found.features_ms + started.elapsed().as_secs_f64() * 1e3,
        });
    }
    if let Some((width, height)) = size {
        watched.image = image_size(width, height);
    }
    Ok(watched)
}
