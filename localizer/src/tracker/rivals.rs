//! Poses beside the best one that may explain a frame as well: the next lane,
//! the same place one delineator further.

use std::f64::consts::PI;

use common::geometry::{Pose, Tangent, local, retract};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use serde::{Deserialize, Serialize};

use super::Tracker;
use super::hypothesis::Hypothesis;
use crate::Result;
use crate::associate::matching::Scene;
use crate::associate::robust::{Associator, Question, Refined};
use crate::config::Config;
use crate::preselect::Reach;
use crate::solver::Prior;

/// Settings of the look beside.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RivalConfig {
    /// Shifted poses are looked at in every so many frames. It costs more than
    /// all the rest of a frame; in every third only, where images come at
    /// wrong times, five times as many wrong poses were called ok.
    pub every_frames: usize,
    /// Shifts to the sides that are tried, metres: half and whole lanes.
    pub sideways_m: Vec<f64>,
    /// Shifts along the road that are tried, metres: what repeats along roads
    /// (dashes, delineators) and what a motion surprise may be.
    pub along_m: Vec<f64>,
    /// Shifts along the least certain direction of the pose that are tried,
    /// metres; a turn counts by how it shifts what is [`Self::lever_m`] ahead.
    pub uncertain_m: Vec<f64>,
    /// Distance at which a turn is weighed as a shift, metres: where most
    /// landmarks are.
    pub lever_m: f64,
    /// The frame is also asked without most of the prediction: standard
    /// deviation of the position then, metres. A drift that feeds on itself
    /// through the prediction shows here.
    pub loose_m: f64,
    /// As above for turns, radians.
    pub loose_rad: f64,
    /// A pose found like that which lies nearer than this is the same, metres;
    /// turns count by how they shift what is [`Self::lever_m`] ahead.
    pub loose_distinct_m: f64,
    /// The best of the shifted poses that are refined.
    pub refined: usize,
    /// A shifted pose that a round of matching leads so near to the best is no
    /// rival and is not refined further, metres; turns count as above. A tenth
    /// of [`Self::distinct_m`]: it would have to go a long way yet.
    pub same_m: f64,
    /// A rival that has less support than the best by no more than this is
    /// tracked on, nats.
    pub spawn_margin: f64,
    /// A rival lies at least this far from the best, metres; turns count as
    /// above.
    pub distinct_m: f64,
}

impl Default for RivalConfig {
    fn default() -> Self {
        Self {
            every_frames: 1,
            sideways_m: vec![-3.5, -1.5, 1.5, 3.5],
            along_m: vec![-6.0, -3.0, -1.5, 1.5, 3.0, 6.0],
            uncertain_m: vec![-1.0, 1.0],
            lever_m: 20.0,
            loose_m: 0.6,
            loose_rad: 0.05,
            loose_distinct_m: 0.25,
            refined: 2,
            same_m: 0.07,
            spawn_margin: 6.0,
            distinct_m: 0.7,
        }
    }
}

impl RivalConfig {
    /// How far a pose lies from another, metres; a turn counts by how it shifts
    /// what is [`Self::lever_m`] ahead.
    fn distance_m(&self, from: &Pose, to: &Pose) -> f64 {
        let off = local(from, to);
        let turned_m = off.fixed_rows::<3>(3).norm() * self.lever_m;
        off.fixed_rows::<3>(0).norm().max(turned_m)
    }

    /// How far the shifted poses lie around one with this covariance.
    pub fn reach(&self, covariance: &Matrix6<f64>) -> Reach {
        let own = Reach::of_covariance(covariance);
        let most_m = |shifts_m: &[f64]| shifts_m.iter().fold(0.0_f64, |most, m| most.max(m.abs()));
        // Where it is least certain may be a turn.
        let turned_rad = most_m(&self.uncertain_m) / self.lever_m.max(f64::MIN_POSITIVE);
        let shifted_m = most_m(&self.sideways_m).max(most_m(&self.along_m)).max(most_m(&self.uncertain_m));
        Reach { position_m: own.position_m + shifted_m, angle_rad: own.angle_rad + turned_rad.min(PI) }
    }
}

