//! A drive on disk: its frames, and the features of each from networks or from
//! probability images made before.

use std::path::{Path, PathBuf};
use std::sync::mpsc::sync_channel;

use common::geometry::PinholeCamera;
use common::kitti::Sequence;

use crate::config::Config;
use crate::features::Features;
use crate::projection::ImageSize;
use crate::vision::config::Ground;
use crate::vision::image::{check_calibration, check_size, size_of_png};
use crate::vision::network::{self, Network, Runtime};
use crate::vision::{Plane, ProbabilityMaps, RgbImage, VisionConfig, labels, read_png};
use crate::visual_odometry::VisualOdometer;
use crate::{Error, Result};

/// The camera of KITTI that is used: left, colour.
pub const CAMERA: usize = 2;

/// Frames that are looked at before they are asked for: enough where one takes
/// longer than the next.
const FRAMES_AHEAD: usize = 2;

/// A sequence with what does not change along it.
#[derive(Debug)]
pub struct Drive {
    /// Where it lies.
    pub sequence: Sequence,
    /// The camera, of images of the size at which they are looked at.
    pub camera: PinholeCamera,
    /// Columns and rows of the images as they were taken.
    taken_px: (usize, usize),
    /// The same as they are looked at.
    seen_px: (usize, usize),
    /// The time of every frame of the sequence, seconds.
    pub times_s: Vec<f64>,
    /// The frames to localize, ascending.
    pub frames: Vec<usize>,
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

/// What a frame gives before it is localized.
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

impl Drive {
    /// The frames `first..=last` of a sequence that have an image, or labels
    /// where `labels` is given; wider images than `widest_px` are looked at scaled
    /// down to that.
    ///
    /// # Errors
    /// As [`check_range`] and [`Sequence::open`], its calibration and times; where there is no folder
    /// `labels`; [`Error::EmptyFolder`] and [`Error::NoFrames`] where there is nothing
    /// to localize in; as [`check_calibration`] where its first image is not of that.
    pub fn open(
        root: &Path,
        name: &str,
        labels: Option<&Path>,
        first: usize,
        last: Option<usize>,
        widest_px: usize,
    ) -> Result<Self> {
        check_range(first, last)?;
        let sequence = Sequence::open(root, name)?;
        let camera = sequence.calibration()?.camera(CAMERA);
        let times_s = sequence.times_s()?;
        let folder = labels.map_or_else(|| sequence.folder().join("image_2"), Path::to_path_buf);
        let mut available = match labels {
            Some(folder) => label_frames(folder, times_s.len())?,
            None => sequence.image_frames(CAMERA)?,
        };
        available.retain(|&frame| frame < times_s.len());
        let (Some(&have_first), Some(&have_last)) = (available.first(), available.last()) else {
            return Err(Error::EmptyFolder { folder });
        };
        let last = last.unwrap_or(have_last);
        let frames: Vec<usize> = available.into_iter().filter(|frame| (first..=last).contains(frame)).collect();
        let Some(&shown) = frames.first() else {
            return Err(Error::NoFrames { folder, first, last, have_first, have_last });
        };
        let taken_px = match labels {
            Some(folder) => labels::size(folder, shown)?,
            None => size_of_png(&sequence.image_path(CAMERA, shown))?,
        };
        let path = labels.map_or_else(|| sequence.image_path(CAMERA, shown), Path::to_path_buf);
        check_calibration(&path, taken_px, &camera)?;
        let seen_px = looked_at(taken_px, widest_px);
        let stretch = |seen: usize, taken: usize| seen as f64 / taken as f64;
        let camera = camera.stretched(stretch(seen_px.0, taken_px.0), stretch(seen_px.1, taken_px.1));
        Ok(Self { sequence, camera, taken_px, seen_px, times_s, frames })
    }

    /// Columns and rows of the images as they are looked at.
    pub fn seen_px(&self) -> ImageSize {
        let (width, height) = self.seen_px;
        ImageSize { width_px: width as f64, height_px: height as f64 }
    }

    /// The times of the frames to localize, seconds.
    pub fn frame_times_s(&self) -> Vec<f64> {
        self.frames.iter().map(|&frame| self.times_s[frame]).collect()
    }

    /// Whether a frame has an image, or label images alone.
    pub fn has_image(&self, frame: usize) -> bool {
        self.sequence.image_path(CAMERA, frame).is_file()
    }

    /// Whether its images tell how it moved, and not its label images: most frames have
    /// one. A frame without says nothing of that, and the others do.
    pub fn moves_by_images(&self) -> bool {
        2 * self.frames.iter().filter(|&&frame| self.has_image(frame)).count() > self.frames.len()
    }

    /// The image of a frame as it is looked at.
    ///
    /// # Errors
    /// As [`read_png`] and [`check_size`]: all have the size of the first.
    pub fn image(&self, frame: usize) -> Result<RgbImage> {
        let path = self.sequence.image_path(CAMERA, frame);
        let image = read_png(&path)?;
        check_size(&path, (image.width(), image.height()), self.taken_px)?;
        Ok(image.resized(self.seen_px))
    }

