use std::path::Path;

use common::map::{EncodeOptions, LaneKind, LaneLine, PoleKind};
use nalgebra::Vector3;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::evidence::{EvidenceConfig, MapEvidence, PointCovariances, PointEvidence};

/// What stands on the street, before any pass saw it: poles at irregular
/// places on both sides, two lane lines, four roads of 50 m.
fn street(seed: u64) -> SemanticMap {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut map = SemanticMap { frame_note: "street".into(), ..SemanticMap::default() };
    for k in 0..4 {
        let z = |end: u32| Point3::new(0.0, 0.0, f64::from(k + end) * 50.0);
        map.roads.push(Road { path_map: vec![z(0), z(1)] });
        for x in [-1.75, 1.75] {
            let points_map = [z(0), z(1)].map(|p| p + Vector3::new(x, 1.6, 0.0)).to_vec();
            map.lanes.push(LaneLine { kind: LaneKind::Solid, points_map, road: RoadId(k), marks_m: Vec::new() });
        }
        for i in 0..6 {
            let side = if i % 2 == 0 { 6.0 } else { -6.0 };
            let z = f64::from(k) * 50.0 + f64::from(i) * 8.0 + random.random_range(1.0..6.0);
            let foot_map = Point3::new(side + random.random_range(-1.0..1.0), 1.6, z);
            let top_map = foot_map - Vector3::y() * random.random_range(2.0..7.0);
            map.poles.push(Pole { kind: PoleKind::LampPost, foot_map, top_map, road: RoadId(k) });
        }
    }
    map
}

/// A pass over a street: noise of 2 cm on every pole, and a shift of all.
fn pass(street: &SemanticMap, seed: u64, shift: Vector3<f64>) -> SemanticMap {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut map = street.clone();
    for pole in &mut map.poles {
        let noise = Vector3::new(random.random_range(-0.03..0.03), 0.0, random.random_range(-0.03..0.03)) + shift;
        (pole.foot_map, pole.top_map) = (pole.foot_map + noise, pole.top_map + noise);
    }
    let points = map.lanes.iter_mut().flat_map(|lane| &mut lane.points_map);
    points.chain(map.roads.iter_mut().flat_map(|road| &mut road.path_map)).for_each(|point| *point += shift);
    map
}

fn sources(maps: &[SemanticMap]) -> Sources {
    let mut sources = Sources::default();
    for map in maps {
        sources.add_map(map, None, &EncodeOptions::default()).unwrap();
    }
    sources
}

/// Poles that are known to this, metres per axis.
fn known(map: &SemanticMap, sigma_m: f64) -> MapEvidence {
    let pole = PointEvidence::new(&(nalgebra::Matrix3::identity() * sigma_m * sigma_m), 50, 5);
    MapEvidence { poles: vec![pole; map.poles.len()], ..MapEvidence::assumed(map, &EvidenceConfig::default()) }
}

fn merged(maps: &[SemanticMap]) -> Merged {
    merge(&sources(maps).read().unwrap(), &MergeConfig::default())
}

fn bytes(sources: &Sources) -> Vec<u8> {
    let merged = merge(&sources.read().unwrap(), &MergeConfig::default());
    merged.map.encode(&EncodeOptions { quantum_m: merged.report.quantum_m }).unwrap()
}

fn worst_m(map: &SemanticMap, truth: &SemanticMap, shift: Vector3<f64>) -> f64 {
    let nearest = |pole: &Pole| {
        let distances = truth.poles.iter().map(|t| (t.foot_map + shift - pole.foot_map).norm());
        distances.fold(f64::INFINITY, f64::min)
    };
    map.poles.iter().map(nearest).fold(0.0, f64::max)
}

#[test]
fn maps_that_lie_apart_meet_in_the_middle() {
    let truth = street(1);
    let shift = Vector3::new(1.2, 0.3, -1.4);
    let Merged { map, report } = merged(&[pass(&truth, 1, Vector3::zeros()), pass(&truth, 2, shift)]);
    assert_eq!(map.poles.len(), truth.poles.len(), "{}", report.text());
    assert!(worst_m(&map, &truth, shift * 0.5) < 0.06, "{}", worst_m(&map, &truth, shift * 0.5));
    assert!((map.roads.len(), report.roads_given) == (4, 8));
    // Each line once, cut where the roads end.
    assert_eq!(map.lanes.len(), 8, "{:?}", map.lanes);
    assert!(map.lanes.iter().all(|lane| ((lane.points_map[0].x - 0.6).abs() - 1.75).abs() < 0.03));
    assert!(report.apart_given_m > 0.5 && report.apart_aligned_m < 0.03, "{}", report.text());
}

