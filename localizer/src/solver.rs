//! Levenberg-Marquardt for one pose (eq. 10-13): fixed-size 6x6, robust loss
//! by iterated reweighting, an optional Gaussian prior. Nothing is allocated.

use common::geometry::{PinholeCamera, Pose, Tangent, local, retract};
use nalgebra::{Cholesky, Matrix3, Matrix6, Vector3, Vector6};
use serde::{Deserialize, Serialize};

use crate::projection::View;
use crate::residual::{Group, Observation};

/// How residuals far off their standard deviation are believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Loss {
    /// Least squares.
    Quadratic,
    /// Linear beyond the scale.
    Huber,
    /// Logarithmic: a gross error keeps a small pull.
    Cauchy,
    /// Bounded: a gross error has no pull.
    GemanMcclure,
}

impl Loss {
    /// Cost and weight (its derivative) for a squared whitened residual `s`,
    /// scale `c` in standard deviations. All losses are `s` near zero.
    #[inline]
    fn evaluate(self, s: f64, c: f64) -> (f64, f64) {
        let c2 = c * c;
        match self {
            Self::Quadratic => (s, 1.0),
            Self::Huber if s <= c2 => (s, 1.0),
            Self::Huber => (2.0 * c * s.sqrt() - c2, c / s.sqrt()),
            Self::Cauchy => (c2 * (s / c2).ln_1p(), 1.0 / (1.0 + s / c2)),
            Self::GemanMcclure => {
                let share = c2 / (c2 + s);
                (s * share, share * share)
            }
        }
    }
}

/// Settings of the optimiser.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SolverConfig {
    /// Robust loss. The paper has none.
    pub loss: Loss,
    /// Where the loss leaves the quadratic, in standard deviations. 2.385 keeps
    /// 95 % efficiency under Gaussian noise for Cauchy (Holland and Welsch).
    pub loss_scale: f64,
    /// Most iterations of one solve; 4 are usual.
    pub max_iterations: usize,
    /// First damping, as a share of the normal matrix's diagonal.
    pub initial_damping: f64,
    /// A step shorter than this ends the iteration, metres.
    pub step_tolerance_m: f64,
    /// A step turning less than this ends the iteration, radians.
    pub step_tolerance_rad: f64,
}

impl Default for SolverConfig {
    fn default() -> Self {
        Self {
            loss: Loss::Cauchy,
            loss_scale: 2.385,
            max_iterations: 20,
            initial_damping: 1e-4,
            step_tolerance_m: 1e-4,
            step_tolerance_rad: 1e-5,
        }
    }
}

impl SolverConfig {
    /// The weight that the loss leaves a correspondence with this mean squared
    /// whitened residual.
    pub fn weight(&self, mean_square: f64) -> f64 {
        self.loss.evaluate(mean_square, self.loss_scale).1
    }
}

/// A Gaussian belief about the pose before the image is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Its mean.
    pub map_from_camera: Pose,
    /// Inverse covariance in the mean's tangent.
    pub information: Matrix6<f64>,
}

impl Prior {
    /// A belief with this covariance; none where it is not positive definite.
    pub fn new(map_from_camera: Pose, covariance: &Matrix6<f64>) -> Option<Self> {
        let information = Cholesky::new(*covariance)?.inverse();
        Some(Self { map_from_camera, information })
    }
}

/// What is to be minimised.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// The camera.
    pub camera: &'a PinholeCamera,
    /// All observations.
    pub observations: &'a [Observation],
    /// The belief, if there is one.
    pub prior: Option<&'a Prior>,
}

/// Where the solver came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// The pose.
    pub map_from_camera: Pose,
    /// Normal matrix there (prior included): the inverse covariance in the
    /// tangent at the pose.
    pub information: Matrix6<f64>,
    /// Half the robust sum of squares, prior included.
    pub cost: f64,
    /// Steps tried.
    pub iterations: usize,
    /// The last step was below the tolerances.
    pub converged: bool,
}

impl Solution {
    /// Inverse of the normal matrix; none where a direction is unobserved.
    pub fn covariance(&self) -> Option<Matrix6<f64>> {
        Cholesky::new(self.information).map(|c| c.inverse())
    }
}

/// What some observations say about the pose that they are seen from, before
/// any robust weight.
#[derive(Debug, Clone, Copy)]
pub struct Normal {
    /// Normal matrix in the tangent at the pose: its lower triangle.
    pub lower: Matrix6<f64>,
    /// Gradient of half the sum of squares.
    pub gradient: Vector6<f64>,
    /// Sum of the squared whitened distances.
    pub square: f64,
    /// Observations whose point lies behind the camera; they are in none of these.
    pub behind: usize,
}

