//! From the survey's poses to poses that the scans agree with.

use std::collections::BTreeMap;

use common::geometry::{Pose, interpolate, local};
use nalgebra::{Matrix6, Point3, UnitQuaternion};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::align::{AlignConfig, ScanSurface, align, scan_surfaces};
use super::graph::{GraphConfig, Motion, refine_poses};
use super::local_map::LocalMap;
use crate::drive::Drive;
use crate::error::Result;
use crate::scan::raised;
use crate::voxel::{Moments, voxel_moments};

/// How the survey's poses are refined.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RefineConfig {
    /// Registration of one scan.
    pub align: AlignConfig,
    /// Scans against survey.
    pub graph: GraphConfig,
    /// The lidar's vertical angle.
    pub vertical_angle: VerticalAngleConfig,
}

/// How an error of the lidar's vertical angles is found: points too low by a
/// constant angle bend the ground, and a scan laid on the bent ground of the
/// one before pitches by the same angle again and again, which the survey's
/// orientations do not show.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VerticalAngleConfig {
    /// Whether the angle is estimated; `fixed_rad` is used where not.
    pub estimate: bool,
    /// The angle by which points are raised where it is not estimated, radians.
    pub fixed_rad: f64,
    /// Distance between the scans compared, metres: over less, the ground is
    /// seen by the same beams and bends the same way.
    pub spacing_m: f64,
    /// Number of motions that the estimate is taken from.
    pub motions: usize,
    /// Largest angle believed, radians: more is no calibration error.
    pub largest_rad: f64,
    /// The estimate is used only if it exceeds its standard deviation so many
    /// times.
    pub significance: f64,
}

impl Default for VerticalAngleConfig {
    fn default() -> Self {
        Self { estimate: true, fixed_rad: 0.0, spacing_m: 5.0, motions: 8, largest_rad: 0.009, significance: 3.0 }
    }
}

/// What the refinement estimated and what it gave.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Report {
    /// Angle by which the lidar's points were raised, radians.
    pub vertical_angle_rad: f64,
    /// Constant misalignment of the survey's axes, rotation vector in camera
    /// axes, radians.
    pub misalignment_rad: [f64; 3],
    /// Root mean square change of the positions, metres.
    pub moved_rms_m: f64,
    /// Largest change of a position, metres.
    pub moved_max_m: f64,
    /// Root mean square distance of scan surfaces to the local map, at the
    /// survey's poses, metres.
    pub rms_given_m: f64,
    /// The same at the registered poses, metres.
    pub rms_refined_m: f64,
}

/// Poses that the scans agree with.
#[derive(Debug, Clone)]
pub struct Registration {
    /// `map_from_camera` of every frame of the drive, stitched or not.
    pub map_from_camera: Vec<Pose>,
    /// What was estimated.
    pub report: Report,
}

impl Registration {
    /// The survey's poses as they are.
    pub fn given(survey: &[Pose]) -> Self {
        Self { map_from_camera: survey.to_vec(), report: Report::default() }
    }
}

/// Scans that are read ahead in parallel: what is held in memory at a time.
const BATCH: usize = 8;

struct Odometry {
    motions: Vec<Motion>,
    rms_given_m: f64,
    rms_refined_m: f64,
}

/// Voxels of scans that were read already, by frame, before any raising.
type KnownCells = BTreeMap<usize, Vec<Moments>>;

fn read_cells(drive: &Drive, frame: usize, config: &AlignConfig) -> Result<Vec<Moments>> {
    let range = config.nearest_m.powi(2)..config.farthest_m.powi(2);
    let scan = drive.read(frame, 0.0)?;
    let used: Vec<Point3<f64>> = scan.points.into_iter().filter(|p| range.contains(&p.coords.norm_squared())).collect();
    Ok(voxel_moments(&used, config.scan_voxel_m))
}

