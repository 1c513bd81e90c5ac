//! The normal equations of a chain of poses with a border for the survey's
//! misalignment: block tridiagonal, so that one elimination along the chain
//! and a 3x3 system solve them in time and memory linear in its length.

use common::geometry::{Pose, Tangent, local};
use nalgebra::{Cholesky, Matrix3, Matrix6, SMatrix, U3, U6, Vector3};

type Border = SMatrix<f64, 6, 3>;

/// A step of all unknowns, or a right-hand side for one.
#[derive(Debug, Clone)]
pub(super) struct Step {
    /// Of each pose, in its own tangent.
    pub poses: Vec<Tangent>,
    /// Of the misalignment.
    pub turn: Vector3<f64>,
}

impl Step {
    /// No step.
    pub fn zero(n: usize) -> Self {
        Self { poses: vec![Tangent::zeros(); n], turn: Vector3::zeros() }
    }

    /// Scalar product.
    pub fn dot(&self, other: &Self) -> f64 {
        self.poses.iter().zip(&other.poses).map(|(a, b)| a.dot(b)).sum::<f64>() + self.turn.dot(&other.turn)
    }

    /// Adds a multiple of another step.
    pub fn add(&mut self, factor: f64, other: &Self) {
        for (a, b) in self.poses.iter_mut().zip(&other.poses) {
            *a += b * factor;
        }
        self.turn += other.turn * factor;
    }

    /// Multiplies by a factor.
    pub fn scale(&mut self, factor: f64) {
        self.poses.iter_mut().for_each(|a| *a *= factor);
        self.turn *= factor;
    }
}

/// `local(z, X_before^-1 X_after)` as a linear function of the steps of both
/// poses: `residual + before * step_before + step_after`.
#[derive(Debug, Clone)]
pub(super) struct MotionTerm {
    /// The residual.
    pub residual: Tangent,
    /// Its derivative by the step of the earlier pose; by that of the later
    /// one it is the identity.
    pub before: Matrix6<f64>,
    /// Its weight.
    pub weight: Matrix6<f64>,
}

impl MotionTerm {
    /// The term of two poses and what was measured between them.
    pub fn new(before: &Pose, after: &Pose, before_from_after: &Pose, weight: &Matrix6<f64>) -> Self {
        let motion = before.inverse() * after;
        let back = motion.rotation.inverse().to_rotation_matrix().into_inner();
        let mut j = Matrix6::zeros();
        j.fixed_view_mut::<3, 3>(0, 0).copy_from(&-back);
        j.fixed_view_mut::<3, 3>(0, 3).copy_from(&(back * motion.translation.vector.cross_matrix()));
        j.fixed_view_mut::<3, 3>(3, 3).copy_from(&-back);
        Self { residual: local(before_from_after, &motion), before: j, weight: *weight }
    }

    /// Squared residual in standard deviations.
    pub fn squared_sigmas(&self) -> f64 {
        (self.residual.transpose() * self.weight * self.residual).x
    }
}

/// The normal equations `H step = -gradient` of the chain.
#[derive(Debug, Clone)]
pub(super) struct Chain {
    diagonal: Vec<Matrix6<f64>>,
    /// Block (i, i + 1).
    above: Vec<Matrix6<f64>>,
    border: Vec<Border>,
    corner: Matrix3<f64>,
    /// The gradient.
    pub gradient: Step,
}

impl Chain {
    /// No term yet.
    pub fn zero(n: usize) -> Self {
        Self {
            diagonal: vec![Matrix6::zeros(); n],
            above: vec![Matrix6::zeros(); n.saturating_sub(1)],
            border: vec![Border::zeros(); n],
            corner: Matrix3::zeros(),
            gradient: Step::zero(n),
        }
    }

    /// Adds a term between pose `i` and the next.
    pub fn add_motion(&mut self, i: usize, term: &MotionTerm) {
        let (j, weight) = (&term.before, &term.weight);
        self.diagonal[i] += j.transpose() * weight * j;
        self.diagonal[i + 1] += weight;
        self.above[i] += j.transpose() * weight;
        self.gradient.poses[i] += j.transpose() * weight * term.residual;
        self.gradient.poses[i + 1] += weight * term.residual;
    }