#[test]
fn a_turned_map_is_turned_back() {
    let truth = street(2);
    let mut turned = pass(&truth, 2, Vector3::zeros());
    let turn = nalgebra::Rotation3::from_axis_angle(&Vector3::y_axis(), 0.012);
    let about = Point3::new(0.0, 0.0, 100.0);
    let turned_point = |p: &mut Point3<f64>| *p = about + turn * (*p - about);
    turned.poles.iter_mut().flat_map(|p| [&mut p.foot_map, &mut p.top_map]).for_each(turned_point);
    turned.lanes.iter_mut().flat_map(|l| &mut l.points_map).for_each(turned_point);
    turned.roads.iter_mut().flat_map(|r| &mut r.path_map).for_each(turned_point);
    let Merged { map, report } = merged(&[pass(&truth, 1, Vector3::zeros()), turned]);
    assert_eq!((map.poles.len(), map.lanes.len()), (truth.poles.len(), 8), "{}", report.text());
    assert!(report.apart_aligned_m < 0.03, "{}", report.text());
}

#[test]
fn what_most_no_longer_see_is_dropped_and_a_tie_is_kept() {
    let truth = street(3);
    let mut newer = truth.clone();
    newer.poles.remove(5);
    newer.poles[9].foot_map.x += 4.0;
    newer.poles[9].top_map.x += 4.0;
    let counts = |maps: &[SemanticMap]| {
        let report = merged(maps).report;
        [report.poles.fused, report.poles.single, report.poles.contested, report.poles.dropped].map(|n| n as usize)
    };
    let old = pass(&truth, 1, Vector3::zeros());
    let [new, again] = [2, 3].map(|seed| pass(&newer, seed, Vector3::x() * 0.1));
    assert_eq!(counts(&[old.clone(), new.clone()]), [22, 0, 3, 0]);
    assert_eq!(counts(&[old.clone(), new.clone(), again.clone()]), [23, 0, 0, 2]);
    // Who did not come near is no witness.
    let mut short = new;
    short.roads.truncate(2);
    short.poles.retain(|pole| pole.road.0 < 2 && pole.foot_map.z < 80.0);
    short.lanes.retain(|lane| lane.road.0 < 2);
    let [_, single, _, dropped] = counts(&[old, short]);
    assert!(single >= 10 && dropped == 0);
}

#[test]
fn what_passes_under_a_bridge_do_not_see_on_it_stays() {
    let below = street(3);
    let bridge = pass(&street(30), 1, Vector3::new(3.0, -5.5, 0.0));
    let mut maps: Vec<SemanticMap> = (2..5).map(|seed| pass(&below, seed, Vector3::zeros())).collect();
    maps.push(bridge.clone());
    let Merged { map, report } = merged(&maps);
    let unseen = [&report.poles, &report.lanes_m].map(|counts| counts.contested + counts.dropped);
    assert!(unseen.iter().all(|unseen| *unseen < 1e-9), "{}", report.text());
    assert_eq!(map.poles.len(), below.poles.len() + bridge.poles.len());
    assert!(report.sources.iter().any(|source| source.state == "alone"), "{}", report.text());
}

#[test]
fn what_a_build_knows_of_its_poles_decides_where_they_are() {
    let truth = street(9);
    let mut off = truth.clone();
    // Towards the road and away from it: no shift of the map explains it.
    for (k, pole) in off.poles.iter_mut().enumerate() {
        let aside = Vector3::x() * if k % 2 == 0 { 0.2 } else { -0.2 };
        (pole.foot_map, pole.top_map) = (pole.foot_map + aside, pole.top_map + aside);
    }
    let mean_off_m = |sigmas_m: [Option<f64>; 2]| {
        let mut sources = Sources::default();
        for (map, sigma_m) in [&truth, &off].into_iter().zip(sigmas_m) {
            let evidence = sigma_m.map(|sigma_m| known(map, sigma_m));
            sources.add_map(map, evidence.as_ref(), &EncodeOptions::default()).unwrap();
        }
        worst_m(&merge(&sources.read().unwrap(), &MergeConfig::default()).map, &truth, Vector3::zeros())
    };
    let (unknown, sure, unsure) =
        (mean_off_m([None; 2]), mean_off_m([Some(0.01), Some(0.3)]), mean_off_m([Some(0.3), Some(0.01)]));
    assert!((0.05..0.15).contains(&unknown) && sure < 0.05 && unsure > 0.15, "{unknown} {sure} {unsure}");
}

#[test]
fn a_map_that_does_not_fit_is_kept_as_given_and_said() {
    let (here, there) = (pass(&street(4), 1, Vector3::zeros()), pass(&street(99), 2, Vector3::zeros()));
    let Merged { map, report } = merged(&[here.clone(), pass(&street(4), 3, Vector3::zeros()), there.clone()]);
    assert_eq!(report.sources.iter().filter(|source| source.state == "unaligned").count(), 1);
    assert!(report.text().contains("kept as given"), "{}", report.text());
    assert_eq!(map.poles.len(), here.poles.len() + there.poles.len());
}

