//! What `run` and `trial` take in: map, drive, features, GPS.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use common::earth::OnEarth;
use common::geometry::Pose;
use indicatif::{ProgressBar, ProgressStyle};

use crate::camera::{Seen, Source};
use crate::config::Config;
use crate::drive::Drive;
use crate::gps::{self, FixFile, GpsFix, simulate};
use crate::local_map::LocalMap;
use crate::odometry::OdometryLog;
use crate::run::FrameFeatures;
use crate::vision::network::Runtime;
use crate::vision::{Class, labels};
use crate::watch::{MotionOfImages, Watched, watch};
use crate::{Error, Result};

/// Label images without a larger value, of 255, are of another scale: masks of 0 and 1, or 16
/// bits that hold 8.
const FAINT: u8 = 1;

/// The drive and where its features come from.
#[derive(Debug, Clone, Args)]
pub struct InputArgs {
    /// Map file (.csm), or atlas of many (.csa).
    #[arg(long, value_name = "FILE")]
    pub map: Option<PathBuf>,
    /// Folder with `sequences/` in KITTI odometry layout.
    #[arg(long, value_name = "ROOT")]
    pub kitti: Option<PathBuf>,
    /// Name of the sequence.
    #[arg(long, value_name = "NN", default_value = "04")]
    pub sequence: String,
    /// Where its features come from.
    #[command(flatten)]
    pub source: SourceArgs,
    /// True poses (KITTI rows) for the simulated GPS; default: poses/NN.txt.
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    /// First frame.
    #[arg(long, value_name = "F", default_value_t = 0)]
    pub first: usize,
    /// Last frame; default: the last that has an image (or labels).
    #[arg(long, value_name = "L")]
    pub last: Option<usize>,
}

/// Where features come from.
#[derive(Debug, Clone, Default, Args)]
pub struct SourceArgs {
    /// Network for poles, signs and lights (.onnx).
    #[arg(long, value_name = "FILE", conflicts_with = "labels")]
    pub pole_net: Option<PathBuf>,
    /// Network for lane lines (.onnx).
    #[arg(long, value_name = "FILE", conflicts_with = "labels")]
    pub lane_net: Option<PathBuf>,
    /// What runs the networks; `ort` needs a program built with the feature
    /// `ort`, and the library that `ORT_DYLIB_PATH` names.
    #[arg(long, value_enum, default_value_t)]
    pub runtime: Runtime,
    /// Folder with probability images made before, instead of networks.
    #[arg(long, value_name = "DIR")]
    pub labels: Option<PathBuf>,
}

impl SourceArgs {
    /// Opens it; says which folders of label images are of no class.
    ///
    /// # Errors
    /// As [`Source::open`] and [`labels::strangers`].
    pub fn open(&self) -> Result<Source> {
        if let Some(folder) = &self.labels {
            for name in labels::strangers(folder)? {
                common::output::print_note(format_args!(
                    "{} is not looked at: label images lie in folders {}",
                    folder.join(name).display(),
                    Class::ALL.map(Class::name).join(", ")
                ));
            }
        }
        let networks: Vec<&Path> =
            [&self.pole_net, &self.lane_net].into_iter().flatten().map(PathBuf::as_path).collect();
        Source::open(&networks, self.runtime, self.labels.as_deref())
    }
}

/// A map, and a drive whose images have not been looked at yet.
pub struct Opened {
    /// The drive.
    pub drive: Drive,
    map: LocalMap,
    source: Source,
}

/// A drive whose images have been looked at.
pub struct Input {
    /// The map.
    pub map: LocalMap,
    /// The drive.
    pub drive: Drive,
    /// What its frames show.
    pub frames: Vec<FrameFeatures>,
    /// How it moved, as its images say.
    pub motion: MotionOfImages,
    /// Frames of which the image could not be read.
    pub unread: usize,
}

impl InputArgs {
    /// The drive.
    ///
    /// # Errors
    /// As [`Drive::open`].
    pub fn open_drive(&self, config: &Config) -> Result<Drive> {
        let root = super::required(self.kitti.as_ref(), "--kitti")?;
        let widest_px = config.vision.widest_px;
        Drive::open(&root, &self.sequence, self.source.labels.as_deref(), self.first, self.last, widest_px)
    }

    /// What a log says of wheels and gyroscope, where one is given.
    ///
    /// # Errors
    /// As [`OdometryLog::read`] and [`Drive::open`], and [`Error::OdometryElsewhere`]
    /// where it says nothing of the drive: images would be passed over for it.
    pub fn read_odometry(&self, path: Option<&Path>, config: &Config) -> Result<Option<OdometryLog>> {
        let Some(path) = path else { return Ok(None) };
        let log = OdometryLog::read(path)?;
        let times_s = self.open_drive(config)?.frame_times_s();
        let ends = log.span_s().zip(times_s.first().copied().zip(times_s.last().copied()));
        match ends {
            Some((told_s, (first_s, last_s))) if times_s.len() > 1 && log.told(&times_s) == 0 => {
                Err(Error::OdometryElsewhere { path: path.to_path_buf(), told_s, frames_s: [first_s, last_s] })
            }
            _ => Ok(Some(log)),
        }
    }

