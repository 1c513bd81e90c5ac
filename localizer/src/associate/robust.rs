//! The default association: the matches that say most together, within gates that shrink
//! with the pose's covariance, a robust loss, and the motion as a prior; each object of what
//! comes out is doubted in turn.

use common::geometry::{Pose, local};
use nalgebra::{Cholesky, Matrix6};
use serde::{Deserialize, Serialize};

use super::foreseen::Foreseen;
use super::matching::{Match, Matcher, Scene};
use super::separation::Balance;
use crate::config::Config;
use crate::estimate::{Correspondence, LandmarkId};
use crate::projection::View;
use crate::residual::{Group, Observation};
use crate::solver::{Prior, Problem, Solution, SolverConfig, solve};

/// Settings of the association.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RobustConfig {
    /// Most rounds of matching and solving; it ends when the matches repeat.
    pub max_rounds: usize,
    /// Half the squared Mahalanobis distance from the prediction above which
    /// other matches are tried: a wrong one in the first round may have led
    /// the rest astray. 2 asks twice in half of the frames.
    pub doubted_cost: f64,
    /// Matches that are worth less than this, nats, are doubted as well: two
    /// good ones, what holds a pose.
    pub doubted_worth: f64,
    /// Share of the prediction's covariance that is the gate of other starts:
    /// only what lies near is matched in the first round.
    pub narrow_share: f64,
    /// They are tried at the prediction, and at the poses that are left without
    /// one object of the doubted matches: at no more of these than so many.
    pub left_out: usize,
    /// A pose without an object that lies nearer is the same, half the squared
    /// Mahalanobis distance.
    pub least_move: f64,
}

impl Default for RobustConfig {
    fn default() -> Self {
        Self { max_rounds: 5, doubted_cost: 2.0, doubted_worth: 6.0, narrow_share: 0.1, left_out: 3, least_move: 1.0 }
    }
}

/// A pose with the frame's support for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined {
    /// The pose: the mean over what may be matched wrongly.
    pub map_from_camera: Pose,
    /// Its covariance (camera tangent), that of the mixture.
    pub covariance: Matrix6<f64>,
    /// Log-likelihood ratio against clutter alone, without the prior, nats.
    pub support: f64,
    /// Half the squared Mahalanobis distance from the prior's mean.
    pub prior_cost: f64,
    /// Logarithm of the share of the prior's volume that the posterior fills,
    /// nats: what a pose pays for having been free to fit (Laplace's
    /// approximation of the evidence).
    pub occam: f64,
    /// What the matches are worth against their landmarks unseen, nats.
    pub worth: f64,
    /// As above, prior and freedom included: below 0 they are better not
    /// believed.
    pub gain: f64,
    /// Matches.
    pub matches: usize,
    /// What should be seen at the pose, and what of that is matched.
    pub foreseen: Foreseen,
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

/// What a pose is asked of.
#[derive(Debug, Clone, Copy)]
pub struct Question<'a> {
    /// What is seen, and what may be.
    pub scene: &'a Scene<'a>,
    /// How well the pose is known that the matching starts from (camera
    /// tangent).
    pub gate_covariance: &'a Matrix6<f64>,
    /// The belief about the pose.
    pub prior: &'a Prior,
    /// How it is matched, solved and doubted.
    pub config: &'a Config,
}

/// Buffers of the association.
#[derive(Debug, Clone, Default)]
pub struct Associator {
    /// The matcher, with the matches of the last call.
    pub matcher: Matcher,
    /// Buffer of poses and their support.
    pub scored: Vec<(f64, Pose)>,
    /// What the matches say by themselves.
    pub balance: Balance,
    observations: Vec<Observation>,
    groups: Vec<Group>,
    previous: Vec<(LandmarkId, usize)>,
    believed: Vec<Match>,
}

impl Associator {
    /// Associates and localizes from `start`.
    ///
    /// Returns none where the prior's information is no covariance.
    pub fn refine(&mut self, question: &Question<'_>, start: &Pose) -> Option<Refined> {
        self.refine_unless(question, start, |_| false)
    }

    /// As [`Self::refine`], but none, too, as soon as a round leads to a pose
    /// that `is_known`.
    pub fn refine_unless(
        &mut self,
        question: &Question<'_>,
        start: &Pose,
        is_known: impl Fn(&Pose) -> bool,
    ) -> Option<Refined> {
        let mut solved = self.solve_unless(question, start, is_known)?;
        self.doubt(question, &mut solved);
        Some(solved)
    }

    /// Makes `solved` the mean over what may be matched wrongly in it, with the matches
    /// that it was solved with.
    fn doubt(&mut self, question: &Question<'_>, solved: &mut Refined) {
        let Question { scene, prior, config, .. } = *question;
        let (pose, view) = (&solved.map_from_camera, View::new(scene.camera, &solved.map_from_camera));
        let matches = &self.matcher.matches;
        let doubted = self.balance.doubted(matches, &view, pose, prior, &config.separation, &config.solver);
        if let Some((map_from_camera, covariance)) = doubted {
            (solved.map_from_camera, solved.covariance) = (map_from_camera, covariance);
        }
    }

