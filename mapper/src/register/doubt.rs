//! How far the survey may be believed beside the scans.
//!
//! Compared are ways and the angles of turns: neither feels how the survey's
//! axes are turned against the camera's.

use common::geometry::Pose;
use nalgebra::{Matrix3, Matrix6, Vector3};

use super::graph::{GraphConfig, Motion};
use crate::quantile::upper_median;
use crate::roads::runs;

/// Steps that are looked at together, two to either side: a survey that lost its
/// satellites is wrong for several, a scan that found no place for one.
const STEPS: usize = 5;

/// Of fewer, one would decide.
const FEWEST_STEPS: usize = 3;

/// Median of a chi-square of two degrees of freedom.
const MEDIAN_CHI_SQUARE: f64 = 1.386;

/// How many times less accurate than stated the survey is around each frame; 1
/// where most of its steps lie within `robust_sigmas` of those of the scans.
pub(super) fn doubts(survey: &[Pose], motions: &[Motion], weights: &[Matrix6<f64>], config: &GraphConfig) -> Vec<f64> {
    let steps: Vec<f64> =
        survey.windows(2).zip(motions).zip(weights).map(|((poses, m), w)| off_squared(poses, m, w, config)).collect();
    (0..survey.len())
        .map(|frame| {
            // Of the steps to and from the frame as many as there are.
            let first = (frame + 1).saturating_sub(STEPS.div_ceil(2)).min(steps.len().saturating_sub(STEPS));
            let around = &steps[first..(first + STEPS).min(steps.len())];
            let doubt = (upper_median(around.to_vec()) / MEDIAN_CHI_SQUARE).sqrt();
            if around.len() >= FEWEST_STEPS && doubt > config.robust_sigmas { doubt } else { 1.0 }
        })
        .collect()
}

/// How far a step of the survey is from that of the scans, in standard deviations,
/// squared: its way and the angle of its turn, a chi-square of two degrees of freedom.
fn off_squared(survey: &[Pose], motion: &Motion, weight: &Matrix6<f64>, config: &GraphConfig) -> f64 {
    let covariance = weight.try_inverse().unwrap_or_else(Matrix6::zeros);
    let of = |first: usize| covariance.fixed_view::<3, 3>(first, first).into_owned();
    let surveyed = survey[0].inverse() * survey[1];
    let registered = &motion.before_from_after;
    // In the later camera's axes, as the covariance is.
    let way = registered.rotation.inverse() * registered.translation.vector;
    squared_sigmas((surveyed.translation.vector, way), &of(0), config.survey_motion_sigma_m)
        + squared_sigmas(
            (surveyed.rotation.scaled_axis(), registered.rotation.scaled_axis()),
            &of(3),
            config.survey_motion_sigma_rad,
        )
}

/// Squared difference of the lengths of two vectors, in standard deviations.
fn squared_sigmas(
    (surveyed, registered): (Vector3<f64>, Vector3<f64>),
    covariance: &Matrix3<f64>,
    survey_sigma: f64,
) -> f64 {
    let along = registered.try_normalize(1e-9).unwrap_or_else(Vector3::z);
    (surveyed.norm() - registered.norm()).powi(2) / (survey_sigma.powi(2) + along.dot(&(covariance * along)))
}

/// The accuracy of the survey's positions, metres per axis, that its distances
/// have beside those of the scans, whose poses and the way driven to them are
/// given: no better than stated, and none of what the scans leave open is put
/// down to it. Distances do not feel a misalignment of the axes.
pub(super) fn survey_sigma_m(
    survey: &[Pose],
    (registered, driven_m): (&[Pose], &[f64]),
    motions: &[Motion],
    weights: &[Matrix6<f64>],
    config: &GraphConfig,
) -> f64 {
    let mut variance_m2 = vec![0.0];
    for (k, (motion, weight)) in motions.iter().zip(weights).enumerate() {
        let way = motion.before_from_after.translation.vector;
        let along = motion.before_from_after.rotation.inverse() * way.try_normalize(1e-6).unwrap_or_else(Vector3::z);
        let covariance = weight.try_inverse().unwrap_or_else(Matrix6::zeros);
        variance_m2.push(variance_m2[k] + along.dot(&(covariance.fixed_view::<3, 3>(0, 0) * along)));
    }
    let distance_m =
        |poses: &[Pose], a: usize, b: usize| (poses[b].translation.vector - poses[a].translation.vector).norm();
    let n = survey.len().min(registered.len());
    // One of each place: where the vehicle stands, all would say the same.
    let (off_m2, open_m2): (Vec<f64>, Vec<f64>) = runs(&driven_m[..n])
        .into_iter()
        .map(|place| place.start)
        .map(|a| (a, driven_m.partition_point(|way| way - driven_m[a] < config.survey_check_m)))
        .filter(|(_, b)| *b < n)
        .map(|(a, b)| {
            let off_m = distance_m(survey, a, b) - distance_m(registered, a, b);
            (off_m * off_m, variance_m2[b] - variance_m2[a])
        })
        .unzip();
    if off_m2.len() < FEWEST_CHECKS {
        return config.survey_sigma_m;
    }
    // A standard deviation is 1.48 median deviations; two positions make a
    // distance.
    let found_m2 = (1.48_f64.powi(2) * upper_median(off_m2) - upper_median(open_m2)) / 2.0;
    config.survey_sigma_m.max(found_m2.max(0.0).sqrt())
}

/// Fewer distances do not tell how accurate a survey is.
const FEWEST_CHECKS: usize = 4;