    /// Opens the map, where features come from, and the drive.
    ///
    /// # Errors
    /// Where an option is missing or a file cannot be read.
    pub fn open(&self, config: &Config) -> Result<Opened> {
        let map = LocalMap::open(&super::required(self.map.as_ref(), "--map")?, &config.local_map)?;
        let source = self.source.open()?;
        Ok(Opened { drive: self.open_drive(config)?, map, source })
    }

    /// Opens these and looks at all images, as [`Opened::watch`] does.
    ///
    /// # Errors
    /// As [`Self::open`] and [`Opened::watch`].
    pub fn read(&self, has_wheels: bool, config: &Config) -> Result<Input> {
        self.open(config)?.watch(has_wheels, config, |_, _, _| Ok(()))
    }

    /// The true poses of all frames of the drive.
    ///
    /// # Errors
    /// Where they cannot be read, [`Error::NoTruth`] where none are given and there are none.
    pub fn true_poses(&self, drive: &Drive) -> Result<Vec<Pose>> {
        let Some(path) = &self.truth else {
            let path = drive.sequence.poses_path();
            return if path.exists() { Ok(drive.sequence.poses()?) } else { Err(Error::NoTruth { path }) };
        };
        Ok(drive.sequence.poses_from(path)?)
    }
}

impl Opened {
    /// Looks at all images, as they are asked where wheels tell the motion; `seen` is called
    /// for each frame.
    ///
    /// # Errors
    /// Where an image cannot be read, [`Error::FaintLabels`] where they hold hardly anything,
    /// and what `seen` says.
    pub fn watch(
        self,
        has_wheels: bool,
        config: &Config,
        mut seen: impl FnMut(&Drive, usize, &Seen) -> Result<()>,
    ) -> Result<Input> {
        let Self { drive, map, source } = self;
        let bar = progress(drive.frames.len(), "features");
        let mut largest = 0;
        let watched = watch(&drive, drive.frames.iter().copied(), &source, has_wheels, config, |frame, found| {
            bar.inc(1);
            if largest <= FAINT {
                largest = largest.max(found.maps.largest_value());
            }
            seen(&drive, frame, found)
        })?;
        bar.finish_and_clear();
        if let (Source::Labels(folder), 1..=FAINT) = (&source, largest) {
            return Err(Error::FaintLabels { folder: folder.clone(), largest });
        }
        let Watched { frames, motion, unread } = watched;
        for (frame, why) in &unread {
            tell_passed_over(*frame, why);
        }
        Ok(Input { map, drive, frames, motion, unread: unread.len() })
    }
}

/// Says that a frame is passed over, and why.
pub fn tell_passed_over(frame: usize, why: impl std::fmt::Display) {
    common::output::print_note(format_args!("frame {frame} is passed over: {why}"));
}

/// How a command ends that passed over so many frames.
///
/// # Errors
/// [`Error::FramesPassedOver`] where there are any.
pub fn all_but(unread: usize) -> Result<bool> {
    if unread > 0 { Err(Error::FramesPassedOver { frames: unread }) } else { Ok(true) }
}

/// Simulated fixes on the first of `frames`.
///
/// # Errors
/// [`Error::NoStart`] where there is none.
pub fn simulated(
    frames: &(impl Iterator<Item = usize> + Clone),
    truth: &[Pose],
    config: &Config,
    seed: u64,
) -> Result<BTreeMap<usize, GpsFix>> {
    let starts: Vec<(usize, Pose)> =
        frames.clone().take(config.gps.simulated_fixes).filter_map(|frame| Some((frame, *truth.get(frame)?))).collect();
    let poses: Vec<Pose> = starts.iter().map(|(_, pose)| *pose).collect();
    let fixes = simulate(&poses, &config.gps, seed);
    started(frames, starts.iter().map(|(frame, _)| *frame).zip(fixes).collect())
        .map_err(|(first, last)| Error::NoStart { first, last })
}

/// The fixes of a file, in degrees where the map is on the Earth; says how many of them are
/// of no frame.
///
/// # Errors
/// As [`gps::read`], and [`Error::NoFix`] where none lies on the frames.
pub fn read_fixes(
    drive: &Drive,
    path: &Path,
    config: &Config,
    on_earth: Option<&OnEarth>,
) -> Result<BTreeMap<usize, GpsFix>> {
    let FixFile { fixes, astray_lines } = gps::read(path, &drive.times_s, &config.gps, on_earth)?;
    let fixes = started(&drive.frames.iter().copied(), fixes).map_err(|(first, last)| Error::NoFix {
        path: path.to_path_buf(),
        first,
        last,
    })?;
    if let Some(line) = astray_lines.first() {
        common::say!(
            "{}: of no frame and left out are fixes in {} lines, the first in line {line}",
            path.display(),
            astray_lines.len()
        );
    }
    Ok(fixes)
}

/// The fixes, if one of them lies on the frames; else which frames these are.
fn started(
    frames: &(impl Iterator<Item = usize> + Clone),
    fixes: BTreeMap<usize, GpsFix>,
) -> std::result::Result<BTreeMap<usize, GpsFix>, (usize, usize)> {
    let ends = frames.clone().next().zip(frames.clone().last()).unwrap_or((0, 0));
    if frames.clone().any(|frame| fixes.contains_key(&frame)) { Ok(fixes) } else { Err(ends) }
}

/// A bar on a terminal, nothing elsewhere.
pub fn progress(count: usize, what: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:>10} {bar:40} {pos}/{len} {eta}");
    let bar = ProgressBar::new(count as u64).with_message(what);
    match style {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
