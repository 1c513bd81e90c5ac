//! A camera whose images are scaled down before anything looks at them, and what
//! they show.

use std::path::{Path, PathBuf};
use std::time::Instant;

use common::geometry::PinholeCamera;

use crate::config::Config;
use crate::features::Features;
use crate::projection::ImageSize;
use crate::vision::config::Ground;
use crate::vision::image::check_size;
use crate::vision::network::{self, Network, Runtime};
use crate::vision::{Plane, ProbabilityMaps, RgbImage, VisionConfig, labels, read_image};
use crate::visual_odometry::VisualOdometer;
use crate::{Error, Result};

/// A camera, and the size at which its images are looked at.
#[derive(Debug, Clone, PartialEq)]
pub struct ScaledCamera {
    /// The camera of images of the size at which they are looked at.
    pub pinhole: PinholeCamera,
    /// Columns and rows of the images as they were taken.
    taken_px: (usize, usize),
    /// The same as they are looked at.
    seen_px: (usize, usize),
}

/// Where the class probabilities of a frame come from.
pub enum Source {
    /// Networks, run on the images.
    Networks(Vec<Network>),
    /// Probability images `CLASS/NNNNNN.png` in a folder.
    Labels(PathBuf),
}

impl Source {
    /// Networks that are given by their files, or else a folder of labels.
    ///
    /// # Errors
    /// [`Error::NoFeatureSource`] where neither is given, and as
    /// [`Network::load`].
    pub fn open(networks: &[&Path], runtime: Runtime, labels: Option<&Path>) -> Result<Self> {
        match labels {
            Some(folder) => Ok(Self::Labels(folder.into())),
            None if networks.is_empty() => Err(Error::NoFeatureSource),
            None => {
                let loaded = networks.iter().map(|path| Network::load(path, runtime));
                Ok(Self::Networks(loaded.collect::<std::result::Result<_, _>>()?))
            }
        }
    }
}

/// What an image gives before it is localized.
#[derive(Debug, Clone)]
pub struct Seen {
    /// The features.
    pub features: Features,
    /// The probabilities that they come from.
    pub maps: ProbabilityMaps,
    /// Brightness of the image, where there is one.
    pub grey: Option<Plane>,
    /// Time for the probabilities (networks or reading files), milliseconds.
    pub maps_ms: f64,
    /// Time for the features from them, milliseconds.
    pub features_ms: f64,
}

impl ScaledCamera {
    /// The camera of images of so many columns and rows; wider ones than `widest_px`
    /// are looked at scaled down to that.
    pub fn new(taken: &PinholeCamera, taken_px: (usize, usize), widest_px: usize) -> Self {
        let seen_px = looked_at(taken_px, widest_px);
        let stretch = |seen: usize, taken: usize| seen as f64 / taken as f64;
        let pinhole = taken.stretched(stretch(seen_px.0, taken_px.0), stretch(seen_px.1, taken_px.1));
        Self { pinhole, taken_px, seen_px }
    }

    /// Columns and rows of the images as they are looked at.
    pub fn seen_px(&self) -> ImageSize {
        let (width, height) = self.seen_px;
        ImageSize { width_px: width as f64, height_px: height as f64 }
    }

    /// The image of a file as it is looked at.
    ///
    /// # Errors
    /// As [`read_image`] and [`check_size`]: all have the size of the first.
    pub fn read_image(&self, path: &Path) -> Result<RgbImage> {
        let image = read_image(path)?;
        check_size(path, (image.width(), image.height()), self.taken_px)?;
        Ok(image.resized(self.seen_px))
    }

    /// The label images of a frame, likewise.
    ///
    /// # Errors
    /// As [`labels::read`].
    pub fn read_labels(&self, folder: &Path, frame: usize) -> Result<ProbabilityMaps> {
        Ok(labels::read(folder, frame, Some(self.taken_px))?.resized(self.seen_px))
    }

    /// Writes the probabilities of a frame as label images of the size of its image.
    ///
    /// # Errors
    /// As [`labels::write`].
    pub fn write_labels(&self, folder: &Path, frame: usize, seen: &Seen) -> Result<()> {
        Ok(labels::write(folder, frame, &seen.maps.clone().resized(self.taken_px))?)
    }

    /// What a frame shows: its image, or its label images and the image where one is given.
    ///
    /// # Errors
    /// Where an image, a label or a network fails, with its sentence;
    /// [`Error::NoImage`] where networks are given none.
    pub fn look(&self, source: &Source, frame: usize, image: Option<&Path>, config: &VisionConfig) -> Result<Seen> {
        let started = Instant::now();
        let image = image.map(|path| self.read_image(path)).transpose()?;
        let maps = match (source, &image) {
            (Source::Labels(folder), _) => self.read_labels(folder, frame)?,
            (Source::Networks(networks), Some(image)) => network::run_all(networks, image)?,
            (Source::Networks(_), None) => return Err(Error::NoImage { frame }),
        };
        let maps_ms = started.elapsed().as_secs_f64() * 1e3;
        Ok(self.see(maps, image.map(|image| image.grey()), maps_ms, config))
    }

    /// The features of an image, in pixels of it as it is looked at, which probabilities
    /// and brightness are; `maps_ms` is what the former took.
    pub fn see(&self, maps: ProbabilityMaps, grey: Option<Plane>, maps_ms: f64, config: &VisionConfig) -> Seen {
        let started = Instant::now();
        let features = crate::vision::extract(&maps, grey.as_ref(), &self.calibrated(config));
        Seen { features, maps, grey, maps_ms, features_ms: started.elapsed().as_secs_f64() * 1e3 }
    }

    /// The odometer for the images of this camera.
    pub fn odometer(&self, config: &Config) -> VisualOdometer {
        VisualOdometer::new(
            &self.pinhole,
            config.vision.height_over_road_m(),
            &config.visual_odometry,
            config.clock.soonest,
        )
    }

    /// The odometer for label images of them.
    pub fn label_odometer(&self, config: &Config) -> VisualOdometer {
        VisualOdometer::of_labels(
            &self.pinhole,
            config.vision.height_over_road_m(),
            &config.visual_odometry,
            config.clock.soonest,
        )
    }

    /// The settings with the ground that this camera sees, where they do not
    /// give one.
    fn calibrated(&self, config: &VisionConfig) -> VisionConfig {
        let mut config = config.clone();
        let (horizon_px, focal_px, camera_height_m) = (self.pinhole.cy_px, self.pinhole.fy_px, config.camera_height_m);
        config.lanes.ground.get_or_insert(Ground { horizon_px, focal_px, camera_height_m });
        config
    }
}

/// Columns and rows at which images of so many are looked at.
fn looked_at(taken_px: (usize, usize), widest_px: usize) -> (usize, usize) {
    let (width, height) = taken_px;
    if width <= widest_px {
        return taken_px;
    }
    let scale = widest_px as f64 / width as f64;
    (widest_px, ((height as f64 * scale).round() as usize).max(1))
}
