//! A drive to build a map from: its scans, its survey and its calibration.

use std::path::{Path as FilePath, PathBuf};

use common::geometry::{Pose, Tangent, local};
use common::kitti::{Calibration, Scan, Sequence};
use nalgebra::{Translation3, Vector3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::input::{Deskew, MapFrame, Source, Steps, assumed_times_s};
use crate::lidar::LidarConfig;
use crate::scan::LidarScan;

/// Farthest point read, metres: the reach of the lidar. What is stitched and
/// what is registered ends nearer, by the settings.
pub const MAX_RANGE_M: f32 = 120.0;

/// A drive and the frames of it that are stitched.
#[derive(Debug, Clone)]
pub struct Drive {
    source: Source,
    /// Frames that are stitched, ascending.
    pub frames: Vec<usize>,
    /// `map_from_camera` of every frame of the drive as the survey has it.
    pub survey: Vec<Pose>,
    /// Where the survey stands: a file, or a folder of packets.
    pub survey_path: PathBuf,
    /// Time of every frame of the drive, seconds.
    pub times_s: Vec<f64>,
    /// `camera_from_velodyne`.
    pub camera_from_velodyne: Pose,
    /// Farthest point kept, metres.
    pub max_range_m: f32,
    /// How points are moved to the time of their scan, and the time that the
    /// lidar takes for a turn, seconds.
    pub deskew: (Deskew, f64),
    /// Where the lidar is in the frame of the source's scans, metres.
    lidar_at_m: [f64; 3],
    /// Whether the camera is a thought one at the place of the lidar.
    camera_is_thought: bool,
    /// The intensity that counts as a reflectance of 1, where it is another.
    full_scale: Option<f32>,
    /// How far apart the points are that are put into the order of the beams; none where they
    /// are in it, or the source sees to it.
    unordered: Option<Steps>,
    /// What places its map in the world.
    pub frame: MapFrame,
    /// What the reader of the input wants people to know.
    pub notes: Vec<String>,
}

/// Which scans of a drive are stitched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Choice {
    /// Every frame whose number is a multiple of this.
    pub every: usize,
    /// First frame.
    pub first: usize,
    /// Last frame.
    pub last: usize,
}

impl Choice {
    /// Those of the frames that are chosen.
    pub fn of(&self, frames: impl IntoIterator<Item = usize>) -> Vec<usize> {
        let chosen = |f: &usize| f.is_multiple_of(self.every.max(1)) && (self.first..=self.last).contains(f);
        frames.into_iter().filter(chosen).collect()
    }

    /// What to say of the frames between the chosen ones that should have been
    /// chosen, too, and have no scan: a copy may have left them out.
    fn gaps(&self, chosen: &[usize]) -> Option<String> {
        let (first, last) = (*chosen.first()?, *chosen.last()?);
        let wanted = (first..=last).step_by(self.every.max(1));
        let missing: Vec<usize> = wanted.filter(|f| chosen.binary_search(f).is_err()).collect();
        (!missing.is_empty()).then(|| format!("no scan of frames {}, which were to be stitched", listed(&missing)))
    }
}

/// Frames in words; of many the first.
fn listed(frames: &[usize]) -> String {
    let (shown, rest) = frames.split_at(frames.len().min(MOST_NAMED));
    let shown: Vec<String> = shown.iter().map(ToString::to_string).collect();
    let more = if rest.is_empty() { String::new() } else { format!(" and {} more", rest.len()) };
    shown.join(", ") + &more
}

/// Why no scan is chosen of a folder with scans of the frames `scans`; `first` is the file that
/// that of frame 0 would be.
fn none_chosen(folder: PathBuf, first: &FilePath, scans: &[usize], every: usize) -> Error {
    if !scans.is_empty() {
        return Error::NoScanChosen { folder, every, there: listed(scans) };
    }
    let name = |path: &FilePath| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let wanted = name(first);
    let entries = std::fs::read_dir(&folder).into_iter().flatten().flatten();
    let mut others: Vec<String> = entries.map(|entry| name(&entry.path())).collect();
    others.sort();
    match others.first() {
        Some(other) => Error::OtherFiles { folder, wanted, count: others.len(), other: other.clone() },
        None => Error::EmptyFolder { folder, wanted },
    }
}

/// Most frames that are named.
const MOST_NAMED: usize = 8;

/// The survey of a drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// Where it stands: a file, or a folder of packets.
    pub path: PathBuf,
    /// `map_from_camera` of every frame.
    pub map_from_camera: Vec<Pose>,
    /// Time of every frame, seconds.
    pub times_s: Vec<f64>,
    /// `camera_from_velodyne`.
    pub camera_from_velodyne: Pose,
    /// Whether the camera is a thought one at the place of the lidar.
    pub camera_is_thought: bool,
}

