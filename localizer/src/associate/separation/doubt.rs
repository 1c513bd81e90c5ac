//! The pose where each object may have been matched wrongly: the mixture of
//! probabilistic data association (Bar-Shalom and Tse, "Tracking in a cluttered
//! environment with probabilistic data association", 1975).

use common::geometry::{Pose, retract};
use nalgebra::{Cholesky, Const, Matrix6, Vector6};

use super::{Balance, Part, SeparationConfig, Sum};
use crate::associate::matching::Match;
use crate::projection::View;
use crate::solver::{Prior, SolverConfig};

/// Odds beyond this are certainty, natural logarithm.
const MOST_LN: f64 = 30.0;

/// A pose by its distance from another (camera tangent).
struct Belief {
    step: Vector6<f64>,
    information: Cholesky<f64, Const<6>>,
}

impl Belief {
    /// None where the information is not positive definite.
    fn new((information, gradient): &Sum) -> Option<Self> {
        let information = Cholesky::new(*information)?;
        Some(Self { step: -information.solve(gradient), information })
    }
}

/// Moments of a mixture.
#[derive(Default)]
struct Moments {
    total: f64,
    first: Vector6<f64>,
    second: Matrix6<f64>,
}

impl Moments {
    fn add(&mut self, belief: &Belief, weight: f64) {
        self.total += weight;
        self.first += belief.step * weight;
        self.second += (belief.information.inverse() + belief.step * belief.step.transpose()) * weight;
    }
}

impl Balance {
    /// Mean and covariance (camera tangent) of the pose that was solved with
    /// `matches` and `prior`, where one object may have been matched wrongly:
    /// `sum b_i (P_i + (x_i - x) (x_i - x)')`, with `x_i` and `P_i` without object
    /// `i`, `b_i` the probability that it is wrong, and one term where none is. None
    /// where the information is not positive definite.
    ///
    /// A match that alone decides where the pose lies agrees with itself. So it is
    /// judged by where the others and the prior expect it: by the evidence of the
    /// frame with it against that without it (Laplace's approximation).
    pub fn doubted(
        &mut self,
        matches: &[Match],
        view: &View,
        pose: &Pose,
        prior: &Prior,
        config: &SeparationConfig,
        solver: &SolverConfig,
    ) -> Option<(Pose, Matrix6<f64>)> {
        self.weigh(matches, view, pose, prior, solver);
        let whole = Belief::new(&(self.information, self.gradient))?;
        let mut mixture = Moments::default();
        mixture.add(&whole, 1.0);
        for (rest, worth) in self.objects(config.object_m) {
            let Some(belief) = Belief::new(&rest) else { continue };
            if let Some(odds) = self.odds_against(&whole, &rest.0, &belief, worth) {
                mixture.add(&belief, odds);
            }
        }
        let mean = mixture.first / mixture.total;
        Some((retract(pose, &mean), mixture.second / mixture.total - mean * mean.transpose()))
    }

    /// For each object of the matches what is left without it, and what its matches
    /// say for the pose, nats.
    fn objects(&self, object_m: f64) -> impl Iterator<Item = (Sum, f64)> + '_ {
        let whole = (self.information, self.gradient);
        self.parts.iter().enumerate().filter_map(move |(i, part)| {
            let is_same = |other: &&Part| part.is_same_object(other, object_m);
            if self.parts[..i].iter().any(|earlier| is_same(&earlier)) {
                return None;
            }
            let others = self.parts[i + 1..].iter().filter(is_same);
            Some((self.less(&whole, part, object_m), part.worth + others.map(|other| other.worth).sum::<f64>()))
        })
    }

    /// The odds that an object is matched wrongly, without which `information` and
    /// `belief` are left, against nothing wrong; its matches say `worth` nats for the
    /// pose of the `whole`.
    fn odds_against(&self, whole: &Belief, information: &Matrix6<f64>, belief: &Belief, worth: f64) -> Option<f64> {
        let apart = belief.step - whole.step;
        let pull = 0.5 * apart.dot(&(information * apart));
        // `worth` holds the density of the object as sharply as the pose is known with
        // it, `|R + J P J'| = |R| |I + I_i| / |I|`; without it the pose is known less well,
        // `|R| |I| / |I - I_i|`.
        let sharper = Cholesky::new(self.information * 2.0 - information)?;
        let ln = |factor: &Cholesky<f64, Const<6>>| factor.ln_determinant();
        let occam = 0.5 * (ln(&sharper) + ln(&belief.information)) - ln(&whole.information);
        Some((pull - worth - occam).clamp(-MOST_LN, MOST_LN).exp())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::with_one_aside;
    use super::*;
    use crate::estimate::{LandmarkId, horizontal_sigma_m};
    use common::geometry::local;

    fn doubted(matches: &[Match], view: &View, pose: &Pose, prior: &Prior) -> (Pose, Matrix6<f64>) {
        let (config, solver) = (SeparationConfig::default(), SolverConfig::default());
        Balance::default().doubted(matches, view, pose, prior, &config, &solver).unwrap()
    }

    #[test]
    fn what_agrees_is_hardly_doubted() {
        with_one_aside(0.0, |matches, view, pose, prior| {
            let (mean, covariance) = doubted(matches, view, pose, prior);
            let mut balance = Balance::default();
            balance.weigh(matches, view, pose, prior, &SolverConfig::default());
            let certain = balance.information.try_inverse().unwrap();
            let ratio = horizontal_sigma_m(&covariance) / horizontal_sigma_m(&certain);
            assert!((1.0..1.1).contains(&ratio), "{ratio}");
            assert!(local(pose, &mean).fixed_rows::<3>(0).norm() < 0.05);
        });
    }

    #[test]
    fn what_says_little_and_pulls_is_doubted() {
        with_one_aside(6.0, |matches, view, pose, prior| {
            let is_pole = |m: &&Match| matches!(m.landmark, LandmarkId::Pole(_));
            let pulled = matches.iter().filter(is_pole).max_by(|a, b| a.distance2.total_cmp(&b.distance2)).unwrap();
            let with_worth = |worth: f64| {
                let doubtful = |m: &Match| Match { support: m.unseen + worth, ..*m };
                let change = |m: &Match| if m.is_same(pulled) { doubtful(m) } else { *m };
                doubted(&matches.iter().map(change).collect::<Vec<_>>(), view, pose, prior)
            };
            let without: Vec<Match> = matches.iter().filter(|m| !m.is_same(pulled)).copied().collect();
            let (without, _) = doubted(&without, view, pose, prior);
            let off_m = |pose: &Pose| local(&without, pose).fixed_rows::<3>(0).norm();
            let (sure, doubtful, wrong) = (with_worth(20.0), with_worth(1.0), with_worth(-20.0));
            assert!(off_m(&wrong.0) < 1e-3 && off_m(&wrong.0) < off_m(&doubtful.0), "{}", off_m(&wrong.0));
            assert!(off_m(&doubtful.0) < off_m(&sure.0), "{} and {}", off_m(&doubtful.0), off_m(&sure.0));
            assert!(horizontal_sigma_m(&doubtful.1) > horizontal_sigma_m(&sure.1));
        });
    }

    #[test]
    fn without_matches_the_prior_is_left() {
        with_one_aside(0.0, |_, view, pose, prior| {
            let (mean, covariance) = doubted(&[], view, pose, prior);
            assert!(local(&mean, &prior.map_from_camera).norm() < 1e-9);
            assert!((covariance * prior.information - Matrix6::identity()).norm() < 1e-6);
        });
    }
}
