use common::map::{LaneKind, LaneLine, RoadId};
use fixtures::truth::{TrueLane, TrueSign};

use super::*;

fn truth() -> Truth {
    let pole = |x: f64, kind: &str| TruePole {
        kind: kind.into(),
        foot_map_m: [x, 1.6, 10.0],
        top_map_m: [x, -3.0, 10.0],
        radius_m: 0.1,
    };
    Truth {
        frame: String::new(),
        poles: vec![pole(5.0, "lamp_post"), pole(-5.0, "sign_post"), pole(8.0, "trunk"), pole(90.0, "lamp_post")],
        signs: vec![TrueSign { kind: "traffic_sign".into(), centroid_map_m: [-5.0, -1.0, 10.0], size_m: 0.6 }],
        lanes: vec![TrueLane {
            kind: "solid".into(),
            points_map_m: vec![[1.5, 1.6, 0.0], [1.5, 1.6, 20.0]],
            width_m: 0.12,
            marks_m: Vec::new(),
            worn_m: Vec::new(),
        }],
    }
}

fn map() -> SemanticMap {
    let road = RoadId(0);
    let pole =
        |x: f64, kind| Pole { kind, foot_map: Point3::new(x, 1.6, 10.0), top_map: Point3::new(x, -3.0, 10.0), road };
    let line = vec![Point3::new(1.55, 1.6, 0.0), Point3::new(1.55, 1.6, 10.0), Point3::new(4.0, 1.6, 10.0)];
    SemanticMap {
        // One 3 cm off, one by a trunk, one out of nothing.
        poles: [5.03, 8.1, 2.0].map(|x| pole(x, PoleKind::LampPost)).to_vec(),
        lanes: vec![LaneLine { kind: LaneKind::Solid, points_map: line, road, marks_m: Vec::new() }],
        ..SemanticMap::default()
    }
}

#[test]
fn a_map_that_lies_elsewhere_is_brought_back() {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.02, -0.1, 0.05));
    let elsewhere = Pose::from_parts(Translation3::new(3.0, -1.0, 2.0), turn);
    let exact: Vec<Pose> = (0..30).map(|z| Pose::translation(0.0, 0.0, f64::from(z))).collect();
    let built: Vec<Pose> = exact.iter().map(|pose| elsewhere * pose).collect();
    let back = alignment(&built, &exact) * elsewhere;
    assert!((back.to_matrix() - nalgebra::Matrix4::identity()).norm() < 1e-9);
    let there = moved(&map(), &elsewhere);
    let here = aligned(&there, &built, &exact);
    assert!((here.poles[0].foot_map - map().poles[0].foot_map).norm() < 1e-9);
}

#[test]
fn a_dashed_line_that_the_map_has_as_solid_is_found_and_of_the_wrong_kind() {
    let path: Vec<Pose> = (0..20).map(|z| Pose::translation(0.0, 0.0, f64::from(z))).collect();
    let mut truth = truth();
    truth.lanes[0].kind = "dashed".into();
    let score = score(&map(), &truth, &path, 20.0);
    assert!((score.lanes.recall() - 0.5).abs() < 0.02 && score.lane_kinds < 1e-12);
}

#[test]
fn a_kerb_is_no_lane_line_and_counts_as_a_kerb() {
    let path: Vec<Pose> = (0..20).map(|z| Pose::translation(0.0, 0.0, f64::from(z))).collect();
    let (mut map, mut truth) = (map(), truth());
    map.lanes[0].kind = LaneKind::Kerb;
    let missed = score(&map, &truth, &path, 20.0);
    assert!(missed.lanes.hits < 1e-9 && missed.lanes.claimed < 1e-9 && missed.kerbs.precision() < 1e-9);
    truth.lanes[0].kind = "kerb".into();
    let found = score(&map, &truth, &path, 20.0);
    assert!((found.kerbs.recall() - 0.5).abs() < 0.02 && found.lanes.wanted < 1e-9, "{:?}", found.kerbs);
    assert!(found.missed_lanes.iter().all(|part| part.name() == "kerb"));
}

#[test]
fn a_trunk_counts_as_what_the_map_calls_it() {
    let path: Vec<Pose> = (0..20).map(|z| Pose::translation(0.0, 0.0, f64::from(z))).collect();
    let mut map = map();
    for pole in &mut map.poles {
        pole.kind = PoleKind::Trunk;
    }
    // A lamp post, a trunk, and what is neither.
    let trunks = score(&map, &truth(), &path, 20.0).trunks;
    assert!((trunks.recall() - 1.0).abs() < 1e-12 && (trunks.precision() - 2.0 / 3.0).abs() < 1e-12);
}

#[test]
fn a_mark_is_found_where_both_of_its_ends_are() {
    let path: Vec<Pose> = (0..20).map(|z| Pose::translation(0.0, 0.0, f64::from(z))).collect();
    let (mut map, mut truth) = (map(), truth());
    truth.lanes[0].kind = "dashed".into();
    truth.lanes[0].marks_m = vec![[1.0, 4.0], [7.0, 9.0], [12.0, 15.0], [60.0, 63.0]];
    // Drawn the other way: one that ends 0.1 m off, one that is a metre too
    // long, one where there is none.
    map.lanes[0].points_map = vec![Point3::new(1.5, 1.6, 20.0), Point3::new(1.5, 1.6, 0.0)];
    map.lanes[0].marks_m = vec![[5.0, 8.1], [10.0, 13.0], [17.0, 18.0]];
    let marks = score(&map, &truth, &path, 20.0).marks;
    assert!((marks.recall() - 1.0 / 3.0).abs() < 1e-12 && (marks.precision() - 1.0 / 3.0).abs() < 1e-12);
    assert!((marks.off_m - 0.1).abs() < 1e-9, "{marks:?}");
}

#[test]
fn misses_false_ones_and_errors_are_counted_within_reach_only() {
    let path: Vec<Pose> = (0..20).map(|z| Pose::translation(0.0, 0.0, f64::from(z))).collect();
    let score = score(&map(), &truth(), &path, 20.0);
    assert!((score.poles.recall() - 0.5).abs() < 1e-12 && (score.poles.precision() - 0.5).abs() < 1e-12);
    assert!((score.poles.off_m - 0.03).abs() < 1e-9 && score.tilt_rad < 1e-9);
    assert!((score.trunks.wanted - 1.0).abs() < 1e-12 && score.trunks.hits < 1e-12);
    assert_eq!(score.missed[0].kind, "sign_post");
    assert!((score.wrong[0].foot_map.x - 2.0).abs() < 1e-12);
    assert!(score.signs.recall() < 1e-12 && (score.lights.recall() - 1.0).abs() < 1e-12);
    assert!((score.lanes.recall() - 0.5).abs() < 0.02, "{:?}", score.lanes);
    assert!((score.lanes.precision() - 10.25 / 12.5).abs() < 0.03);
    assert!((score.lanes.off_m - 0.05).abs() < 0.01);
    assert!((score.lane_kinds - 1.0).abs() < 1e-12);
    let [[missed], [wrong]] = [&score.missed_lanes[..], &score.wrong_lanes[..]] else { panic!("one part of each") };
    assert!((missed.length_m - 9.75).abs() < 0.3 && (missed.from_map_m.z - 10.25).abs() < 0.3, "{missed:?}");
    assert!((wrong.length_m - 2.25).abs() < 0.3 && (wrong.to_map_m.x - 4.0).abs() < 0.3, "{wrong:?}");
}
