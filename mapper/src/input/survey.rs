//! Poses of any lidar, as poses of a camera in the map.

use std::path::Path;

use common::earth::World;
use common::geometry::{Pose, interpolate};
use common::kitti::{Calibration, read_times};
use common::trajectory::{PoseFile, StampedRow, read_pose_file};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::error::{Error, Result};

/// Which poses a survey holds, and the axes of the frame that they lead to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum SurveyFrame {
    /// The lidar's (x forward, y left, z up), in a world whose z points up.
    #[default]
    Lidar,
    /// The camera's (x right, y down, z forward), in a world with such axes.
    Camera,
}

impl SurveyFrame {
    /// The world of such poses.
    pub fn world(self) -> World {
        match self {
            Self::Lidar => World::ZUp,
            Self::Camera => World::CameraAxes,
        }
    }
}

/// Coordinates farther from the origin than this are reduced, metres: those
/// of a national grid, which take more digits than clouds have.
const FARTHEST_M: f64 = 20_000.0;
/// What they are reduced by is a multiple of this, metres, the next below the
/// first pose: so drives of one place mostly are reduced alike, but not those
/// that start on both sides of a multiple. `--reduce` says it for all.
const REDUCED_BY_M: f64 = 10_000.0;

/// Map axes (x right, y down, z forward) from those of a world with z up (x
/// forward, y left): the map of a world that is the lidar at the first frame
/// is the camera's that looks ahead.
fn map_from_world() -> UnitQuaternion<f64> {
    let axes = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}

/// How poses and clouds of a survey get into the map.
#[derive(Debug, Clone, Copy)]
pub struct Placement {
    frame: SurveyFrame,
    /// `camera_from_velodyne`.
    pub camera_from_velodyne: Pose,
    /// Whether the camera is a thought one at the place of the lidar, whose poses are given.
    pub camera_is_thought: bool,
    /// What is taken off the coordinates of the survey's world, metres.
    pub reduced_by_m: Vector3<f64>,
}

impl Placement {
    /// The placement of a survey; without a calibration the camera is a
    /// thought one, at the lidar's place and looking ahead. Nothing given as
    /// `reduced_by_m`, it depends on the first pose.
    ///
    /// # Errors
    /// As [`Calibration::read_camera_from_velodyne`].
    pub fn new(
        frame: SurveyFrame,
        calibration: Option<&Path>,
        first: Option<&Pose>,
        reduced_by_m: Option<Vector3<f64>>,
    ) -> Result<Self> {
        let camera_from_velodyne = match calibration {
            Some(path) => Calibration::read_camera_from_velodyne(path)?,
            None => Pose::from_parts(Vector3::zeros().into(), map_from_world()),
        };
        let at = first.map_or_else(Vector3::zeros, |pose| pose.translation.vector);
        let reduced = |v: f64| if v.abs() > FARTHEST_M { (v / REDUCED_BY_M).floor() * REDUCED_BY_M } else { 0.0 };
        let camera_is_thought = calibration.is_none() && frame == SurveyFrame::Lidar;
        Ok(Self {
            frame,
            camera_from_velodyne,
            camera_is_thought,
            reduced_by_m: reduced_by_m.unwrap_or_else(|| at.map(reduced)),
        })
    }

    /// `map_from_camera` of a pose of the survey.
    pub fn map_from_camera(&self, pose: &Pose) -> Pose {
        let translation = pose.translation.vector - self.reduced_by_m;
        let pose = Pose::from_parts(translation.into(), pose.rotation);
        match self.frame {
            SurveyFrame::Camera => pose,
            SurveyFrame::Lidar => {
                Pose::from_parts(Vector3::zeros().into(), map_from_world()) * pose * self.camera_from_velodyne.inverse()
            }
        }
    }

    /// A point of a cloud in the survey's world, map frame. Clouds have z up:
    /// that of a camera's world is x right, y forward, z up, as `--cloud`
    /// writes it.
    pub fn map_from_cloud(&self, point: &nalgebra::Point3<f64>) -> nalgebra::Point3<f64> {
        self.frame.world().map_from_survey(self.reduced_by_m.into(), point)
    }

