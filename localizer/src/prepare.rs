//! Features in the form in which every hypothesis looks at them: lines with
//! their directions, lane curves as a few local tangents. Done once a frame.

use common::geometry::ImageLine;
use common::map::PoleKind;
use nalgebra::{Point2, Vector2};

use crate::features::{Features, LaneFeature, LineFeature, MarkEdge, PointFeature};

/// Places along a lane feature where it is compared with the map.
pub const MAX_KNOTS: usize = 6;

/// Probabilities count as no closer than this to 0 and 1: no network is surer.
const LEAST_PROBABILITY: f64 = 0.02;

/// Log odds of the probability of a region, nats; even where it is no number.
pub fn log_odds(probability: f64) -> f64 {
    let known = if probability.is_nan() { 0.5 } else { probability };
    let p = known.clamp(LEAST_PROBABILITY, 1.0 - LEAST_PROBABILITY);
    (p / (1.0 - p)).ln()
}

/// A pole feature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreparedPole {
    /// Index into `Features::poles`, or beyond these into `Features::trunks`.
    pub index: usize,
    /// It is seen as a trunk.
    pub is_trunk: bool,
    /// Its line.
    pub line: ImageLine,
    /// Unit vector from the upper to the lower end.
    pub down: Vector2<f64>,
    /// Upper end, pixels.
    pub upper_px: Point2<f64>,
    /// Half way between its ends, pixels.
    pub middle_px: Point2<f64>,
    /// Nearer to its middle than this nothing is too far away, pixels: five
    /// standard deviations of its own.
    pub least_off_px: f64,
    /// Distance of its ends, pixels.
    pub length_px: f64,
    /// Standard deviation of the offset at its middle, pixels.
    pub offset_sigma_px: f64,
    /// Standard deviation of its direction, radians.
    pub angle_sigma_rad: f64,
    /// The lower end is cut.
    pub lower_is_cut: bool,
    /// The upper end is cut.
    pub upper_is_cut: bool,
    /// Log odds of its probability, nats.
    pub log_odds: f64,
}

impl PreparedPole {
    fn new(index: usize, feature: &LineFeature, is_trunk: bool) -> Option<Self> {
        let line = feature.line()?;
        let down = (feature.lower_px - feature.upper_px).try_normalize(1e-9)?;
        let length_px = feature.length_px();
        let own_px = feature.offset_sigma_px + feature.angle_sigma_rad * length_px;
        Some(Self {
            index,
            is_trunk,
            line,
            down,
            upper_px: feature.upper_px,
            middle_px: feature.upper_px + down * (0.5 * length_px),
            least_off_px: 5.0 * own_px + 2.01,
            length_px,
            offset_sigma_px: feature.offset_sigma_px,
            angle_sigma_rad: feature.angle_sigma_rad,
            lower_is_cut: feature.lower_is_cut,
            upper_is_cut: feature.upper_is_cut,
            log_odds: log_odds(feature.probability),
        })
    }

    /// Whether it may be a pole of this kind.
    #[inline]
    pub fn may_be(&self, kind: PoleKind) -> bool {
        self.is_trunk == (kind == PoleKind::Trunk)
    }

    /// Variance of the line's place, `along_px` below the upper end, px^2.
    #[inline]
    pub fn variance_px2(&self, along_px: f64) -> f64 {
        let lever = self.angle_sigma_rad * (along_px - 0.5 * self.length_px);
        self.offset_sigma_px * self.offset_sigma_px + lever * lever
    }
}

/// A place on a lane feature with the local tangent of its curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knot {
    /// On the curve, pixels.
    pub at_px: Point2<f64>,
    /// Unit normal of the tangent.
    pub normal: Vector2<f64>,
    /// Standard deviation across the tangent, pixels.
    pub sigma_px: f64,
}

/// A lane feature, from far to near.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreparedLane {
    /// Index into `Features::lanes`.
    pub index: usize,
    knots: [Knot; MAX_KNOTS],
    count: usize,
    /// The ends of its marks are `Prepared::edges[edges.0..edges.1]`.
    pub edges: (usize, usize),
    /// Around its knots.
    pub bounds: Bounds,
}

/// A rectangle in the image, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    low_px: Point2<f64>,
    high_px: Point2<f64>,
}

impl Bounds {
    /// The smallest around some pixels.
    pub fn of(pixels: impl Iterator<Item = Point2<f64>>) -> Self {
        let none = (Point2::from([f64::INFINITY; 2]), Point2::from([f64::NEG_INFINITY; 2]));
        let (low_px, high_px) = pixels.fold(none, |(low, high), p| (low.inf(&p), high.sup(&p)));
        Self { low_px, high_px }
    }

