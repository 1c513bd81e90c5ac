//! Brings the scans' own motion and the survey's poses together: a graph of
//! poses with a constant misalignment of the survey's axes.
//!
//! Unknown are the camera poses `X_i` of the stitched frames and one rotation
//! `E` (the survey's axes against the camera's). Minimised are
//!
//! - `local(Z_i, X_i^-1 X_(i+1))`: the motion between neighbours, from
//!   registration, weighted with what the scans constrain,
//! - `local(E^-1 G_i^-1 G_(i+1) E, X_i^-1 X_(i+1))`: the same from the survey,
//!   with a Cauchy weight, and with the `E` of the round before,
//! - `X_i.t - G_i.t`: the survey's positions, with a Cauchy weight,
//! - `log((G_i.R E)^T X_i.R)`: the survey's orientations but for `E`,
//! - `local(Z_ij, X_i^-1 X_j)`: where the drive comes back to a place, the
//!   motion between both passes, with a Cauchy weight,
//! - `log(E)`.
//!
//! Of a place at which the vehicle stands, positions and orientations of the
//! survey count as one of each: they all err alike.
//!
//! Where most of the survey's steps contradict those of the scans, it lost its
//! satellites: all of its terms count as less accurate by as much.
//!
//! Without revisits the normal matrix is block tridiagonal with a border of
//! three columns for `E`, and one elimination along the chain solves it.
//! Revisits break the band by 6 rows each; conjugate gradients with the
//! eliminated chain as their preconditioner then need no more than that many
//! steps, in practice some dozens, and memory stays linear in the drive.

use common::geometry::{Pose, Tangent, retract};
use nalgebra::{Matrix6, Translation3, UnitQuaternion};
use serde::{Deserialize, Serialize};

use super::chain::{Chain, MotionTerm, Step};
use super::doubt::{doubts, survey_sigma_m};
use crate::roads::{driven_m, runs};

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
    /// Stated accuracy of the survey's positions, metres per axis; where its
    /// distances contradict those of the scans by more, it counts as less
    /// accurate by as much.
    pub survey_sigma_m: f64,
    /// Way over which these distances are compared, metres: long enough for
    /// what surveys drift, short enough for what registration does.
    pub survey_check_m: f64,
    /// Stated accuracy of the survey's orientations once the constant
    /// misalignment is taken off, radians per axis.
    pub survey_sigma_rad: f64,
    /// How far the survey's axes may stand off the camera's, radians per axis.
    pub misalignment_sigma_rad: f64,
    /// Least standard deviation of the motion between two passes of one place,
    /// metres per axis: they see its things from different sides.
    pub revisit_sigma_m: f64,
    /// The same, radians per axis.
    pub revisit_sigma_rad: f64,
    /// Directions in which a scan, laid on those before it, is known so many times less
    /// accurately than the survey's motion are weak: there, few surfaces stand against the
    /// pattern of the beams, and the survey holds the scan before the next are laid on it.
    pub weak_times: f64,
    /// Scale of the Cauchy weight with which it does, in standard deviations of both: a survey
    /// that lost its satellites is off by more at every step.
    pub weak_sigmas: f64,
    /// Scale of the Cauchy weight on the survey's positions and on revisits,
    /// in standard deviations: where survey and scans contradict each other,
    /// the scans decide, for the map is made of scans. Steps that contradict
    /// each other by more cast doubt on all that the survey says there.
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
            survey_check_m: 30.0,
            survey_sigma_rad: 2e-3,
            misalignment_sigma_rad: 0.01,
            revisit_sigma_m: 0.02,
            revisit_sigma_rad: 1e-3,
            weak_times: 2.0,
            weak_sigmas: 2.0,
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

/// A motion between two passes of one place, from registration.
#[derive(Debug, Clone, Copy)]
pub struct Revisit {
    /// Index of the stitched frame of the earlier pass.
    pub before: usize,
    /// Index of the stitched frame of the later pass.
    pub after: usize,
    /// `camera_before_from_camera_after`.
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
    /// Accuracy that the survey's positions were counted with, metres per axis.
    pub survey_sigma_m: f64,
    /// How many times less accurate the survey was counted around each frame.
    pub survey_doubts: Vec<f64>,
}

/// Weight of a registered motion: the inverse of its inflated covariance
/// plus the floor. None of the floor's directions counts more than the floor.
fn motion_weight(information: &Matrix6<f64>, floor: [f64; 2], config: &GraphConfig) -> Matrix6<f64> {
    let floor = Matrix6::from_diagonal(&Tangent::from_fn(|i, _| floor[i / 3].powi(2)));
    // A direction that the scans leave open has next to no information.
    let open = Matrix6::identity() * 1e-3;
    let covariance =
        (information + open).try_inverse().unwrap_or_else(Matrix6::zeros) * config.motion_inflation.powi(2);
    (covariance + floor).try_inverse().unwrap_or_else(Matrix6::zeros)
}

