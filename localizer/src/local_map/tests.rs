use common::geometry::Pose;
use common::map::atlas::{AtlasBuilder, AtlasOptions};
use common::map::{EncodeOptions, PoleKind, Road, RoadId};

use super::*;
use crate::config::Config;
use crate::estimate::PoseEstimate;
use crate::gps::{GpsConfig, simulate};
use crate::run::{Localizer, Method};
use crate::testing::{IMAGE, Recipe, World, time_s};
use crate::tracker::FrameInput;

fn two_roads() -> SemanticMap {
    let pole = |z: f64, road| Pole {
        kind: PoleKind::LampPost,
        foot_map: Point3::new(5.0, 1.6, z),
        top_map: Point3::new(5.0, -6.0, z),
        road: RoadId(road),
    };
    SemanticMap {
        roads: vec![
            Road { path_map: vec![Point3::new(0.0, 0.0, 0.0), Point3::new(0.0, -2.0, 200.0)] },
            Road { path_map: vec![Point3::new(0.0, -2.0, 200.0), Point3::new(0.0, 0.0, 900.0)] },
        ],
        poles: vec![pole(300.0, 1), pole(10.0, 0), pole(20.0, 0)],
        ..SemanticMap::default()
    }
}

#[test]
fn only_near_roads_are_found_and_their_landmarks() {
    let mut map = LocalMap::whole(two_roads());
    let mut roads = Vec::new();
    let mut poles_near = |x: f64, z: f64| {
        map.roads_near(&Point3::new(x, 0.0, z), 40.0, &mut roads).unwrap();
        roads.iter().map(|&road| map.poles(road).map(|(index, _)| index).collect()).collect::<Vec<Vec<usize>>>()
    };
    assert_eq!(poles_near(3.0, 20.0), [[1, 2]]);
    // No vertex of road 1 is near here, but its edge is.
    assert_eq!(poles_near(3.0, 600.0), [[0]]);
    assert!(poles_near(5e4, 600.0).is_empty());
    let unknown = RoadKey { number: 99, tile: 0, road: 99 };
    assert!(map.poles(unknown).next().is_none() && map.path(unknown).is_empty());
}

#[test]
fn the_path_gives_height_and_direction() {
    let (mut map, mut roads) = (LocalMap::whole(two_roads()), Vec::new());
    map.roads_near(&Point3::origin(), 1e6, &mut roads).unwrap();
    let place = map.nearest_path(&roads, &Point3::new(4.0, 9.0, 100.0)).unwrap();
    assert!((place.point_map - Point3::new(0.0, -1.0, 100.0)).norm() < 1e-9);
    assert!(place.forward_map.z > 0.99 && place.forward_map.y < 0.0);
    assert!(map.nearest_path(&[], &Point3::origin()).is_none());
}

#[test]
fn in_front_of_the_end_of_the_map_is_where_no_road_goes_on() {
    let (mut map, mut roads) = (LocalMap::whole(two_roads()), Vec::new());
    map.roads_near(&Point3::origin(), 1e6, &mut roads).unwrap();
    let beyond_m = |x: f64, z: f64| map.beyond_end_m(&roads, &Point3::new(x, 0.0, z), 9.0);
    // Before its first end and behind its last, however far aside.
    assert!(beyond_m(0.0, -30.0).is_some_and(|m| (m - 30.0).abs() < 1e-9));
    assert!(beyond_m(40.0, 930.0).is_some_and(|m| (m - 30.0).abs() < 1e-9));
    // On a road, beside one, and where one goes on as the other.
    assert_eq!([beyond_m(0.0, 40.0), beyond_m(60.0, 40.0), beyond_m(50.0, 200.0)], [None; 3]);
    assert!(map.beyond_end_m(&[], &Point3::origin(), 9.0).is_none());
}

/// What a map holds after it was stored: the same whether in one file or many.
fn stored(map: &SemanticMap) -> SemanticMap {
    SemanticMap::decode(&map.encode(&EncodeOptions::default()).unwrap()).unwrap()
}

/// `map` with its coordinates moved along x and z, metres.
fn moved(map: &SemanticMap, x_m: f64, z_m: f64) -> SemanticMap {
    let off = Vector3::new(x_m, 0.0, z_m);
    let mut map = map.clone();
    map.roads.iter_mut().flat_map(|road| &mut road.path_map).for_each(|p| *p += off);
    map.poles.iter_mut().for_each(|pole| (pole.foot_map, pole.top_map) = (pole.foot_map + off, pole.top_map + off));
    map.signs.iter_mut().for_each(|sign| sign.centroid_map += off);
    map.lanes.iter_mut().flat_map(|lane| &mut lane.points_map).for_each(|p| *p += off);
    map
}

/// An atlas of maps in tiles so small that a street crosses many.
fn atlas(folder: &tempfile::TempDir, maps: impl Iterator<Item = SemanticMap>) -> Atlas {
    let path = folder.path().join("test.csa");
    let options = AtlasOptions { tile_bytes: 400, ..AtlasOptions::default() };
    let mut builder = AtlasBuilder::new(&path, options);
    maps.for_each(|map| builder.add(&map, EncodeOptions::default().quantum_m).unwrap());
    builder.write(None).unwrap();
    Atlas::open(&path).unwrap()
}

