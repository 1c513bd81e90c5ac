//! Marks of dashed lines that are matched: they tell where along the line the
//! camera is, up to the length of a dash and a gap.

use nalgebra::{Point3, Vector2};

use super::{Look, Match, Matcher};
use crate::estimate::LandmarkId;
use crate::features::MarkEdge;
use crate::measurement::Pairing;
use crate::prepare::MAX_KNOTS;
use crate::residual::Observation;

/// Standard deviations from the common shift within which an end of a mark
/// supports it: three of them hold 99.7 %.
const SUPPORT_SIGMAS: f64 = 3.0;
/// Ends that tell something of their own about whether a pose is right, however
/// many there are: a wrong dash has the same gaps.
const INDEPENDENT: f64 = 2.0;
/// Shifts that differ by no more are one, metres: half of the shortest marks.
const SAME_M: f64 = 0.5;
/// Over so much of a line its scale in the image is taken, metres.
const SCALE_M: f64 = 0.2;

/// An end of a mark in the image and one in the map that may be the same.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgePair {
    /// Which end in the image.
    edge: usize,
    observation: Observation,
    /// By how much the map's end lies further along the line, metres.
    shift_m: f64,
    /// Standard deviation of that without the pose's, metres.
    sigma_m: f64,
    /// That of the pose, metres.
    pose_sigma_m: f64,
}

impl EdgePair {
    /// How much more likely the pair is at a common shift than clutter, nats;
    /// none beyond what supports it.
    fn support(&self, shift_m: f64, clutter_m: f64) -> Option<f64> {
        let off = (self.shift_m - shift_m) / self.sigma_m;
        let density = self.sigma_m * std::f64::consts::TAU.sqrt();
        (off.abs() <= SUPPORT_SIGMAS).then(|| (clutter_m / density).ln() - 0.5 * off * off)
    }
}

impl Matcher {
    /// Adds the marks of the lines that are matched from `first` on, where their
    /// ends agree on one shift along the line and on no other.
    pub(super) fn match_marks(&mut self, look: &Look<'_>, first: usize, matched: &mut f64) {
        let scene = look.scene;
        if scene.features.edges.is_empty() || scene.candidates.marks_map.is_empty() {
            return;
        }
        for at in first..self.matches.len() {
            let Some(found) = self.matches.get(at) else { continue };
            let (LandmarkId::Lane(index), feature) = (found.landmark, found.feature) else { continue };
            let lane = scene.candidates.lanes.iter().find(|lane| lane.index == index);
            let seen = scene.features.lanes.iter().find(|lane| lane.index == feature);
            let Some((lane, seen)) = lane.zip(seen) else { continue };
            let marks = scene.candidates.marks_map.get(lane.marks.0..lane.marks.1).unwrap_or(&[]);
            let edges = scene.features.edges.get(seen.edges.0..seen.edges.1).unwrap_or(&[]);
            self.pair_edges(look, marks, edges);
            let Some((pairing, support)) = self.agree(look) else { continue };
            *matched += support;
            let landmark = LandmarkId::Marks(index);
            self.matches.push(Match { landmark, feature, pairing, distance2: 0.0, support, unseen: 0.0 });
        }
    }

