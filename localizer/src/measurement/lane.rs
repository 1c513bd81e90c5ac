//! Lane lines in the image, and what a lane feature says about them.

use nalgebra::{Point2, Point3};

use super::{NoiseConfig, Pairing};
use crate::prepare::{Knot, PreparedLane};
use crate::preselect::{Candidates, LaneCandidate};
use crate::projection::{NEAR_M, View, fraction_in_space};
use crate::residual::Observation;

/// A vertex of a lane line in the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaneVertex {
    /// Pixel.
    pub at_px: Point2<f64>,
    /// Depth, metres.
    pub depth_m: f64,
    /// Map frame, metres.
    pub point_map: Point3<f64>,
}

/// Appends the image of a lane candidate to `out`, cut at the near plane;
/// returns the range of its vertices.
pub fn project_lane(
    view: &View,
    candidates: &Candidates,
    lane: &LaneCandidate,
    out: &mut Vec<LaneVertex>,
) -> (usize, usize) {
    let start = out.len();
    // The point a hair before the plane projects; rounding may not.
    let plane_m = NEAR_M * (1.0 + 1e-9);
    let mut before: Option<(Point3<f64>, f64)> = None;
    for &point_map in candidates.lane_points_map.get(lane.start..lane.end).unwrap_or(&[]) {
        let depth_m = view.to_camera(&point_map).z;
        let crossed = before.filter(|(_, z)| (*z < NEAR_M) != (depth_m < NEAR_M));
        let cut = crossed.map(|(last, z)| last + (point_map - last) * ((plane_m - z) / (depth_m - z)));
        for point_map in cut.into_iter().chain((depth_m >= NEAR_M).then_some(point_map)) {
            if let Some((at_px, depth_m)) = view.project(&point_map) {
                out.push(LaneVertex { at_px, depth_m, point_map });
            }
        }
        before = Some((point_map, depth_m));
    }
    (start, out.len())
}

/// The pair of a lane feature and a projected lane line: for each knot of the
/// feature the nearest point of the line, against the knot's tangent. None
/// where fewer than two knots have a part of the line beside them.
pub fn pair_lane(
    vertices: &[LaneVertex],
    feature: &PreparedLane,
    noise: &NoiseConfig,
    focal_px: f64,
    reach_px: f64,
) -> Option<Pairing> {
    let mut pairing = Pairing::empty();
    for knot in feature.knots() {
        if let Some(observation) = observe(vertices, knot, noise, focal_px, reach_px) {
            pairing.push(observation);
        }
    }
    if pairing.count < 2 {
        return None;
    }
    let share = share_of(pairing.count);
    for observation in &mut pairing.observations[..pairing.count] {
        observation.sigma_px *= share;
    }
    Some(pairing)
}

/// The first and the last observation of [`pair_lane`], sooner known than all.
pub fn lane_ends(
    vertices: &[LaneVertex],
    feature: &PreparedLane,
    noise: &NoiseConfig,
    focal_px: f64,
    reach_px: f64,
) -> Option<[Observation; 2]> {
    let mut knots = feature.knots().iter();
    let mut first = knots.find_map(|knot| observe(vertices, knot, noise, focal_px, reach_px))?;
    let mut last = knots.by_ref().rev().find_map(|knot| observe(vertices, knot, noise, focal_px, reach_px))?;
    let between = knots.filter(|knot| nearest_on(vertices, &knot.at_px, reach_px).is_some()).count();
    let share = share_of(between + 2);
    first.sigma_px *= share;
    last.sigma_px *= share;
    Some([first, last])
}

/// However many knots: a line tells two numbers.
fn share_of(knots: usize) -> f64 {
    (knots as f64 / 2.0).sqrt()
}

/// What a knot says about the line beside it.
fn observe(
    vertices: &[LaneVertex],
    knot: &Knot,
    noise: &NoiseConfig,
    focal_px: f64,
    reach_px: f64,
) -> Option<Observation> {
    let (point_map, depth_m) = place_on(vertices, &knot.at_px, reach_px)?;
    let lateral_px = knot.normal.x * noise.lane_sigma_m * focal_px / depth_m;
    let height_px = knot.normal.y * noise.lane_height_sigma_m * focal_px / depth_m;
    let variance = knot.sigma_px * knot.sigma_px
        + lateral_px * lateral_px
        + height_px * height_px
        + noise.calibration_sigma_px * noise.calibration_sigma_px;
    Some(Observation::on_line(point_map, knot.normal, &knot.at_px, variance.sqrt()))
}

/// The point of a projected polyline nearest to a pixel, in the map, with its
/// depth.
fn place_on(vertices: &[LaneVertex], pixel: &Point2<f64>, reach_px: f64) -> Option<(Point3<f64>, f64)> {
    let (a, b, fraction) = nearest_on(vertices, pixel, reach_px)?;
    let share = fraction_in_space(fraction, a.depth_m, b.depth_m);
    Some((a.point_map + (b.point_map - a.point_map) * share, a.depth_m + (b.depth_m - a.depth_m) * share))
}

/// The edge of a projected polyline that is nearest to a pixel, and the fraction
/// of it; none beyond the polyline's ends or further than `reach_px`.
fn nearest_on<'a>(
    vertices: &'a [LaneVertex],
    pixel: &Point2<f64>,
    reach_px: f64,
) -> Option<(&'a LaneVertex, &'a LaneVertex, f64)> {
    let mut best = (reach_px * reach_px, None);
    let last = vertices.len().saturating_sub(2);
    for (i, ends) in vertices.windows(2).enumerate() {
        let (a, b) = (&ends[0], &ends[1]);
        let along = b.at_px - a.at_px;
        let length2 = along.norm_squared();
        if length2 < 1e-12 {
            continue;
        }
        let fraction = along.dot(&(pixel - a.at_px)) / length2;
        let beyond = (i == 0 && fraction < 0.0) || (i == last && fraction > 1.0);
        let fraction = fraction.clamp(0.0, 1.0);
        let at_px = a.at_px + along * fraction;
        let distance2 = (pixel - at_px).norm_squared();
        if distance2 < best.0 {
            best = (distance2, (!beyond).then_some((a, b, fraction)));
        }
    }
    best.1
}