/// Registers each scan of `frames`, raised by an angle, against those before it.
fn odometry(
    drive: &Drive,
    frames: &[usize],
    angle_rad: f64,
    config: &AlignConfig,
    known: &KnownCells,
) -> Result<Odometry> {
    let camera_from_velodyne = drive.camera_from_velodyne;
    let velodyne_from_camera = camera_from_velodyne.inverse();
    let mut map = LocalMap::new(config.map_voxel_m, config.keep_scans, config.surface);
    let mut last: Option<(usize, Pose)> = None;
    let mut result = Odometry { motions: Vec::new(), rms_given_m: 0.0, rms_refined_m: 0.0 };
    // A voxel is too small to be bent by the angle: its mean moves.
    let turn = angle_rad.sin_cos();
    let prepare = |frame: usize| -> Result<(Vec<Moments>, Vec<ScanSurface>)> {
        let raise = |c: &Moments| Moments { mean: raised(&c.mean, turn), ..*c };
        let cells: Vec<Moments> = match known.get(&frame) {
            Some(cells) => cells.iter().map(raise).collect(),
            None => read_cells(drive, frame, config)?.iter().map(raise).collect(),
        };
        let surfaces = scan_surfaces(&cells, &config.surface);
        Ok((cells, surfaces))
    };
    for (b, batch) in frames.chunks(BATCH).enumerate() {
        let prepared: Vec<Result<_>> = batch.par_iter().map(|frame| prepare(*frame)).collect();
        for (k, (&frame, scan)) in batch.iter().zip(prepared).enumerate() {
            let (cells, surfaces) = scan?;
            let pose = match last {
                None => drive.survey[frame] * camera_from_velodyne,
                Some((before, before_pose)) => {
                    let guess = before_pose
                        * velodyne_from_camera
                        * drive.survey[before].inverse()
                        * drive.survey[frame]
                        * camera_from_velodyne;
                    let found = align(&map, &surfaces, &guess, config);
                    // The normal matrix is in the tangent of the Velodyne frame.
                    let tangent = adjoint(&velodyne_from_camera);
                    result.motions.push(Motion {
                        before_from_after: camera_from_velodyne
                            * before_pose.inverse()
                            * found.map_from_velodyne
                            * velodyne_from_camera,
                        information: tangent.transpose() * found.information * tangent,
                    });
                    result.rms_given_m += found.first_rms_m.powi(2);
                    result.rms_refined_m += found.rms_m.powi(2);
                    found.map_from_velodyne
                }
            };
            map.insert(b * BATCH + k, &cells, &pose);
            last = Some((frame, pose));
        }
    }
    let n = result.motions.len().max(1) as f64;
    result.rms_given_m = (result.rms_given_m / n).sqrt();
    result.rms_refined_m = (result.rms_refined_m / n).sqrt();
    Ok(result)
}

/// Takes a small motion in frame `b` to the same motion in frame `a`.
fn adjoint(a_from_b: &Pose) -> Matrix6<f64> {
    let r = a_from_b.rotation.to_rotation_matrix().into_inner();
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(&r);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(&(a_from_b.translation.vector.cross_matrix() * r));
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
    m
}

/// Difference of pitch between registration and survey, per motion, radians.
fn pitch_differences(drive: &Drive, frames: &[usize], motions: &[Motion]) -> Vec<f64> {
    motions
        .iter()
        .zip(frames.windows(2))
        .map(|(m, f)| {
            let survey = drive.survey[f[0]].inverse() * drive.survey[f[1]];
            local(&survey, &m.before_from_after)[3]
        })
        .collect()
}

/// Stitched frames at least `spacing_m` apart, from the first on.
fn spaced_frames(drive: &Drive, settings: &VerticalAngleConfig) -> Vec<usize> {
    let mut frames: Vec<usize> = Vec::new();
    for &f in &drive.frames {
        let far = frames.last().is_none_or(|last| {
            let step = drive.survey[f].translation.vector - drive.survey[*last].translation.vector;
            step.norm() >= settings.spacing_m
        });
        if far && frames.len() <= settings.motions {
            frames.push(f);
        }
    }
    frames
}

/// Trial angle of the secant, radians: of the size of real calibration errors.
const TRIAL_RAD: f64 = 0.0035;

