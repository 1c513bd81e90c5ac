//! What an atlas promises.

use nalgebra::Point3;
use proptest::prelude::*;

use super::super::tests::hex_dump;
use super::super::{EncodeOptions, LaneKind, LaneLine, Pole, PoleKind, Road, RoadId, SemanticMap, Sign, SignKind};
use super::entry::{ENTRY_BYTES, Entry};
use super::header::HEADER_BYTES;
use super::*;
use crate::{Error, Result};

const QUANTUM_M: f64 = 0.01;

/// The map of the worked example in `FORMAT.md`, moved ahead.
fn example(ahead_m: f64) -> SemanticMap {
    let (road, kind) = (RoadId(0), PoleKind::LampPost);
    let point = |x: f64, y: f64, z: f64| Point3::new(x, y, z + ahead_m);
    let pole = |foot_map: Point3<f64>, top_map: Point3<f64>| Pole { kind, foot_map, top_map, road };
    SemanticMap {
        frame_note: "example".into(),
        roads: vec![Road { path_map: vec![point(0.0, 0.0, 0.0), point(0.0, 0.0, 50.0)] }],
        poles: vec![
            pole(point(5.0, 1.5, 12.0), point(5.03, -4.5, 11.982)),
            pole(point(-4.5, 1.6, 30.0), point(-4.469, -4.6, 29.9814)),
        ],
        signs: vec![Sign { kind: SignKind::TrafficSign, centroid_map: point(4.2, -0.6, 20.0), size_m: 0.85, road }],
        lanes: vec![LaneLine {
            kind: LaneKind::Dashed,
            points_map: (0..4).map(|i| point(-1.8, 1.65, 5.0 + 10.0 * f64::from(i))).collect(),
            road,
            marks_m: Vec::new(),
        }],
    }
}

/// The bytes of the atlas of some maps.
fn built(maps: &[SemanticMap], options: AtlasOptions) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csa");
    let mut builder = AtlasBuilder::new(&path, options);
    for map in maps {
        builder.add(map, QUANTUM_M).unwrap();
    }
    let summary = builder.write(None).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(summary.bytes, bytes.len() as u64);
    assert_eq!(Atlas::open(&path).unwrap().summary(), summary);
    bytes
}

fn documented() -> Vec<u8> {
    hex_dump(include_str!("../../../ATLAS.md"), 0)
}

/// A file with these bytes, to be opened again and again.
struct OnDisk {
    _folder: tempfile::TempDir,
    path: std::path::PathBuf,
}

impl OnDisk {
    fn new(bytes: &[u8]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csa");
        std::fs::write(&path, bytes).unwrap();
        Self { _folder: folder, path }
    }

    fn read(&self) -> Result<(Atlas, Vec<(TilePlace, Tile)>)> {
        let atlas = Atlas::open(&self.path)?;
        let mut tiles = Vec::new();
        atlas.read_all(|place, tile| {
            tiles.push((*place, tile));
            Ok(())
        })?;
        Ok((atlas, tiles))
    }
}

/// Everything in an atlas, and what is wrong with it without the file's name.
fn read(bytes: &[u8]) -> Result<(Atlas, Vec<(TilePlace, Tile)>)> {
    OnDisk::new(bytes).read().map_err(|error| match error {
        Error::InFile { error, .. } => *error,
        other => other,
    })
}

/// The map that an atlas was cut from: its roads by their numbers.
fn joined(tiles: &[(TilePlace, Tile)]) -> SemanticMap {
    let roads = tiles.iter().map(|(_, tile)| tile.map.roads.len()).sum();
    let mut map = SemanticMap { roads: vec![Road { path_map: Vec::new() }; roads], ..SemanticMap::default() };
    for (_, Tile { map: own, road_numbers }) in tiles {
        let road = |id: RoadId| RoadId(road_numbers[id.0 as usize]);
        for (road, &number) in own.roads.iter().zip(road_numbers) {
            map.roads[number as usize] = road.clone();
        }
        map.poles.extend(own.poles.iter().map(|pole| Pole { road: road(pole.road), ..*pole }));
        map.signs.extend(own.signs.iter().map(|sign| Sign { road: road(sign.road), ..*sign }));
        map.lanes.extend(own.lanes.iter().map(|lane| LaneLine { road: road(lane.road), ..lane.clone() }));
    }
    map
}

