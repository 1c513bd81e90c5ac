//! Brings the scans' own motion and the survey's poses together: a chain of
//! poses with a constant misalignment of the survey's axes.
//!
//! Unknown are the camera poses `X_i` of the stitched frames and one rotation
//! `E` (the survey's axes against the camera's). Minimised are
//!
//! - `local(Z_i, X_i^-1 X_(i+1))`: the motion between neighbours, from
//!   registration, weighted with what the scans constrain,
//! - `local(E^-1 G_i^-1 G_(i+1) E, X_i^-1 X_(i+1))`: the same from the survey,
//!   with a Cauchy weight,
//! - `X_i.t - G_i.t`: the survey's positions, with a Cauchy weight,
//! - `log((G_i.R E)^T X_i.R)`: the survey's orientations but for `E`,
//! - `log(E)`.
//!
//! The normal matrix is block tridiagonal with a border of three columns for
//! `E`: one elimination along the chain, then a 3x3 system.

use common::geometry::{Pose, Tangent, local, retract};
use nalgebra::{Matrix3, Matrix6, SMatrix, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Accuracies that weigh the scans' motion against the survey.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GraphConfig {
    /// Least standard deviation of a registered motion, metres per axis.
    pub motion_sigma_m: f64,
    /// Least standard deviation of a registered motion, radians per axis.
    pub motion_sigma_rad: f64,
    /// How many times larger the error of a registered motion is than its
    /// normal matrix says: neighbouring voxels err together.
    pub motion_inflation: f64,
    /// Standard deviation of the survey's motion between neighbours, metres
    /// per axis: what an inertial system drifts in a second.
    pub survey_motion_sigma_m: f64,
    /// The same, radians per axis.
    pub survey_motion_sigma_rad: f64,
    /// Stated accuracy of the survey's positions, metres per axis.
    pub survey_sigma_m: f64,
    /// Stated accuracy of the survey's orientations once the constant
    /// misalignment is taken off, radians per axis.
    pub survey_sigma_rad: f64,
    /// How far the survey's axes may stand off the camera's, radians per axis.
    pub misalignment_sigma_rad: f64,
    /// Scale of the Cauchy weight on the survey's positions, in standard
    /// deviations: where survey and scans contradict each other, the scans
    /// decide, for the map is made of scans.
    pub robust_sigmas: f64,
}

impl Default for GraphConfig {
    fn default() -> Self {
        Self {
            motion_sigma_m: 0.005,
            motion_sigma_rad: 2e-4,
            motion_inflation: 4.0,
            survey_motion_sigma_m: 0.02,
            survey_motion_sigma_rad: 5e-4,
            survey_sigma_m: 0.1,
            survey_sigma_rad: 2e-3,
            misalignment_sigma_rad: 0.01,
            robust_sigmas: 3.0,
        }
    }
}

/// A motion between neighbours from registration.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    /// `camera_i_from_camera_(i+1)`.
    pub before_from_after: Pose,
    /// Normal matrix of the registration in the tangent of the later camera.
    pub information: Matrix6<f64>,
}

/// What the refinement gives.
#[derive(Debug, Clone)]
pub struct Refined {
    /// `map_from_camera` of each frame given.
    pub map_from_camera: Vec<Pose>,
    /// `E`: takes the camera's axes to the survey's.
    pub survey_from_camera: UnitQuaternion<f64>,
}

type Border = SMatrix<f64, 6, 3>;

/// The normal equations of the chain.
struct Chain {
    diagonal: Vec<Matrix6<f64>>,
    /// Block (i, i + 1).
    above: Vec<Matrix6<f64>>,
    border: Vec<Border>,
    corner: Matrix3<f64>,
    gradient: Vec<Tangent>,
    corner_gradient: Vector3<f64>,
}

impl Chain {
    fn zero(n: usize) -> Self {
        Self {
            diagonal: vec![Matrix6::zeros(); n],
            above: vec![Matrix6::zeros(); n.saturating_sub(1)],
            border: vec![Border::zeros(); n],
            corner: Matrix3::zeros(),
            gradient: vec![Tangent::zeros(); n],
            corner_gradient: Vector3::zeros(),
        }
    }