impl Normal {
    /// Of observations seen from a pose.
    #[inline]
    pub fn of(observations: &[Observation], view: &View) -> Self {
        let (mut lower, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
        let (mut square, mut behind) = (0.0, 0);
        for observation in observations {
            let Some((distance_px, row)) = observation.linearise(view) else {
                behind += 1;
                continue;
            };
            let weight = 1.0 / (observation.sigma_px * observation.sigma_px);
            square += weight * distance_px * distance_px;
            let pull = weight * distance_px;
            for j in 0..6 {
                gradient[j] += pull * row[j];
                let scaled = weight * row[j];
                // From an even row on: two at a time.
                for i in (j & !1)..6 {
                    lower[(i, j)] += scaled * row[i];
                }
            }
        }
        Self { lower, gradient, square, behind }
    }
}

/// Normal equations at one pose.
struct Linearised {
    information: Matrix6<f64>,
    gradient: Vector6<f64>,
    cost: f64,
}

/// Squared whitened distance charged for a point that fell behind the camera:
/// far beyond any gate, so that such a step is refused.
const BEHIND: f64 = 1e4;

fn linearise(problem: &Problem<'_>, groups: &mut [Group], config: &SolverConfig, pose: &Pose) -> Linearised {
    let view = View::new(problem.camera, pose);
    let mut sum = Linearised { information: Matrix6::zeros(), gradient: Vector6::zeros(), cost: 0.0 };
    for group in groups {
        let observations = problem.observations.get(group.start..group.end).unwrap_or(&[]);
        let own = Normal::of(observations, &view);
        let square = own.square + own.behind as f64 * BEHIND;
        let count = observations.len().max(1) as f64;
        let (cost, weight) = config.loss.evaluate(square / count, config.loss_scale);
        group.mean_square = square / count;
        group.weight = weight;
        sum.cost += 0.5 * count * cost;
        sum.gradient += own.gradient * weight;
        sum.information += own.lower * weight;
    }
    // Only the lower triangle was accumulated.
    sum.information.fill_upper_triangle_with_lower_triangle();
    if let Some(prior) = problem.prior {
        let error = local(&prior.map_from_camera, pose);
        let [of_translation, of_rotation] = local_derivative(prior, pose, &error);
        let weighted = prior.information * error;
        sum.cost += 0.5 * error.dot(&weighted);
        let blocks = [(0, of_translation), (3, of_rotation)];
        for (i, left) in blocks {
            let own = left.transpose() * weighted.fixed_rows::<3>(i);
            let mut gradient = sum.gradient.fixed_rows_mut::<3>(i);
            gradient += own;
            for (j, right) in blocks {
                let own = left.transpose() * prior.information.fixed_view::<3, 3>(i, j) * right;
                let mut information = sum.information.fixed_view_mut::<3, 3>(i, j);
                information += own;
            }
        }
    }
    sum
}

/// Derivative of `local(prior, retract(pose, delta))` in delta at zero: the
/// relative rotation for the translation, the inverse right Jacobian of the
/// rotation vector for the rotation. Neither turns into the other.
fn local_derivative(prior: &Prior, pose: &Pose, error: &Tangent) -> [Matrix3<f64>; 2] {
    let relative = (prior.map_from_camera.rotation.inverse() * pose.rotation).to_rotation_matrix();
    let phi = Vector3::new(error[3], error[4], error[5]);
    let angle = phi.norm();
    let hat = phi.cross_matrix();
    let second = if angle < 1e-4 {
        1.0 / 12.0
    } else {
        1.0 / (angle * angle) - (1.0 + angle.cos()) / (2.0 * angle * angle.sin())
    };
    [relative.into_inner(), Matrix3::identity() + hat * 0.5 + hat * hat * second]
}

/// Minimises the robust sum of squares of `problem` from `start`.
///
/// `groups` say which observations belong together; each group's mean squared
/// residual and final weight are written back. Always returns a pose: the best
/// one seen, which is `start` where there is nothing to go by.
pub fn solve(problem: &Problem<'_>, groups: &mut [Group], config: &SolverConfig, start: &Pose) -> Solution {
    let mut pose = *start;
    let mut at = linearise(problem, groups, config, &pose);
    let mut damping = config.initial_damping;
    let mut converged = false;
    let mut iterations = 0;
    let mut groups_are_here = true;
    while iterations < config.max_iterations && !converged && damping < 1e8 {
        iterations += 1;
        let mut damped = at.information;
        for i in 0..6 {
            // The small constant keeps an unobserved direction where it is.
            damped[(i, i)] += damping * at.information[(i, i)] + 1e-9;
        }
        let Some(factor) = Cholesky::new(damped) else {
            damping *= 10.0;
            continue;
        };
        let step = factor.solve(&-at.gradient);
        let candidate = retract(&pose, &step);
        let there = linearise(problem, groups, config, &candidate);
        let short = step.fixed_rows::<3>(0).norm() < config.step_tolerance_m
            && step.fixed_rows::<3>(3).norm() < config.step_tolerance_rad;
        groups_are_here = there.cost <= at.cost;
        if groups_are_here {
            pose = candidate;
            at = there;
            damping = (damping * 0.1).max(1e-9);
        } else {
            // At the minimum rounding decides whether the cost falls.
            damping *= 10.0;
        }
        converged = short;
    }
    if !groups_are_here {
        // Leave the groups' weights as they are at the pose returned.
        at = linearise(problem, groups, config, &pose);
    }
    Solution { map_from_camera: pose, information: at.information, cost: at.cost, iterations, converged }
}

#[cfg(test)]
mod tests;
