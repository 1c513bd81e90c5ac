//! Trajectories, as KITTI rows and as TUM lines.
//!
//! A KITTI file has one row per frame of the sequence and no times: a frame
//! without a pose is a row of twelve `nan`, so that the row number stays the
//! frame. A TUM file has one line `t tx ty tz qx qy qz qw` per pose. Both are
//! read with commas between the numbers and names above them, too, as tables are
//! written.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{Quaternion, Translation3, UnitQuaternion};

use crate::geometry::Pose;
use crate::kitti::poses_of;
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
    /// accepted), [`Error::BadNumber`], [`Error::BadRow`],
    /// [`Error::NotARotation`] or [`Error::Mirrors`] at their line,
    /// [`Error::Io`] where the file cannot be read.
    pub fn read_kitti(path: impl AsRef<Path>, times_s: &[f64]) -> Result<Self> {
        let path = path.as_ref();
        let content = text::read(path)?;
        let rows = text::rows_below_names(&content).count();
        if rows > times_s.len() {
            return Err(Error::PoseCount {
                poses_path: path.to_path_buf(),
                poses: rows,
                times_path: "times.txt".into(),
                times: times_s.len(),
            });
        }
        let mut stamps = Vec::with_capacity(rows);
        for (frame, ((line, row), &time_s)) in text::rows_below_names(&content).zip(times_s).enumerate() {
            if !text::words(row).all(|value| value.eq_ignore_ascii_case("nan")) {
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
        let rows = self.stamps.iter().map(|stamp| stamp.frame + 1).max().unwrap_or(0);
        let mut rows = vec!["nan nan nan nan nan nan nan nan nan nan nan nan".to_owned(); rows];
        for stamp in &self.stamps {
            rows[stamp.frame] = text::pose_row(&stamp.map_from_camera);
        }
        rows.push(String::new());
        atomic_file::write(path, rows.join("\n").as_bytes())
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
        for StampedRow { line, time_s, pose } in read_tum_rows(path)? {
            let frame =
                frame_at(times_s, time_s).ok_or_else(|| Error::NoFrameAt { path: path.to_path_buf(), line, time_s })?;
            if stamps.last().is_some_and(|before| before.frame >= frame) {
                return Err(Error::TimeOrder { path: path.to_path_buf(), line, time_s });
            }
            stamps.push(StampedPose { frame, time_s: times_s[frame], map_from_camera: pose });
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

/// A line of a TUM file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedRow {
    /// The line, counted from 1.
    pub line: usize,
    /// Its time, seconds.
    pub time_s: f64,
    /// Its pose, in the frames of whoever wrote it.
    pub pose: Pose,
}

/// Reads TUM lines as they are, whatever their frames are.
///
/// # Errors
/// [`Error::TimeOrder`] where the times do not ascend, [`Error::BadNumber`] or
/// [`Error::BadRow`] at their line, [`Error::NotARotation`] where a quaternion
/// is not of unit length, [`Error::Io`] where the file cannot be read.
pub fn read_tum_rows(path: impl AsRef<Path>) -> Result<Vec<StampedRow>> {
    let path = path.as_ref();
    tum_rows_of(path, &text::read(path)?)
}

fn tum_rows_of(path: &Path, content: &str) -> Result<Vec<StampedRow>> {
    let mut rows: Vec<StampedRow> = Vec::new();
    for (line, row) in text::rows_below_names(content) {
        let [time_s, x, y, z, i, j, k, w] = text::numbers(path, line, row)?;
        if rows.last().is_some_and(|before| before.time_s >= time_s) {
            return Err(Error::TimeOrder { path: path.to_path_buf(), line, time_s });
        }
        let quaternion = Quaternion::new(w, i, j, k);
        let deviation = (quaternion.norm() - 1.0).abs();
        if deviation > text::ROTATION_LIMIT {
            let limit = text::ROTATION_LIMIT;
            return Err(Error::NotARotation { path: path.to_path_buf(), line, deviation, limit });
        }
        let pose = Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_quaternion(quaternion));
        rows.push(StampedRow { line, time_s, pose });
    }
    Ok(rows)
}

/// Poses of either form.
#[derive(Debug, Clone, PartialEq)]
pub enum PoseFile {
    /// TUM lines.
    Stamped(Vec<StampedRow>),
    /// KITTI rows, one after the other.
    Rows(Vec<Pose>),
}

/// Reads a file of TUM lines (8 numbers) or of KITTI rows (12 numbers), as its first row
/// says; once, for a pipe gives its content to one reader.
///
/// # Errors
/// [`Error::NoPoses`] where it holds no row, and as [`read_tum_rows`] and
/// [`read_poses`](crate::kitti::read_poses).
pub fn read_pose_file(path: impl AsRef<Path>) -> Result<PoseFile> {
    let path = path.as_ref();
    let content = text::read(path)?;
    let first = text::rows_below_names(&content).next();
    let (_, row) = first.ok_or_else(|| Error::NoPoses { path: path.to_path_buf() })?;
    Ok(if text::words(row).count() == 8 {
        PoseFile::Stamped(tum_rows_of(path, &content)?)
    } else {
        PoseFile::Rows(poses_of(path, &content)?)
    })
}

/// The frame whose time is nearest, if it is within the tolerance.
fn frame_at(times_s: &[f64], time_s: f64) -> Option<usize> {
    let after = times_s.partition_point(|&t| t < time_s);
    let distance = |frame: usize| times_s.get(frame).map_or(f64::INFINITY, |t| (t - time_s).abs());
    let before = after.saturating_sub(1);
    let nearest = if distance(before) < distance(after) { before } else { after };
    (distance(nearest) <= TIME_TOLERANCE_S).then_some(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::PoseParameters;
    use proptest::prelude::*;

    const TIMES_S: [f64; 6] = [0.0, 0.103_662, 0.207_325, 0.310_988, 0.414_651, 0.518_314];

    prop_compose! {
        fn pose()(
            x_m in -1e3..1e3_f64,
            y_m in -1e2..1e2_f64,
            z_m in -1e3..1e3_f64,
            yaw_rad in -3.1..3.1_f64,
            pitch_rad in -1.5..1.5_f64,
            roll_rad in -3.1..3.1_f64,
        ) -> Pose {
            PoseParameters { x_m, y_m, z_m, yaw_rad, pitch_rad, roll_rad }.to_pose()
        }
    }

    /// Some of six frames.
    fn trajectory() -> impl Strategy<Value = Trajectory> {
        prop::collection::vec(prop::option::of(pose()), TIMES_S.len()).prop_map(|poses| {
            let stamp = |(frame, pose): (usize, Option<Pose>)| {
                pose.map(|map_from_camera| StampedPose { frame, time_s: TIMES_S[frame], map_from_camera })
            };
            Trajectory { stamps: poses.into_iter().enumerate().filter_map(stamp).collect() }
        })
    }

    fn file() -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trajectory.txt");
        (folder, path)
    }

    fn assert_same(a: &Trajectory, b: &Trajectory) -> std::result::Result<(), TestCaseError> {
        prop_assert_eq!(a.stamps.len(), b.stamps.len());
        for (a, b) in a.stamps.iter().zip(&b.stamps) {
            prop_assert_eq!((a.frame, a.time_s), (b.frame, b.time_s));
            let difference = a.map_from_camera.inverse() * b.map_from_camera;
            prop_assert!(difference.translation.vector.norm() < 1e-6);
            prop_assert!(difference.rotation.angle() < 1e-7);
        }
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn kitti_rows_give_back_the_trajectory(trajectory in trajectory()) {
            let (_folder, path) = file();
            trajectory.write_kitti(&path).unwrap();
            assert_same(&trajectory, &Trajectory::read_kitti(&path, &TIMES_S).unwrap())?;
        }

        #[test]
        fn tum_lines_give_back_the_trajectory(trajectory in trajectory()) {
            let (_folder, path) = file();
            trajectory.write_tum(&path).unwrap();
            assert_same(&trajectory, &Trajectory::read_tum(&path, &TIMES_S).unwrap())?;
        }
    }

    #[test]
    fn the_row_number_of_a_kitti_file_is_the_frame() {
        let (_folder, path) = file();
        let stamp = StampedPose { frame: 2, time_s: TIMES_S[2], map_from_camera: Pose::identity() };
        Trajectory { stamps: vec![stamp] }.write_kitti(&path).unwrap();
        let content = std::fs::read_to_string(&path).unwrap();
        assert_eq!(content.lines().count(), 3);
        let back = Trajectory::read_kitti(&path, &TIMES_S).unwrap();
        assert_eq!(back.at_frame(2), Some(&stamp));
        assert_eq!(back.at_frame(1), None);
    }

    #[test]
    fn poses_out_of_a_table_are_poses() {
        let (_folder, path) = file();
        let trajectory = Trajectory::from_poses(&[Pose::translation(1.0, -2.0, 3.5); 6], &TIMES_S);
        trajectory.write_tum(&path).unwrap();
        let commas = |content: String| content.replace(' ', ",");
        let table = commas(std::fs::read_to_string(&path).unwrap());
        std::fs::write(&path, format!("# of a receiver\n\"t\",x,y,z,qx,qy,qz,qw\n{table}")).unwrap();
        assert_same(&trajectory, &Trajectory::read_tum(&path, &TIMES_S).unwrap()).unwrap();
        assert!(matches!(read_pose_file(&path).unwrap(), PoseFile::Stamped(rows) if rows[0].line == 3));
        trajectory.write_kitti(&path).unwrap();
        let rows = commas(std::fs::read_to_string(&path).unwrap());
        std::fs::write(&path, format!("r11,r12,r13,x,r21,r22,r23,y,r31,r32,r33,z\n{rows}")).unwrap();
        assert_same(&trajectory, &Trajectory::read_kitti(&path, &TIMES_S).unwrap()).unwrap();
        assert!(matches!(read_pose_file(&path).unwrap(), PoseFile::Rows(poses) if poses.len() == 6));
        // Names amid the numbers are a fault, with its line.
        std::fs::write(&path, format!("{rows}r11,r12,r13,x,r21,r22,r23,y,r31,r32,r33,z\n")).unwrap();
        assert!(matches!(read_pose_file(&path), Err(Error::BadNumber { line: 7, .. })));
    }

    #[test]
    fn a_trajectory_of_another_sequence_is_refused() {
        let (_folder, path) = file();
        Trajectory::from_poses(&[Pose::identity(); 6], &TIMES_S).write_kitti(&path).unwrap();
        assert!(matches!(
            Trajectory::read_kitti(&path, &TIMES_S[..5]),
            Err(Error::PoseCount { poses: 6, times: 5, .. })
        ));
        let tum = |content: &str| {
            std::fs::write(&path, content).unwrap();
            Trajectory::read_tum(&path, &TIMES_S)
        };
        assert!(matches!(tum("# t ..\n0.15 0 0 0 0 0 0 1\n"), Err(Error::NoFrameAt { line: 2, .. })));
        assert!(matches!(tum("0.103 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n"), Err(Error::TimeOrder { line: 2, .. })));
        assert!(matches!(tum("0 0 0 0 0 0 0 0.5\n"), Err(Error::NotARotation { line: 1, .. })));
        assert_eq!(tum("0.1037 1 2 3 0 0 0 1\n").unwrap().stamps[0].frame, 1);
    }
}
