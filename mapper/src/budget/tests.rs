use common::map::{LaneKind, LaneLine, Pole, PoleKind, Road, RoadId, SemanticMap, Sign, SignKind};
use nalgebra::Point3;
use proptest::prelude::*;

use super::*;
use crate::evidence::EvidenceConfig;

const QUANTUM_M: f64 = 0.01;

fn pole(x: f64, z: f64, road: u32) -> Pole {
    let foot_map = Point3::new(x, 1.6, z);
    Pole { kind: PoleKind::LampPost, foot_map, top_map: Point3::new(x, -4.4, z), road: RoadId(road) }
}

/// Two roads of 100 m: on the first a pole every 5 m on either side, on the
/// second one every 50 m on the right.
fn map() -> SemanticMap {
    let road = |from: f64| Road { path_map: vec![Point3::new(0.0, 0.0, from), Point3::new(0.0, 0.0, from + 100.0)] };
    let mut poles: Vec<Pole> = Vec::new();
    for k in 0..20 {
        let z = 5.0 * f64::from(k);
        poles.extend([pole(6.0, z, 0), pole(-6.5, z + 1.0, 0)]);
    }
    poles.extend([pole(6.0, 140.0, 1), pole(6.0, 190.0, 1)]);
    let line = |x: f64, road: u32| LaneLine {
        kind: LaneKind::Solid,
        points_map: [0.0, 30.0, 100.0].map(|z| Point3::new(x, 1.6, z + 100.0 * f64::from(road))).to_vec(),
        road: RoadId(road),
        marks_m: Vec::new(),
    };
    let sign = |z: f64, road: u32| Sign {
        kind: SignKind::TrafficSign,
        centroid_map: Point3::new(5.0, -0.8, z),
        size_m: 0.8,
        road: RoadId(road),
    };
    SemanticMap {
        roads: vec![road(0.0), road(100.0)],
        poles,
        signs: vec![sign(30.0, 0), sign(160.0, 1)],
        lanes: vec![line(-1.8, 0), line(1.8, 0), line(-1.8, 1)],
        ..SemanticMap::default()
    }
}

fn whole(map: &SemanticMap) -> (SemanticMap, MapEvidence) {
    let bytes = map.encode(&EncodeOptions { quantum_m: QUANTUM_M }).unwrap();
    let map = SemanticMap::decode(&bytes).unwrap();
    let mut evidence = MapEvidence::assumed(&map, &EvidenceConfig::default());
    // So that each can be told from the others.
    for (k, pole) in evidence.poles.iter_mut().enumerate() {
        pole.points = k;
    }
    (map, evidence)
}

fn reduced(budget_bytes: usize) -> Result<Reduced> {
    let (map, evidence) = whole(&map());
    let known = Known { map: &map, evidence: &evidence, quantum_m: QUANTUM_M };
    reduce(known, budget_bytes, &BudgetConfig::default())
}

#[test]
fn a_map_that_is_longer_than_memory_is_refused() {
    let far = 2.1e9;
    for is_road in [true, false] {
        let (mut map, evidence) = whole(&map());
        let ends = vec![Point3::new(-far, 1.6, -far), Point3::new(far, 1.6, far)];
        if is_road {
            map.roads[0].path_map = ends;
        } else {
            map.lanes[0].points_map = ends;
        }
        let known = Known { map: &map, evidence: &evidence, quantum_m: QUANTUM_M };
        let said = reduce(known, 4096, &BudgetConfig::default()).unwrap_err().to_string();
        assert!(said.contains("5.9e9 m long (at most 1e7 m is accepted)"), "{said}");
    }
}

#[test]
fn a_map_that_fits_is_kept_as_it_is() {
    let (map, evidence) = whole(&map());
    let reduced = reduced(100_000).unwrap();
    assert_eq!((reduced.map, reduced.evidence), (map, evidence));
    assert_eq!(reduced.detail, Detail::unchanged(QUANTUM_M));
}

