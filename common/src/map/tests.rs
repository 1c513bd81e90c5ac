//! What the map file promises.

use nalgebra::Point3;

use super::pole::Leans;
use super::*;
use crate::Error;

mod properties;

/// The map of the worked example in `FORMAT.md`.
fn example() -> SemanticMap {
    let road = RoadId(0);
    SemanticMap {
        frame_note: "example".into(),
        roads: vec![Road { path_map: vec![Point3::new(0.0, 0.0, 0.0), Point3::new(0.0, 0.0, 50.0)] }],
        poles: vec![
            lamp_post(Point3::new(-4.5, 1.6, 30.0), Point3::new(-4.469, -4.6, 29.9814)),
            lamp_post(Point3::new(5.0, 1.5, 12.0), Point3::new(5.03, -4.5, 11.982)),
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

fn lamp_post(foot_map: Point3<f64>, top_map: Point3<f64>) -> Pole {
    Pole { kind: PoleKind::LampPost, foot_map, top_map, road: RoadId(0) }
}

fn encode(map: &SemanticMap) -> Vec<u8> {
    map.encode(&EncodeOptions::default()).unwrap()
}

/// What versions have in which way.
fn form(version: u8) -> envelope::Form {
    let leans = if version < 3 { Leans::Quanta } else { Leans::Thousandths };
    let has_kerbs = version == 5;
    envelope::Form { has_marks: has_kerbs || version.is_multiple_of(2), has_kerbs, leans }
}

/// `bytes` with the length and checksum that belong to them.
fn resealed(bytes: &[u8]) -> Vec<u8> {
    envelope::seal(form(bytes[3]), &bytes[envelope::PREFIX_BYTES..bytes.len() - envelope::CHECKSUM_BYTES]).unwrap()
}

fn documented_example() -> Vec<u8> {
    hex_dump(include_str!("../../FORMAT.md"), 0)
}

/// The example as `FORMAT.md` says that older programs wrote it.
fn documented_example_of_version_1() -> Vec<u8> {
    let mut bytes = documented_example();
    bytes[3] = 1;
    let length = bytes.len();
    bytes[length - envelope::CHECKSUM_BYTES..].copy_from_slice(&[0x36, 0x5e, 0x5a, 0x4c]);
    let leans = (1..length).filter(|&at| bytes[at - 1..=at] == [0x0a, 0x05]).collect::<Vec<_>>();
    assert_eq!(leans.len(), 2);
    for at in leans {
        bytes[at - 1..=at].copy_from_slice(&[0x06, 0x03]);
    }
    bytes
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
    assert_eq!((plain[3], bytes[3]), (3, 4));
    let documented = hex_dump(include_str!("../../FORMAT.md"), 1);
    let body = plain.len() - envelope::CHECKSUM_BYTES;
    assert_eq!(bytes[8..body], plain[8..body], "nothing else changes");
    let hex: Vec<String> = bytes[body..].iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(bytes[body..], documented, "{}", hex.join(" "));
    let mut expected = example_with_marks();
    expected.poles.reverse();
    assert_eq!(SemanticMap::decode(&bytes).unwrap(), expected);
    let empty = [&plain[..body], &[0], &plain[body..]].concat();
    let error = SemanticMap::decode(&resealed(&[&empty[..3], &[4], &empty[4..]].concat())).unwrap_err();
    assert!(error.to_string().contains("canonical"), "a section of no marks is left out: {error}");
}

#[test]
fn kerbs_make_another_version_and_stand_behind_the_marks() {
    let kerb = LaneLine {
        kind: LaneKind::Kerb,
        points_map: vec![Point3::new(4.0, 1.65, 2.0), Point3::new(4.2, 1.6, 22.0)],
        road: RoadId(0),
        marks_m: Vec::new(),
    };
    let mut map = example_with_marks();
    map.lanes.push(kerb);
    let (marked, bytes) = (encode(&example_with_marks()), encode(&map));
    assert_eq!((marked[3], bytes[3]), (4, 5));
    let body = marked.len() - envelope::CHECKSUM_BYTES;
    assert_eq!(bytes[8..body], marked[8..body], "nothing else changes");
    let documented = hex_dump(include_str!("../../FORMAT.md"), 2);
    let hex: Vec<String> = bytes[body..].iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(bytes[body..], documented, "{} of {}", hex.join(" "), bytes.len());
    map.poles.reverse();
    assert_eq!(SemanticMap::decode(&bytes).unwrap(), map);
    // Without marks their section is empty; without kerbs there is none.
    map.lanes[0].marks_m.clear();
    let unmarked = encode(&map);
    assert_eq!(SemanticMap::decode(&unmarked).unwrap(), map);
    assert_eq!(layout(&unmarked).unwrap().sections.iter().map(|s| s.items).collect::<Vec<_>>()[10..], [0, 1, 1]);
    let none = [&marked[..3], &[5], &marked[4..body], &[0], &marked[body..]].concat();
    let error = SemanticMap::decode(&resealed(&none)).unwrap_err();
    assert!(error.to_string().contains("canonical"), "a section of no kerbs is left out: {error}");
    map.lanes[1].marks_m = vec![[1.0, 2.0]];
    assert!(map.encode(&EncodeOptions::default()).unwrap_err().to_string().contains("not dashed"));
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
    assert_eq!((layout.version, layout.quantum_m), (3, 0.01));
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
                // Some other versions are read.
                3 => assert!(matches!(error, Error::MapVersion { .. } | Error::MapChecksum { .. })),
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
    assert!(said.contains("version 9") && said.contains("reads versions up to 5"), "{said}");
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
    assert!(refuse(|map| map.poles[0].top_map.y = 9.0).contains("pole 0 has its foot above its top"));
    assert!(refuse(|map| map.poles[0].top_map = Point3::new(3e5, 1.59, 30.0)).contains("pole 0 lies"));
    assert!(refuse(|map| map.lanes[0].points_map.truncate(1)).contains("fewer than two"));
    assert!(refuse(|map| map.lanes[0].marks_m = vec![[4.0, 7.0], [6.0, 9.0]]).contains("marks of lane line 0"));
    assert!(refuse(|map| map.lanes[0].marks_m = vec![[4.0, f64::NAN]]).contains("marks of lane line 0"));
    assert!(refuse(|map| map.lanes[0].marks_m = vec![[4.0, 3e9]]).contains("a mark of lane line 0"));
    assert!(refuse(|map| map.roads[0].path_map.clear()).contains("road 0 has no vertex"));
    assert!(refuse(|map| map.frame_note = "x".repeat(65)).contains("65 bytes"));
    assert!(refuse(|map| map.frame_note = "\u{1b}[2J".into()).contains("control"));
}

#[test]
fn maps_of_versions_one_and_two_are_read() {
    for (map, version) in [(example(), 1), (example_with_marks(), 2)] {
        let bytes = map.encode_with(Leans::Quanta, EncodeOptions::default()).unwrap();
        assert_eq!(bytes[3], version);
        if version == 1 {
            assert_eq!(bytes, documented_example_of_version_1());
        }
        let mut expected = map;
        expected.poles.reverse();
        for pole in &mut expected.poles {
            (pole.top_map.x, pole.top_map.z) = (pole.foot_map.x + 0.03, pole.foot_map.z - 0.02);
        }
        assert_eq!(SemanticMap::decode(&bytes).unwrap(), expected);
        assert_eq!(layout(&bytes).unwrap().version, version);
    }
}

#[test]
fn the_coarsest_grid_turns_no_pole() {
    let mut map = example();
    for height_m in [0.9, 6.0] {
        map.poles = vec![lamp_post(Point3::new(4.03, 1.6, 10.02), Point3::new(4.03 + 0.0133, 1.6 - height_m, 10.0))];
        let bytes = map.encode(&EncodeOptions { quantum_m: 0.3 }).unwrap();
        let axis = |pole: &Pole| pole.top_map - pole.foot_map;
        let turned_rad = axis(&SemanticMap::decode(&bytes).unwrap().poles[0]).angle(&axis(&map.poles[0]));
        assert!(turned_rad < 0.75e-3, "{turned_rad}");
    }
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
        let axis = nalgebra::Vector3::new(0.05 * scatter(i, 4.0), -1.0, 0.05 * scatter(i, 5.0));
        let top_map = foot_map + axis * height_m;
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
