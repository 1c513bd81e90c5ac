//! The paper's association (IV.E), for comparison: `--method paper`.
//!
//! `Closest_correspond` takes the nearest landmark of like semantics for each
//! feature (eq. 8 for points, eq. 9 for lines) within a gate in pixels.
//! `Associate_and_localize` draws small sets of correspondences, localizes with
//! each (eq. 10-12), associates again with what that gives, localizes again,
//! and judges by the mean residual (eq. 13).
//!
//! The printed text of the algorithm was not at hand: this is rebuilt from its
//! description, with the names D1 to D5, R1, R2 and `lambda_n` of the paper. What
//! is known to fail as printed is repaired, each place marked `Repair`.

use common::geometry::{PinholeCamera, Pose, local};
use nalgebra::{Matrix6, Vector6};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::estimate::{Correspondence, LandmarkId};
use crate::measurement::{LaneVertex, NoiseConfig, Pairing, PoleImage, pair_lane, pair_sign, project_lane};
use crate::prepare::Prepared;
use crate::preselect::Candidates;
use crate::projection::View;
use crate::residual::{Group, Observation};
use crate::solver::{Loss, Prior, Problem, SolverConfig, solve};

/// Settings of the paper's method.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PaperConfig {
    /// D1: gate of pole lines under the predicted pose, pixels.
    pub d1_px: f64,
    /// D2: gate of lane lines under the predicted pose, pixels.
    pub d2_px: f64,
    /// D3: gate of signs under the predicted pose, pixels.
    pub d3_px: f64,
    /// D4: gate of all under a hypothesis' pose, pixels; the paper's 10.
    pub d4_px: f64,
    /// D5: how far a hypothesis may lie from the prediction. Printed without a
    /// unit; metres here.
    pub d5_m: f64,
    /// Repair: while GPS predicts, D1 to D3 and D5 are this many times as wide
    /// and `lambda_n` weighs by its square less, so that the pose can leave a
    /// fix that is metres off.
    pub start_factor: f64,
    /// Hypotheses per frame while GPS predicts.
    pub start_hypotheses: usize,
    /// R1: mean residual with which a hypothesis is taken at once, pixels.
    pub r1_px: f64,
    /// R2: mean residual above which the best hypothesis is refused, pixels.
    /// With gates of 10 px a limit of 10 refuses nothing.
    pub r2_px: f64,
    /// `lambda_n`: weight of the distance from the predicted pose against the
    /// residuals, px^2 per m^2. Printed as 0.001, which is no constraint: 3 px
    /// and 0.5 m weigh the same at 36.
    pub lambda_px2_m2: f64,
    /// As `lambda_n`, for the three angles, px^2 per rad^2: 3 px and 0.01 rad.
    pub lambda_px2_rad2: f64,
    /// Hypotheses per frame.
    pub hypotheses: usize,
    /// Correspondences of a hypothesis' first set.
    pub drawn: usize,
    /// Seed of the drawing.
    pub seed: u64,
}

impl Default for PaperConfig {
    fn default() -> Self {
        Self {
            d1_px: 40.0,
            d2_px: 40.0,
            d3_px: 40.0,
            d4_px: 10.0,
            d5_m: 1.0,
            start_factor: 4.0,
            start_hypotheses: 300,
            r1_px: 1.0,
            r2_px: 6.0,
            lambda_px2_m2: 36.0,
            lambda_px2_rad2: 9e4,
            hypotheses: 30,
            drawn: 4,
            seed: 1,
        }
    }
}

/// One frame as the paper sees it.
#[derive(Debug, Clone, Copy)]
pub struct PaperScene<'a> {
    /// The camera.
    pub camera: &'a PinholeCamera,
    /// What is seen.
    pub features: &'a Prepared,
    /// What may be seen.
    pub candidates: &'a Candidates,
    /// Overlap and size tests, and how far below its foot a pole may reach; no other
    /// standard deviation is used.
    pub noise: &'a NoiseConfig,
}

/// A correspondence with its observations.
#[derive(Debug, Clone, Copy)]
struct Pair {
    landmark: LandmarkId,
    feature: usize,
    pairing: Pairing,
    distance_px: f64,
}

impl PaperConfig {
    /// The settings for a frame that GPS predicts.
    #[must_use]
    pub fn at_start(&self) -> Self {
        let factor = self.start_factor.max(1.0);
        Self {
            d1_px: self.d1_px * factor,
            d2_px: self.d2_px * factor,
            d3_px: self.d3_px * factor,
            d5_m: self.d5_m * factor,
            lambda_px2_m2: self.lambda_px2_m2 / (factor * factor),
            lambda_px2_rad2: self.lambda_px2_rad2 / (factor * factor),
            hypotheses: self.start_hypotheses,
            ..*self
        }
    }
}