#[test]
fn of_poles_alike_in_the_image_delineators_are_found_most_and_trunks_least() {
    let (map, evidence) = whole(&map());
    let config = BudgetConfig::default();
    let places = Places::along(&map.roads, &config);
    let (pole, evidence) = map.poles.iter().zip(&evidence.poles).find(|(pole, _)| pole.foot_map.z > 60.0).unwrap();
    let found = |kind: PoleKind| {
        let rows = sight::of_pole(&Pole { kind, ..*pole }, evidence, &places, &config);
        assert!(!rows.is_empty());
        rows.iter().map(|row| row.found).sum::<f64>()
    };
    let shares = [PoleKind::Delineator, PoleKind::LampPost, PoleKind::SignPost, PoleKind::Trunk].map(found);
    assert!(shares.is_sorted_by(|a, b| a > b), "{shares:?}");
}

/// A dashed line along some points, with marks of 3 m every 9 m.
fn dashed(points_map: Vec<Point3<f64>>) -> LaneLine {
    let length_m: f64 = points_map.windows(2).map(|ends| (ends[1] - ends[0]).norm()).sum();
    let begins = (0..).map(|k| 9.0 * f64::from(k)).take_while(|from_m| from_m + 3.0 < length_m);
    LaneLine {
        kind: LaneKind::Dashed,
        marks_m: begins.map(|from_m| [from_m, from_m + 3.0]).collect(),
        points_map,
        road: RoadId(0),
    }
}

#[test]
fn marks_are_kept_where_they_are_read() {
    let lines = [-1.8, 1.8].map(|x| dashed([0.0, 30.0, 100.0].map(|z| Point3::new(x, 1.6, z)).to_vec()));
    let own = SemanticMap { poles: Vec::new(), signs: Vec::new(), lanes: lines.to_vec(), ..map() };
    let (map, evidence) = whole(&own);
    let reduced = |marks: f64, budget_bytes: usize| {
        let config = BudgetConfig { found: Found { marks, ..Found::default() }, ..BudgetConfig::default() };
        reduce(Known { map: &map, evidence: &evidence, quantum_m: QUANTUM_M }, budget_bytes, &config).unwrap()
    };
    let (read, unread) = (reduced(0.75, usize::MAX), reduced(0.0, usize::MAX));
    assert!(read.predicted.longitudinal_m.median < 0.5 * unread.predicted.longitudinal_m.median);
    let kept = |marks: f64| {
        let map = reduced(marks, read.bytes.len() - 8).map;
        (map.lanes.len(), map.lanes.iter().map(|lane| lane.marks_m.len()).sum::<usize>())
    };
    assert!(kept(0.75).1 > 0);
    assert_eq!(kept(0.0), (2, 0));
}

#[test]
fn a_simpler_line_has_its_marks_where_they_were() {
    let arc = (0..30).map(|k| 0.02 * f64::from(k)).map(|a| Point3::new(100.0 * (1.0 - a.cos()), 1.6, 100.0 * a.sin()));
    let own = SemanticMap { lanes: vec![dashed(arc.collect())], ..map() };
    let (map, evidence) = whole(&own);
    let level = [0.05, 0.08, 0.3];
    let (simple, _) = Detail::from(level).applied(Known { map: &map, evidence: &evidence, quantum_m: QUANTUM_M });
    let [full, simple] = [&map, &simple].map(|map| &map.lanes[0]);
    assert!(simple.points_map.len() < full.points_map.len() / 2, "{} vertices", simple.points_map.len());
    assert_eq!(simple.marks_m.len(), full.marks_m.len());
    for (now, before) in simple.marks_map().flatten().zip(full.marks_map().flatten()) {
        assert!((now - before).norm() < 0.12, "{now} {before}");
    }
}

