//! What a map costs, stage by stage: `cargo bench -p mapper`.
//!
//! On KITTI 04, every fifth scan of frames 0 to 50, where there is real data
//! (`WAYMARK_DATA`, else `shared` beside the repository); else on as many
//! generated scans.

// A bench without its data has nothing to say.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use common::map::{EncodeOptions, PoleKind, SemanticMap};
use divan::Bencher;
use divan::counter::{BytesCount, ItemsCount};
use mapper::build::{build, find_lanes};
use mapper::cloud::Cloud;
use mapper::drive::{Drive, MAX_RANGE_M};
use mapper::ground::{Ground, Heights};
use mapper::poles::{FittedPole, Plumb, Stack, Stacks, Wanted, find_poles, fit_pole};
use mapper::register::{Registration, refine};
use mapper::signs::find_signs;
use mapper::{Config, PoseSource};

fn main() {
    println!("{}", CASE.name);
    divan::main();
}

/// A drive with what its stages take and give.
struct Case {
    name: String,
    config: Config,
    drive: Drive,
    registration: Registration,
    cloud: Cloud,
    stacks: Vec<Stack>,
    poles: Vec<(PoleKind, FittedPole)>,
    map: SemanticMap,
    /// Length of the scans, bytes.
    scan_bytes: u64,
}

static CASE: LazyLock<Case> = LazyLock::new(|| {
    let shared = std::env::var_os("WAYMARK_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"), PathBuf::from);
    let real = shared.join("kitti");
    let (root, sequence) = if real.join("sequences/04").is_dir() { (real, "04") } else { (generated(), "00") };
    let config = Config::default();
    let drive = Drive::open(&root, sequence, 5, (0, 50), None, MAX_RANGE_M).unwrap();
    let registration = refine(&drive, &config.refine).unwrap();
    let cloud = Cloud::stitch(&drive, &drive.frames, &registration, &config).unwrap();
    let stacks = find_stacks(&cloud, &config);
    let poles = find_poles(&cloud, &config.poles, &config.lidar);
    let map = build(&drive, PoseSource::Refine, &config, |_| Ok(())).unwrap().map;
    let scan_bytes = drive.frames.iter().map(|&f| std::fs::metadata(drive.scan_path(f)).unwrap().len()).sum();
    let name = format!("{}, {} scans of frames 0 to 50", drive.name(), drive.frames.len());
    Case { name, config, drive, registration, cloud, stacks, poles, map, scan_bytes }
});

fn find_stacks(cloud: &Cloud, config: &Config) -> Vec<Stack> {
    let stacks = Stacks::new(&cloud.points, cloud.ground.grid(), &config.poles);
    stacks.find(&config.poles).into_iter().chain(stacks.find_before(&config.poles)).collect()
}

fn generated() -> PathBuf {
    let root = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bench");
    let options = fixtures::Options {
        world: fixtures::world::WorldSpec::named("street", 1).with_frames(51),
        ..fixtures::Options::default()
    };
    fixtures::generate(&options, &root, &|_| ()).unwrap();
    root
}

/// Bytes of the scans to points in the Velodyne frame.
#[divan::bench]
fn read(bencher: Bencher) {
    bencher.counter(BytesCount::new(CASE.scan_bytes)).bench(|| {
        let mut points = 0;
        CASE.drive.for_each(&CASE.drive.frames, 0.0, |_, scan| scan.points.len(), |_, n| points += n).unwrap();
        points
    });
}

/// The survey's poses to poses that the scans agree with; reads every scan
/// up to three times.
#[divan::bench(sample_count = 20)]
fn register(bencher: Bencher) {
    bencher
        .counter(ItemsCount::new(CASE.drive.frames.len()))
        .bench(|| refine(&CASE.drive, &CASE.config.refine).unwrap());
}

/// Scans to one cloud over its ground; reads every scan once.
#[divan::bench(sample_count = 20)]
fn stitch(bencher: Bencher) {
    bencher
        .counter(BytesCount::new(CASE.scan_bytes))
        .bench(|| Cloud::stitch(&CASE.drive, &CASE.drive.frames, &CASE.registration, &CASE.config).unwrap());
}

/// The ground under the points of a cloud.
#[divan::bench(sample_count = 20)]
fn ground(bencher: Bencher) {
    let Cloud { points, ground, path, path_index, .. } = &CASE.cloud;
    bencher.counter(ItemsCount::new(points.len())).bench(|| {
        let mut heights = Heights::new(path, path_index, ground.grid().clone());
        heights.add(points.iter().map(|p| p.position));
        Ground::grow(heights, path, &CASE.config.ground)
    });
}

/// Points to isolated upright stacks: what could be a pole.
#[divan::bench(sample_count = 20)]
fn stacks(bencher: Bencher) {
    bencher.counter(ItemsCount::new(CASE.cloud.points.len())).bench(|| find_stacks(&CASE.cloud, &CASE.config));
}

/// Stacks to axes.
#[divan::bench(sample_count = 20)]
fn fits(bencher: Bencher) {
    let (cloud, config) = (&CASE.cloud, &CASE.config);
    let (plumb, wanted) = (Plumb::of_map(&config.poles), Wanted::PolesAndFences);
    bencher.counter(ItemsCount::new(CASE.stacks.len())).bench(|| {
        let fit = |stack: &Stack| {
            fit_pole(cloud, cloud.near(&stack.centre), stack, &plumb, wanted, &config.poles, &config.lidar)
        };
        CASE.stacks.iter().filter_map(fit).count()
    });
}

/// Stacks, their fits, and which of them are poles.
#[divan::bench(sample_count = 20)]
fn poles(bencher: Bencher) {
    bencher
        .counter(ItemsCount::new(CASE.cloud.points.len()))
        .bench(|| find_poles(&CASE.cloud, &CASE.config.poles, &CASE.config.lidar));
}

/// Clusters of bright points, and plates on posts.
#[divan::bench(sample_count = 20)]
fn signs(bencher: Bencher) {
    bencher
        .counter(ItemsCount::new(CASE.cloud.points.len()))
        .bench(|| find_signs(&CASE.cloud, &CASE.poles, &CASE.config));
}

/// Points of paint to lane lines.
#[divan::bench(sample_count = 20)]
fn lanes(bencher: Bencher) {
    bencher.counter(ItemsCount::new(CASE.cloud.points.len())).bench(|| find_lanes(&CASE.cloud, &CASE.config));
}

#[divan::bench]
fn encode(bencher: Bencher) {
    let options = EncodeOptions::default();
    let bytes = CASE.map.encode(&options).unwrap().len();
    bencher.counter(BytesCount::new(bytes)).bench(|| CASE.map.encode(&options).unwrap());
}

#[divan::bench]
fn decode(bencher: Bencher) {
    let bytes = CASE.map.encode(&EncodeOptions::default()).unwrap();
    bencher.counter(BytesCount::new(bytes.len())).bench(|| SemanticMap::decode(&bytes).unwrap());
}

/// Everything, from the files to the map.
#[divan::bench(sample_count = 20)]
fn whole(bencher: Bencher) {
    bencher
        .counter(BytesCount::new(CASE.scan_bytes))
        .bench(|| build(&CASE.drive, PoseSource::Refine, &CASE.config, |_| Ok(())).unwrap());
}
