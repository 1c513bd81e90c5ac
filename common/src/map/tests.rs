//! What the map file promises.

use nalgebra::Point3;
use proptest::prelude::*;

use super::*;
use crate::Error;

/// The map of the worked example in `FORMAT.md`.
fn example() -> SemanticMap {
    let road = RoadId(0);
    SemanticMap {
        frame_note: "example".into(),
        roads: vec![Road { path_map: vec![Point3::new(0.0, 0.0, 0.0), Point3::new(0.0, 0.0, 50.0)] }],
        poles: vec![
            pole(PoleKind::LampPost, Point3::new(-4.5, 1.6, 30.0), 6.2),
            pole(PoleKind::LampPost, Point3::new(5.0, 1.5, 12.0), 6.0),
        ],
        signs: vec![Sign {
            kind: SignKind::TrafficSign,
            centroid_map: Point3::new(4.2, -0.6, 20.0),
            size_m: 0.85,
            road,
        }],
        lanes: vec![LaneLine {
            kind: LaneKind::Dashed,
            points_map: (0..4).map(|i| Point3::new(-1.8, 1.65, 5.0 + 10.0 * f64::from(i))).collect(),
            road,
            marks_m: Vec::new(),
        }],
    }
}

fn pole(kind: PoleKind, foot_map: Point3<f64>, height_m: f64) -> Pole {
    let top_map = foot_map + nalgebra::Vector3::new(0.03, -height_m, -0.02);
    Pole { kind, foot_map, top_map, road: RoadId(0) }
}

fn encode(map: &SemanticMap) -> Vec<u8> {
    map.encode(&EncodeOptions::default()).unwrap()
}

/// `bytes` with the length and checksum that belong to them.
fn resealed(bytes: &[u8]) -> Vec<u8> {
    envelope::seal(bytes[3], &bytes[envelope::PREFIX_BYTES..bytes.len() - envelope::CHECKSUM_BYTES]).unwrap()
}

fn documented_example() -> Vec<u8> {
    hex_dump(include_str!("../../FORMAT.md"), 0)
}

/// The same map with two marks on its dashed line.
fn example_with_marks() -> SemanticMap {
    let mut map = example();
    map.lanes[0].marks_m = vec![[1.2, 4.2], [10.25, 13.24]];
    map
}

/// A hex dump on a page that describes a format: what stands before `|` on the
/// lines of one of its blocks of hex.
pub(super) fn hex_dump(page: &str, block: usize) -> Vec<u8> {
    page.split("```")
        .filter_map(|block| block.strip_prefix("hex\n"))
        .nth(block)
        .unwrap()
        .lines()
        .flat_map(|line| line.split('|').next().unwrap_or_default().split_whitespace())
        .map(|byte| u8::from_str_radix(byte, 16).unwrap())
        .collect()
}

#[test]
fn the_bytes_are_those_of_the_format_description() {
    let hex: Vec<String> = encode(&example()).iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(encode(&example()), documented_example(), "{}", hex.join(" "));
}

#[test]
fn marks_make_another_version_and_stand_behind_all_lines() {
    let (plain, bytes) = (encode(&example()), encode(&example_with_marks()));
    assert_eq!((plain[3], bytes[3]), (1, 2));
    let documented = hex_dump(include_str!("../../FORMAT.md"), 1);
    let body = plain.len() - envelope::CHECKSUM_BYTES;
    assert_eq!(bytes[8..body], plain[8..body], "nothing else changes");
    let hex: Vec<String> = bytes[body..].iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(bytes[body..], documented, "{}", hex.join(" "));
    let mut expected = example_with_marks();
    expected.poles.reverse();
    assert_eq!(SemanticMap::decode(&bytes).unwrap(), expected);
    let empty = [&plain[..body], &[0], &plain[body..]].concat();
    let error = SemanticMap::decode(&resealed(&[&empty[..3], &[2], &empty[4..]].concat())).unwrap_err();
    assert!(error.to_string().contains("canonical"), "a section of no marks is left out: {error}");
}