    /// Adds a position `off` by so much, in the axes of pose `i`.
    pub fn add_position(&mut self, i: usize, off: &Vector3<f64>, weight: f64) {
        for k in 0..3 {
            self.diagonal[i][(k, k)] += weight;
            self.gradient.poses[i][k] += weight * off[k];
        }
    }

    /// Adds an orientation turned against the survey's by so much.
    pub fn add_orientation(&mut self, i: usize, turn: &Vector3<f64>, weight: f64) {
        for k in 0..3 {
            self.diagonal[i][(k + 3, k + 3)] += weight;
            self.gradient.poses[i][k + 3] += weight * turn[k];
            self.border[i][(k + 3, k)] -= weight;
            self.corner[(k, k)] += weight;
            self.gradient.turn[k] -= weight * turn[k];
        }
    }

    /// Adds what is known of the misalignment beforehand.
    pub fn add_misalignment(&mut self, turn: &Vector3<f64>, weight: f64) {
        self.corner += Matrix3::identity() * weight;
        self.gradient.turn += turn * weight;
    }

    /// `H step`.
    pub fn times(&self, step: &Step) -> Step {
        let mut out = Step { poses: Vec::with_capacity(step.poses.len()), turn: self.corner * step.turn };
        for (i, x) in step.poses.iter().enumerate() {
            let mut row = self.diagonal[i] * x + self.border[i] * step.turn;
            if i > 0 {
                row += self.above[i - 1].transpose() * step.poses[i - 1];
            }
            if let (Some(above), Some(next)) = (self.above.get(i), step.poses.get(i + 1)) {
                row += above * next;
            }
            out.turn += self.border[i].transpose() * x;
            out.poses.push(row);
        }
        out
    }

    /// Eliminates along the chain; none where `H` is not positive definite.
    pub fn factor(&self) -> Option<Factors> {
        let n = self.diagonal.len();
        let (mut diagonal, mut border, mut corner) = (self.diagonal.clone(), self.border.clone(), self.corner);
        let mut pivots = Vec::with_capacity(n);
        let mut gains = Vec::with_capacity(n);
        for i in 0..n {
            let pivot = diagonal[i].cholesky()?;
            corner -= border[i].transpose() * pivot.solve(&border[i]);
            if i + 1 < n {
                let gain = pivot.solve(&self.above[i]).transpose();
                diagonal[i + 1] -= gain * self.above[i];
                let eliminated = border[i];
                border[i + 1] -= gain * eliminated;
                gains.push(gain);
            }
            pivots.push(pivot);
        }
        Some(Factors { pivots, gains, above: self.above.clone(), border, corner: corner.cholesky()? })
    }
}

/// The eliminated chain.
pub(super) struct Factors {
    pivots: Vec<Cholesky<f64, U6>>,
    gains: Vec<Matrix6<f64>>,
    above: Vec<Matrix6<f64>>,
    border: Vec<Border>,
    corner: Cholesky<f64, U3>,
}

impl Factors {
    /// Solves `H step = rhs`.
    pub fn solve(&self, rhs: &Step) -> Step {
        let mut step = rhs.clone();
        for i in 0..step.poses.len() {
            let eliminated = step.poses[i];
            step.turn -= self.border[i].transpose() * self.pivots[i].solve(&eliminated);
            if let Some(gain) = self.gains.get(i) {
                step.poses[i + 1] -= gain * eliminated;
            }
        }
        step.turn = self.corner.solve(&step.turn);
        for i in (0..step.poses.len()).rev() {
            let mut open = step.poses[i] - self.border[i] * step.turn;
            if let (Some(above), Some(next)) = (self.above.get(i), step.poses.get(i + 1)) {
                open -= above * next;
            }
            step.poses[i] = self.pivots[i].solve(&open);
        }
        step
    }
}
