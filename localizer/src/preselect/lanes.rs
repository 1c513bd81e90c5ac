//! Lane lines, cut to where they are used.

use common::map::LaneLine;
use nalgebra::Point3;

use super::{Candidates, LaneCandidate, Lookup, Reach};
use crate::projection::{NEAR_M, View};

impl Lookup<'_> {
    /// Keeps the stretches of a polyline that lie 5 to 20 m (as configured)
    /// ahead; a line that leaves the range and comes back gives several.
    pub(super) fn cut_lane(&self, index: usize, lane: &LaneLine, view: &View, reach: &Reach, out: &mut Candidates) {
        let near_m = (self.config.lane_near_m - reach.position_m).max(NEAR_M);
        let far_m = self.config.lane_far_m + reach.position_m;
        let is_near = |mark: &[Point3<f64>; 2]| {
            mark.iter().map(|end| view.to_camera(end).z).any(|depth_m| (near_m..far_m).contains(&depth_m))
        };
        let first = out.marks_map.len();
        out.marks_map.extend(lane.marks_map().filter(is_near));
        let marks = (first, out.marks_map.len());
        let mut start = out.lane_points_map.len();
        let close = |start: &mut usize, out: &mut Candidates| {
            let end = out.lane_points_map.len();
            if end >= *start + 2 {
                out.lanes.push(LaneCandidate { index, kind: lane.kind, start: *start, end, marks });
            } else {
                out.lane_points_map.truncate(*start);
            }
            *start = out.lane_points_map.len();
        };
        for ends in lane.points_map.windows(2) {
            let (a, b) = (view.to_camera(&ends[0]), view.to_camera(&ends[1]));
            let Some((from, to)) = clip(a.z, b.z, near_m, far_m) else {
                close(&mut start, out);
                continue;
            };
            let (p, q) = (a + (b - a) * from, a + (b - a) * to);
            if !self.may_be_in_image(&p, reach) && !self.may_be_in_image(&q, reach) && p.x * q.x > 0.0 {
                close(&mut start, out);
                continue;
            }
            let along = ends[1] - ends[0];
            if out.lane_points_map.len() == start {
                out.lane_points_map.push(ends[0] + along * from);
            }
            out.lane_points_map.push(ends[0] + along * to);
            if to < 1.0 {
                close(&mut start, out);
            }
        }
        close(&mut start, out);
    }
}

/// The part of a segment whose depth runs from `a` to `b` that lies within
/// `[near, far]`, as fractions of the segment.
fn clip(a: f64, b: f64, near: f64, far: f64) -> Option<(f64, f64)> {
    if (b - a).abs() < 1e-9 {
        return (a >= near && a <= far).then_some((0.0, 1.0));
    }
    let (at_near, at_far) = ((near - a) / (b - a), (far - a) / (b - a));
    let from = at_near.min(at_far).max(0.0);
    let to = at_near.max(at_far).min(1.0);
    (to - from > 1e-9).then_some((from, to))
}
