//! Whether the estimates' own word on their error holds: normalised errors and
//! the table of Stanford (protection level against error).
//!
//! The protection level is the radius of the ball that holds the position with
//! 95 %, by the covariance. Of each frame either the level is under the alert
//! limit, and the estimate is available, or not. An error above the level is
//! misleading; an error above the alert limit while the level is below is
//! hazardous.

use common::geometry::{Pose, local};
use nalgebra::{Cholesky, Matrix6, SymmetricEigen};
use serde::Serialize;

use crate::estimate::Status;
use crate::output::Recorded;

/// Position error that nobody should meet unwarned, metres.
pub const ALERT_LIMIT_M: f64 = 0.5;
/// Standard deviations that hold 95 % of a Gaussian in three dimensions.
const SIGMAS_95: f64 = 2.795;
/// 95 % of the normalised squared errors of six degrees of freedom lie below.
const CHI_SQUARE_95: f64 = 12.59;

/// How far the estimates could be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Trust {
    /// Frames that are called ok and have a covariance.
    pub ok: usize,
    /// Their errors against their covariances; none where there is no such frame.
    #[serde(flatten)]
    pub nees: Option<Nees>,
    /// Of all frames: called ok, with a protection level under the alert limit.
    pub available: usize,
    /// Of these: the error is above the protection level.
    pub misleading: usize,
    /// Of these: the error is above the alert limit.
    pub hazardous: usize,
}

/// Squared errors normalised by the covariance (NEES).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Nees {
    /// Mean of them: 6 where the covariance tells the truth, less where it is too
    /// careful.
    pub mean_nees: f64,
    /// So many of these errors are as good as independent: the same landmarks
    /// are seen again, so errors last for some frames.
    pub independent: f64,
    /// 95 % bounds of the mean of so many.
    pub nees_bounds: [f64; 2],
    /// Share of them under the 95 % quantile, 12.6.
    pub share_within: f64,
}

impl Nees {
    /// Of the squares; none without any.
    fn of(squares: &[f64]) -> Option<Self> {
        if squares.is_empty() {
            return None;
        }
        let count = squares.len() as f64;
        let independent = independent(squares);
        Some(Self {
            mean_nees: squares.iter().sum::<f64>() / count,
            independent,
            nees_bounds: [-1.96, 1.96].map(|z| 6.0 * mean_chi_square(6.0 * independent, z)),
            share_within: squares.iter().filter(|nees| **nees <= CHI_SQUARE_95).count() as f64 / count,
        })
    }
}

impl Trust {
    /// Of estimates with their true poses; none where none has a covariance.
    pub fn of<'a>(pairs: impl Iterator<Item = (&'a Recorded, &'a Pose)>) -> Option<Self> {
        let mut trust = Self { ok: 0, nees: None, available: 0, misleading: 0, hazardous: 0 };
        let mut known = false;
        let mut squares = Vec::new();
        for (recorded, truth) in pairs {
            let Some(covariance) = recorded.covariance else { continue };
            known = true;
            let Some(factor) = Cholesky::new(covariance).filter(|_| recorded.status == Some(Status::Ok)) else {
                continue;
            };
            let error = local(&recorded.map_from_camera, truth);
            squares.push(error.dot(&factor.solve(&error)));
            let off_m = error.fixed_rows::<3>(0).norm();
            let level_m = protection_level_m(&covariance);
            if level_m <= ALERT_LIMIT_M {
                trust.available += 1;
                trust.misleading += usize::from(off_m > level_m);
                trust.hazardous += usize::from(off_m > ALERT_LIMIT_M);
            }
        }
        trust.ok = squares.len();
        trust.nees = Nees::of(&squares);
        known.then_some(trust)
    }
}

/// How many independent numbers have a mean as certain as that of these:
/// `n / (1 + 2 sum rho_k)`, the autocorrelations `rho_k` up to where the sum of
/// two that follow each other is no longer positive (Geyer, "Practical Markov
/// chain Monte Carlo", 1992). At least one.
fn independent(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count.max(1.0);
    let product = |lag: usize| values.iter().zip(&values[lag..]).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>();
    let variance = product(0);
    if variance <= 0.0 {
        return count.max(1.0);
    }
    let pairs = (0..values.len() / 2).map(|i| (product(2 * i) + product(2 * i + 1)) / variance);
    let sum: f64 = pairs.take_while(|pair| *pair > 0.0).sum();
    (count / (2.0 * sum - 1.0).max(1.0)).max(1.0)
}

