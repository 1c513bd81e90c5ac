//! Lane lines.

use nalgebra::Vector2;

use super::{Look, Matcher, Pair};
use crate::estimate::LandmarkId;
use crate::measurement::{LaneEnds, LaneVertex, pair_lane, project_lane};
use crate::prepare::Bounds;
use crate::preselect::LaneCandidate;

/// A lane line visible over less than this is not expected, metres.
const MIN_VISIBLE_LANE_M: f64 = 5.0;

/// A candidate in the image.
#[derive(Debug, Clone, Copy)]
pub(super) struct LaneAt {
    /// Its vertices are `Matcher::vertices[start..end]`.
    start: usize,
    end: usize,
    /// Nothing further from it is compared with it, pixels; 0 where there is
    /// nothing near.
    reach_px: f64,
}

/// What it costs that a lane line was not seen, nats.
fn missing(look: &Look<'_>, lane: &LaneCandidate, vertices: &[LaneVertex]) -> f64 {
    let seen = vertices.iter().filter(|vertex| !vertex.is_cut && look.scene.image.contains(&vertex.at_px, 0.0));
    let (least_m, most_m) =
        seen.fold((f64::MAX, f64::MIN), |(least, most), seen| (seen.depth_m.min(least), seen.depth_m.max(most)));
    if most_m - least_m > MIN_VISIBLE_LANE_M { (1.0 - look.scene.detection.lane(lane.kind)).ln() } else { 0.0 }
}

impl Look<'_> {
    /// A lane line half a lane away is another line, whatever the gate:
    /// `sigma` is that of its nearest vertex, pixels.
    fn lane_reach_px(&self, sigma: &Vector2<f64>, nearest: &LaneVertex) -> f64 {
        4.0 * sigma.norm() + 0.25 * self.scene.camera.fx_px / nearest.depth_m.max(1.0) + 10.0
    }
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
            self.lanes.push(LaneAt { start, end, reach_px: 0.0 });
            let vertices = self.vertices.get(start..end).unwrap_or(&[]);
            let Some(nearest) = vertices.iter().min_by(|a, b| a.depth_m.total_cmp(&b.depth_m)) else { continue };
            let p = look.view.to_camera(&nearest.point_map);
            // First by bounds, which cost less; their margin is far above what
            // rounding does to the exact distance.
            let most = Vector2::new(look.most_sigma_px(&p, &Vector2::x()), look.most_sigma_px(&p, &Vector2::y()));
            let around = Bounds::of(vertices.iter().map(|vertex| vertex.at_px));
            let around = around.grown(1.001 * look.lane_reach_px(&most, nearest));
            let mut known = None;
            for (i, feature) in scene.features.lanes.iter().enumerate() {
                if around.is_apart(&feature.bounds) {
                    continue;
                }
                let (reach_px, log_probability) = *known.get_or_insert_with(|| {
                    let sigma = Vector2::new(look.sigma_px(&p, &Vector2::x()), look.sigma_px(&p, &Vector2::y()));
                    (look.lane_reach_px(&sigma, nearest), scene.detection.lane(lane.kind).ln())
                });
                let pair = LaneEnds::new(vertices, feature, scene.noise, focal_px, reach_px);
                let Some((distance2, log_density)) = look.judge_lane(pair) else { continue };
                let support = log_probability + log_density - clutter_ln;
                self.pairs.push(Pair { feature: i, candidate, distance2, support });
            }
            if let (Some((reach_px, _)), Some(at)) = (known, self.lanes.last_mut()) {
                at.reach_px = reach_px;
            }
        }
        self.assignment.find(&self.pairs, scene.features.lanes.len(), lanes.len());
        let first = self.matches.len();
        let (ats, vertices) = (std::mem::take(&mut self.lanes), std::mem::take(&mut self.vertices));
        let at = |candidate: usize| ats.get(candidate).zip(lanes.get(candidate));
        let of = |at: &LaneAt| vertices.get(at.start..at.end).unwrap_or(&[]);
        let unseen = self.close(
            look.wanted,
            false,
            matched,
            |candidate| at(candidate).map_or(0.0, |(at, lane)| missing(look, lane, of(at))),
            |pair| {
                let (at, lane) = at(pair.candidate)?;
                let feature = scene.features.lanes.get(pair.feature)?;
                let pairing = pair_lane(of(at), feature, scene.noise, focal_px, at.reach_px)?;
                Some((LandmarkId::Lane(lane.index), feature.index, pairing))
            },
        );
        (self.lanes, self.vertices) = (ats, vertices);
        self.match_marks(look, first, matched);
        unseen
    }
}
