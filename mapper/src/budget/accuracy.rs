//! How well a camera is expected to be localized along a map's roads.

use common::map::SemanticMap;
use nalgebra::{Matrix3, Matrix6, Vector6};
use serde::{Deserialize, Serialize};

use super::BudgetConfig;
use super::places::Places;
use super::sight::{self, Row};
use crate::evidence::MapEvidence;

/// A standard deviation along a drive.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Figure {
    /// At half of the places it is smaller.
    pub median: f64,
    /// At the worst place.
    pub worst: f64,
}

/// Expected standard deviations of the pose of a camera that drives along the
/// roads.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Accuracy {
    /// To the right, metres.
    pub lateral_m: Figure,
    /// Forward, metres.
    pub longitudinal_m: Figure,
    /// Heading, radians.
    pub heading_rad: Figure,
    /// Root mean square of the horizontal position over all places, metres.
    pub position_rms_m: f64,
}

/// Index of the components in the pose tangent.
const LATERAL: usize = 0;
const LONGITUDINAL: usize = 2;
const HEADING: usize = 4;

/// What is known without landmarks comes anew over this way, metres: the
/// errors of a satellite receiver change as slowly as that.
const ANEW_M: f64 = 100.0;

/// The information in what is known of the pose before any landmark.
pub(super) fn before(config: &BudgetConfig) -> Matrix6<f64> {
    Matrix6::from_diagonal(&Vector6::from(config.before_sigma.map(|sigma| sigma.max(1e-6).powi(-2))))
}

/// Weighted variance of a place: what is to be made small.
pub(super) fn badness(covariance: &Matrix6<f64>, config: &BudgetConfig) -> f64 {
    let share = |(axis, sigma): (usize, &f64)| covariance[(axis, axis)].max(0.0) / sigma.max(1e-9).powi(2);
    config.wanted_sigma.iter().enumerate().map(share).sum::<f64>().powf(config.worst_power)
}

/// What every landmark of a map tells: poles, signs, lane lines, in its order.
pub(super) fn rows(map: &SemanticMap, evidence: &MapEvidence, places: &Places, config: &BudgetConfig) -> Vec<Vec<Row>> {
    let poles = map.poles.iter().zip(&evidence.poles).map(|(p, e)| sight::of_pole(p, e, places, config));
    let signs = map.signs.iter().zip(&evidence.signs).map(|(s, e)| sight::of_sign(s, e, places, config));
    let lanes = map.lanes.iter().zip(&evidence.lanes).map(|(l, e)| sight::of_lane(l, e, places, config));
    poles.chain(signs).chain(lanes).collect()
}

/// Predicts the accuracy along some places: at each what was known at the one
/// before, less certain by the way between, and what its landmarks tell.
pub fn predict(map: &SemanticMap, evidence: &MapEvidence, places: &Places, config: &BudgetConfig) -> Accuracy {
    let mut told = vec![Matrix6::zeros(); places.list.len()];
    for Row { place, whitened: row, .. } in rows(map, evidence, places, config).into_iter().flatten() {
        told[place] += row * row.transpose();
    }
    let before = before(config);
    let drift = Matrix6::from_diagonal(&Vector6::from(config.drift_sigma.map(|sigma| sigma * sigma)));
    // In the axes of the camera there, as all that is known at a place.
    let mut last: Option<(Matrix3<f64>, Matrix6<f64>)> = None;
    let mut sigmas: [Vec<f64>; 3] = Default::default();
    let mut square_m2 = 0.0;
    for (place, told) in places.list.iter().zip(&told) {
        let carried = place.after_m.zip(last).and_then(|(metres, (camera_from_map, last))| {
            let turn = both(&(place.camera_from_map * camera_from_map.transpose()));
            let information = (turn * last * turn.transpose() + drift * metres).try_inverse()?;
            Some(information + before * (metres / ANEW_M))
        });
        let covariance = (carried.unwrap_or(before) + told).try_inverse().unwrap_or_else(Matrix6::zeros);
        for (list, axis) in sigmas.iter_mut().zip([LATERAL, LONGITUDINAL, HEADING]) {
            list.push(covariance[(axis, axis)].max(0.0).sqrt());
        }
        square_m2 += covariance[(LATERAL, LATERAL)] + covariance[(LONGITUDINAL, LONGITUDINAL)];
        last = Some((place.camera_from_map, covariance));
    }
    let [lateral, longitudinal, heading] = sigmas;
    Accuracy {
        lateral_m: figure(lateral),
        longitudinal_m: figure(longitudinal),
        heading_rad: figure(heading),
        position_rms_m: (square_m2 / places.list.len().max(1) as f64).sqrt(),
    }
}

/// Turns positions and rotations alike.
fn both(turn: &Matrix3<f64>) -> Matrix6<f64> {
    let mut both = Matrix6::zeros();
    both.fixed_view_mut::<3, 3>(0, 0).copy_from(turn);
    both.fixed_view_mut::<3, 3>(3, 3).copy_from(turn);
    both
}

fn figure(mut sigmas: Vec<f64>) -> Figure {
    sigmas.sort_by(f64::total_cmp);
    Figure {
        median: sigmas.get(sigmas.len() / 2).copied().unwrap_or(0.0),
        worst: sigmas.last().copied().unwrap_or(0.0),
    }
}