/// The angle by which the lidar's points must be raised, radians, and the
/// scans that were read to find it.
fn vertical_angle(drive: &Drive, config: &RefineConfig) -> Result<(f64, KnownCells)> {
    let settings = &config.vertical_angle;
    let frames = spaced_frames(drive, settings);
    let frames = frames.as_slice();
    if !settings.estimate || frames.len() < 4 {
        return Ok((settings.fixed_rad, KnownCells::new()));
    }
    let read: Vec<Result<_>> = frames.par_iter().map(|f| Ok((*f, read_cells(drive, *f, &config.align)?))).collect();
    let known = read.into_iter().collect::<Result<KnownCells>>()?;
    let trial = |angle| -> Result<Vec<f64>> {
        let found = odometry(drive, frames, angle, &config.align, &known)?;
        Ok(pitch_differences(drive, frames, &found.motions))
    };
    let (none, some) = rayon::join(|| trial(0.0), || trial(TRIAL_RAD));
    let (none, some) = (none?, some?);
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let slope = (mean(&some) - mean(&none)) / TRIAL_RAD;
    if slope.abs() < 1e-3 {
        return Ok((0.0, known));
    }
    let angle = -mean(&none) / slope;
    let n = none.len() as f64;
    let spread = none.iter().map(|d| (d - mean(&none)).powi(2)).sum::<f64>() / (n - 1.0);
    let sigma = (spread / n).sqrt() / slope.abs();
    let believed = angle.abs() < settings.largest_rad && angle.abs() > settings.significance * sigma;
    Ok((if believed { angle } else { 0.0 }, known))
}

/// Refines the survey's poses of a drive by registering its stitched scans.
///
/// # Errors
/// A scan that cannot be read.
pub fn refine(drive: &Drive, config: &RefineConfig) -> Result<Registration> {
    let (angle, known) = vertical_angle(drive, config)?;
    let found = odometry(drive, &drive.frames, angle, &config.align, &known)?;
    let survey: Vec<Pose> = drive.frames.iter().map(|f| drive.survey[*f]).collect();
    let refined = refine_poses(&survey, &found.motions, &config.graph);
    let moved: Vec<f64> = refined
        .map_from_camera
        .iter()
        .zip(&survey)
        .map(|(a, b)| (a.translation.vector - b.translation.vector).norm())
        .collect();
    let misalignment = refined.survey_from_camera.scaled_axis();
    Ok(Registration {
        map_from_camera: carry_over(
            &drive.survey,
            &drive.frames,
            &refined.map_from_camera,
            &refined.survey_from_camera,
        ),
        report: Report {
            vertical_angle_rad: angle,
            misalignment_rad: misalignment.into(),
            moved_rms_m: (moved.iter().map(|m| m * m).sum::<f64>() / moved.len() as f64).sqrt(),
            moved_max_m: moved.iter().copied().fold(0.0, f64::max),
            rms_given_m: found.rms_given_m,
            rms_refined_m: found.rms_refined_m,
        },
    })
}

/// Carries the corrections of the stitched frames over to all frames: between
/// two stitched frames the correction changes linearly, beyond them it stays.
fn carry_over(
    survey: &[Pose],
    frames: &[usize],
    refined: &[Pose],
    survey_from_camera: &UnitQuaternion<f64>,
) -> Vec<Pose> {
    let aligned = |f: usize| Pose::from_parts(survey[f].translation, survey[f].rotation * survey_from_camera);
    // In the body: the correction of a neighbour applies as seen from the vehicle.
    let correction = |k: usize| aligned(frames[k]).inverse() * refined[k];
    (0..survey.len())
        .map(|f| {
            let after = frames.partition_point(|s| *s <= f);
            let delta = if after == 0 {
                correction(0)
            } else if after == frames.len() {
                correction(after - 1)
            } else {
                let (a, b) = (frames[after - 1], frames[after]);
                let share = (f - a) as f64 / (b - a) as f64;
                interpolate(&correction(after - 1), &correction(after), share)
            };
            aligned(f) * delta
        })
        .collect()
}