#[test]
fn the_bytes_are_those_of_the_format_description() {
    let bytes = built(&[example(0.0), example(3000.0)], AtlasOptions::default());
    let hex: Vec<String> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(bytes, documented(), "{}", hex.join(" "));
}

#[test]
fn the_documented_bytes_are_read_as_the_documented_maps() {
    let (atlas, tiles) = read(&documented()).unwrap();
    let summary = atlas.summary();
    assert_eq!((summary.version, summary.quantum_m, summary.levels), (1, 0.01, 1));
    assert_eq!(summary.frame_note, "example");
    assert_eq!(summary.counts, Counts { tiles: 2, roads: 2, poles: 4, signs: 2, lanes: 2 });
    assert_eq!(tiles.iter().map(|(place, _)| place.before.poles).collect::<Vec<_>>(), [0, 2]);
    for (i, (place, tile)) in (0..).zip(&tiles) {
        let map = SemanticMap { frame_note: String::new(), ..example(3000.0 * f64::from(i)) };
        assert_eq!(tile, &Tile { map, road_numbers: vec![i] });
        assert_eq!(Some(place.bounds), tile.map.bounds());
    }
}

#[test]
fn any_flipped_bit_is_noticed() {
    let good = documented();
    let file = OnDisk::new(&good);
    for at in 0..good.len() {
        for bit in 0..8 {
            let mut bad = good.clone();
            bad[at] ^= 1 << bit;
            std::fs::write(&file.path, &bad).unwrap();
            let Err(Error::InFile { error, .. }) = file.read() else { panic!("byte {at}") };
            match at {
                0..3 => assert!(matches!(*error, Error::NotAnAtlas)),
                3 => assert!(matches!(*error, Error::AtlasVersion { .. })),
                4..12 => assert!(matches!(*error, Error::AtlasLength { .. })),
                _ => assert!(matches!(*error, Error::AtlasChecksum { .. }), "byte {at}: {error}"),
            }
        }
    }
}

#[test]
fn a_truncated_or_extended_atlas_says_both_lengths() {
    let good = documented();
    for length in (1..good.len()).chain([good.len() + 1]) {
        let mut bytes = good.clone();
        bytes.resize(length, 0);
        let error = read(&bytes).unwrap_err();
        assert!(matches!(error, Error::AtlasLength { found, .. } if found == length as u64), "{length}: {error}");
    }
    assert!(matches!(read(&[]), Err(Error::NotAnAtlas)));
    assert!(matches!(read(b"CSM\x01"), Err(Error::NotAnAtlas)));
    let said = OnDisk::new(&good[..200]).read().unwrap_err().to_string();
    assert!(said.contains("a.csa: this atlas should have") && said.contains("and has 200"), "{said}");
}

/// `bytes` after `change` to the index node of the documented example, with
/// the checksums that belong to them.
fn with_node(change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    let mut bytes = documented();
    let (node_at, root_at) = (bytes.len() - 2 * ENTRY_BYTES, HEADER_BYTES - 4 - ENTRY_BYTES);
    change(&mut bytes[node_at..]);
    let node = crc32c::crc32c(&bytes[node_at..]);
    bytes[root_at + 36..root_at + 40].copy_from_slice(&node.to_le_bytes());
    reseal(&mut bytes);
    bytes
}

/// Puts the checksum in the header right.
fn reseal(bytes: &mut [u8]) {
    let header = crc32c::crc32c(&bytes[..HEADER_BYTES - 4]);
    bytes[HEADER_BYTES - 4..HEADER_BYTES].copy_from_slice(&header.to_le_bytes());
}

#[test]
fn an_index_that_points_outside_is_refused() {
    let said = |change: fn(&mut Entry)| {
        let bytes = with_node(|node| {
            let mut entry = Entry::read(&mut &*node).unwrap();
            change(&mut entry);
            let mut bytes = Vec::new();
            entry.write(&mut bytes);
            node[..ENTRY_BYTES].copy_from_slice(&bytes);
        });
        read(&bytes).unwrap_err().to_string()
    };
    let outside = "its index node at byte 330 has an entry that points outside";
    assert!(said(|entry| entry.offset = 1 << 40).contains(outside), "{}", said(|entry| entry.offset = 1 << 40));
    assert!(said(|entry| entry.offset = u64::MAX).contains(outside));
    assert!(said(|entry| entry.offset = 0).contains(outside));
    assert!(said(|entry| entry.length = u32::MAX).contains(outside));
    assert!(said(|entry| entry.max[0] = i32::MAX).contains(outside));
    assert!(said(|entry| entry.min[2] = entry.max[2] + 1).contains(outside));
    assert!(said(|entry| entry.counts.tiles = 0).contains(outside));
    assert!(said(|entry| entry.counts.poles += 1).contains("do not add up"));
    assert!(said(|entry| entry.counts.lanes = u32::MAX).contains("do not add up"));
    assert!(said(|entry| entry.max[0] -= 1).contains("tile at byte 146 has another box"));
    assert!(said(|entry| entry.length -= 1).contains("checksum of its tile at byte 146"));
    assert!(said(|entry| entry.offset += 1).contains("should stand at byte 146"));
}

