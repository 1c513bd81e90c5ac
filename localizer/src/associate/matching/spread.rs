//! A bound on uncertainty that costs little.

use nalgebra::{Matrix6, Vector6};

/// Bounds the standard deviation in any direction by those of the components:
/// `sqrt(j' P j) <= sum |j_i| sigma_i` where no correlation exceeds one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spread {
    sigmas: Vector6<f64>,
}

impl Spread {
    pub(super) fn new(covariance: &Matrix6<f64>) -> Self {
        let sigmas = covariance.diagonal().map(|variance| variance.max(0.0).sqrt());
        // Rounding may have left correlations beyond one.
        let mut most = 1.0_f64;
        for i in 0..6 {
            for j in 0..i {
                let both = sigmas[i] * sigmas[j];
                let own = covariance[(i, j)].abs().max(covariance[(j, i)].abs());
                if own > both {
                    most = most.max(own / both);
                }
            }
        }
        Self { sigmas: sigmas * (most.sqrt() * (1.0 + 1e-9)) }
    }

    /// Bound along a row of derivatives.
    pub(super) fn most(&self, row: &Vector6<f64>) -> f64 {
        row.abs().dot(&self.sigmas)
    }
}
