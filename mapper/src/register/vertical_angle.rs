//! A constant error of the lidar's vertical angles, from the ground.

use common::geometry::local;
use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::RefineConfig;
use super::graph::Motion;
use super::jumps::Jumps;
use super::odometry::{KnownCells, ScanCells, odometry};
use crate::drive::Drive;
use crate::error::Result;
use crate::quantile::upper_median;

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

/// Difference of pitch between registration and survey, per motion, radians: about the axis
/// of the camera, x or z, that lies across the way, for a lidar need not look along it.
fn pitch_differences(drive: &Drive, frames: &[usize], motions: &[Motion]) -> Vec<f64> {
    let way_m = motions.iter().fold(Vector3::zeros(), |sum, m| sum + m.before_from_after.translation.vector.abs());
    let across = if way_m.z >= way_m.x { 0 } else { 2 };
    motions
        .iter()
        .zip(frames.windows(2))
        .map(|(m, f)| {
            let survey = drive.survey[f[0]].inverse() * drive.survey[f[1]];
            local(&survey, &m.before_from_after)[3 + across]
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

/// A motion counts as badly registered from so many robust standard
/// deviations off the median on: survey positions that err by a metre give
/// first guesses from which a scan may be laid on the wrong surfaces.
const OUTLIER_SIGMAS: f64 = 5.0;

/// The pairs of differences neither of which lies far from all others.
fn without_outliers(none: &[f64], some: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let limits = |values: &[f64]| {
        let middle = upper_median(values.to_vec());
        let off: Vec<f64> = values.iter().map(|v| (v - middle).abs()).collect();
        // 1.48 medians of the absolute deviations are one standard deviation.
        (middle, OUTLIER_SIGMAS * 1.48 * upper_median(off))
    };
    let ((none_middle, none_limit), (some_middle, some_limit)) = (limits(none), limits(some));
    none.iter()
        .zip(some)
        .filter(|(n, s)| (*n - none_middle).abs() <= none_limit && (*s - some_middle).abs() <= some_limit)
        .unzip()
}

/// Trial angle of the secant, radians: of the size of real calibration errors.
const TRIAL_RAD: f64 = 0.0035;

/// The angle by which the lidar's points must be raised, radians, and the
/// scans that were read to find it, raised by it.
pub(super) fn vertical_angle(drive: &Drive, config: &RefineConfig) -> Result<(f64, KnownCells)> {
    let settings = &config.vertical_angle;
    let frames = spaced_frames(drive, settings);
    let frames = frames.as_slice();
    if !settings.estimate || frames.len() < 4 {
        return Ok((settings.fixed_rad, KnownCells::new()));
    }
    let read: Vec<Result<_>> =
        frames.par_iter().map(|f| Ok((*f, ScanCells::read(drive, *f, &config.align)?))).collect();
    let mut known = read.into_iter().collect::<Result<KnownCells>>()?;
    let trial = |angle, raised: &KnownCells| -> Result<Vec<f64>> {
        let found = odometry(drive, frames, angle, config, raised, &mut Jumps::default())?;
        Ok(pitch_differences(drive, frames, &found.motions))
    };
    let (none, some) = rayon::join(|| trial(0.0, &known), || trial(TRIAL_RAD, &raised(known.clone(), TRIAL_RAD)));
    let (none, some) = without_outliers(&none?, &some?);
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let slope = (mean(&some) - mean(&none)) / TRIAL_RAD;
    if none.len() < 3 || slope.abs() < 1e-3 {
        return Ok((0.0, known));
    }
    let angle = -mean(&none) / slope;
    let n = none.len() as f64;
    let spread = none.iter().map(|d| (d - mean(&none)).powi(2)).sum::<f64>() / (n - 1.0);
    let sigma = (spread / n).sqrt() / slope.abs();
    let believed = angle.abs() < settings.largest_rad && angle.abs() > settings.significance * sigma;
    if !believed {
        return Ok((0.0, known));
    }
    known = raised(known, angle);
    Ok((angle, known))
}

fn raised(mut scans: KnownCells, angle_rad: f64) -> KnownCells {
    for scan in scans.values_mut() {
        scan.raise(angle_rad);
    }
    scans
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scan_on_the_wrong_surfaces_does_not_count() {
        let none = [-0.081, -0.068, -0.077, -0.066, -0.063, 0.937, 0.284, -0.399];
        let some = [0.005, -0.002, -0.004, -0.004, -0.003, 0.029, 1.546, -1.569];
        let (kept, _) = without_outliers(&none, &some);
        assert_eq!(kept, none[..5]);
        let (kept, _) = without_outliers(&[-0.08, -0.07, -0.09], &[0.0, 0.01, -0.01]);
        assert_eq!(kept.len(), 3, "an ordinary spread is no outlier");
        assert!(without_outliers(&[], &[]).0.is_empty());
    }
}