#[test]
fn an_index_that_names_a_tile_twice_is_refused() {
    let bytes = with_node(|node| node.copy_within(..ENTRY_BYTES, ENTRY_BYTES));
    let atlas = Atlas::open(&OnDisk::new(&bytes).path).unwrap();
    let everywhere = Area { min_xz: [-1e9; 2], max_xz: [1e9; 2] };
    let said = atlas.tiles_in(&everywhere).unwrap_err().to_string();
    assert!(said.contains("tile at byte 146") && said.contains("should not begin before byte"), "{said}");
}

#[test]
fn a_header_that_cannot_be_is_refused() {
    let said = |at: usize, value: &[u8]| {
        let mut bytes = documented();
        bytes[at..at + value.len()].copy_from_slice(value);
        reseal(&mut bytes);
        read(&bytes).unwrap_err().to_string()
    };
    assert!(said(12, &[0; 4]).contains("quantum of 0"));
    assert!(said(16, &[33]).contains("33 levels"));
    assert!(said(16, &[0]).contains("tile"));
    assert!(said(16, &[2]).contains("index node"));
    assert!(said(17, &[65]).contains("frame note of 65 bytes"));
    assert!(said(18, &[0x1b]).contains("no text"));
    assert!(said(17, &[3]).contains("no text"));
    let root_at = HEADER_BYTES - 4 - ENTRY_BYTES;
    assert!(said(root_at + 24, &[0xff; 8]).contains("points outside the file"));
    assert!(said(root_at + 32, &[0xff; 4]).contains("points outside the file"));
    assert!(said(root_at + 32, &[119]).contains("119 bytes, which are not 1 to 256 entries"));
    assert!(said(root_at + 40, &[0; 4]).contains("levels over 0 tiles"));
}