/// The best hypothesis so far.
struct Best {
    mean_px: f64,
    map_from_camera: Pose,
    covariance: Matrix6<f64>,
    pairs: Vec<Pair>,
}

impl Best {
    /// Repair: what it explains and how well, in pixels below the gate.
    fn score(count: usize, mean_px: f64, gate_px: f64) -> f64 {
        count as f64 * (gate_px - mean_px)
    }
}

/// What the paper's method gives for one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct PaperResult {
    /// The pose.
    pub map_from_camera: Pose,
    /// Inverse of the normal matrix for residuals of one pixel.
    pub covariance: Matrix6<f64>,
    /// What was matched.
    pub correspondences: Vec<Correspondence>,
    /// Mean residual (eq. 13), pixels.
    pub mean_residual_px: f64,
    /// Iterations over all hypotheses.
    pub iterations: usize,
    /// The mean residual is within R2.
    pub accepted: bool,
}

/// Gates of one call of `Closest_correspond`, pixels.
#[derive(Clone, Copy)]
struct Gates {
    pole: f64,
    lane: f64,
    sign: f64,
}

/// Eq. 8 and 9: the distance of a pair, pixels. Repair: the two ends of a line
/// are averaged, so that one gate holds for points and lines.
fn distance_px(view: &View, pairing: &Pairing) -> Option<f64> {
    let (first, last) = pairing.extremes();
    let (a, b) = (first.distance_px(view)?, last.distance_px(view)?);
    Some(0.5 * (a.abs() + b.abs()))
}

/// All pairs of like semantics within the gates, per feature by ascending
/// distance.
fn close_pairs(scene: &PaperScene<'_>, view: &View, gates: Gates) -> Vec<Vec<Pair>> {
    let focal_px = scene.camera.fx_px;
    let mut by_feature = Vec::with_capacity(scene.features.len());
    let mut vertices: Vec<LaneVertex> = Vec::new();
    let finish = |mut pairs: Vec<Pair>| {
        pairs.sort_by(|a, b| a.distance_px.total_cmp(&b.distance_px));
        pairs
    };
    for feature in scene.features.poles.iter().filter(|feature| !feature.is_trunk) {
        let posts = scene.candidates.poles.iter().filter(|pole| feature.may_be(pole.kind));
        let pairs = posts.filter_map(|pole| {
            let pairing = PoleImage::new(view, pole)?.pair(feature, scene.noise, focal_px, gates.pole)?.into();
            let distance_px = distance_px(view, &pairing).filter(|d| *d < gates.pole)?;
            Some(Pair { landmark: LandmarkId::Pole(pole.index), feature: feature.index, pairing, distance_px })
        });
        by_feature.push(finish(pairs.collect()));
    }
    for feature in &scene.features.lanes {
        let mut pairs = Vec::new();
        for lane in &scene.candidates.lanes {
            vertices.clear();
            project_lane(view, scene.candidates, lane, &mut vertices);
            let Some(pairing) = pair_lane(&vertices, feature, scene.noise, focal_px, 2.0 * gates.lane) else {
                continue;
            };
            let Some(distance_px) = distance_px(view, &pairing).filter(|d| *d < gates.lane) else { continue };
            pairs.push(Pair { landmark: LandmarkId::Lane(lane.index), feature: feature.index, pairing, distance_px });
        }
        by_feature.push(finish(pairs));
    }
    for (index, feature) in &scene.features.signs {
        let pairs = scene.candidates.signs.iter().filter_map(|sign| {
            let (_, depth_m) = view.project(&sign.centroid_map)?;
            let pairing = pair_sign(sign, depth_m, feature, scene.noise, focal_px)?.into();
            let distance_px = distance_px(view, &pairing).filter(|d| *d < gates.sign)?;
            Some(Pair { landmark: LandmarkId::Sign(sign.index), feature: *index, pairing, distance_px })
        });
        by_feature.push(finish(pairs.collect()));
    }
    by_feature
}

/// `Closest_correspond`: the nearest landmark of like semantics for each
/// feature, within the gate. One landmark may serve several features.
fn closest_correspond(scene: &PaperScene<'_>, view: &View, gates: Gates) -> Vec<Pair> {
    close_pairs(scene, view, gates).into_iter().filter_map(|pairs| pairs.into_iter().next()).collect()
}

/// Eq. 10-12: the pose that minimises the squared distances (px) of the pairs
/// plus `lambda_n` times the squared distance from the prediction.
fn localize(scene: &PaperScene<'_>, pairs: &[Pair], prior: &Prior, start: &Pose) -> crate::solver::Solution {
    let mut observations: Vec<Observation> = Vec::new();
    let mut groups = Vec::new();
    for pair in pairs {
        let first = observations.len();
        // The paper weighs all pixels alike.
        observations.extend(pair.pairing.observations().iter().map(|o| Observation { sigma_px: 1.0, ..*o }));
        groups.push(Group::new(first, observations.len()));
    }
    let problem = Problem { camera: scene.camera, observations: &observations, prior: Some(prior) };
    solve(&problem, &mut groups, &SolverConfig { loss: Loss::Quadratic, ..SolverConfig::default() }, start)
}