/// Most of the long map lies beside the one that does not fit alone.
#[test]
fn a_map_that_does_not_fit_takes_none_with_it() {
    let (long, other) = (pass(&street(4), 1, Vector3::zeros()), pass(&street(99), 2, Vector3::zeros()));
    let mut short = pass(&street(4), 3, Vector3::new(0.3, 0.0, 0.1));
    short.roads.truncate(1);
    short.poles.truncate(5);
    short.lanes.retain(|lane| lane.road == RoadId(0));
    let Merged { map, report } = merged(&[long.clone(), short, other.clone()]);
    let mut states: Vec<&str> = report.sources.iter().map(|source| source.state).collect();
    states.sort_unstable();
    assert_eq!(states, ["aligned", "aligned", "unaligned"]);
    assert_eq!(map.poles.len(), long.poles.len() + other.poles.len());
}

#[test]
fn maps_far_from_each_other_stay_as_they_are() {
    let (here, there) = (street(5), pass(&street(6), 2, Vector3::x() * 5000.0));
    let Merged { map, report } = merged(&[here.clone(), there.clone()]);
    assert!(report.sources.iter().all(|source| source.state == "alone"));
    let expected = SemanticMap { roads: [here.roads.clone(), there.roads.clone()].concat(), ..SemanticMap::default() };
    assert_eq!(map.roads.len(), expected.roads.len());
    assert_eq!((map.poles.len(), map.lanes.len()), (48, 16));
    assert!(
        worst_m(&map, &SemanticMap { poles: [here.poles, there.poles].concat(), ..expected }, Vector3::zeros()) < 0.01
    );
}

#[test]
fn maps_with_nothing_in_them_can_be_merged() {
    let empty = |note: &str| SemanticMap { frame_note: note.into(), ..SemanticMap::default() };
    assert_eq!(merged(&[]).map, SemanticMap::default());
    assert_eq!(merged(&[empty("a"), empty("b")]).map.frame_note, "a, b");
    let mut roadless = street(1);
    roadless.roads.clear();
    for pole in &mut roadless.poles {
        pole.road = RoadId(0);
    }
    roadless.lanes.clear();
    // Landmarks without any road have no file, but the function must not fall.
    let source = Source { crc32c: 0, quantum_m: 0.01, map: roadless, known: PointCovariances::default() };
    assert_eq!(merge(&[source.clone(), source], &MergeConfig::default()).map.poles.len(), 24);
    let long: Vec<SemanticMap> = (0..9).map(|i| empty(&format!("a note of some length {i}"))).collect();
    assert!(merged(&long).map.frame_note.ends_with(" and 8 more"));
}

/// `mapper merge` of files, as the command does it.
fn merge_files(files: &[&Path], out: &Path) {
    let mut sources = Sources::default();
    for file in files {
        sources.add_file(file).unwrap();
    }
    let bytes = sources.only().map_or_else(|| bytes(&sources), <[u8]>::to_vec);
    sources.write(out, &bytes).unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_order_of_maps_does_not_matter(
        seeds in proptest::collection::vec(0_u64..1000, 2..6),
        shifts in proptest::collection::vec((-0.6..0.6, -0.6..0.6), 6),
        turn in 0_usize..6,
    ) {
        let truth = street(7);
        let mut maps: Vec<SemanticMap> = seeds
            .iter()
            .zip(&shifts)
            .map(|(seed, (x, z))| pass(&truth, *seed, Vector3::new(*x, 0.0, *z)))
            .collect();
        let expected = bytes(&sources(&maps));
        let turn = turn % maps.len();
        maps.rotate_left(turn);
        prop_assert_eq!(&bytes(&sources(&maps)), &expected);
        maps.reverse();
        maps.push(maps[0].clone());
        prop_assert_eq!(&bytes(&sources(&maps)), &expected);
    }

    #[test]
    fn the_steps_of_a_merge_do_not_matter(seed in 0_u64..1000, x in -0.8..0.8, z in -0.8..0.8) {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str| folder.path().join(format!("{name}.csm"));
        let truth = street(8);
        for (name, share) in [("a", 0.0), ("b", 1.0), ("c", -0.5)] {
            let map = pass(&truth, seed + name.len() as u64, Vector3::new(x, 0.0, z) * share);
            common::map::write(file(name), &map, &EncodeOptions::default()).unwrap();
        }
        let merge = |inputs: &[&str], out: &str| {
            let inputs: Vec<_> = inputs.iter().map(|name| file(name)).collect();
            merge_files(&inputs.iter().map(std::path::PathBuf::as_path).collect::<Vec<_>>(), &file(out));
            let read = |path: &Path| std::fs::read(path).unwrap();
            (read(&file(out)), read(&path_beside(&file(out))))
        };
        let at_once = merge(&["a", "b", "c"], "abc");
        merge(&["a", "b"], "ab");
        merge(&["c", "b"], "bc");
        merge(&["a"], "only");
        prop_assert_eq!(&merge(&["ab", "c"], "ab_c"), &at_once);
        prop_assert_eq!(&merge(&["bc", "only"], "a_bc"), &at_once);
        prop_assert_eq!(&merge(&["ab", "bc"], "ab_bc"), &at_once);
    }
}