    /// The label images of a frame, likewise.
    fn labels(&self, folder: &Path, frame: usize) -> Result<ProbabilityMaps> {
        Ok(labels::read(folder, frame, Some(self.taken_px))?.resized(self.seen_px))
    }

    /// What an odometer looks at: the label images of a frame, as one, where `labels`
    /// is given, else the brightness of its image.
    ///
    /// # Errors
    /// As [`labels::read`] and [`Drive::image`].
    pub fn plane(&self, frame: usize, labels: Option<&Path>) -> Result<Plane> {
        Ok(match labels {
            Some(folder) => self.labels(folder, frame)?.largest(),
            None => self.image(frame)?.grey(),
        })
    }

    /// The features of a frame, in pixels of the image as it is looked at.
    ///
    /// # Errors
    /// Where an image, a label or a network fails, with its sentence.
    pub fn see(&self, frame: usize, source: &Source, config: &VisionConfig) -> Result<Seen> {
        let started = std::time::Instant::now();
        let (maps, image) = match source {
            // Its image is worth having, and not needed.
            Source::Labels(folder) => {
                let maps = self.labels(folder, frame)?;
                (maps, self.has_image(frame).then(|| self.image(frame)).transpose()?)
            }
            Source::Networks(networks) => {
                let image = self.image(frame)?;
                (network::run_all(networks, &image)?, Some(image))
            }
        };
        let maps_ms = started.elapsed().as_secs_f64() * 1e3;
        let started = std::time::Instant::now();
        let grey = image.map(|image| image.grey());
        let features = crate::vision::extract(&maps, grey.as_ref(), &self.calibrated(config));
        let features_ms = started.elapsed().as_secs_f64() * 1e3;
        Ok(Seen { features, maps, grey, maps_ms, features_ms })
    }

    /// Writes the probabilities of a frame as label images of the size of its image.
    ///
    /// # Errors
    /// As [`labels::write`].
    pub fn write_labels(&self, folder: &Path, frame: usize, seen: &Seen) -> Result<()> {
        Ok(labels::write(folder, frame, &seen.maps.clone().resized(self.taken_px))?)
    }

    /// Looks at frames in their order, the next ones while `take` has one.
    ///
    /// # Errors
    /// As [`Drive::see`], and what `take` says; nothing comes after either.
    pub fn see_all(
        &self,
        frames: impl IntoIterator<Item = usize, IntoIter: Send>,
        source: &Source,
        config: &VisionConfig,
        mut take: impl FnMut(usize, Seen) -> Result<()>,
    ) -> Result<()> {
        let frames = frames.into_iter();
        std::thread::scope(|scope| {
            let (give, seen) = sync_channel(FRAMES_AHEAD);
            scope.spawn(move || {
                for frame in frames {
                    let found = self.see(frame, source, config);
                    // Nobody takes more once there was an error.
                    if give.send((frame, found)).is_err() {
                        break;
                    }
                }
            });
            seen.into_iter().try_for_each(|(frame, found)| take(frame, found?))
        })
    }

    /// The odometer for the images of this drive.
    pub fn odometer(&self, config: &Config) -> VisualOdometer {
        VisualOdometer::new(
            &self.camera,
            config.vision.height_over_road_m(),
            &config.visual_odometry,
            config.clock.soonest,
        )
    }

    /// The odometer for its label images.
    pub fn label_odometer(&self, config: &Config) -> VisualOdometer {
        VisualOdometer::of_labels(
            &self.camera,
            config.vision.height_over_road_m(),
            &config.visual_odometry,
            config.clock.soonest,
        )
    }

    /// The settings with the ground that this camera sees, where they do not
    /// give one.
    fn calibrated(&self, config: &VisionConfig) -> VisionConfig {
        let mut config = config.clone();
        let (horizon_px, focal_px, camera_height_m) = (self.camera.cy_px, self.camera.fy_px, config.camera_height_m);
        config.lanes.ground.get_or_insert(Ground { horizon_px, focal_px, camera_height_m });
        config
    }
}

/// Whether a range of frames may hold any.
///
/// # Errors
/// [`Error::FirstAfterLast`] where it ends before it begins.
pub fn check_range(first: usize, last: Option<usize>) -> Result<()> {
    match last.filter(|last| *last < first) {
        Some(last) => Err(Error::FirstAfterLast { first, last }),
        None => Ok(()),
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

/// The frames for which some class has a file.
fn label_frames(folder: &Path, frames: usize) -> Result<Vec<usize>> {
    std::fs::read_dir(folder).map_err(common::Error::io(folder))?;
    let has =
        |frame: &usize| crate::vision::Class::ALL.iter().any(|&class| labels::path(folder, class, *frame).is_file());
    Ok((0..frames).filter(has).collect())
}