/// `Associate_and_localize`: the pose of a frame near `predicted`; `frame`
/// makes the drawing differ from frame to frame.
pub fn associate_and_localize(
    scene: &PaperScene<'_>,
    predicted: &Pose,
    frame: u64,
    config: &PaperConfig,
) -> PaperResult {
    let (l, r) = (config.lambda_px2_m2, config.lambda_px2_rad2);
    let information = Matrix6::from_diagonal(&Vector6::new(l, l, l, r, r, r));
    let prior = Prior { map_from_camera: *predicted, information };
    let wide = Gates { pole: config.d1_px, lane: config.d2_px, sign: config.d3_px };
    let narrow = Gates { pole: config.d4_px, lane: config.d4_px, sign: config.d4_px };
    let possible: Vec<Vec<Pair>> = close_pairs(scene, &View::new(scene.camera, predicted), wide)
        .into_iter()
        .filter(|pairs| !pairs.is_empty())
        .collect();
    let mut random = Pcg64::seed_from_u64(config.seed.wrapping_add(frame.wrapping_mul(0x9e37_79b9_7f4a_7c15)));
    let mut best: Option<Best> = None;
    let mut iterations = 0;
    for hypothesis in 0..config.hypotheses.max(1) {
        // The first hypothesis is the prediction's own; the others draw.
        let seed_pose = if hypothesis == 0 {
            *predicted
        } else {
            let drawn = draw(&possible, config.drawn, &mut random);
            let solution = localize(scene, &drawn, &prior, predicted);
            iterations += solution.iterations;
            solution.map_from_camera
        };
        let pairs = closest_correspond(scene, &View::new(scene.camera, &seed_pose), narrow);
        if pairs.is_empty() {
            continue;
        }
        let solution = localize(scene, &pairs, &prior, &seed_pose);
        iterations += solution.iterations;
        let moved_m = local(predicted, &solution.map_from_camera).fixed_rows::<3>(0).norm();
        if moved_m > config.d5_m {
            continue;
        }
        let view = View::new(scene.camera, &solution.map_from_camera);
        let distances = pairs.iter().filter_map(|pair| distance_px(&view, &pair.pairing));
        let mean_px = distances.sum::<f64>() / pairs.len() as f64;
        // Repair: the best of all hypotheses instead of the first within R2.
        let score = Best::score(pairs.len(), mean_px, config.d4_px);
        if best.as_ref().is_none_or(|best| score > Best::score(best.pairs.len(), best.mean_px, config.d4_px)) {
            let covariance = solution.covariance().unwrap_or_else(Matrix6::identity);
            best = Some(Best { mean_px, map_from_camera: solution.map_from_camera, covariance, pairs });
        }
        // R1: good enough to stop, with every feature that could be explained.
        if best.as_ref().is_some_and(|best| best.mean_px < config.r1_px && best.pairs.len() == possible.len()) {
            break;
        }
    }
    let Some(Best { mean_px: mean_residual_px, map_from_camera, covariance, pairs }) =
        best.filter(|best| best.mean_px <= config.r2_px)
    else {
        let unknown = Vector6::new(l, l, l, r, r, r).map(|weight| 1.0 / weight.max(1e-9));
        return PaperResult {
            map_from_camera: *predicted,
            covariance: Matrix6::from_diagonal(&unknown),
            correspondences: Vec::new(),
            mean_residual_px: 0.0,
            iterations,
            accepted: false,
        };
    };
    let view = View::new(scene.camera, &map_from_camera);
    let correspondences = pairs
        .iter()
        .map(|pair| Correspondence {
            landmark: pair.landmark,
            feature: pair.feature,
            residual_px: distance_px(&view, &pair.pairing).unwrap_or(pair.distance_px),
            weight: 1.0,
        })
        .collect();
    PaperResult { map_from_camera, covariance, correspondences, mean_residual_px, iterations, accepted: true }
}

/// Some features, each with one of its possible landmarks.
fn draw(possible: &[Vec<Pair>], count: usize, random: &mut Pcg64) -> Vec<Pair> {
    let mut features: Vec<usize> = (0..possible.len()).collect();
    let mut drawn = Vec::with_capacity(count);
    while drawn.len() < count && !features.is_empty() {
        let feature = features.swap_remove(random.random_range(0..features.len()));
        let landmarks = &possible[feature];
        drawn.push(landmarks[random.random_range(0..landmarks.len())]);
    }
    drawn
}