/// Quantile of the mean square of so many standard normal numbers, `z` standard
/// deviations above the median (Wilson and Hilferty, 1931).
fn mean_chi_square(count: f64, z: f64) -> f64 {
    let variance = 2.0 / (9.0 * count.max(1.0));
    (1.0 - variance + z * variance.sqrt()).max(0.0).powi(3)
}

/// Radius that holds the position with 95 %, metres.
pub fn protection_level_m(covariance: &Matrix6<f64>) -> f64 {
    let position = covariance.fixed_view::<3, 3>(0, 0).into_owned();
    SIGMAS_95 * SymmetricEigen::new(position).eigenvalues.max().max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::geometry::{Tangent, retract};

    fn recorded(off_m: f64, sigma_m: f64, status: Status) -> Recorded {
        Recorded {
            frame: 0,
            map_from_camera: retract(&Pose::identity(), &Tangent::new(off_m, 0.0, 0.0, 0.0, 0.0, 0.0)),
            status: Some(status),
            correspondences: None,
            covariance: Some(Matrix6::identity() * (sigma_m * sigma_m)),
        }
    }

    #[test]
    fn who_claims_less_than_he_is_off_misleads() {
        let truth = Pose::identity();
        let all = [
            recorded(0.2, 0.1, Status::Ok),
            recorded(0.4, 0.1, Status::Ok),
            recorded(0.8, 0.1, Status::Ok),
            recorded(0.8, 0.1, Status::Degraded),
            recorded(0.8, 0.5, Status::Ok),
        ];
        let trust = Trust::of(all.iter().map(|r| (r, &truth))).unwrap();
        assert_eq!([trust.ok, trust.available, trust.misleading, trust.hazardous], [4, 3, 2, 1]);
        let nees = trust.nees.unwrap();
        assert!((nees.mean_nees - (4.0 + 16.0 + 64.0 + 2.56) / 4.0).abs() < 1e-9);
        assert!((nees.share_within - 0.5).abs() < 1e-12);
    }

    #[test]
    fn errors_that_last_are_fewer_than_they_are() {
        // Every second one turns; and the same, each for ten frames.
        let fast: Vec<f64> = (0..400).map(|i| f64::from(i * 7919 % 101)).collect();
        let slow: Vec<f64> = fast.iter().take(40).flat_map(|value| [*value; 10]).collect();
        let (of_fast, of_slow) = (independent(&fast), independent(&slow));
        assert!(of_fast > 200.0 && of_slow > 20.0 && of_slow < 80.0, "{of_fast} {of_slow}");
        assert!((independent(&[3.0; 5]) - 5.0).abs() < 1e-9 && (independent(&[]) - 1.0).abs() < 1e-9);
        // 95 % of the chi-squares of 60 degrees of freedom, from a table.
        let [low, high] = [-1.96, 1.96].map(|z| 60.0 * mean_chi_square(60.0, z));
        assert!((low - 40.48).abs() < 0.1 && (high - 83.30).abs() < 0.1, "{low} {high}");
    }

    #[test]
    fn where_no_frame_is_called_ok_there_are_no_figures_of_those() {
        let lost = recorded(0.8, 0.1, Status::Lost);
        let trust = Trust::of([(&lost, &Pose::identity())].into_iter()).unwrap();
        assert_eq!((trust.ok, trust.nees, trust.available), (0, None, 0));
        let json = serde_json::to_string(&trust).unwrap();
        assert!(json.contains("available") && !json.contains("nees"), "{json}");
    }

    #[test]
    fn without_a_covariance_nothing_is_claimed() {
        let silent = Recorded { covariance: None, ..recorded(0.0, 0.1, Status::Ok) };
        assert!(Trust::of([(&silent, &Pose::identity())].into_iter()).is_none());
    }
}