impl Drive {
    /// Opens a KITTI sequence and chooses every `every`-th of its frames that
    /// have a scan, of those from `first` to `last`.
    ///
    /// # Errors
    /// What the sequence lacks, [`Error::NoScanChosen`], [`Error::OtherFiles`], or
    /// [`Error::EmptyFolder`] where it holds no scan to stitch.
    pub fn open(
        root: &FilePath,
        sequence: &str,
        every: usize,
        span: (usize, usize),
        poses: Option<&FilePath>,
        max_range_m: f32,
    ) -> Result<Self> {
        let sequence = Sequence::open(root, sequence)?;
        let path = poses.map_or_else(|| sequence.poses_path(), FilePath::to_path_buf);
        let survey = Survey {
            map_from_camera: sequence.poses_from(&path)?,
            path,
            times_s: sequence.times_s()?,
            camera_from_velodyne: Calibration::read_camera_from_velodyne(sequence.calibration_path())?,
            camera_is_thought: false,
        };
        let scans = sequence.scan_frames()?;
        let choice = Choice { every, first: span.0, last: span.1 };
        Self::new(Source::Odometry(sequence), &scans, survey, choice, max_range_m)
    }

    /// The drive of a source that has scans of the frames `scans`.
    ///
    /// # Errors
    /// [`Error::NoScanChosen`] where none of them is chosen, [`Error::EmptyFolder`] or
    /// [`Error::OtherFiles`] where there is none, [`Error::FrameWithoutPose`] where the survey does not reach one.
    pub(crate) fn new(
        source: Source,
        scans: &[usize],
        survey: Survey,
        choice: Choice,
        max_range_m: f32,
    ) -> Result<Self> {
        let frames = choice.of(scans.iter().copied());
        let poses = survey.map_from_camera.len();
        if let Some(&frame) = frames.iter().find(|f| **f >= poses) {
            return Err(Error::FrameWithoutPose { path: source.scan_path(frame), poses });
        }
        if frames.is_empty() {
            return Err(none_chosen(source.folder(), &source.scan_path(0), scans, choice.every));
        }
        let Survey { path, map_from_camera, times_s, camera_from_velodyne, camera_is_thought } = survey;
        Ok(Self {
            notes: choice.gaps(&frames).into_iter().collect(),
            source,
            frames,
            survey: map_from_camera,
            survey_path: path,
            times_s,
            camera_from_velodyne,
            max_range_m,
            deskew: (Deskew::None, 0.0),
            lidar_at_m: [0.0; 3],
            camera_is_thought,
            full_scale: None,
            unordered: None,
            // What else it is, who opened the drive says.
            frame: MapFrame::of_first_camera(None),
        })
    }

    /// First and last stitched frame.
    pub fn span(&self) -> (usize, usize) {
        let ends = self.frames.first().zip(self.frames.last());
        ends.map_or((0, 0), |(a, b)| (*a, *b))
    }

    /// Whether times came with the drive: those that are made up where it has none say nothing
    /// of how fast the vehicle was.
    pub fn has_times(&self) -> bool {
        self.times_s != assumed_times_s(self.times_s.len())
    }

    /// Name of the drive, for people.
    pub fn name(&self) -> String {
        self.source.name()
    }

    /// Where its scans lie.
    pub fn folder(&self) -> PathBuf {
        self.source.folder()
    }

    /// Whether a scan is what the lidar saw from one place: what is compared
    /// between scans (their registration, what moved) means nothing otherwise.
    pub fn has_single_scans(&self) -> bool {
        !matches!(self.source, Source::Stitched(_))
    }

    /// The file of a scan.
    pub fn scan_path(&self, frame: usize) -> PathBuf {
        self.source.scan_path(frame)
    }

    /// Says what the lidar is like, into the order of whose beams points are put. Of KITTI's
    /// layout, whose own scans are in it, one is looked at for that: false where its points
    /// are in another.
    pub(crate) fn put_lidar(&mut self, lidar: &LidarConfig, scan: &LidarScan) -> Result<bool> {
        self.put_lidar_at(lidar.at_m);
        let steps = Steps::of(lidar);
        self.source.put_lidar(lidar)?;
        self.notes.extend(self.source.order_note().map(String::from));
        let steps = steps.seen_from_origin();
        let is_ordered = !self.source.is_kitti() || steps.are_in_order(&scan.points);
        self.unordered = (!is_ordered).then_some(steps);
        Ok(is_ordered)
    }