    /// Wider by so many pixels to each side.
    #[must_use]
    pub fn grown(&self, margin_px: f64) -> Self {
        let margin = Vector2::repeat(margin_px);
        Self { low_px: self.low_px - margin, high_px: self.high_px + margin }
    }

    /// Whether the two have no pixel in common.
    pub fn is_apart(&self, other: &Self) -> bool {
        self.low_px.x > other.high_px.x
            || self.low_px.y > other.high_px.y
            || other.low_px.x > self.high_px.x
            || other.low_px.y > self.high_px.y
    }
}

impl PreparedLane {
    /// From far (top) to near; at least two.
    #[inline]
    pub fn knots(&self) -> &[Knot] {
        &self.knots[..self.count]
    }

    fn new(index: usize, feature: &LaneFeature) -> Option<Self> {
        let blank = Knot { at_px: Point2::origin(), normal: Vector2::x(), sigma_px: 1.0 };
        let bounds = Bounds::of(std::iter::empty());
        let mut lane = Self { index, knots: [blank; MAX_KNOTS], count: 0, edges: (0, 0), bounds };
        let points = &feature.points_px;
        // A tangent takes the points within half a knot distance of its place.
        let window = points.len() / MAX_KNOTS;
        if window < 3 {
            return lane.straight(feature);
        }
        for place in 0..MAX_KNOTS {
            let start = place * (points.len() - window) / (MAX_KNOTS - 1);
            let part = points.get(start..start + window).unwrap_or(&[]);
            let Some((at_px, normal, rms_px)) = tangent(part) else { continue };
            // Noise of neighbouring rows is one error, not `window` of them:
            // the network's edge wanders slowly.
            let sigma_px = rms_px.max(feature.line.offset_sigma_px);
            lane.knots[lane.count] = Knot { at_px, normal, sigma_px };
            lane.count += 1;
        }
        if lane.count >= 2 { Some(lane.bounded()) } else { lane.straight(feature) }
    }

    fn bounded(mut self) -> Self {
        self.bounds = Bounds::of(self.knots().iter().map(|knot| knot.at_px));
        self
    }

    /// A feature without enough points for a curve: the ends of its line.
    fn straight(mut self, feature: &LaneFeature) -> Option<Self> {
        let line = feature.line.line()?;
        let lever_px = 0.5 * feature.line.length_px() * feature.line.angle_sigma_rad;
        let sigma_px = feature.line.offset_sigma_px.hypot(lever_px);
        for (knot, at_px) in self.knots.iter_mut().zip([feature.line.upper_px, feature.line.lower_px]) {
            *knot = Knot { at_px, normal: line.normal, sigma_px };
        }
        self.count = 2;
        Some(self.bounded())
    }
}

/// Least-squares line (across its direction) through points: centre, unit
/// normal, root mean square distance; none where they coincide.
fn tangent(points: &[Point2<f64>]) -> Option<(Point2<f64>, Vector2<f64>, f64)> {
    let count = points.len() as f64;
    if points.len() < 2 {
        return None;
    }
    let mean = points.iter().fold(Vector2::zeros(), |sum, p| sum + p.coords) / count;
    let (mut uu, mut uv, mut vv) = (0.0, 0.0, 0.0);
    for p in points {
        let d = p.coords - mean;
        uu += d.x * d.x;
        uv += d.x * d.y;
        vv += d.y * d.y;
    }
    if uu + vv < 1e-9 {
        return None;
    }
    // Direction of the larger eigenvalue of the scatter.
    let angle = 0.5 * (2.0 * uv).atan2(uu - vv);
    let normal = Vector2::new(-angle.sin(), angle.cos());
    let square = normal.x * normal.x * uu + 2.0 * normal.x * normal.y * uv + normal.y * normal.y * vv;
    Some((Point2::from(mean), normal, (square / count).max(0.0).sqrt()))
}

/// All features of a frame. Buffers are reused.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Prepared {
    /// Poles and trunks that have a direction.
    pub poles: Vec<PreparedPole>,
    /// How many of them are trunks; none where nothing tells of trunks.
    pub trunks: Option<usize>,
    /// Lane lines that have a direction.
    pub lanes: Vec<PreparedLane>,
    /// Ends of the marks of all lane lines.
    pub edges: Vec<MarkEdge>,
    /// Signs whose centre is theirs, with their index into `Features::signs`.
    pub signs: Vec<(usize, PointFeature)>,
}

