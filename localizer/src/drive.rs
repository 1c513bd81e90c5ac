//! A drive on disk: its frames, and the features of each from networks or from
//! probability images made before.

use std::path::Path;
use std::sync::mpsc::sync_channel;

use common::kitti::Sequence;

use crate::camera::{ScaledCamera, Seen, Source};
use crate::vision::image::{check_calibration, image_size};
use crate::vision::{Plane, RgbImage, VisionConfig, labels};
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
    /// The camera, and how its images are looked at.
    pub camera: ScaledCamera,
    /// The time of every frame of the sequence, seconds.
    pub times_s: Vec<f64>,
    /// The frames to localize, ascending.
    pub frames: Vec<usize>,
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
        let camera = sequence.camera(CAMERA)?;
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
            None => image_size(&sequence.image_path(CAMERA, shown))?,
        };
        let path = labels.map_or_else(|| sequence.image_path(CAMERA, shown), Path::to_path_buf);
        check_calibration(&path, taken_px, &camera)?;
        let camera = ScaledCamera::new(&camera, taken_px, widest_px);
        Ok(Self { sequence, camera, times_s, frames })
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
    /// As [`ScaledCamera::read_image`].
    pub fn image(&self, frame: usize) -> Result<RgbImage> {
        self.camera.read_image(&self.sequence.image_path(CAMERA, frame))
    }

    /// What an odometer looks at: the label images of a frame, as one, where `labels`
    /// is given, else the brightness of its image.
    ///
    /// # Errors
    /// As [`labels::read`] and [`Drive::image`].
    pub fn plane(&self, frame: usize, labels: Option<&Path>) -> Result<Plane> {
        Ok(match labels {
            Some(folder) => self.camera.read_labels(folder, frame)?.largest(),
            None => self.image(frame)?.grey(),
        })
    }

    /// The features of a frame, in pixels of the image as it is looked at.
    ///
    /// # Errors
    /// Where an image, a label or a network fails, with its sentence.
    pub fn see(&self, frame: usize, source: &Source, config: &VisionConfig) -> Result<Seen> {
        // Beside label images it is worth having, and not needed.
        let image = self.has_image(frame).then(|| self.sequence.image_path(CAMERA, frame));
        self.camera.look(source, frame, image.as_deref(), config)
    }

    /// Looks at frames in their order, the next ones while `take` has one.
    ///
    /// # Errors
    /// What `take` says, of what it is given, too; nothing comes after.
    pub fn see_all(
        &self,
        frames: impl IntoIterator<Item = usize, IntoIter: Send>,
        source: &Source,
        config: &VisionConfig,
        mut take: impl FnMut(usize, Result<Seen>) -> Result<()>,
    ) -> Result<()> {
        let frames = frames.into_iter();
        std::thread::scope(|scope| {
            let (give, seen) = sync_channel(FRAMES_AHEAD);
            scope.spawn(move || {
                for frame in frames {
                    let found = self.see(frame, source, config);
                    // Nobody takes more once there was an error that counts.
                    if give.send((frame, found)).is_err() {
                        break;
                    }
                }
            });
            seen.into_iter().try_for_each(|(frame, found)| take(frame, found))
        })
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

/// The frames for which some class has a file.
fn label_frames(folder: &Path, frames: usize) -> Result<Vec<usize>> {
    std::fs::read_dir(folder).map_err(common::Error::io(folder))?;
    let has =
        |frame: &usize| crate::vision::Class::ALL.iter().any(|&class| labels::path(folder, class, *frame).is_file());
    Ok((0..frames).filter(has).collect())
}
