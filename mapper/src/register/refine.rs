//! From the survey's poses to poses that the scans agree with.

use common::geometry::{Pose, interpolate};
use nalgebra::UnitQuaternion;
use serde::{Deserialize, Serialize};

use super::align::AlignConfig;
use super::graph::{GraphConfig, refine_poses};
use super::jumps::{JumpConfig, Jumps, SurveyJump};
use super::odometry::odometry;
use super::revisits::{RevisitConfig, RevisitReport, apart_m, find_revisits, fits};
use super::vertical_angle::{VerticalAngleConfig, vertical_angle};
use crate::drive::Drive;
use crate::error::Result;

/// How the survey's poses are refined.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RefineConfig {
    /// Registration of one scan.
    pub align: AlignConfig,
    /// Scans against survey.
    pub graph: GraphConfig,
    /// Steps of the survey that are jumps.
    pub jumps: JumpConfig,
    /// The lidar's vertical angle.
    pub vertical_angle: VerticalAngleConfig,
    /// Places that the drive comes back to.
    pub revisits: RevisitConfig,
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
    /// Accuracy that the survey's positions were counted with, metres per
    /// axis: as stated, or what its distances have beside those of the scans.
    pub survey_sigma_m: f64,
    /// Stitched frames around which the survey's motion contradicts the scans,
    /// as where it had no satellites.
    #[serde(default)]
    pub survey_doubted_frames: usize,
    /// How many times less accurate than stated it was counted there at most;
    /// 1 where it was believed throughout, 0 in reports of versions that did not ask.
    #[serde(default)]
    pub survey_doubt_most: f64,
    /// What places that the drive comes back to gave.
    pub revisits: RevisitReport,
}

/// Poses that the scans agree with.
#[derive(Debug, Clone)]
pub struct Registration {
    /// `map_from_camera` of every frame of the drive, stitched or not.
    pub map_from_camera: Vec<Pose>,
    /// What was estimated.
    pub report: Report,
    /// Steps of the survey that the vehicle did not make.
    pub jumps: Vec<SurveyJump>,
}

impl Registration {
    /// The survey's poses as they are.
    pub fn given(survey: &[Pose]) -> Self {
        Self { map_from_camera: survey.to_vec(), report: Report::default(), jumps: Vec::new() }
    }
}

/// Refines the survey's poses of a drive by registering its stitched scans.
///
/// # Errors
/// A scan that cannot be read.
pub fn refine(drive: &Drive, config: &RefineConfig) -> Result<Registration> {
    let (angle, known) = vertical_angle(drive, config)?;
    let mut jumps = Jumps::of(drive, &config.jumps);
    let found = odometry(drive, &drive.frames, angle, config, &known, &mut jumps)?;
    let survey: Vec<Pose> = drive.frames.iter().map(|f| drive.survey[*f]).collect();
    let mut refined = refine_poses(&survey, &found.motions, &[], &config.graph);
    let (mut ties, mut revisits) = find_revisits(drive, &refined.map_from_camera, &found.motions, angle, config)?;
    if !ties.is_empty() {
        refined = refine_poses(&survey, &found.motions, &ties, &config.graph);
        // What the poses do not follow in spite of it is a false match.
        ties.retain(|tie| fits(tie, &refined.map_from_camera, config));
        if ties.len() < revisits.kept {
            refined = refine_poses(&survey, &found.motions, &ties, &config.graph);
        }
        revisits.kept = ties.len();
        revisits.apart_after_m = apart_m(&ties, &refined.map_from_camera);
    }
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
            survey_sigma_m: refined.survey_sigma_m,
            survey_doubted_frames: refined.survey_doubts.iter().filter(|doubt| **doubt > 1.0).count(),
            survey_doubt_most: refined.survey_doubts.iter().copied().fold(1.0, f64::max),
            revisits,
        },
        jumps: jumps.told(),
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