impl Prepared {
    /// Replaces the content by that of `features`. Features with coordinates
    /// that are no numbers are left out.
    pub fn fill(&mut self, features: &Features) {
        self.poles.clear();
        self.lanes.clear();
        self.edges.clear();
        self.signs.clear();
        let finite = |p: &Point2<f64>| p.x.is_finite() && p.y.is_finite();
        let poles = features.poles.iter().map(|pole| (pole, false));
        let trunks = features.trunks.iter().flatten().map(|trunk| (trunk, true));
        let upright = poles.chain(trunks).enumerate();
        let upright = upright.filter(|(_, (f, _))| finite(&f.upper_px) && finite(&f.lower_px));
        self.poles.extend(upright.filter_map(|(i, (f, is_trunk))| PreparedPole::new(i, f, is_trunk)));
        let trunks = self.poles.iter().filter(|pole| pole.is_trunk).count();
        self.trunks = features.trunks.as_ref().map(|_| trunks);
        let lanes = features.lanes.iter().enumerate().filter(|(_, f)| f.points_px.iter().all(finite));
        for (index, feature) in lanes {
            let Some(mut lane) = PreparedLane::new(index, feature) else { continue };
            let first = self.edges.len();
            self.edges.extend(feature.edges.iter().filter(|edge| finite(&edge.at_px)));
            lane.edges = (first, self.edges.len());
            self.lanes.push(lane);
        }
        let signs = features.signs.iter().copied().enumerate();
        self.signs.extend(signs.filter(|(_, f)| !f.is_cut && finite(&f.centre_px)));
    }

    /// Whether the image would show a pole of this kind.
    #[inline]
    pub fn tells_of(&self, kind: PoleKind) -> bool {
        kind != PoleKind::Trunk || self.trunks.is_some()
    }

    /// How many features may be a pole of this kind.
    #[inline]
    pub fn count_of(&self, kind: PoleKind) -> usize {
        let trunks = self.trunks.unwrap_or(0);
        if kind == PoleKind::Trunk { trunks } else { self.poles.len() - trunks }
    }

    /// Number of features.
    pub fn len(&self) -> usize {
        self.poles.len() + self.lanes.len() + self.signs.len()
    }

    /// The image gave nothing.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(upper: (f64, f64), lower: (f64, f64)) -> LineFeature {
        LineFeature {
            upper_px: Point2::new(upper.0, upper.1),
            lower_px: Point2::new(lower.0, lower.1),
            offset_sigma_px: 0.5,
            angle_sigma_rad: 0.01,
            width_px: 5.0,
            probability: 0.8,
            upper_is_cut: false,
            lower_is_cut: false,
        }
    }

    #[test]
    fn a_curved_lane_gives_tangents_of_its_own_curve() {
        let curve = |v: f64| 300.0 + 0.002 * (v - 200.0) * (v - 200.0);
        let points_px = (200..320).map(|v| Point2::new(curve(f64::from(v)), f64::from(v))).collect();
        let lane = LaneFeature { points_px, line: line((300.0, 200.0), (328.0, 320.0)), edges: Vec::new() };
        let prepared = PreparedLane::new(0, &lane).unwrap();
        assert_eq!(prepared.knots().len(), MAX_KNOTS);
        for knot in prepared.knots() {
            assert!((knot.at_px.x - curve(knot.at_px.y)).abs() < 0.2);
            let slope = 0.004 * (knot.at_px.y - 200.0);
            let along = Vector2::new(slope, 1.0).normalize();
            assert!(knot.normal.dot(&along).abs() < 0.01);
        }
        let (first, last) = (prepared.knots()[0], prepared.knots()[MAX_KNOTS - 1]);
        assert!(first.at_px.y < 215.0 && last.at_px.y > 305.0);
    }

    #[test]
    fn a_lane_without_points_is_its_line() {
        let lane = LaneFeature { points_px: Vec::new(), line: line((300.0, 200.0), (200.0, 320.0)), edges: Vec::new() };
        assert_eq!(PreparedLane::new(0, &lane).unwrap().knots().len(), 2);
    }

    #[test]
    fn what_has_no_direction_or_no_number_is_left_out() {
        let mut features = Features::default();
        features.poles.push(line((10.0, 10.0), (10.0, 10.0)));
        features.poles.push(line((f64::NAN, 10.0), (10.0, 90.0)));
        features.poles.push(line((10.0, 10.0), (10.0, 90.0)));
        let mut prepared = Prepared::default();
        prepared.fill(&features);
        assert_eq!(prepared.poles.iter().map(|p| p.index).collect::<Vec<_>>(), [2]);
    }
}