    /// Says where the lidar is in the frame of the scans: all of the drive that is of the
    /// lidar then is of that place, and a thought camera moves with it.
    pub(crate) fn put_lidar_at(&mut self, at_m: [f64; 3]) {
        let moved = Vector3::from(at_m) - Vector3::from(self.lidar_at_m);
        if moved.norm() > 0.0 {
            let before_from_after = Translation3::from(moved);
            if self.camera_is_thought {
                let camera_from_velodyne = self.camera_from_velodyne;
                let before_from_after = camera_from_velodyne * before_from_after * camera_from_velodyne.inverse();
                self.survey.iter_mut().for_each(|pose| *pose *= before_from_after);
            } else {
                self.camera_from_velodyne *= before_from_after;
            }
        }
        self.lidar_at_m = at_m;
    }

    /// Says which intensity counts as a reflectance of 1.
    pub(crate) fn put_full_scale(&mut self, full: f32) {
        self.full_scale = (full.to_bits() != 1.0_f32.to_bits()).then_some(full);
    }

    /// Reads one scan.
    ///
    /// # Errors
    /// As [`LidarScan::read`].
    pub fn read(&self, frame: usize, vertical_angle_rad: f64) -> Result<LidarScan> {
        let scan = LidarScan::prepare(&self.read_raw(frame)?, vertical_angle_rad);
        Ok(LidarScan { is_uneven: self.source.is_uneven(), ..scan })
    }

    /// Reads one scan as the file has it, but for the motion during it.
    pub(crate) fn read_raw(&self, frame: usize) -> Result<Scan> {
        let mut scan = self.source.read(frame, self.max_range_m)?;
        if self.lidar_at_m.iter().any(|v| *v != 0.0) {
            let [x_m, y_m, z_m] = self.lidar_at_m.map(|v| v as f32);
            for p in &mut scan.points {
                (p.x_m, p.y_m, p.z_m) = (p.x_m - x_m, p.y_m - y_m, p.z_m - z_m);
            }
        }
        if let Some(steps) = self.unordered {
            steps.put_in_order(&mut scan.points, &[]);
        }
        if let Some(full) = self.full_scale {
            for p in &mut scan.points {
                p.reflectance /= full;
            }
        }
        let (deskew, turn_s) = self.deskew;
        if deskew != Deskew::None {
            deskew.apply(&mut scan.points, &self.motion_per_s(frame), turn_s);
        }
        Ok(scan)
    }

    /// Motion of the lidar at a frame, in its own frame, per second, by the
    /// survey's poses before and after; none where there is only one.
    fn motion_per_s(&self, frame: usize) -> Tangent {
        let (a, b) = (frame.saturating_sub(1), (frame + 1).min(self.survey.len().saturating_sub(1)));
        let pose =
            |f: usize| self.survey.get(f).zip(self.times_s.get(f)).map(|(p, t)| (p * self.camera_from_velodyne, *t));
        match pose(a).zip(pose(b)) {
            Some(((before, from_s), (after, to_s))) if to_s > from_s => local(&before, &after) / (to_s - from_s),
            _ => Tangent::zeros(),
        }
    }

    /// Reads scans in parallel, a batch at a time, and hands `map`'s results
    /// to `each` in the order of the frames; memory is bounded by the batch.
    ///
    /// # Errors
    /// The first error in the order of the frames.
    pub fn for_each<'a, T: Send>(
        &self,
        frames: &'a [usize],
        vertical_angle_rad: f64,
        map: impl Fn(usize, LidarScan) -> T + Sync,
        mut each: impl FnMut(usize, T) + Send,
    ) -> Result<()> {
        // One scan for each thread: what one takes while it is read and
        // stitched, some 14 MB, comes on top of the cloud, and what one gave.
        let mut batches = frames.chunks(rayon::current_num_threads().max(1));
        let read = |batch: &'a [usize]| {
            let results = batch.par_iter().map(|&f| Ok(map(f, self.read(f, vertical_angle_rad)?)));
            (batch, results.collect::<Vec<Result<T>>>())
        };
        let mut ahead = batches.next().map(read);
        while let Some((batch, results)) = ahead {
            // What one batch gave is taken while the next one is read.
            let take = || batch.iter().zip(results).try_for_each(|(&frame, result)| result.map(|r| each(frame, r)));
            let (next, taken) = rayon::join(|| batches.next().map(read), take);
            taken?;
            ahead = next;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_that_a_copy_left_out_are_named() {
        let every_5th = Choice { every: 5, first: 0, last: usize::MAX };
        assert_eq!(every_5th.gaps(&[]), None);
        assert_eq!(every_5th.gaps(&[5, 10, 15]), None);
        let note = every_5th.gaps(&[0, 15, 20, 30]).unwrap();
        assert!(note.starts_with("no scan of frames 5, 10, 25,"), "{note}");
        let note = Choice { every: 1, ..every_5th }.gaps(&[0, 11]).unwrap();
        assert!(note.contains("1, 2, 3, 4, 5, 6, 7, 8 and 2 more"), "{note}");
    }
}
