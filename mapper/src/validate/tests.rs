use common::map::{LaneKind, LaneLine, Pole, PoleKind, Road, RoadId, Sign, SignKind};

use super::*;

fn line(points: &[[f64; 3]]) -> LaneLine {
    let points_map = points.iter().map(|&p| Point3::from(p)).collect();
    LaneLine { kind: LaneKind::Solid, points_map, road: RoadId(0), marks_m: Vec::new() }
}

fn good() -> SemanticMap {
    let pole = |x: f64, z: f64| Pole {
        kind: PoleKind::LampPost,
        foot_map: Point3::new(x, 1.6, z),
        top_map: Point3::new(x, -6.0, z),
        road: RoadId(0),
    };
    let centroid_map = Point3::new(5.0, -1.0, 20.0);
    SemanticMap {
        frame_note: String::new(),
        roads: vec![
            Road { path_map: vec![Point3::origin(), Point3::new(0.0, 0.0, 50.0)] },
            Road { path_map: vec![Point3::new(0.0, 0.0, 50.0), Point3::new(0.0, 0.0, 100.0)] },
        ],
        poles: vec![pole(5.0, 10.0), pole(5.0, 12.0), pole(-6.0, 30.0)],
        signs: vec![Sign { kind: SignKind::TrafficSign, centroid_map, size_m: 0.6, road: RoadId(0) }],
        lanes: vec![
            line(&[[1.5, 1.6, 0.0], [1.5, 1.6, 50.0]]),
            line(&[[1.8, 1.6, 0.0], [1.8, 1.6, 30.0], [3.0, 1.6, 50.0]]),
        ],
    }
}

/// The faults of a good map that was spoilt, with the landmark.
fn faults(spoil: impl Fn(&mut SemanticMap)) -> Vec<(Fault, String)> {
    let mut map = good();
    spoil(&mut map);
    let findings = validate(&map, &ValidateConfig::default());
    assert_eq!(text(&findings).lines().count(), findings.len() + 1);
    findings.into_iter().map(|finding| (finding.fault, finding.landmark)).collect()
}

fn one(fault: Fault, landmark: &str) -> Vec<(Fault, String)> {
    vec![(fault, landmark.to_owned())]
}

#[test]
fn nothing_is_found_in_a_good_map() {
    assert_eq!(faults(|_| ()), []);
    assert!(validate(&SemanticMap::default(), &ValidateConfig::default()).is_empty());
}

#[test]
fn poles_and_signs() {
    assert_eq!(faults(|m| m.poles[1].top_map.y = 1.6), one(Fault::NoLength, "lamp-post 1"));
    let tall = one(Fault::AbsurdSize, "lamp-post 1");
    assert_eq!(faults(|m| m.poles[1].top_map.y = -38.0), [tall.clone(), tall].concat(), "by itself and above the path");
    assert_eq!(faults(|m| m.poles[2].top_map.x += 5.0), one(Fault::Lean, "lamp-post 2"));
    assert_eq!(faults(|m| m.signs[0].size_m = 0.0), one(Fault::NoLength, "traffic-sign 0"));
    assert_eq!(faults(|m| m.signs[0].size_m = 30.0), one(Fault::AbsurdSize, "traffic-sign 0"));
    assert_eq!(faults(|m| m.signs[0].centroid_map.y = 20.0), one(Fault::AbsurdSize, "traffic-sign 0"));
    assert_eq!(faults(|m| m.signs[0].centroid_map.x = 90.0), one(Fault::OffRoad, "traffic-sign 0"));
    assert_eq!(faults(|m| m.signs[0].road = RoadId(1)), one(Fault::WrongRoad, "traffic-sign 0"));
}

#[test]
fn doubles() {
    assert_eq!(faults(|m| m.poles[1].foot_map.z = 10.1), one(Fault::Duplicate, "lamp-post 1"));
    assert_eq!(faults(|m| m.signs.push(m.signs[0])), one(Fault::Duplicate, "traffic-sign 1"));
    let along = |m: &mut SemanticMap| m.lanes.push(line(&[[1.52, 1.6, 40.0], [1.52, 1.6, 10.0]]));
    assert_eq!(faults(along), one(Fault::Duplicate, "solid-line 2"));
}

#[test]
fn lines_and_paths() {
    let back = |m: &mut SemanticMap| m.lanes[0].points_map.push(Point3::new(1.2, 1.6, 45.0));
    assert_eq!(faults(back), one(Fault::FoldsBack, "solid-line 0"));
    let point = |m: &mut SemanticMap| m.lanes[0].points_map[1] = Point3::new(1.5, 1.6, 0.1);
    assert_eq!(faults(point), one(Fault::NoLength, "solid-line 0"));
    let knot = |m: &mut SemanticMap| {
        m.lanes.push(line(&[[-3.0, 1.6, 0.0], [-3.0, 1.6, 9.0], [-5.0, 1.6, 9.5], [-5.0, 1.6, 5.0], [-1.0, 1.6, 4.0]]));
    };
    assert!(faults(knot).contains(&(Fault::CrossesItself, "solid-line 2".into())));
    assert_eq!(faults(|m| m.roads[1].path_map[1].y = -60.0), one(Fault::Steep, "road 1"));
    assert_eq!(faults(|m| m.roads[1].path_map[1].z = 900.0), one(Fault::Jump, "road 1"));
    assert_eq!(faults(|m| m.roads[1].path_map.truncate(1)), one(Fault::NoLength, "road 1"));
}