#[test]
fn marks_that_touch_on_the_grid_are_one() {
    let mut map = example();
    map.lanes[0].marks_m = vec![[1.0, 2.0], [2.003, 3.0], [4.0, 4.002], [5.0, 6.0]];
    assert_eq!(SemanticMap::decode(&encode(&map)).unwrap().lanes[0].marks_m, [[1.0, 3.0], [5.0, 6.0]]);
}

#[test]
fn the_documented_bytes_are_read_as_the_documented_map() {
    let map = SemanticMap::decode(&documented_example()).unwrap();
    let mut expected = example();
    expected.poles.reverse();
    assert_eq!(map, expected);
}

#[test]
fn the_layout_accounts_for_every_byte() {
    let bytes = encode(&example());
    let layout = layout(&bytes).unwrap();
    assert_eq!(layout.total_bytes(), bytes.len());
    let section = |name: &str| layout.sections.iter().find(|section| section.name == name).unwrap();
    assert_eq!(section("lamp-post").items, 2);
    assert_eq!(section("trunk"), &SectionSize { name: "trunk".into(), items: 0, bytes: 1 });
    assert_eq!((layout.version, layout.quantum_m), (1, 0.01));
    assert_eq!(layout.bounds, SemanticMap::decode(&bytes).unwrap().bounds());
}

#[test]
fn any_flipped_bit_is_noticed() {
    let good = encode(&example());
    for at in 0..good.len() {
        for bit in 0..8 {
            let mut bad = good.clone();
            bad[at] ^= 1 << bit;
            let error = SemanticMap::decode(&bad).unwrap_err();
            match at {
                0..3 => assert!(matches!(error, Error::NotAMap)),
                3 => assert!(matches!(error, Error::MapVersion { .. })),
                4..8 => assert!(matches!(error, Error::MapLength { .. })),
                _ => assert!(matches!(error, Error::MapChecksum { .. })),
            }
        }
    }
}

#[test]
fn a_truncated_or_extended_map_says_both_lengths() {
    let good = encode(&example());
    for length in 1..good.len() {
        let error = SemanticMap::decode(&good[..length]).unwrap_err();
        assert!(matches!(error, Error::MapLength { found, .. } if found == length), "{length}: {error}");
    }
    let cut = SemanticMap::decode(&good[..good.len() - 3]).unwrap_err().to_string();
    assert!(cut.contains(&format!("should have {} bytes and has {}", good.len(), good.len() - 3)), "{cut}");
    let longer = [good.as_slice(), &[0]].concat();
    assert!(matches!(SemanticMap::decode(&longer), Err(Error::MapLength { .. })));
    assert!(matches!(SemanticMap::decode(&[]), Err(Error::NotAMap)));
}

#[test]
fn a_map_of_a_future_version_says_which_one_is_read() {
    let mut bytes = encode(&example());
    bytes[3] = 9;
    let said = SemanticMap::decode(&bytes).unwrap_err().to_string();
    assert!(said.contains("version 9") && said.contains("reads versions up to 2"), "{said}");
}

#[test]
fn another_spelling_of_the_same_map_is_refused() {
    let good = encode(&example());
    let layout = layout(&good).unwrap();
    // The first bound, right after the quantum (2 bytes) and the note (1 + 7).
    let mut other_bounds = good.clone();
    other_bounds[18] ^= 2;
    // An empty group for the road in the section of sign posts.
    let at: usize = layout.sections[..3].iter().map(|section| section.bytes).sum();
    assert_eq!(good[at], 0);
    let empty_group = [&good[..at], &[1, 0], &good[at + 1..]].concat();
    for bad in [other_bounds, empty_group] {
        let error = SemanticMap::decode(&resealed(&bad)).unwrap_err();
        assert!(error.to_string().contains("canonical"), "{error}");
    }
}