    /// As [`Self::refine_unless`], with all matches taken for right.
    fn solve_unless(
        &mut self,
        question: &Question<'_>,
        start: &Pose,
        is_known: impl Fn(&Pose) -> bool,
    ) -> Option<Refined> {
        let Question { scene, gate_covariance, prior, config } = *question;
        let prior_factor = Cholesky::new(prior.information)?;
        let prior_covariance = prior_factor.inverse();
        // The gate of each round, and what the last leaves.
        let mut covariance = *gate_covariance;
        let mut solution = Solution {
            map_from_camera: *start,
            information: prior.information,
            cost: 0.0,
            iterations: 0,
            converged: false,
        };
        let mut iterations = 0;
        self.previous.clear();
        for round in 0..config.robust.max_rounds {
            self.matcher.find(scene, &solution.map_from_camera, &covariance);
            if round > 0 {
                // The first gate is wide, and a wide gate says little for a
                // pair; now a pair must be worth something.
                self.matcher.drop_worthless(scene.detection);
            }
            let repeated = round > 0
                && self.previous.len() == self.matcher.matches.len()
                && self.matcher.matches.iter().zip(&self.previous).all(|(m, p)| (m.landmark, m.feature) == *p);
            self.matcher.observations(&mut self.observations, &mut self.groups);
            let problem = Problem { camera: scene.camera, observations: &self.observations, prior: Some(prior) };
            solution = solve(&problem, &mut self.groups, &config.solver, &solution.map_from_camera);
            if is_known(&solution.map_from_camera) {
                return None;
            }
            iterations += solution.iterations;
            covariance = solution.covariance().unwrap_or(prior_covariance);
            if repeated {
                break;
            }
            self.previous.clear();
            self.previous.extend(self.matcher.matches.iter().map(|m| (m.landmark, m.feature)));
        }
        // Judged by its own matches, as precisely as the pose is known now.
        self.matcher.run(scene, &solution.map_from_camera, &covariance);
        let support = self.matcher.drop_worthless(scene.detection);
        let worth = self.matcher.worth(scene.detection);
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
            worth,
            gain: worth - prior_cost + occam,
            matches: self.matcher.matches.len(),
            foreseen: self.matcher.foreseen(scene),
            rms_px,
            mean_square,
            iterations,
            converged: solution.converged,
        })
    }

    /// Associates and localizes from where `prior` expects the camera. Where
    /// the pose comes out far from there or is held by little, a wrong match may
    /// have drawn the others after it: then other starts are tried, and the pose
    /// for which the frame says most is taken. Matches that lie nearest to the
    /// prediction and that are not those of the pose are always tried: the wide
    /// gate of the first round lets a neighbour through, and what it draws aside
    /// finds more of its kind.
    ///
    /// Returns none where the prior's information is no covariance.
    pub fn refine_predicted(&mut self, question: &Question<'_>) -> Option<Refined> {
        let Question { scene, gate_covariance, prior, config } = *question;
        let (separation, solver, config) = (&config.separation, &config.solver, &config.robust);
        let predicted = prior.map_from_camera;
        let mut best = self.solve_unless(question, &predicted, |_| false)?;
        let doubted = best.prior_cost > config.doubted_cost || best.worth < config.doubted_worth;
        self.believed.clone_from(&self.matcher.matches);
        let narrow = gate_covariance * config.narrow_share;
        if !doubted {
            // Where the same matches lie nearest to the prediction, it ends here.
            self.matcher.find(scene, &predicted, &narrow);
            if self.matcher.matches.iter().all(|m| self.believed.iter().any(|b| b.is_same(m))) {
                self.matcher.matches.clone_from(&self.believed);
                self.doubt(question, &mut best);
                return Some(best);
            }
        }
        self.balance.moved.clear();
        if doubted {
            let (pose, object_m) = (best.map_from_camera, separation.object_m);
            let view = View::new(scene.camera, &pose);
            self.balance.poses_without(&self.believed, &view, &pose, prior, object_m, solver);
        }
        let without = std::mem::take(&mut self.balance.moved);
        let far = without.iter().filter(|(cost, _)| *cost > config.least_move).map(|&(_, pose)| pose);
        for start in std::iter::once(predicted).chain(far.take(config.left_out)) {
            let narrowly = Question { gate_covariance: &narrow, ..*question };
            let Some(other) = self.solve_unless(&narrowly, &start, |_| false) else { continue };
            if other.evidence() > best.evidence() {
                best = other;
                self.believed.clone_from(&self.matcher.matches);
            }
        }
        self.balance.moved = without;
        self.matcher.matches.clone_from(&self.believed);
        self.doubt(question, &mut best);
        Some(best)
    }

    /// Root mean square distance (px) and mean squared whitened distance.
    fn residuals(&self, scene: &Scene<'_>, pose: &Pose) -> (f64, f64) {
        let view = View::new(scene.camera, pose);
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

    /// Replaces `out` by the matches of the last call at a pose, as they stand
    /// in an estimate.
    pub fn correspondences(
        &self,
        scene: &Scene<'_>,
        pose: &Pose,
        solver: &SolverConfig,
        out: &mut Vec<Correspondence>,
    ) {
        let view = View::new(scene.camera, pose);
        out.clear();
        out.extend(self.matcher.matches.iter().map(|found| {
            let observations = found.pairing.line();
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
        }));
    }
}
