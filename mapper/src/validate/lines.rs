//! The course of lane lines and paths.

use common::map::SemanticMap;
use nalgebra::{Point2, Point3, Vector3};

use super::{Fault, Findings, Names, ValidateConfig};
use crate::fuse::length_m;

pub(super) fn check(map: &SemanticMap, config: &ValidateConfig, findings: &mut Findings) {
    let mut names = Names(Vec::new());
    for lane in &map.lanes {
        let name = names.next(lane.kind.name());
        let points = &lane.points_map;
        let Some(first) = points.first() else { continue };
        let length_m = length_m(points);
        if length_m < config.shortest_line_m {
            findings.add(Fault::NoLength, &name, first, format!("has a length of {length_m:.2} m"));
        }
        course(&name, points, config, findings);
        if let Some(at) = crossing(points) {
            findings.add(Fault::CrossesItself, &name, &at, "crosses itself".into());
        }
    }
    for road in &map.roads {
        let name = names.next("road");
        let Some(first) = road.path_map.first() else { continue };
        if length_m(&road.path_map) < 1e-6 {
            findings.add(Fault::NoLength, &name, first, "has no length".into());
        }
        course(&name, &road.path_map, config, findings);
        for pair in road.path_map.windows(2) {
            let step_m = (pair[1] - pair[0]).norm();
            if step_m > config.longest_step_m {
                findings.add(Fault::Jump, &name, &pair[0], format!("jumps by {step_m:.0} m"));
            }
        }
    }
}

/// Steps shorter than this say more about the grid than about direction,
/// metres.
const SHORTEST_STEP_M: f64 = 0.1;

/// Turns and slopes.
fn course(name: &str, points: &[Point3<f64>], config: &ValidateConfig, findings: &mut Findings) {
    let mut before: Option<Vector3<f64>> = None;
    for pair in points.windows(2) {
        let way = pair[1] - pair[0];
        let flat = Vector3::new(way.x, 0.0, way.z);
        if way.norm() < SHORTEST_STEP_M {
            continue;
        }
        let steep_rad = way.y.abs().atan2(flat.norm());
        if steep_rad > config.steepest_rad {
            let what = format!("is {:.0} degrees steep over {:.1} m", steep_rad.to_degrees(), way.norm());
            findings.add(Fault::Steep, name, &pair[0], what);
        }
        if flat.norm() < SHORTEST_STEP_M {
            continue;
        }
        let turn_rad = before.map_or(0.0, |before| before.angle(&flat));
        if turn_rad > config.largest_turn_rad {
            let what = format!("turns by {:.0} degrees at once", turn_rad.to_degrees());
            findings.add(Fault::FoldsBack, name, &pair[0], what);
        }
        before = Some(flat);
    }
}

/// Where a line first crosses itself seen from above. By pairs of segments: a
/// lane line has tens of them.
fn crossing(points: &[Point3<f64>]) -> Option<Point3<f64>> {
    let above: Vec<Point2<f64>> = points.iter().map(|p| Point2::new(p.x, p.z)).collect();
    for (i, first) in above.windows(2).enumerate() {
        for second in above.windows(2).skip(i + 2) {
            if cross(first, second) {
                return points.get(i).copied();
            }
        }
    }
    None
}

/// Whether two segments cross within both.
fn cross(a: &[Point2<f64>], b: &[Point2<f64>]) -> bool {
    let side = |s: &[Point2<f64>], p: &Point2<f64>| (s[1] - s[0]).perp(&(p - s[0]));
    side(a, &b[0]) * side(a, &b[1]) < 0.0 && side(b, &a[0]) * side(b, &a[1]) < 0.0
}