#[test]
fn absurd_counts_end_at_once() {
    let good = encode(&example());
    let at: usize = layout(&good).unwrap().sections[..1].iter().map(|section| section.bytes).sum();
    for count in [[0xff, 0xff, 0xff, 0xff, 0x7f], [0xff, 0xff, 0xff, 0x01, 0x00]] {
        let bad = [&good[..at], &count, &good[at + 1..]].concat();
        let error = SemanticMap::decode(&resealed(&bad)).unwrap_err();
        assert!(matches!(&error, Error::MapMalformed { what } if what.contains("`roads`")), "{error}");
    }
}

#[test]
fn what_cannot_be_stored_is_named() {
    let refuse = |change: fn(&mut SemanticMap)| {
        let mut map = example();
        change(&mut map);
        map.encode(&EncodeOptions::default()).unwrap_err().to_string()
    };
    assert!(refuse(|map| map.poles[1].top_map.z = f64::NAN).contains("z of pole 1 is NaN m"));
    assert!(refuse(|map| map.lanes[0].points_map[2].x = 3e9).contains("x of lane line 0"));
    assert!(refuse(|map| map.signs[0].size_m = -1.0).contains("size of sign 0"));
    assert!(refuse(|map| map.signs[0].road = RoadId(1)).contains("on road 1 and there are 1 roads"));
    assert!(refuse(|map| map.poles[0].top_map.y = 9.0).contains("foot of pole 0 is above its top"));
    assert!(refuse(|map| map.lanes[0].points_map.truncate(1)).contains("fewer than two"));
    assert!(refuse(|map| map.lanes[0].marks_m = vec![[4.0, 7.0], [6.0, 9.0]]).contains("marks of lane line 0"));
    assert!(refuse(|map| map.lanes[0].marks_m = vec![[4.0, f64::NAN]]).contains("marks of lane line 0"));
    assert!(refuse(|map| map.lanes[0].marks_m = vec![[4.0, 3e9]]).contains("a mark of lane line 0"));
    assert!(refuse(|map| map.roads[0].path_map.clear()).contains("road 0 has no vertex"));
    assert!(refuse(|map| map.frame_note = "x".repeat(65)).contains("65 bytes"));
    assert!(refuse(|map| map.frame_note = "\u{1b}[2J".into()).contains("control"));
}

#[test]
fn an_empty_map_is_a_map() {
    let empty = SemanticMap::default();
    assert_eq!(SemanticMap::decode(&encode(&empty)).unwrap(), empty);
    assert_eq!(layout(&encode(&empty)).unwrap().bounds, None);
}

/// A bend of 300 m radius, 400 m long, in stretches of 50 m, with landmarks
/// scattered as on a real street.
fn street() -> SemanticMap {
    let at = |s_m: f64, right_m: f64, down_m: f64| {
        let angle = s_m / 300.0;
        Point3::new(300.0 - (300.0 - right_m) * angle.cos(), down_m + 0.01 * s_m, (300.0 - right_m) * angle.sin())
    };
    // Any value in -1..1 that no rule of the encoder could guess.
    let scatter = |i: usize, salt: f64| (12.9898 * i as f64 + salt).sin();
    let road = |s_m: f64| RoadId((s_m / 50.0) as u32);
    let mut map = SemanticMap { frame_note: "kitti 04".into(), ..SemanticMap::default() };
    for stretch in 0..8_u32 {
        let path = (0..=2).map(|i| at(f64::from(stretch) * 50.0 + 25.0 * f64::from(i), 0.0, 0.0));
        map.roads.push(Road { path_map: path.collect() });
    }
    for i in 0..80 {
        let s_m = 5.0 * i as f64;
        let foot_map = at(s_m, 9.0 * scatter(i, 1.0), 1.6 + 0.2 * scatter(i, 2.0));
        let height_m = 4.0 + 3.0 * scatter(i, 3.0);
        let top_map = foot_map + nalgebra::Vector3::new(0.2 * scatter(i, 4.0), -height_m, 0.2 * scatter(i, 5.0));
        map.poles.push(Pole { kind: PoleKind::ALL[i % 2], foot_map, top_map, road: road(s_m) });
        let centroid_map = at(s_m, 9.0 * scatter(i, 6.0), -1.0 + scatter(i, 7.0));
        let size_m = 0.8 + 0.3 * scatter(i, 8.0);
        map.signs.push(Sign { kind: SignKind::TrafficSign, centroid_map, size_m, road: road(s_m) });
    }
    for (i, &right_m) in [-3.6, 0.0, 3.6].iter().cycle().take(24).enumerate() {
        let from_m = 50.0 * (i / 3) as f64;
        let vertex = |j: usize| {
            at(from_m + 10.0 * j as f64 + scatter(9 * i + j, 1.0), right_m, 1.65 + 0.02 * scatter(9 * i + j, 2.0))
        };
        let points_map = (0..5).map(vertex).collect();
        map.lanes.push(LaneLine { kind: LaneKind::ALL[i % 2], points_map, road: road(from_m), marks_m: Vec::new() });
    }
    map
}

