//! Lane lines in the image, and what a lane feature says about them.

use common::map::LaneKind;
use nalgebra::{Point2, Point3, Vector2, Vector3};

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
    /// It is no vertex of the line: there the line passes the near plane.
    pub is_cut: bool,
    /// It is of a kerb.
    pub is_kerb: bool,
    /// From here to the next vertex, pixels.
    along_px: Vector2<f64>,
    /// The square of its length.
    length2_px2: f64,
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
        let mut push = |p: &Vector3<f64>, point_map: Point3<f64>, is_cut: bool| {
            if p.z >= NEAR_M {
                let (at_px, along_px) = (view.pixel(p), Vector2::zeros());
                let is_kerb = lane.kind == LaneKind::Kerb;
                out.push(LaneVertex { at_px, depth_m: p.z, point_map, is_cut, is_kerb, along_px, length2_px2: 0.0 });
            }
        };
        let p = view.to_camera(&point_map);
        if let Some((last, z)) = before.filter(|(_, z)| (*z < NEAR_M) != (p.z < NEAR_M)) {
            let cut = last + (point_map - last) * ((plane_m - z) / (p.z - z));
            push(&view.to_camera(&cut), cut, true);
        }
        push(&p, point_map, false);
        before = Some((point_map, p.z));
    }
    let mut next_px = None;
    for vertex in out.iter_mut().skip(start).rev() {
        vertex.along_px = next_px.map_or(Vector2::zeros(), |next: Point2<f64>| next - vertex.at_px);
        vertex.length2_px2 = vertex.along_px.norm_squared();
        next_px = Some(vertex.at_px);
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
        if let Some(observation) = observe(vertices, knot, Across::Feature, noise, focal_px, reach_px) {
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

/// The places of [`pair_lane`], from its ends inwards: most pairs are refuted by
/// the first end already. Their distances are measured across the line, not across
/// the feature: what lies nearest on a line that runs athwart lies along the feature,
/// and across that it is no distance away.
#[derive(Debug, Clone)]
pub struct LaneEnds<'a> {
    vertices: &'a [LaneVertex],
    noise: &'a NoiseConfig,
    focal_px: f64,
    reach_px: f64,
    /// Knots that were not asked for yet.
    left: std::slice::Iter<'a, Knot>,
}

impl<'a> LaneEnds<'a> {
    /// Arguments as those of [`pair_lane`].
    pub fn new(
        vertices: &'a [LaneVertex],
        feature: &'a PreparedLane,
        noise: &'a NoiseConfig,
        focal_px: f64,
        reach_px: f64,
    ) -> Self {
        Self { vertices, noise, focal_px, reach_px, left: feature.knots().iter() }
    }

    /// The first observation that is left. Its standard deviation is still to
    /// be multiplied by [`Self::share`].
    pub fn first(&mut self) -> Option<Observation> {
        self.left.find_map(|knot| observe(self.vertices, knot, Across::Line, self.noise, self.focal_px, self.reach_px))
    }

    /// As [`Self::first`], the last.
    pub fn last(&mut self) -> Option<Observation> {
        let mut left = self.left.by_ref().rev();
        left.find_map(|knot| observe(self.vertices, knot, Across::Line, self.noise, self.focal_px, self.reach_px))
    }

    /// With first and last taken: what their standard deviations are to be
    /// multiplied by.
    pub fn share(&self) -> f64 {
        let beside = |knot: &&Knot| nearest_on(self.vertices, &knot.at_px, self.reach_px).is_some();
        share_of(self.left.as_slice().iter().filter(beside).count() + 2)
    }

    /// No less than [`Self::share`], with `taken` ends taken, and sooner known.
    pub fn most_share(&self, taken: usize) -> f64 {
        share_of(self.left.len() + taken)
    }
}

/// However many knots: a line tells two numbers.
fn share_of(knots: usize) -> f64 {
    (knots as f64 / 2.0).sqrt()
}

/// Across what a distance is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Across {
    /// The feature: that stays in the image as the pose is moved.
    Feature,
    /// The projected line.
    Line,
}

/// What a knot says about the line beside it.
fn observe(
    vertices: &[LaneVertex],
    knot: &Knot,
    across: Across,
    noise: &NoiseConfig,
    focal_px: f64,
    reach_px: f64,
) -> Option<Observation> {
    let (a, b, fraction) = nearest_on(vertices, &knot.at_px, reach_px)?;
    let share = fraction_in_space(fraction, a.depth_m, b.depth_m);
    let point_map = a.point_map + (b.point_map - a.point_map) * share;
    let depth_m = a.depth_m + (b.depth_m - a.depth_m) * share;
    let normal = match across {
        Across::Feature => knot.normal,
        Across::Line => Vector2::new(-a.along_px.y, a.along_px.x) / a.length2_px2.sqrt(),
    };
    let (lateral_m, height_m) = noise.of_line(a.is_kerb);
    let lateral_px = normal.x * lateral_m * focal_px / depth_m;
    let height_px = normal.y * height_m * focal_px / depth_m;
    let variance = knot.sigma_px * knot.sigma_px
        + lateral_px * lateral_px
        + height_px * height_px
        + noise.calibration_px(focal_px).powi(2);
    Some(Observation::on_line(point_map, normal, &knot.at_px, variance.sqrt()))
}

/// The edge of a projected polyline that is nearest to a pixel, and the fraction
/// of it; none beyond the polyline's ends or further than `reach_px`.
fn nearest_on<'a>(
    vertices: &'a [LaneVertex],
    pixel: &Point2<f64>,
    reach_px: f64,
) -> Option<(&'a LaneVertex, &'a LaneVertex, f64)> {
    let (mut least_px2, mut nearest) = (reach_px * reach_px, None);
    let (_, edges) = vertices.split_last()?;
    for (i, edge) in edges.iter().enumerate() {
        if edge.length2_px2 < 1e-12 {
            continue;
        }
        let fraction = edge.along_px.dot(&(pixel - edge.at_px)) / edge.length2_px2;
        let at_px = edge.at_px + edge.along_px * fraction.clamp(0.0, 1.0);
        let distance2 = (pixel - at_px).norm_squared();
        if distance2 < least_px2 {
            (least_px2, nearest) = (distance2, Some((i, fraction)));
        }
    }
    let (i, fraction) = nearest?;
    let beyond = (i == 0 && fraction < 0.0) || (i + 1 == edges.len() && fraction > 1.0);
    if beyond {
        return None;
    }
    Some((vertices.get(i)?, vertices.get(i + 1)?, fraction.clamp(0.0, 1.0)))
}