    /// Leaves in `edge_pairs` what may be the same end of a mark.
    fn pair_edges(&mut self, look: &Look<'_>, marks: &[[Point3<f64>; 2]], edges: &[MarkEdge]) {
        let noise = look.scene.noise;
        let focal_px = look.scene.camera.fy_px;
        let calibration_px = noise.calibration_px(focal_px);
        self.edge_pairs.clear();
        for mark in marks {
            let depths_m = mark.map(|end| look.view.to_camera(&end).z);
            let Some(along) = (mark[1] - mark[0]).try_normalize(1e-9) else { continue };
            // Away from the camera.
            let along = if depths_m[0] < depths_m[1] { along } else { -along };
            for (k, end) in mark.iter().enumerate() {
                let is_near = depths_m[k] < depths_m[1 - k];
                let ahead = look.view.project(&(end + along * SCALE_M));
                let Some(((at_px, depth_m), (ahead_px, _))) = look.view.project(end).zip(ahead) else { continue };
                let way: Vector2<f64> = (ahead_px - at_px) / SCALE_M;
                let px_per_m = way.norm();
                let Some(tangent) = way.try_normalize(1e-6) else { continue };
                let height_px = tangent.y * noise.mark_height_sigma_m * focal_px / depth_m;
                let map_px = (noise.mark_sigma_m * px_per_m).hypot(height_px).hypot(calibration_px);
                for (edge, seen) in edges.iter().enumerate().filter(|(_, seen)| seen.is_near == is_near) {
                    let observation = Observation::on_line(*end, tangent, &seen.at_px, seen.sigma_px.hypot(map_px));
                    let Some((distance_px, row)) = observation.linearise(&look.view) else { continue };
                    let pose_px = look.row_sigma_px(&row);
                    if distance_px.abs() > SUPPORT_SIGMAS * pose_px.hypot(observation.sigma_px) {
                        continue;
                    }
                    self.edge_pairs.push(EdgePair {
                        edge,
                        observation,
                        shift_m: distance_px / px_per_m,
                        sigma_m: observation.sigma_px / px_per_m,
                        pose_sigma_m: pose_px / px_per_m,
                    });
                }
            }
        }
    }

    /// What all ends say for a shift along the line, nats, and how many of them
    /// support it.
    fn support_of(&self, shift_m: f64, clutter_m: f64) -> (f64, f64) {
        let ends = self.edge_pairs.iter().map(|pair| pair.edge + 1).max().unwrap_or(0);
        let best = |edge: usize| {
            let own = self.edge_pairs.iter().filter(|pair| pair.edge == edge);
            own.filter_map(|pair| pair.support(shift_m, clutter_m)).fold(0.0, f64::max)
        };
        (0..ends).map(best).filter(|nats| *nats > 0.0).fold((0.0, 0.0), |(sum, count), nats| (sum + nats, count + 1.0))
    }

    /// The pairs that agree on the shift that most speaks for, and what that is
    /// worth, nats; none where another shift is nearly as good.
    fn agree(&self, look: &Look<'_>) -> Option<(Pairing, f64)> {
        let detection = look.scene.detection;
        let against = |pair: &EdgePair| {
            let off = pair.shift_m / pair.pose_sigma_m.max(1e-6);
            0.5 * off * off
        };
        let mut best: Option<(f64, &EdgePair)> = None;
        for pair in &self.edge_pairs {
            let (sum, count) = self.support_of(pair.shift_m, detection.mark_clutter_m);
            let value = sum - against(pair);
            if count >= INDEPENDENT && best.is_none_or(|(most, _)| value > most) {
                best = Some((value, pair));
            }
        }
        let (value, best) = best?;
        let shift_m = best.shift_m;
        let rival = self
            .edge_pairs
            .iter()
            .filter(|pair| (pair.shift_m - shift_m).abs() > SAME_M)
            .map(|pair| self.support_of(pair.shift_m, detection.mark_clutter_m).0 - against(pair))
            .fold(0.0, f64::max);
        if value < rival + detection.mark_lead {
            return None;
        }
        let (sum, count) = self.support_of(shift_m, detection.mark_clutter_m);
        let value = sum * INDEPENDENT / count.max(INDEPENDENT) - against(best);
        let (mut pairing, mut last) = (Pairing::empty(), usize::MAX);
        let agrees = |pair: &&EdgePair| pair.support(shift_m, detection.mark_clutter_m).is_some_and(|nats| nats > 0.0);
        let agreeing = self.edge_pairs.iter().filter(agrees);
        let count = agreeing.clone().count().min(MAX_KNOTS) as f64;
        for pair in agreeing {
            if pair.edge == last {
                continue;
            }
            last = pair.edge;
            // Together they know no better than what is common to all.
            let common = look.scene.noise.mark_common_m / pair.sigma_m;
            let sigma_px = pair.observation.sigma_px * (1.0 + count * common * common).sqrt();
            pairing.push(Observation { sigma_px, ..pair.observation });
        }
        Some((pairing, value))
    }
}