    /// Solves for the steps of the poses and of `E`; none where the matrix is
    /// not positive definite.
    fn solve(mut self) -> Option<(Vec<Tangent>, Vector3<f64>)> {
        let n = self.diagonal.len();
        let mut inverse = Vec::with_capacity(n);
        for i in 0..n {
            let chol = self.diagonal[i].cholesky()?;
            if i + 1 < n {
                let gain = chol.solve(&self.above[i]).transpose();
                self.diagonal[i + 1] -= gain * self.above[i];
                let (border, gradient) = (self.border[i], self.gradient[i]);
                self.border[i + 1] -= gain * border;
                self.gradient[i + 1] -= gain * gradient;
            }
            let solved = chol.solve(&self.border[i]);
            self.corner -= self.border[i].transpose() * solved;
            self.corner_gradient -= solved.transpose() * self.gradient[i];
            inverse.push(chol);
        }
        let e = self.corner.cholesky()?.solve(&-self.corner_gradient);
        let mut steps = vec![Tangent::zeros(); n];
        for i in (0..n).rev() {
            let mut rhs = -self.gradient[i] - self.border[i] * e;
            if i + 1 < n {
                rhs -= self.above[i] * steps[i + 1];
            }
            steps[i] = inverse[i].solve(&rhs);
        }
        Some((steps, e))
    }
}

/// Weight of a registered motion: the inverse of its inflated covariance
/// plus the floor. None of the floor's directions counts more than the floor.
fn motion_weight(information: &Matrix6<f64>, config: &GraphConfig) -> Matrix6<f64> {
    let floor = Matrix6::from_diagonal(&Tangent::from_fn(|i, _| {
        (if i < 3 { config.motion_sigma_m } else { config.motion_sigma_rad }).powi(2)
    }));
    // A direction that the scans leave open has next to no information.
    let open = Matrix6::identity() * 1e-3;
    let covariance =
        (information + open).try_inverse().unwrap_or_else(Matrix6::zeros) * config.motion_inflation.powi(2);
    (covariance + floor).try_inverse().unwrap_or_else(Matrix6::zeros)
}

fn cauchy(squared_sigmas: f64, config: &GraphConfig) -> f64 {
    1.0 / (1.0 + squared_sigmas / config.robust_sigmas.powi(2))
}

impl Chain {
    /// Adds `local(z, X_i^-1 X_(i+1))` with a weight.
    fn add_motion(&mut self, i: usize, poses: &[Pose], z: &Pose, weight: &Matrix6<f64>) {
        let m = poses[i].inverse() * poses[i + 1];
        let r = local(z, &m);
        let back = m.rotation.inverse().to_rotation_matrix().into_inner();
        let mut j = Matrix6::zeros();
        j.fixed_view_mut::<3, 3>(0, 0).copy_from(&-back);
        j.fixed_view_mut::<3, 3>(0, 3).copy_from(&(back * m.translation.vector.cross_matrix()));
        j.fixed_view_mut::<3, 3>(3, 3).copy_from(&-back);
        self.diagonal[i] += j.transpose() * weight * j;
        self.diagonal[i + 1] += weight;
        self.above[i] += j.transpose() * weight;
        self.gradient[i] += j.transpose() * weight * r;
        self.gradient[i + 1] += weight * r;
    }

    /// Adds the survey's pose of a frame.
    fn add_survey(&mut self, i: usize, pose: &Pose, survey: &Pose, e: &UnitQuaternion<f64>, config: &GraphConfig) {
        let off = pose.rotation.inverse() * (pose.translation.vector - survey.translation.vector);
        let w_position = config.survey_sigma_m.powi(-2);
        let w_position = w_position * cauchy(off.norm_squared() * w_position, config);
        let w_rotation = config.survey_sigma_rad.powi(-2);
        let turn = ((survey.rotation * e).inverse() * pose.rotation).scaled_axis();
        for k in 0..3 {
            self.diagonal[i][(k, k)] += w_position;
            self.diagonal[i][(k + 3, k + 3)] += w_rotation;
            self.gradient[i][k] += w_position * off[k];
            self.gradient[i][k + 3] += w_rotation * turn[k];
            self.border[i][(k + 3, k)] -= w_rotation;
            self.corner[(k, k)] += w_rotation;
            self.corner_gradient[k] -= w_rotation * turn[k];
        }
    }
}

