//! Trajectories, as KITTI rows and as TUM lines.
//!
//! A KITTI file has one row per frame of the sequence and no times: a frame
//! without a pose is a row of twelve `nan`, so that the row number stays the
//! frame. A TUM file has one line `t tx ty tz qx qy qz qw` per pose.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{Quaternion, Translation3, UnitQuaternion};

use crate::geometry::Pose;
use crate::{Error, Result, atomic_file, text};

/// How far a TUM line's time may be from its frame's, seconds: a hundredth of
/// a frame at 10 Hz, and above the rounding of any printed time.
const TIME_TOLERANCE_S: f64 = 1e-3;

/// Where the camera was at a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedPose {
    /// Index of the frame in its sequence.
    pub frame: usize,
    /// Time of the frame, seconds.
    pub time_s: f64,
    /// The reference camera's pose in the map.
    pub map_from_camera: Pose,
}

/// Poses of some frames of a sequence, by ascending frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trajectory {
    /// The poses.
    pub stamps: Vec<StampedPose>,
}

impl Trajectory {
    /// One pose for every frame; as many as the shorter of both has.
    pub fn from_poses(poses: &[Pose], times_s: &[f64]) -> Self {
        let stamps = poses
            .iter()
            .zip(times_s)
            .enumerate()
            .map(|(frame, (&map_from_camera, &time_s))| StampedPose { frame, time_s, map_from_camera })
            .collect();
        Self { stamps }
    }

    /// The pose of a frame, where there is one.
    pub fn at_frame(&self, frame: usize) -> Option<&StampedPose> {
        let index = self.stamps.binary_search_by_key(&frame, |stamp| stamp.frame).ok()?;
        self.stamps.get(index)
    }

    /// Reads KITTI rows; `times_s` are the times of the sequence's frames.
    ///
    /// # Errors
    /// [`Error::PoseCount`] where there are more rows than frames (fewer are
    /// accepted), [`Error::BadNumber`], [`Error::BadRow`] or
    /// [`Error::NotARotation`] at their line, [`Error::Io`] where the file
    /// cannot be read.
    pub fn read_kitti(path: impl AsRef<Path>, times_s: &[f64]) -> Result<Self> {
        let path = path.as_ref();
        let content = text::read(path)?;
        let rows = text::rows(&content).count();
        if rows > times_s.len() {
            return Err(Error::PoseCount {
                poses_path: path.to_path_buf(),
                poses: rows,
                times_path: "times.txt".into(),
                times: times_s.len(),
            });
        }
        let mut stamps = Vec::with_capacity(rows);
        for (frame, ((line, row), &time_s)) in text::rows(&content).zip(times_s).enumerate() {
            if !row.split_whitespace().all(|value| value.eq_ignore_ascii_case("nan")) {
                stamps.push(StampedPose { frame, time_s, map_from_camera: text::pose(path, line, row)? });
            }
        }
        Ok(Self { stamps })
    }

    /// Writes KITTI rows, up to the last frame with a pose.
    ///
    /// # Errors
    /// As [`atomic_file::write`].
    pub fn write_kitti(&self, path: impl AsRef<Path>) -> Result<()> {
        let mut content = String::new();
        let mut next = 0;
        for stamp in &self.stamps {
            while next < stamp.frame {
                content.push_str("nan nan nan nan nan nan nan nan nan nan nan nan\n");
                next += 1;
            }
            content.push_str(&text::pose_row(&stamp.map_from_camera));
            content.push('\n');
            next = stamp.frame + 1;
        }
        atomic_file::write(path, content.as_bytes())
    }

    /// Reads TUM lines; the frame of each is the one of `times_s` (ascending)
    /// that is at most a millisecond away.
    ///
    /// # Errors
    /// [`Error::NoFrameAt`] where there is no such frame, [`Error::TimeOrder`]
    /// where the lines do not ascend, [`Error::BadNumber`] or
    /// [`Error::BadRow`] at their line, [`Error::NotARotation`] where a
    /// quaternion is not of unit length, [`Error::Io`] where the file cannot
    /// be read.
    pub fn read_tum(path: impl AsRef<Path>, times_s: &[f64]) -> Result<Self> {
        let path = path.as_ref();
        let mut stamps: Vec<StampedPose> = Vec::new();
        for (line, row) in text::rows(&text::read(path)?) {
            let [time_s, x, y, z, i, j, k, w] = text::numbers(path, line, row)?;
            let frame =
                frame_at(times_s, time_s).ok_or_else(|| Error::NoFrameAt { path: path.to_path_buf(), line, time_s })?;
            if stamps.last().is_some_and(|before| before.frame >= frame) {
                return Err(Error::TimeOrder { path: path.to_path_buf(), line, time_s });
            }
            let quaternion = Quaternion::new(w, i, j, k);
            let deviation = (quaternion.norm() - 1.0).abs();
            if deviation > text::ROTATION_LIMIT {
                let limit = text::ROTATION_LIMIT;
                return Err(Error::NotARotation { path: path.to_path_buf(), line, deviation, limit });
            }
            let map_from_camera =
                Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_quaternion(quaternion));
            stamps.push(StampedPose { frame, time_s: times_s[frame], map_from_camera });
        }
        Ok(Self { stamps })
    }

    /// Writes TUM lines.
    ///
    /// # Errors
    /// As [`atomic_file::write`].
    pub fn write_tum(&self, path: impl AsRef<Path>) -> Result<()> {
        let mut content = String::new();
        for stamp in &self.stamps {
            let t = stamp.map_from_camera.translation.vector;
            let q = stamp.map_from_camera.rotation.coords;
            // Writing to a string cannot fail.
            let _ = writeln!(
                content,
                "{:.6} {:.9} {:.9} {:.9} {:.12} {:.12} {:.12} {:.12}",
                stamp.time_s, t.x, t.y, t.z, q.x, q.y, q.z, q.w
            );
        }
        atomic_file::write(path, content.as_bytes())
    }
}

/// The frame whose time is nearest, if it is within the tolerance.
fn frame_at(times_s: &[f64], time_s: f64) -> Option<usize> {
    let after = times_s.partition_point(|&t| t < time_s);
    let distance = |frame: usize| times_s.get(frame).map_or(f64::INFINITY, |t| (t - time_s).abs());
    let before = after.saturating_sub(1);
    let nearest = if distance(before) < distance(after) { before } else { after };
    (distance(nearest) <= TIME_TOLERANCE_S).then_some(nearest)
}