pub(super) fn cauchy(squared_sigmas: f64, robust_sigmas: f64) -> f64 {
    1.0 / (1.0 + squared_sigmas / robust_sigmas.powi(2))
}

/// Poses of the frames as the motions lead from one to the next.
fn registered(motions: &[Motion]) -> Vec<Pose> {
    let mut poses = vec![Pose::identity()];
    poses.extend(motions.iter().scan(Pose::identity(), |pose, motion| {
        *pose *= motion.before_from_after;
        Some(*pose)
    }));
    poses
}

/// What each frame counts where the survey is asked, given the way driven to it:
/// the survey errs alike in all frames in which the vehicle stands.
fn place_shares(driven_m: &[f64]) -> Vec<f64> {
    runs(driven_m).into_iter().flat_map(|run| std::iter::repeat_n((run.len() as f64).recip(), run.len())).collect()
}

/// What the survey says of a frame.
struct Surveyed<'a> {
    /// `map_from_camera`.
    pose: &'a Pose,
    /// How many times less accurate than stated it is.
    doubt: f64,
    /// What it counts among the frames of its place.
    share: f64,
}

/// Adds the survey's pose of a frame.
fn add_survey(
    chain: &mut Chain,
    i: usize,
    pose: &Pose,
    Surveyed { pose: survey, doubt, share }: &Surveyed,
    e: &UnitQuaternion<f64>,
    config: &GraphConfig,
) {
    let off = pose.rotation.inverse() * (pose.translation.vector - survey.translation.vector);
    let weight = (config.survey_sigma_m * doubt).powi(-2);
    chain.add_position(i, &off, share * weight * cauchy(off.norm_squared() * weight, config.robust_sigmas));
    let turn = ((survey.rotation * e).inverse() * pose.rotation).scaled_axis();
    let weight = (config.survey_sigma_rad * doubt).powi(-2);
    // Errors of doubted steps add up to any turn.
    let robust = if *doubt > 1.0 { cauchy(turn.norm_squared() * weight, config.robust_sigmas) } else { 1.0 };
    chain.add_orientation(i, &turn, share * weight * robust);
}

/// Solves the normal equations of the chain and of the revisits; none where
/// they are not positive definite.
fn solve(chain: &Chain, revisits: &[(&Revisit, MotionTerm)]) -> Option<Step> {
    let factors = chain.factor()?;
    let mut rhs = chain.gradient.clone();
    for (revisit, term) in revisits {
        let pull = term.weight * term.residual;
        rhs.poses[revisit.before] += term.before.transpose() * pull;
        rhs.poses[revisit.after] += pull;
    }
    rhs.scale(-1.0);
    if revisits.is_empty() {
        return Some(factors.solve(&rhs));
    }
    let times = |step: &Step| {
        let mut out = chain.times(step);
        for (revisit, term) in revisits {
            let pull = term.weight * (term.before * step.poses[revisit.before] + step.poses[revisit.after]);
            out.poses[revisit.before] += term.before.transpose() * pull;
            out.poses[revisit.after] += pull;
        }
        out
    };
    // Hestenes and Stiefel 1952, preconditioned.
    let mut step = Step::zero(rhs.poses.len());
    let mut residual = rhs;
    let mut solved = factors.solve(&residual);
    let mut direction = solved.clone();
    let mut product = residual.dot(&solved);
    let enough = product * CG_TOLERANCE.powi(2);
    for _ in 0..6 * revisits.len() + 3 {
        if product <= enough {
            break;
        }
        let bent = times(&direction);
        let length = product / direction.dot(&bent);
        if !length.is_finite() {
            return None;
        }
        step.add(length, &direction);
        residual.add(-length, &bent);
        solved = factors.solve(&residual);
        let next = residual.dot(&solved);
        direction.scale(next / product);
        direction.add(1.0, &solved);
        product = next;
    }
    Some(step)
}

/// Most steps of the refinement.
const MOST_STEPS: usize = 50;

/// What is left of a step's error, as a share: the steps are repeated until
/// they are small, so that each need be right to a few digits only.
const CG_TOLERANCE: f64 = 1e-4;