#[test]
fn landmarks_take_few_bytes() {
    let layout = layout(&encode(&street())).unwrap();
    let bytes_per_item = |names: &[&str]| {
        let sections = layout.sections.iter().filter(|section| names.contains(&section.name.as_str()));
        let (bytes, items) = sections.fold((0, 0), |sum, s| (sum.0 + s.bytes, sum.1 + s.items));
        bytes as f64 / items as f64
    };
    let header = bytes_per_item(&["header"]) + bytes_per_item(&["checksum"]);
    let pole = bytes_per_item(&["lamp-post", "sign-post"]);
    let sign = bytes_per_item(&["traffic-sign"]);
    let lane_vertex = bytes_per_item(&["solid-line", "dashed-line"]) / 5.0;
    let said = format!("header {header}, pole {pole}, sign {sign}, lane vertex {lane_vertex}");
    assert!(header <= 40.0 && pole <= 9.2 && sign <= 6.2 && lane_vertex <= 4.3, "{said}");
}

fn point(range_m: f64) -> impl Strategy<Value = Point3<f64>> {
    prop::array::uniform3(-range_m..range_m).prop_map(Point3::from)
}

fn landmarks() -> impl Strategy<Value = SemanticMap> {
    let road = || (0..3_u32).prop_map(RoadId);
    let path = |least| prop::collection::vec(point(500.0), least..6);
    let pole = (0..4_usize, point(500.0), 0.0..12.0_f64, road()).prop_map(|(kind, foot_map, height, road)| Pole {
        kind: PoleKind::ALL[kind],
        foot_map,
        top_map: Point3::new(foot_map.x + 0.1, foot_map.y - height, foot_map.z - 0.3),
        road,
    });
    let sign = (0..2_usize, point(500.0), 0.0..3.0_f64, road()).prop_map(|(kind, centroid_map, size_m, road)| Sign {
        kind: SignKind::ALL[kind],
        centroid_map,
        size_m,
        road,
    });
    let steps = prop::collection::vec((0.3..9.0_f64, 0.3..9.0_f64), 0..5);
    let lane = (0..2_usize, path(2), road(), steps).prop_map(|(kind, points_map, road, steps)| {
        let kind = LaneKind::ALL[kind];
        let mut end_m = 0.0;
        let marks = steps.into_iter().map(|(gap_m, mark_m)| {
            end_m += gap_m + mark_m;
            [end_m - mark_m, end_m]
        });
        let marks_m = if kind == LaneKind::Dashed { marks.collect() } else { Vec::new() };
        LaneLine { kind, points_map, road, marks_m }
    });
    (
        "[ -~]{0,20}",
        prop::collection::vec(path(1).prop_map(|path_map| Road { path_map }), 3),
        prop::collection::vec(pole, 0..12),
        prop::collection::vec(sign, 0..12),
        prop::collection::vec(lane, 0..6),
    )
        .prop_map(|(frame_note, roads, poles, signs, lanes)| SemanticMap {
            frame_note,
            roads,
            poles,
            signs,
            lanes,
        })
}

/// Everything in a map as numbers, in an order that rounding does not change
/// often: compared only where it did not.
fn is_near(a: &Point3<f64>, b: &Point3<f64>, quantum_m: f64) -> bool {
    (a - b).amax() <= 0.5 * quantum_m + 1e-9
}