impl Tracker<'_> {
    /// What a rival that this frame shows beside the best pays, nats: as much as a jump,
    /// but where the best was found again and is not trusted yet.
    pub(super) fn rival_cost(&self) -> f64 {
        let is_anew = self.verdict.is_some_and(|verdict| verdict.was_ever_ok && !verdict.was_ok);
        if is_anew { self.config.bank.newcomer_cost } else { self.config.bank.jump_cost }
    }

    /// Looks beside the best hypothesis for poses that explain the frame as
    /// well; returns by how much support the best is ahead, nats: in this
    /// frame, or when it was last looked.
    pub(super) fn find_rivals(&mut self) -> Result<f64> {
        let Some(first) = self.bank.first_mut() else { return Ok(0.0) };
        // All but the list of its matches.
        let matches = std::mem::take(&mut first.correspondences);
        let best = first.clone();
        first.correspondences = matches;
        let reach = self.config.rivals.reach(&best.state.pose_covariance());
        self.select(&best.state.map_from_camera, &reach)?;
        let scene = self.sight.scene(&self.config);
        // Asked too, in turn: where else it fits as well. A wrong lock lasts.
        let is_due = best.margin.is_none() || best.age_frames.is_multiple_of(self.config.rivals.every_frames.max(1));
        let mut found = std::mem::take(&mut self.rivals);
        found.clear();
        if is_due {
            find(&scene, &best, &mut self.associator, &self.config, &mut found);
        }
        let loose = find_loose(&scene, &best, &mut self.associator, &self.config);
        if let Some(loose) = loose.filter(|loose| loose.evidence() > best.evidence - self.config.rivals.spawn_margin) {
            self.add(Hypothesis::beside(&best, &loose, self.rival_cost()));
        }
        let mut margin = best.margin.filter(|_| !is_due).unwrap_or(f64::INFINITY);
        for rival in &found {
            let ahead = best.evidence - rival.evidence();
            margin = margin.min(ahead);
            if ahead < self.config.rivals.spawn_margin {
                self.add(Hypothesis::beside(&best, rival, self.rival_cost()));
            }
        }
        self.rivals = found;
        // What was added stands behind those that were tracked.
        if let Some(best) = self.bank.first_mut() {
            best.margin = Some(margin);
        }
        Ok(margin)
    }
}

/// The direction in which the place on the road is least certain, as a shift
/// of one metre (a turn by its effect at `lever_m`): right, forward and yaw.
/// Height and tilt are the road's.
fn least_certain(covariance: &Matrix6<f64>, lever_m: f64) -> Tangent {
    const OF_ROAD: [usize; 3] = [0, 2, 4];
    let scale = Vector3::new(1.0, 1.0, lever_m);
    let scaled = Matrix3::from_fn(|i, j| covariance[(OF_ROAD[i], OF_ROAD[j])] * scale[i] * scale[j]);
    let eigen = scaled.symmetric_eigen();
    let direction = eigen.eigenvectors.column(eigen.eigenvalues.imax()).component_div(&scale);
    let mut shift = Tangent::zeros();
    for (value, component) in direction.iter().zip(OF_ROAD) {
        shift[component] = *value;
    }
    shift
}

/// Appends the refined rivals of `best` in this scene, all distinct from it.
fn find(scene: &Scene<'_>, best: &Hypothesis, associator: &mut Associator, config: &Config, found: &mut Vec<Refined>) {
    let rivals = &config.rivals;
    let pose = best.state.map_from_camera;
    let shifts = rivals
        .sideways_m
        .iter()
        .map(|&m| Tangent::new(m, 0.0, 0.0, 0.0, 0.0, 0.0))
        .chain(rivals.along_m.iter().map(|&m| Tangent::new(0.0, 0.0, m, 0.0, 0.0, 0.0)));
    let direction = least_certain(&best.state.pose_covariance(), rivals.lever_m);
    let shifts = shifts.chain(rivals.uncertain_m.iter().map(|&m| direction * m));
    // Each is as uncertain as the shifts are apart.
    let sigmas = Vector6::new(0.5, 0.1, 0.6, 0.01, 0.015, 0.01);
    let covariance = Matrix6::from_diagonal(&sigmas.component_mul(&sigmas));
    let mut scored = std::mem::take(&mut associator.scored);
    scored.clear();
    scored.extend(shifts.map(|shift| {
        let shifted = retract(&pose, &shift);
        (associator.matcher.support(scene, &shifted, &covariance), shifted)
    }));
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let is_best = |other: &Pose| rivals.distance_m(&pose, other) < rivals.same_m;
    for &(_, shifted) in scored.iter().take(rivals.refined) {
        let Some(prior) = Prior::new(shifted, &covariance) else { continue };
        let question = Question { scene, gate_covariance: &covariance, prior: &prior, config };
        let refined = associator.refine_unless(&question, &shifted, is_best);
        let is_distinct = |r: &Refined| rivals.distance_m(&pose, &r.map_from_camera) >= rivals.distinct_m;
        found.extend(refined.filter(is_distinct));
    }
    associator.scored = scored;
}

/// The pose that the frame alone asks for near `best`; none where it is the
/// same.
fn find_loose(scene: &Scene<'_>, best: &Hypothesis, associator: &mut Associator, config: &Config) -> Option<Refined> {
    let rivals = &config.rivals;
    let pose = best.state.map_from_camera;
    let (m, rad) = (rivals.loose_m, rivals.loose_rad);
    // Height and tilt stay as they were predicted: they do not drift.
    let predicted = best.state.pose_covariance();
    let sigma = |component: usize, loose: f64| predicted[(component, component)].max(0.0).sqrt().min(loose);
    let start = &config.start;
    let (height_m, tilt_rad) = (start.height_sigma_m, start.tilt_sigma_rad);
    let sigmas = Vector6::new(m, sigma(1, height_m), m, sigma(3, tilt_rad), rad, sigma(5, tilt_rad));
    let covariance = Matrix6::from_diagonal(&sigmas.component_mul(&sigmas));
    let prior = Prior::new(pose, &covariance)?;
    let question = Question { scene, gate_covariance: &covariance, prior: &prior, config };
    let refined = associator.refine(&question, &pose)?;
    (rivals.distance_m(&pose, &refined.map_from_camera) >= rivals.loose_distinct_m).then_some(refined)
}
