//! What is said where several hypotheses may be right.

use common::geometry::{Pose, Tangent, local, retract};
use nalgebra::Matrix6;

use super::hypothesis::Hypothesis;

/// Mean pose of all hypotheses and its covariance, their spread included: of
/// all poses the one with the least expected square error, weighted by the [`odds`]. With
/// one hypothesis, its own.
pub fn mean_of(bank: &[Hypothesis], doubt: f64) -> Option<(Pose, Matrix6<f64>)> {
    let best = bank.first()?;
    let pose = best.state.map_from_camera;
    let (mut total, mut mean, mut square) = (0.0, Tangent::zeros(), Matrix6::zeros());
    for hypothesis in bank {
        let weight = odds(hypothesis, best, doubt);
        let off = local(&pose, &hypothesis.state.map_from_camera);
        total += weight;
        mean += off * weight;
        square += (hypothesis.state.pose_covariance() + off * off.transpose()) * weight;
    }
    mean /= total;
    Some((retract(&pose, &mean), square / total - mean * mean.transpose()))
}

/// How much more probable a hypothesis is than another: `exp(w / doubt)` of what its
/// evidence is ahead by, `w` nats.
pub fn odds(of: &Hypothesis, against: &Hypothesis, doubt: f64) -> f64 {
    // What was known before is no evidence: that counts in full.
    let before = |of: &Hypothesis| of.handicap + of.astray;
    let evidence = |of: &Hypothesis| of.log_weight + before(of);
    let ahead = (evidence(of) - evidence(against)) / doubt.max(1e-3);
    (ahead - before(of) + before(against)).exp()
}
