//! Points on the poles and lane lines of a drive's own map.

use common::geometry::Pose;
use common::map::{LaneKind, PoleKind, SemanticMap};
use nalgebra::{Point2, Point3};

use super::view::View;

/// Points nearer than this to a pole's axis are on it, metres: the map is a few
/// centimetres off, and a pulse at 40 m is 8 cm wide.
const BESIDE_POLE_M: f64 = 0.25;
/// Between this and that distance from the axis there is nothing about a post
/// that stands free, metres.
const FREE_M: (f64, f64) = (0.35, 0.7);
/// At most this many points for each one on the post.
const FREE_SHARE: f64 = 0.4;
/// The part of a pole that is looked at, metres above its foot: above weeds, and
/// low enough that posts of every kind have it.
const POLE_PART_M: (f64, f64) = (0.4, 2.4);
/// Fewer points are no pole in view.
const FEWEST_ON_POLE: usize = 2;
/// Ground points nearer than this to the middle of a line are paint, metres:
/// half the width of a line.
const ON_LINE_M: f64 = 0.06;
/// And those between these distances are asphalt beside it, metres.
const BESIDE_LINE_M: (f64, f64) = (0.3, 0.8);

/// The parts of a map that are looked at.
pub struct Landmarks {
    /// Foot, and a point above it, map frame, metres.
    posts: Vec<(Point3<f64>, Point3<f64>)>,
    /// Pieces of solid lane lines, map frame, metres.
    lines: Vec<(Point3<f64>, Point3<f64>)>,
}

/// Points of one scan on landmarks.
#[derive(Debug, Default)]
pub struct Seen {
    /// Distance (m) of each pole in view and its points per metre of height.
    pub posts: Vec<(f64, f64)>,
    /// Range (m) and reflectance of each point on a line that reports one.
    pub paint: Vec<(f64, f64)>,
    /// The same beside the lines.
    pub asphalt: Vec<(f64, f64)>,
}

impl Landmarks {
    /// Posts and masts, no trunks; solid lines, no dashes.
    pub fn new(map: &SemanticMap) -> Self {
        let posts = map.poles.iter().filter(|pole| pole.kind != PoleKind::Trunk);
        let lines = map.lanes.iter().filter(|lane| lane.kind == LaneKind::Solid);
        Self {
            posts: posts.map(|pole| (pole.foot_map, pole.top_map)).collect(),
            lines: lines.flat_map(|lane| lane.points_map.windows(2).map(|ends| (ends[0], ends[1]))).collect(),
        }
    }

    /// What a scan shows of them.
    pub fn seen_from(&self, map_from_velodyne: &Pose, view: &View) -> Seen {
        let velodyne_from_map = map_from_velodyne.inverse();
        let bring = |(a, b): &(Point3<f64>, Point3<f64>)| (velodyne_from_map * a, velodyne_from_map * b);
        let mut seen = Seen::default();
        for (foot, top) in self.posts.iter().map(bring) {
            seen.posts.extend(on_post(&foot, &top, view));
        }
        let lines: Vec<_> =
            self.lines.iter().map(bring).filter(|(a, b)| a.coords.norm().min(b.coords.norm()) < 45.0).collect();
        for (i, p) in view.points.iter().enumerate() {
            if !view.is_ground(i) || view.range_m[i] > 40.0 || view.reflectance[i] <= 0.0 {
                continue;
            }
            let at = Point2::new(p.x, p.y);
            let distance_m = lines
                .iter()
                .filter_map(|(a, b)| beside(&at, &Point2::new(a.x, a.y), &Point2::new(b.x, b.y)))
                .fold(f64::INFINITY, f64::min);
            let report = (view.range_m[i], view.reflectance[i]);
            if distance_m < ON_LINE_M {
                seen.paint.push(report);
            } else if distance_m > BESIDE_LINE_M.0 && distance_m < BESIDE_LINE_M.1 {
                seen.asphalt.push(report);
            }
        }
        seen
    }
}

/// Distance of a pole that stands free, and points per metre of it.
fn on_post(foot: &Point3<f64>, top: &Point3<f64>, view: &View) -> Option<(f64, f64)> {
    let axis = top - foot;
    let length_m = axis.norm();
    let (low_m, high_m) = (POLE_PART_M.0, POLE_PART_M.1.min(length_m - 0.1));
    if high_m < low_m + 0.2 {
        return None;
    }
    let axis = axis / length_m;
    let (mut on, mut about) = (0, 0);
    for p in &view.points {
        let from_foot = p - foot;
        let up_m = from_foot.dot(&axis);
        if (low_m..high_m).contains(&up_m) {
            let beside_m = (from_foot - axis * up_m).norm();
            on += usize::from(beside_m < BESIDE_POLE_M);
            about += usize::from((FREE_M.0..FREE_M.1).contains(&beside_m));
        }
    }
    let is_free = about as f64 <= FREE_SHARE * on as f64;
    (on >= FEWEST_ON_POLE && is_free).then(|| (foot.x.hypot(foot.y), on as f64 / (high_m - low_m)))
}

/// Distance of a point from a piece of a line, where it lies beside it.
fn beside(p: &Point2<f64>, a: &Point2<f64>, b: &Point2<f64>) -> Option<f64> {
    let along = b - a;
    let length = along.norm();
    let t = (p - a).dot(&along) / length.powi(2);
    (0.0..=1.0).contains(&t).then(|| (along.perp(&(p - a)) / length).abs())
}
