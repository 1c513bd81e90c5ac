//! Lane lines.

use nalgebra::Vector2;

use super::{Look, Matcher, Pair};
use crate::estimate::LandmarkId;
use crate::measurement::{lane_ends, pair_lane, project_lane};
use crate::preselect::LaneCandidate;

/// A lane line visible over less than this is not expected, metres.
const MIN_VISIBLE_LANE_M: f64 = 5.0;

/// A candidate in the image.
#[derive(Debug, Clone, Copy)]
pub(super) struct LaneAt {
    /// Its vertices are `Matcher::vertices[start..end]`.
    start: usize,
    end: usize,
    /// Nothing further from it is compared with it, pixels.
    reach_px: f64,
}

/// What it costs that a lane line was not seen, nats.
fn missing(look: &Look<'_>, lane: &LaneCandidate) -> f64 {
    let scene = look.scene;
    let points = scene.candidates.lane_points_map.get(lane.start..lane.end).unwrap_or(&[]);
    let seen = points.iter().filter_map(|p| look.view.project(p)).filter(|(p, _)| scene.image.contains(p, 0.0));
    let (least_m, most_m) =
        seen.fold((f64::MAX, f64::MIN), |(least, most), (_, depth_m)| (depth_m.min(least), depth_m.max(most)));
    if most_m - least_m > MIN_VISIBLE_LANE_M { (1.0 - scene.detection.lane(lane.kind)).ln() } else { 0.0 }
}

impl Matcher {
    pub(super) fn match_lanes(&mut self, look: &Look<'_>, matched: &mut f64) -> f64 {
        let scene = look.scene;
        let focal_px = scene.camera.fx_px;
        let clutter_ln = look.clutter.lanes_per_px2().ln();
        let lanes = &scene.candidates.lanes;
        self.vertices.clear();
        self.lanes.clear();
        for (candidate, lane) in lanes.iter().enumerate() {
            let (start, end) = project_lane(&look.view, scene.candidates, lane, &mut self.vertices);
            let vertices = self.vertices.get(start..end).unwrap_or(&[]);
            let Some(nearest) = vertices.iter().min_by(|a, b| a.depth_m.total_cmp(&b.depth_m)) else {
                self.lanes.push(LaneAt { start, end, reach_px: 0.0 });
                continue;
            };
            let p = look.view.to_camera(&nearest.point_map);
            let sigma = Vector2::new(look.sigma_px(&p, &Vector2::x()), look.sigma_px(&p, &Vector2::y()));
            // A lane line half a lane away is another line, whatever the gate.
            let reach_px = 4.0 * sigma.norm() + 0.25 * focal_px / nearest.depth_m.max(1.0) + 10.0;
            self.lanes.push(LaneAt { start, end, reach_px });
            let log_probability = scene.detection.lane(lane.kind).ln();
            for (i, feature) in scene.features.lanes.iter().enumerate() {
                let ends = lane_ends(vertices, feature, scene.noise, focal_px, reach_px);
                let Some([first, last]) = ends else { continue };
                let Some((distance2, log_density)) = look.judge(&first, &last) else { continue };
                let support = log_probability + log_density - clutter_ln;
                self.pairs.push(Pair { feature: i, candidate, distance2, support });
            }
        }
        self.settle(scene.features.lanes.len(), lanes.len());
        let first = self.matches.len();
        let (ats, vertices) = (std::mem::take(&mut self.lanes), std::mem::take(&mut self.vertices));
        let unseen = self.close(
            look.wanted,
            matched,
            |candidate| lanes.get(candidate).map_or(0.0, |lane| missing(look, lane)),
            |pair| {
                let (at, lane) = ats.get(pair.candidate).zip(lanes.get(pair.candidate))?;
                let feature = scene.features.lanes.get(pair.feature)?;
                let pairing = pair_lane(vertices.get(at.start..at.end)?, feature, scene.noise, focal_px, at.reach_px)?;
                Some((LandmarkId::Lane(lane.index), feature.index, pairing))
            },
        );
        (self.lanes, self.vertices) = (ats, vertices);
        self.match_marks(look, first, matched);
        unseen
    }
}
