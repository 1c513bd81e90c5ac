//! A drive to build a map from: its scans, its survey and its calibration.

use std::path::{Path as FilePath, PathBuf};

use common::geometry::Pose;
use common::kitti::Sequence;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::scan::LidarScan;

/// A KITTI sequence and the frames of it that are stitched.
#[derive(Debug, Clone)]
pub struct Drive {
    sequence: Sequence,
    /// Frames that are stitched, ascending.
    pub frames: Vec<usize>,
    /// `map_from_camera` of every frame of the drive as the survey has it.
    pub survey: Vec<Pose>,
    /// Time of every frame of the drive, seconds.
    pub times_s: Vec<f64>,
    /// `camera_from_velodyne`.
    pub camera_from_velodyne: Pose,
    /// Farthest point kept, metres.
    pub max_range_m: f32,
}

impl Drive {
    /// Opens a KITTI sequence and chooses every `every`-th of its frames that
    /// have a scan, of those from `first` to `last`.
    ///
    /// # Errors
    /// What the sequence lacks, and [`Error::NoScans`] where no frame is left.
    pub fn open(
        root: &FilePath,
        sequence: &str,
        every: usize,
        span: (usize, usize),
        poses: Option<&FilePath>,
        max_range_m: f32,
    ) -> Result<Self> {
        let sequence = Sequence::open(root, sequence)?;
        let survey = match poses {
            Some(path) => sequence.poses_from(path)?,
            None => sequence.poses()?,
        };
        let frames: Vec<usize> = sequence
            .scan_frames()?
            .into_iter()
            .filter(|f| f.is_multiple_of(every.max(1)) && (span.0..=span.1).contains(f))
            .collect();
        if let Some(&frame) = frames.iter().find(|f| **f >= survey.len()) {
            return Err(Error::FrameWithoutPose { path: sequence.scan_path(frame), poses: survey.len() });
        }
        if frames.is_empty() {
            return Err(Error::NoScans { folder: sequence.folder().join("velodyne"), every });
        }
        Ok(Self {
            frames,
            survey,
            times_s: sequence.times_s()?,
            camera_from_velodyne: sequence.calibration()?.camera_from_velodyne,
            max_range_m,
            sequence,
        })
    }

    /// First and last stitched frame.
    pub fn span(&self) -> (usize, usize) {
        let ends = self.frames.first().zip(self.frames.last());
        ends.map_or((0, 0), |(a, b)| (*a, *b))
    }

    /// Name of the drive, for people.
    pub fn name(&self) -> String {
        format!("kitti {}", self.sequence.name())
    }

    /// The file of a scan.
    pub fn scan_path(&self, frame: usize) -> PathBuf {
        self.sequence.scan_path(frame)
    }

    /// Reads one scan.
    ///
    /// # Errors
    /// As [`LidarScan::read`].
    pub fn read(&self, frame: usize, vertical_angle_rad: f64) -> Result<LidarScan> {
        let path = self.sequence.scan_path(frame);
        Ok(LidarScan::read(&path, self.max_range_m, vertical_angle_rad)?)
    }

    /// Reads scans in parallel, a batch at a time, and hands `map`'s results
    /// to `each` in the order of the frames; memory is bounded by the batch.
    ///
    /// # Errors
    /// The first error in the order of the frames.
    pub fn for_each<T: Send>(
        &self,
        frames: &[usize],
        vertical_angle_rad: f64,
        map: impl Fn(usize, LidarScan) -> T + Sync,
        mut each: impl FnMut(usize, T),
    ) -> Result<()> {
        for batch in frames.chunks(2 * rayon::current_num_threads().max(1)) {
            let read: Vec<Result<T>> =
                batch.par_iter().map(|&f| Ok(map(f, self.read(f, vertical_angle_rad)?))).collect();
            for (&frame, result) in batch.iter().zip(read) {
                each(frame, result?);
            }
        }
        Ok(())
    }
}
