//! The map of a generated drive holds what stands there.

use common::kitti::read_poses;
use common::map::{LaneKind, PoleKind, SemanticMap, SignKind};
use fixtures::truth::Truth;
use nalgebra::{Point2, Point3, center};
use waymark_tests::matching::one_to_one;

use crate::support::DEMO;

/// What lies farther from the path does not count, metres.
const BESIDE_PATH_M: f64 = 12.0;

struct Case {
    map: SemanticMap,
    truth: Truth,
    path: Vec<Point2<f64>>,
}

fn above(p: &Point3<f64>) -> Point2<f64> {
    Point2::new(p.x, p.z)
}

impl Case {
    fn demo() -> Self {
        let truth = std::fs::read_to_string(DEMO.file("drive/truth.json")).unwrap();
        let poses = read_poses(DEMO.file("drive/truth/poses.txt")).unwrap();
        Self {
            map: common::map::read(DEMO.file("street.csm")).unwrap(),
            truth: serde_json::from_str(&truth).unwrap(),
            path: poses.iter().map(|p| Point2::new(p.translation.x, p.translation.z)).collect(),
        }
    }

    /// Whether a place is beside the driven path.
    fn counts(&self, at: &Point2<f64>) -> bool {
        self.path.iter().any(|p| (p - at).norm() < BESIDE_PATH_M)
    }
}

#[test]
fn poles_are_found_where_they_stand() {
    let case = Case::demo();
    // Trunks are kept apart and are no pole to a localizer.
    let standing = case.truth.poles.iter().filter(|p| p.kind != "trunk");
    let standing: Vec<Point2<f64>> =
        standing.map(|p| above(&center(&p.foot_map_m.into(), &p.top_map_m.into()))).collect();
    let trunks = case.truth.poles.iter().filter(|p| p.kind == "trunk").map(|p| above(&p.foot_map_m.into()));
    let any: Vec<Point2<f64>> = standing.iter().copied().chain(trunks).collect();
    let found = case.map.poles.iter().filter(|p| p.kind != PoleKind::Trunk);
    let found: Vec<Point2<f64>> = found.map(|p| above(&center(&p.foot_map, &p.top_map))).collect();

    let wanted: Vec<Point2<f64>> = standing.iter().copied().filter(|p| case.counts(p)).collect();
    let pairs = one_to_one(&found, &wanted, 0.3);
    let recall = pairs.len() as f64 / wanted.len() as f64;
    let claimed: Vec<Point2<f64>> = found.iter().copied().filter(|p| case.counts(p)).collect();
    let precision = one_to_one(&claimed, &any, 0.3).len() as f64 / claimed.len() as f64;
    let mut off: Vec<f64> = pairs.iter().map(|(f, w)| (found[*f] - wanted[*w]).norm()).collect();
    off.sort_by(f64::total_cmp);
    println!("poles: recall {recall:.2}, precision {precision:.2}, {} pairs, off {off:.2?}", pairs.len());
    assert!(recall >= 0.8 && precision >= 0.8);
    assert!(off[off.len() / 2] < 0.06);
}

#[test]
fn signs_are_found_with_their_size() {
    let case = Case::demo();
    let hung = case.truth.signs.iter().filter(|s| s.kind == "traffic_sign");
    let hung: Vec<(Point3<f64>, f64)> = hung.map(|s| (Point3::from(s.centroid_map_m), s.size_m)).collect();
    let near = |at: &Point3<f64>| hung.iter().find(|(c, _)| (c - at).norm() < 0.3);
    let signs: Vec<_> = case.map.signs.iter().filter(|s| s.kind == SignKind::TrafficSign).collect();
    let wanted = hung.iter().filter(|(c, _)| case.counts(&above(c))).count();
    let right = signs.iter().filter(|s| near(&s.centroid_map).is_some()).count();
    println!("signs: {right} of {} in the map are right; {wanted} hang beside the path", signs.len());
    assert!(right >= signs.len() * 3 / 4 && 2 * right >= wanted);
    for (sign, (_, size_m)) in signs.iter().filter_map(|s| Some((s, near(&s.centroid_map)?))) {
        assert!((sign.size_m - size_m).abs() < 0.3, "{sign:?} {size_m}");
    }
}

struct Lanes {
    painted: Vec<(LaneKind, Vec<Point2<f64>>)>,
    mapped: Vec<(LaneKind, Vec<Point2<f64>>)>,
}

impl Lanes {
    fn of(case: &Case) -> Self {
        let kind = |name: &str| if name == "solid" { LaneKind::Solid } else { LaneKind::Dashed };
        let true_line = |points: &[[f64; 3]]| points.iter().map(|p| above(&Point3::from(*p))).collect();
        Self {
            painted: case.truth.lanes.iter().map(|l| (kind(&l.kind), true_line(&l.points_map_m))).collect(),
            mapped: case.map.lanes.iter().map(|l| (l.kind, l.points_map.iter().map(above).collect())).collect(),
        }
    }
}

/// Points every metre along a polyline.
fn samples(line: &[Point2<f64>]) -> Vec<Point2<f64>> {
    let pieces = line.windows(2).flat_map(|w| {
        let steps = (w[1] - w[0]).norm().ceil() as usize;
        (0..steps).map(move |i| w[0] + (w[1] - w[0]) * (i as f64 / steps as f64))
    });
    pieces.collect()
}

/// Distance of a point from the nearest line of a kind, metres.
fn distance(p: &Point2<f64>, kind: LaneKind, lines: &[(LaneKind, Vec<Point2<f64>>)]) -> f64 {
    let piece = |w: &[Point2<f64>]| {
        let along = w[1] - w[0];
        let share = ((p - w[0]).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (p - (w[0] + along * share)).norm()
    };
    let of_kind = lines.iter().filter(|(k, _)| *k == kind);
    of_kind.flat_map(|(_, line)| line.windows(2)).map(piece).fold(f64::INFINITY, f64::min)
}

#[test]
fn lane_lines_lie_on_paint_of_their_kind() {
    let lanes = Lanes::of(&Case::demo());
    let off: Vec<f64> = lanes
        .mapped
        .iter()
        .flat_map(|(kind, line)| samples(line).into_iter().map(|p| distance(&p, *kind, &lanes.painted)))
        .collect();
    let right = off.iter().filter(|d| **d < 0.1).count();
    println!("{right} of {} m lie on paint of their kind", off.len());
    assert!(right as f64 > 0.9 * off.len() as f64);
}

#[test]
fn solid_lines_beside_the_driven_path_are_in_the_map() {
    let case = Case::demo();
    let lanes = Lanes::of(&case);
    let is_driven = |p: &Point2<f64>| case.path.iter().any(|c| (c - p).norm() < 4.0);
    for kind in LaneKind::ALL {
        let painted = lanes.painted.iter().filter(|(k, _)| *k == kind).flat_map(|(_, line)| samples(line));
        let beside: Vec<Point2<f64>> = painted.filter(is_driven).collect();
        let mapped = beside.iter().filter(|p| distance(p, kind, &lanes.mapped) < 0.15).count();
        println!("{kind:?}: {mapped} of {} m beside the path are in the map", beside.len());
        assert!(kind == LaneKind::Dashed || mapped as f64 > 0.9 * beside.len() as f64);
    }
}