proptest! {
    #[test]
    fn every_landmark_survives_within_half_a_quantum(map in landmarks(), quantum_mm in 1..200_u32) {
        let quantum_m = f64::from(quantum_mm) / 1e3;
        let bytes = map.encode(&EncodeOptions { quantum_m }).unwrap();
        let back = SemanticMap::decode(&bytes).unwrap();
        prop_assert_eq!(&back.frame_note, &map.frame_note);
        prop_assert_eq!(back.poles.len(), map.poles.len());
        prop_assert_eq!(back.signs.len(), map.signs.len());
        prop_assert_eq!(back.lanes.len(), map.lanes.len());
        for (a, b) in map.roads.iter().zip(&back.roads) {
            prop_assert_eq!(a.path_map.len(), b.path_map.len());
            prop_assert!(a.path_map.iter().zip(&b.path_map).all(|(a, b)| is_near(a, b, quantum_m)));
        }
        for a in &map.poles {
            prop_assert!(back.poles.iter().any(|b| (a.kind, a.road) == (b.kind, b.road)
                && is_near(&a.foot_map, &b.foot_map, quantum_m)
                && is_near(&a.top_map, &b.top_map, quantum_m)));
        }
        for a in &map.signs {
            prop_assert!(back.signs.iter().any(|b| (a.kind, a.road) == (b.kind, b.road)
                && is_near(&a.centroid_map, &b.centroid_map, quantum_m)
                && (a.size_m - b.size_m).abs() <= 0.5 * quantum_m + 1e-9));
        }
        for a in &map.lanes {
            prop_assert!(back.lanes.iter().any(|b| (a.kind, a.road) == (b.kind, b.road)
                && a.points_map.len() == b.points_map.len()
                && a.points_map.iter().zip(&b.points_map).all(|(a, b)| is_near(a, b, quantum_m))
                && a.marks_m.len() == b.marks_m.len()
                && a.marks_m.iter().flatten().zip(b.marks_m.iter().flatten())
                    .all(|(a, b)| (a - b).abs() <= 0.5 * quantum_m + 1e-9)));
        }
        prop_assert_eq!(back.encode(&EncodeOptions { quantum_m }).unwrap(), bytes);
    }

    #[test]
    fn the_order_of_landmarks_does_not_change_the_bytes(mut map in landmarks(), tied in any::<bool>()) {
        // Side by side, only their other values can tell landmarks apart.
        let anchors = map.poles.iter_mut().map(|pole| &mut pole.foot_map);
        let anchors = anchors.chain(map.signs.iter_mut().map(|sign| &mut sign.centroid_map));
        for anchor in anchors.chain(map.lanes.iter_mut().map(|lane| &mut lane.points_map[0])).filter(|_| tied) {
            (anchor.x, anchor.z) = (0.0, 0.0);
        }
        let mut turned = map.clone();
        turned.poles.reverse();
        turned.signs.reverse();
        turned.lanes.reverse();
        prop_assert_eq!(encode(&turned), encode(&map));
    }

    #[test]
    fn what_is_accepted_is_what_would_be_written(version in 1..=2_u8, body in prop::collection::vec(any::<u8>(), 0..80)) {
        let bytes = envelope::seal(version, &body).unwrap();
        if let Ok(map) = SemanticMap::decode(&bytes) {
            let quantum_m = layout(&bytes).unwrap().quantum_m;
            prop_assert_eq!(map.encode(&EncodeOptions { quantum_m }).unwrap(), bytes);
        }
    }

    #[test]
    fn a_changed_body_never_panics(map in landmarks(), at in any::<prop::sample::Index>(), byte in any::<u8>()) {
        let mut bytes = encode(&map);
        let at = envelope::PREFIX_BYTES + at.index(bytes.len() - envelope::PREFIX_BYTES);
        bytes[at] = byte;
        let _ = SemanticMap::decode(&resealed(&bytes));
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(SemanticMap::decode(&bytes).is_err());
    }
}