fn drive(world: &World, map: &mut LocalMap, method: Method) -> Result<Vec<PoseEstimate>> {
    let fixes = simulate(&world.truth[..2], &GpsConfig::default(), 1);
    let mut localizer = Localizer::new(method, map, &world.camera, IMAGE, &Config::default());
    let frame = |frame: usize| {
        let features = world.features(frame);
        let input = FrameInput { time_s: time_s(frame), features: &features, gps: fixes.get(frame), odometry: None };
        localizer.step(&input)
    };
    (0..world.truth.len()).map(frame).filter_map(Result::transpose).collect()
}

fn poses(estimates: &[PoseEstimate]) -> Vec<Pose> {
    estimates.iter().map(|estimate| estimate.map_from_camera).collect()
}

/// Tiles are read as late as they can be, and dropped at once.
const LAZY: LocalMapConfig = LocalMapConfig { prefetch_m: 0.0, keep_m: 0.0, max_reach_m: 500.0 };

#[test]
fn a_drive_across_tiles_gives_the_poses_of_the_whole_map() {
    let world = World::new(Recipe { length_m: 640.0, speed_m_s: 25.0, corner: (1.3, 40.0), ..Recipe::default() });
    let folder = tempfile::tempdir().unwrap();
    let ahead = LocalMapConfig { prefetch_m: 50.0, ..LocalMapConfig::default() };
    for (method, configs) in [(Method::Robust, &[LAZY, ahead][..]), (Method::Paper, &[LAZY])] {
        let whole = drive(&world, &mut LocalMap::whole(stored(&world.map)), method).unwrap();
        for config in configs {
            let atlas = atlas(&folder, std::iter::once(world.map.clone()));
            let tiles = atlas.summary().counts.tiles as usize;
            let mut local = LocalMap::around(atlas, config);
            let around = drive(&world, &mut local, method).unwrap();
            assert_eq!(poses(&around), poses(&whole));
            assert!(around.iter().zip(&whole).all(|(a, b)| a.covariance == b.covariance && a.status == b.status));
            assert_eq!(local.numbering(), Numbering::of(&world.map));
            let usage = local.usage().unwrap();
            assert!(tiles > 8 && usage.tiles_read >= tiles, "{tiles} tiles, {usage:?}");
            assert!(*config != LAZY || usage.most_held < tiles, "{tiles} tiles, {usage:?}");
        }
    }
}

#[test]
fn what_is_read_and_held_does_not_grow_with_the_atlas() {
    let world = World::new(Recipe { length_m: 150.0, ..Recipe::default() });
    let folder = tempfile::tempdir().unwrap();
    let usage = |side: i32| {
        let places = (0..side).flat_map(|x| (0..side).map(move |z| (f64::from(x) * 3e3, f64::from(z) * 3e3)));
        let mut local = LocalMap::around(
            atlas(&folder, places.map(|(x_m, z_m)| moved(&world.map, x_m, z_m))),
            &LocalMapConfig::default(),
        );
        let estimates = drive(&world, &mut local, Method::Robust).unwrap();
        (poses(&estimates), local.usage().unwrap())
    };
    let (alone, among_many) = (usage(1), usage(30));
    assert_eq!(alone.0, among_many.0);
    assert_eq!((alone.1.tiles_read, alone.1.most_held), (among_many.1.tiles_read, among_many.1.most_held));
    // The index: two more levels, of nodes of at most 64 entries of 60 bytes.
    assert!(among_many.1.bytes_read < alone.1.bytes_read + 12 * 64 * 60, "{:?} {:?}", alone.1, among_many.1);
}

#[test]
fn a_jump_to_another_place_and_back_finds_the_roads_of_each() {
    let world = World::new(Recipe { length_m: 150.0, ..Recipe::default() });
    let folder = tempfile::tempdir().unwrap();
    let maps: Vec<_> = [0.0, 2e3, 4e3].map(|x_m| moved(&world.map, x_m, 0.0)).into();
    let mut local = LocalMap::around(atlas(&folder, maps.into_iter()), &LAZY);
    let count = |local: &mut LocalMap, x_m: f64| {
        let mut roads = Vec::new();
        local.roads_near(&Point3::new(x_m, 0.0, 50.0), 100.0, &mut roads).unwrap();
        roads.iter().map(|&road| local.poles(road).count()).sum::<usize>()
    };
    let here = count(&mut local, 0.0);
    assert!(here > 0);
    // Two places in each frame, then one that swallows the other.
    for _ in 0..4 {
        local.next_frame().unwrap();
        assert_eq!((count(&mut local, 2e3), count(&mut local, 0.0), count(&mut local, 1e3)), (here, here, 0));
    }
    for x_m in [4e3, 0.0, 0.0, 0.0, 4e3, 2e3] {
        local.next_frame().unwrap();
        assert_eq!(count(&mut local, x_m), here);
    }
    let most = local.usage().unwrap().most_held;
    assert!(most <= 2 * local.held.len() + 2, "{most} tiles were held, {} are", local.held.len());
}

#[test]
fn a_damaged_tile_ends_the_drive_with_a_sentence() {
    let world = World::new(Recipe { length_m: 150.0, ..Recipe::default() });
    let folder = tempfile::tempdir().unwrap();
    let path = atlas(&folder, std::iter::once(world.map.clone())).path().to_path_buf();
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[400] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let mut local = LocalMap::around(Atlas::open(&path).unwrap(), &LocalMapConfig::default());
    let said = drive(&world, &mut local, Method::Robust).unwrap_err().to_string();
    assert!(said.contains("test.csa: this atlas is damaged") && said.contains("tile at byte"), "{said}");
}
