//! The default association: all mutual-best matches within gates that shrink
//! with the pose's covariance, a robust loss, and the motion as a prior.

use common::geometry::{Pose, local};
use nalgebra::{Cholesky, Matrix6};
use serde::{Deserialize, Serialize};

use super::matching::{Matcher, Scene};
use crate::estimate::{Correspondence, LandmarkId};
use crate::residual::{Group, Observation};
use crate::solver::{Prior, Problem, Solution, SolverConfig, solve};

/// Settings of the association.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RobustConfig {
    /// Most rounds of matching and solving; it ends when the matches repeat.
    pub max_rounds: usize,
    /// The posterior covariance of a round times this is the gate of the next:
    /// wrong pairs of an early round bias more than the covariance knows.
    pub gate_inflation: f64,
}

impl Default for RobustConfig {
    fn default() -> Self {
        Self { max_rounds: 5, gate_inflation: 4.0 }
    }
}

/// A pose with the frame's support for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined {
    /// The pose.
    pub map_from_camera: Pose,
    /// Its covariance (camera tangent).
    pub covariance: Matrix6<f64>,
    /// Log-likelihood ratio against clutter alone, without the prior, nats.
    pub support: f64,
    /// Half the squared Mahalanobis distance from the prior's mean.
    pub prior_cost: f64,
    /// Logarithm of the share of the prior's volume that the posterior fills,
    /// nats: what a pose pays for having been free to fit (Laplace's
    /// approximation of the evidence).
    pub occam: f64,
    /// What the matches are worth against none, prior and freedom included,
    /// nats: below 0 they are better not believed.
    pub gain: f64,
    /// Matches.
    pub matches: usize,
    /// Root mean square of the matched distances, pixels.
    pub rms_px: f64,
    /// Mean of the squared whitened distances of the matches: 1 where the
    /// standard deviations are right.
    pub mean_square: f64,
    /// Iterations over all rounds.
    pub iterations: usize,
    /// The last round reached a minimum.
    pub converged: bool,
}

impl Refined {
    /// What the frame says for the pose under its prior, nats.
    pub fn evidence(&self) -> f64 {
        self.support - self.prior_cost + self.occam
    }
}

/// Buffers of the association.
#[derive(Debug, Clone, Default)]
pub struct Associator {
    /// The matcher, with the matches of the last call.
    pub matcher: Matcher,
    observations: Vec<Observation>,
    groups: Vec<Group>,
    previous: Vec<(LandmarkId, usize)>,
}

impl Associator {
    /// Associates and localizes from `start`, known to `gate_covariance`
    /// (camera tangent), with `prior` as the belief about the pose.
    ///
    /// Returns none where the prior's information is no covariance.
    pub fn refine(
        &mut self,
        scene: &Scene<'_>,
        start: &Pose,
        gate_covariance: &Matrix6<f64>,
        prior: &Prior,
        config: &RobustConfig,
        solver: &SolverConfig,
    ) -> Option<Refined> {
        let prior_factor = Cholesky::new(prior.information)?;
        let prior_covariance = prior_factor.inverse();
        let mut gate = *gate_covariance;
        let mut solution = Solution {
            map_from_camera: *start,
            information: prior.information,
            cost: 0.0,
            iterations: 0,
            converged: false,
        };
        let mut iterations = 0;
        self.previous.clear();
        for round in 0..config.max_rounds {
            self.matcher.run(scene, &solution.map_from_camera, &gate);
            if round > 0 {
                // The first gate is wide, and a wide gate says little for a
                // pair; now a pair must be worth something.
                self.matcher.drop_worthless();
            }
            let repeated = round > 0
                && self.previous.len() == self.matcher.matches.len()
                && self.matcher.matches.iter().zip(&self.previous).all(|(m, p)| (m.landmark, m.feature) == *p);
            self.matcher.observations(&mut self.observations, &mut self.groups);
            let problem = Problem { camera: scene.camera, observations: &self.observations, prior: Some(prior) };
            solution = solve(&problem, &mut self.groups, solver, &solution.map_from_camera);
            iterations += solution.iterations;
            gate = solution.covariance().unwrap_or(prior_covariance) * config.gate_inflation;
            if repeated {
                break;
            }
            self.previous.clear();
            self.previous.extend(self.matcher.matches.iter().map(|m| (m.landmark, m.feature)));
        }
        let covariance = solution.covariance().unwrap_or(prior_covariance);
        // Judged by its own matches, as precisely as the pose is known now.
        let mut support = self.matcher.run(scene, &solution.map_from_camera, &covariance);
        support += self.matcher.drop_worthless();
        self.matcher.observations(&mut self.observations, &mut self.groups);
        let error = local(&prior.map_from_camera, &solution.map_from_camera);
        let posterior_ln = Cholesky::new(covariance).map_or(0.0, |factor| factor.ln_determinant());
        let (rms_px, mean_square) = self.residuals(scene, &solution.map_from_camera);
        let prior_cost = 0.5 * error.dot(&(prior.information * error));
        let occam = (0.5 * (posterior_ln + prior_factor.ln_determinant())).min(0.0);
        Some(Refined {
            map_from_camera: solution.map_from_camera,
            covariance,
            support,
            prior_cost,
            occam,
            gain: self.matcher.worth() - prior_cost + occam,
            matches: self.matcher.matches.len(),
            rms_px,
            mean_square,
            iterations,
            converged: solution.converged,
        })
    }

    /// Root mean square distance (px) and mean squared whitened distance.
    fn residuals(&self, scene: &Scene<'_>, pose: &Pose) -> (f64, f64) {
        let view = crate::projection::View::new(scene.camera, pose);
        let (mut square, mut whitened, mut count) = (0.0, 0.0, 0.0);
        for observation in &self.observations {
            if let Some(distance_px) = observation.distance_px(&view) {
                square += distance_px * distance_px;
                whitened += (distance_px / observation.sigma_px).powi(2);
                count += 1.0;
            }
        }
        if count > 0.0 { ((square / count).sqrt(), whitened / count) } else { (0.0, 0.0) }
    }

    /// The matches of the last call at a pose, as they stand in an estimate.
    pub fn correspondences(&self, scene: &Scene<'_>, pose: &Pose, solver: &SolverConfig) -> Vec<Correspondence> {
        let view = crate::projection::View::new(scene.camera, pose);
        let matches = self.matcher.matches.iter();
        matches
            .map(|found| {
                let observations = found.pairing.observations();
                let count = observations.len() as f64;
                let (mut square, mut whitened) = (0.0, 0.0);
                for observation in observations {
                    let distance_px = observation.distance_px(&view).unwrap_or(f64::MAX.sqrt());
                    square += distance_px * distance_px;
                    whitened += (distance_px / observation.sigma_px).powi(2);
                }
                Correspondence {
                    landmark: found.landmark,
                    feature: found.feature,
                    residual_px: (square / count).sqrt(),
                    weight: solver.weight(whitened / count),
                }
            })
            .collect()
    }
}