    /// What people should know about it, if anything.
    pub fn note(&self) -> Option<String> {
        let [x, y, z] = self.reduced_by_m.into();
        let by = format!("({x}, {y}, {z}) m; give other drives of this frame --reduce {x},{y},{z}");
        (self.reduced_by_m.norm() > 0.0).then(|| format!("the survey's coordinates are reduced by {by}"))
    }
}

/// A file of poses.
pub enum Poses {
    /// By time, ascending.
    Stamped(Vec<StampedRow>),
    /// One after the other.
    Rows(Vec<Pose>),
}

impl Poses {
    /// Reads TUM lines or KITTI rows.
    ///
    /// # Errors
    /// As [`read_pose_file`].
    pub fn read(path: &Path) -> Result<Self> {
        Ok(match read_pose_file(path)? {
            PoseFile::Stamped(rows) => Self::Stamped(rows),
            PoseFile::Rows(poses) => Self::Rows(poses),
        })
    }

    /// Its first pose.
    pub fn first(&self) -> Option<&Pose> {
        match self {
            Self::Stamped(rows) => rows.first().map(|row| &row.pose),
            Self::Rows(poses) => poses.first(),
        }
    }
}

/// Times of a drive of so many frames that has none, seconds: ten frames a
/// second, as lidars turn.
pub fn assumed_times_s(frames: usize) -> Vec<f64> {
    (0..frames).map(|frame| frame as f64 * 0.1).collect()
}

/// The times of KITTI rows, seconds.
///
/// # Errors
/// [`Error::TimesAndPoses`] where there is not one for each, and as [`read_times`].
pub fn times_of_rows(path: &Path, survey: &Path, poses: usize) -> Result<Vec<f64>> {
    let times_s = read_times(path)?;
    if times_s.len() != poses {
        return Err(Error::TimesAndPoses {
            path: path.to_path_buf(),
            times: times_s.len(),
            survey: survey.to_path_buf(),
            poses,
        });
    }
    Ok(times_s)
}

/// The pose at a time, between two that are not more than `longest_gap_s`
/// apart; beyond the first and the last not at all.
pub fn pose_at(rows: &[StampedRow], time_s: f64, longest_gap_s: f64) -> Option<Pose> {
    // Printed times are rounded: a millisecond is no time.
    let at = |row: &StampedRow| (row.time_s - time_s).abs() <= 1e-3;
    let after = rows.partition_point(|row| row.time_s < time_s);
    if let Some(row) = rows.get(after).filter(|row| at(row)) {
        return Some(row.pose);
    }
    let before = rows.get(after.checked_sub(1)?)?;
    if at(before) {
        return Some(before.pose);
    }
    let next = rows.get(after)?;
    let gap_s = next.time_s - before.time_s;
    (gap_s <= longest_gap_s).then(|| interpolate(&before.pose, &next.pose, (time_s - before.time_s) / gap_s))
}

/// The poses of scans that have times, or none where a scan lies outside.
///
/// # Errors
/// [`Error::TimesApart`] where no scan has a pose.
pub fn poses_at(
    rows: &[StampedRow],
    times_s: &[f64],
    longest_gap_s: f64,
    (survey, scans): (&Path, &Path),
) -> Result<Vec<Option<Pose>>> {
    let poses: Vec<Option<Pose>> = times_s.iter().map(|&t| pose_at(rows, t, longest_gap_s)).collect();
    if poses.iter().all(Option::is_none) {
        let ends = |a: Option<f64>, b: Option<f64>| (a.unwrap_or(f64::NAN), b.unwrap_or(f64::NAN));
        return Err(Error::TimesApart {
            survey: survey.to_path_buf(),
            scans: scans.to_path_buf(),
            poses_s: ends(rows.first().map(|r| r.time_s), rows.last().map(|r| r.time_s)),
            scans_s: ends(times_s.first().copied(), times_s.last().copied()),
            gap_s: longest_gap_s,
        });
    }
    Ok(poses)
}