#[test]
fn an_empty_atlas_is_an_atlas() {
    for maps in [&[][..], &[SemanticMap::default()]] {
        let bytes = built(maps, AtlasOptions::default());
        assert_eq!(bytes.len(), HEADER_BYTES);
        let (atlas, tiles) = read(&bytes).unwrap();
        assert!(tiles.is_empty() && atlas.summary().bounds.is_none());
        let everywhere = Area { min_xz: [-1e9; 2], max_xz: [1e9; 2] };
        assert!(atlas.tiles_in(&everywhere).unwrap().is_empty());
    }
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csa");
    let mut builder = AtlasBuilder::new(&path, AtlasOptions::default());
    builder.add(&example(0.0), 0.01).unwrap();
    let said = builder.add(&example(0.0), 0.005).unwrap_err().to_string();
    assert!(said.contains("whole multiples of 0.005 m") && said.contains("of 0.01 m"), "{said}");
    let mut stray = example(0.0);
    stray.poles[0].road = RoadId(7);
    assert!(builder.add(&stray, 0.01).unwrap_err().to_string().contains("on road 7"));
    assert!(builder.write(Some("x".repeat(65))).unwrap_err().to_string().contains("65 bytes"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// So many examples on a square of this many metres.
fn country(count: usize, side_m: f64) -> Vec<SemanticMap> {
    let scatter = |i: usize, salt: f64| 0.5 * side_m * (12.9898 * i as f64 + salt).sin();
    let place = |i| {
        let mut map = example(scatter(i, 1.0));
        let off = nalgebra::Vector3::new(scatter(i, 2.0), 0.0, 0.0);
        map.roads.iter_mut().flat_map(|road| &mut road.path_map).for_each(|p| *p += off);
        // The box ends at a pole's top, which lies beside the grid.
        let lean = nalgebra::Vector3::x() * (0.1 * (i as f64).sin().abs());
        map.poles.iter_mut().for_each(|p| (p.foot_map, p.top_map) = (p.foot_map + off, p.top_map + off + lean));
        map.signs.iter_mut().for_each(|sign| sign.centroid_map += off);
        map.lanes.iter_mut().flat_map(|lane| &mut lane.points_map).for_each(|p| *p += off);
        map
    };
    (0..count).map(place).collect()
}

#[test]
fn opening_and_looking_around_read_a_few_pages() {
    let file = OnDisk::new(&built(&country(5000, 1e6), AtlasOptions { tile_bytes: 1, ..AtlasOptions::default() }));
    let atlas = Atlas::open(&file.path).unwrap();
    let page = 64 * ENTRY_BYTES as u64;
    assert_eq!((atlas.summary().counts.tiles, atlas.summary().levels), (5000, 3));
    assert!(atlas.bytes_read() <= HEADER_BYTES as u64 + page);
    let middle = example(0.0).bounds().unwrap().min_map;
    let area = Area { min_xz: [middle.x, middle.z], max_xz: [middle.x, middle.z] }.grown(300.0);
    atlas.tiles_in(&area).unwrap();
    assert!(atlas.bytes_read() <= HEADER_BYTES as u64 + 7 * page, "{} bytes", atlas.bytes_read());
}

#[test]
fn memory_does_not_change_the_bytes() {
    let maps = country(200, 5e3);
    let options = AtlasOptions { tile_bytes: 600, ..AtlasOptions::default() };
    let at_once = built(&maps, options);
    for memory_bytes in [1, 5_000] {
        assert_eq!(built(&maps, AtlasOptions { memory_bytes, ..options }), at_once);
    }
}

proptest! {
    #[test]
    fn an_atlas_holds_what_was_put_in(count in 0..30_usize, side_m in 10.0..1e5, tile_bytes in 1..3000_usize) {
        let mut maps = country(count, side_m);
        // One map of many roads, as a drive has them.
        let mut drive = SemanticMap::default();
        for map in maps.drain(count / 2..) {
            let road = RoadId(drive.roads.len() as u32);
            drive.roads.extend(map.roads);
            drive.poles.extend(map.poles.into_iter().map(|pole| Pole { road, ..pole }));
            drive.signs.extend(map.signs.into_iter().map(|sign| Sign { road, ..sign }));
            drive.lanes.extend(map.lanes.into_iter().map(|lane| LaneLine { road, ..lane }));
        }
        let bytes = built(&[drive.clone()], AtlasOptions { tile_bytes, ..AtlasOptions::default() });
        let (atlas, tiles) = read(&bytes).unwrap();
        let options = EncodeOptions { quantum_m: QUANTUM_M };
        prop_assert_eq!(joined(&tiles).encode(&options).unwrap(), drive.encode(&options).unwrap());
        prop_assert_eq!(atlas.summary().counts.roads as usize, drive.roads.len());
        for (place, tile) in &tiles {
            prop_assert_eq!(tile.counts(), Some(place.counts));
            prop_assert!(tile.road_numbers.is_sorted());
        }
    }

    #[test]
    fn a_query_finds_every_tile_that_touches_it(
        side_m in 100.0..1e5,
        centre in prop::array::uniform2(-1e5..1e5),
        reach_m in 0.0..5e4,
    ) {
        let bytes = built(&country(150, side_m), AtlasOptions { tile_bytes: 1, ..AtlasOptions::default() });
        let file = OnDisk::new(&bytes);
        let (atlas, tiles) = file.read().unwrap();
        let area = Area { min_xz: centre, max_xz: centre }.grown(reach_m);
        let touching: Vec<_> = tiles.iter().map(|(place, _)| *place).filter(|p| area.touches(&p.bounds)).collect();
        prop_assert_eq!(atlas.tiles_in(&area).unwrap(), touching);
    }

    #[test]
    fn a_changed_index_never_panics(at in any::<prop::sample::Index>(), byte in any::<u8>()) {
        let _ = read(&with_node(|node| node[at.index(node.len())] = byte));
        let mut bytes = documented();
        bytes[at.index(HEADER_BYTES)] = byte;
        reseal(&mut bytes);
        let _ = read(&bytes);
    }

    #[test]
    fn a_changed_tile_never_panics(at in any::<prop::sample::Index>(), byte in any::<u8>()) {
        let mut tile = documented()[HEADER_BYTES..HEADER_BYTES + 90].to_vec();
        let at = at.index(tile.len());
        tile[at] = byte;
        let _ = Tile::decode(&tile);
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        prop_assert!(read(&bytes).is_err());
        let _ = Tile::decode(&bytes);
    }
}