#[test]
fn behind_a_corner_what_was_unknown_along_the_road_is_unknown_across_it() {
    let path = |ends: &[[f64; 2]]| ends.iter().map(|[x, z]| Point3::new(*x, 0.0, *z)).collect::<Vec<_>>();
    let line = |x: f64| LaneLine {
        kind: LaneKind::Solid,
        points_map: vec![Point3::new(x, 1.6, 0.0), Point3::new(x, 1.6, 140.0)],
        road: RoadId(0),
        marks_m: Vec::new(),
    };
    let expected = |ends: &[[f64; 2]]| {
        let roads = vec![Road { path_map: path(ends) }];
        let map = SemanticMap { roads, lanes: vec![line(-1.8), line(1.8)], ..SemanticMap::default() };
        let evidence = MapEvidence::assumed(&map, &EvidenceConfig::default());
        let config = BudgetConfig::default();
        predict(&map, &evidence, &Places::along(&map.roads, &config), &config)
    };
    // Lines say nothing of how far along them the camera is.
    let straight = expected(&[[0.0, 0.0], [0.0, 100.0]]);
    assert!(straight.lateral_m.worst < 0.2 && straight.longitudinal_m.median > 0.5, "{straight:?}");
    let corner = expected(&[[0.0, 0.0], [0.0, 100.0], [2.0, 100.0]]);
    assert!(corner.lateral_m.median < 0.2 && corner.lateral_m.worst > 0.5, "{corner:?}");
}

#[test]
fn the_lonely_landmarks_are_kept_before_the_many() {
    let all = reduced(usize::MAX).unwrap();
    let few = reduced(all.bytes.len() / 3).unwrap();
    let lonely = few.map.poles.iter().filter(|pole| pole.foot_map.z > 120.0).count();
    assert_eq!(lonely, 2, "{:?}", few.map.poles);
    assert!(few.map.poles.len() < 25);
    assert!(few.predicted.position_rms_m >= all.predicted.position_rms_m);
    // The first poles of the first road, taken as they stand, know the second
    // road not at all.
    let (map, evidence) = whole(&map());
    let config = BudgetConfig::default();
    let first = SemanticMap { poles: map.poles[..few.map.poles.len()].to_vec(), ..cost::without_landmarks(&map) };
    let own = MapEvidence { poles: evidence.poles[..first.poles.len()].to_vec(), ..MapEvidence::default() };
    let naive = predict(&first, &own, &Places::along(&map.roads, &config), &config);
    assert!(few.predicted.position_rms_m < 0.5 * naive.position_rms_m, "{:?} {naive:?}", few.predicted);
}

#[test]
fn the_evidence_stays_with_its_landmark() {
    let (map, evidence) = whole(&map());
    let few = reduced(300).unwrap();
    assert!(few.evidence.fits(&few.map) && !few.map.poles.is_empty());
    for (pole, own) in few.map.poles.iter().zip(&few.evidence.poles) {
        let near = |other: &&Pole| (other.foot_map - pole.foot_map).norm() < 2.0 * few.detail.quantum_m;
        let was = map.poles.iter().position(|other| near(&other)).unwrap();
        assert_eq!(own.points, evidence.poles[was].points);
    }
}

#[test]
fn a_budget_below_the_roads_is_told_with_what_they_take() {
    let said = reduced(20).unwrap_err().to_string();
    assert!(said.contains("no map fits 20 bytes: 2 road stretches") && said.contains("--budget "), "{said}");
    let least: usize = said.rsplit("--budget ").next().unwrap().split(' ').next().unwrap().parse().unwrap();
    assert_eq!(reduced(least).unwrap().map.roads.len(), 2);
    assert!(reduced(least - 1).is_err());
}

#[test]
fn an_empty_map_has_nothing_to_lose() {
    let map = SemanticMap::default();
    let known = Known { map: &map, evidence: &MapEvidence::default(), quantum_m: QUANTUM_M };
    let reduced = reduce(known, 4096, &BudgetConfig::default()).unwrap();
    assert_eq!(reduced.map, map);
    assert!(reduced.predicted.position_rms_m.abs() < 1e-12);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn the_budget_is_never_exceeded_and_more_bytes_are_never_worse(bytes in 90_usize..700, more in 0_usize..200) {
        let (few, many) = (reduced(bytes).unwrap(), reduced(bytes + more).unwrap());
        prop_assert!(few.bytes.len() <= bytes && many.bytes.len() <= bytes + more);
        prop_assert_eq!(SemanticMap::decode(&few.bytes).unwrap(), few.map.clone());
        // Greedy is not optimal: it may be a little worse for more bytes.
        prop_assert!(many.predicted.position_rms_m <= 1.1 * few.predicted.position_rms_m + 0.01);
        prop_assert_eq!(reduced(bytes).unwrap().bytes, few.bytes);
    }
}