/// Refines the survey's poses with the motions between neighbours.
///
/// `survey` holds `map_from_camera` as the survey has it, `motions` what
/// registration found between each and the next: one fewer.
pub fn refine_poses(survey: &[Pose], motions: &[Motion], config: &GraphConfig) -> Refined {
    let n = survey.len();
    let mut poses = survey.to_vec();
    let mut e = UnitQuaternion::identity();
    let weights: Vec<Matrix6<f64>> = motions.iter().map(|m| motion_weight(&m.information, config)).collect();
    let survey_weight = Matrix6::from_diagonal(&Tangent::from_fn(|i, _| {
        (if i < 3 { config.survey_motion_sigma_m } else { config.survey_motion_sigma_rad }).powi(-2)
    }));
    let w_e = config.misalignment_sigma_rad.powi(-2);
    // Small rotations and a near-linear chain: a handful of steps settle it;
    // the robust weights need some more.
    for _ in 0..30 {
        let mut chain = Chain::zero(n);
        for (i, (motion, weight)) in motions.iter().zip(&weights).enumerate().take(n - 1) {
            chain.add_motion(i, &poses, &motion.before_from_after, weight);
            let z = Pose::from_parts(Translation3::identity(), e).inverse()
                * survey[i].inverse()
                * survey[i + 1]
                * Pose::from_parts(Translation3::identity(), e);
            let r = local(&z, &(poses[i].inverse() * poses[i + 1]));
            let robust = cauchy((r.transpose() * survey_weight * r).x, config);
            chain.add_motion(i, &poses, &z, &(survey_weight * robust));
        }
        for i in 0..n {
            chain.add_survey(i, &poses[i], &survey[i], &e, config);
        }
        chain.corner += Matrix3::identity() * w_e;
        chain.corner_gradient += e.scaled_axis() * w_e;
        let Some((steps, turn)) = chain.solve() else { break };
        for (pose, step) in poses.iter_mut().zip(&steps) {
            *pose = retract(pose, step);
        }
        e *= UnitQuaternion::from_scaled_axis(turn);
        if steps.iter().all(|s| s.amax() < 1e-6) && turn.amax() < 1e-7 {
            break;
        }
    }
    Refined { map_from_camera: poses, survey_from_camera: e }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A drive around a bend, and the survey of it with misaligned axes.
    fn drive(e: &UnitQuaternion<f64>) -> (Vec<Pose>, Vec<Pose>) {
        let mut pose = Pose::identity();
        let mut truth = Vec::new();
        for i in 0..40 {
            truth.push(pose);
            let bend = if i > 15 { 0.04 } else { 0.0 };
            pose = retract(&pose, &Tangent::new(0.0, 0.02, 6.5, 0.001, bend, 0.0));
        }
        let survey = truth.iter().map(|p| Pose::from_parts(p.translation, p.rotation * e.inverse())).collect();
        (truth, survey)
    }

    fn exact_motions(truth: &[Pose]) -> Vec<Motion> {
        truth
            .windows(2)
            .map(|w| Motion { before_from_after: w[0].inverse() * w[1], information: Matrix6::identity() * 1e8 })
            .collect()
    }

    #[test]
    fn a_constant_misalignment_is_found_and_taken_out() {
        let e = UnitQuaternion::from_scaled_axis(Vector3::new(0.003, -0.006, 0.002));
        let (truth, survey) = drive(&e);
        let motions = exact_motions(&truth);
        let refined = refine_poses(&survey, &motions, &GraphConfig::default());
        assert!(refined.survey_from_camera.angle_to(&e) < 5e-4);
        for (a, b) in refined.map_from_camera.iter().zip(&truth) {
            assert!((a.translation.vector - b.translation.vector).norm() < 0.02);
            assert!(a.rotation.angle_to(&b.rotation) < 5e-4);
        }
    }

    #[test]
    fn where_the_survey_is_short_the_scans_keep_their_scale() {
        let (truth, _) = drive(&UnitQuaternion::identity());
        let motions = exact_motions(&truth);
        let short: Vec<Pose> =
            truth.iter().map(|p| Pose::from_parts((p.translation.vector * 0.97).into(), p.rotation)).collect();
        let refined = refine_poses(&short, &motions, &GraphConfig::default());
        let step = (refined.map_from_camera[10].inverse() * refined.map_from_camera[11]).translation.vector.norm();
        assert!((step - 6.5).abs() < 0.01, "{step}");
    }
}