/// Refines the survey's poses with the motions between neighbours and between
/// passes.
///
/// `survey` holds `map_from_camera` as the survey has it, `motions` what
/// registration found between each and the next: one fewer.
pub fn refine_poses(survey: &[Pose], motions: &[Motion], revisits: &[Revisit], config: &GraphConfig) -> Refined {
    let n = survey.len();
    let mut poses = survey.to_vec();
    let mut e = UnitQuaternion::identity();
    let floor = [config.motion_sigma_m, config.motion_sigma_rad];
    let weights: Vec<Matrix6<f64>> = motions.iter().map(|m| motion_weight(&m.information, floor, config)).collect();
    let doubts = doubts(survey, motions, &weights, config);
    let registered = registered(motions);
    let driven_m = driven_m(&registered);
    let shares = place_shares(&driven_m);
    let survey_sigma_m = survey_sigma_m(survey, (&registered, &driven_m), motions, &weights, config);
    let config = &GraphConfig {
        survey_sigma_m,
        // What drifts more drifts more in each step, too.
        survey_motion_sigma_m: config.survey_motion_sigma_m * survey_sigma_m / config.survey_sigma_m,
        ..config.clone()
    };
    let known = |r: &&Revisit| r.before < n && r.after < n;
    let revisits: Vec<(&Revisit, Matrix6<f64>)> =
        revisits.iter().filter(known).map(|r| (r, revisit_weight(r, config))).collect();
    let survey_weight = Matrix6::from_diagonal(&Tangent::from_fn(|i, _| {
        (if i < 3 { config.survey_motion_sigma_m } else { config.survey_motion_sigma_rad }).powi(-2)
    }));
    let w_e = config.misalignment_sigma_rad.powi(-2);
    let robust = |mut term: MotionTerm, sigmas: f64| {
        term.weight *= cauchy(term.squared_sigmas(), sigmas);
        term
    };
    let tie = |r: &Revisit, w: &Matrix6<f64>, poses: &[Pose]| {
        MotionTerm::new(&poses[r.before], &poses[r.after], &r.before_from_after, w)
    };
    // Both passes start as far apart as the survey has drifted: the robust
    // scale begins there and is halved in each step (graduated non-convexity).
    let farthest = revisits.iter().map(|(r, w)| tie(r, w, &poses).squared_sigmas().sqrt()).fold(0.0, f64::max);
    let mut revisit_sigmas = farthest.max(config.robust_sigmas);
    // Small rotations and a near-linear chain: a handful of steps settle it;
    // the robust weights need some more.
    for _ in 0..MOST_STEPS {
        let mut chain = Chain::zero(n);
        for (i, (motion, weight)) in motions.iter().zip(&weights).enumerate().take(n - 1) {
            let (a, b) = (&poses[i], &poses[i + 1]);
            chain.add_motion(i, &MotionTerm::new(a, b, &motion.before_from_after, weight));
            let z = Pose::from_parts(Translation3::identity(), e).inverse()
                * survey[i].inverse()
                * survey[i + 1]
                * Pose::from_parts(Translation3::identity(), e);
            let weight = survey_weight / doubts[i].max(doubts[i + 1]).powi(2);
            chain.add_motion(i, &robust(MotionTerm::new(a, b, &z, &weight), config.robust_sigmas));
        }
        for (i, share) in shares.iter().enumerate().take(n) {
            let surveyed = Surveyed { pose: &survey[i], doubt: doubts[i], share: *share };
            add_survey(&mut chain, i, &poses[i], &surveyed, &e, config);
        }
        chain.add_misalignment(&e.scaled_axis(), w_e);
        let terms: Vec<(&Revisit, MotionTerm)> =
            revisits.iter().map(|(r, w)| (*r, robust(tie(r, w, &poses), revisit_sigmas))).collect();
        let annealed = revisit_sigmas <= config.robust_sigmas;
        revisit_sigmas = (revisit_sigmas / 2.0).max(config.robust_sigmas);
        let Some(step) = solve(&chain, &terms) else { break };
        for (pose, step) in poses.iter_mut().zip(&step.poses) {
            *pose = retract(pose, step);
        }
        e *= UnitQuaternion::from_scaled_axis(step.turn);
        if annealed && step.poses.iter().all(|s| s.amax() < 1e-6) && step.turn.amax() < 1e-7 {
            break;
        }
    }
    Refined {
        map_from_camera: poses,
        survey_from_camera: e,
        survey_sigma_m: config.survey_sigma_m,
        survey_doubts: doubts,
    }
}

fn revisit_weight(revisit: &Revisit, config: &GraphConfig) -> Matrix6<f64> {
    motion_weight(&revisit.information, [config.revisit_sigma_m, config.revisit_sigma_rad], config)
}

/// Squared distance between a revisit and the poses of its frames, in
/// standard deviations: a chi-square of six degrees of freedom.
pub fn squared_sigmas(revisit: &Revisit, map_from_camera: &[Pose], config: &GraphConfig) -> f64 {
    let (Some(before), Some(after)) = (map_from_camera.get(revisit.before), map_from_camera.get(revisit.after)) else {
        return f64::INFINITY;
    };
    MotionTerm::new(before, after, &revisit.before_from_after, &revisit_weight(revisit, config)).squared_sigmas()
}

#[cfg(test)]
mod tests;
