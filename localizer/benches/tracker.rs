//! What a frame costs from its features to its pose: milliseconds, and what is
//! allocated for it.
//!
//! On KITTI 04, frames 0 to 50, where there are data and networks
//! (`WAYMARK_DATA`, else `shared` beside the repository); else on as many
//! generated frames. What the networks give is kept beside the build. The
//! drive is localized from several GPS starts; every frame is timed on its own.

// A bench without its data has nothing to say.
#![allow(clippy::unwrap_used)]

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::Instant;

use common::geometry::Pose;
use common::map::{RoadId, SemanticMap};
use divan::{AllocProfiler, Bencher};
use localizer::camera::Source;
use localizer::cli::input::simulated;
use localizer::config::Config;
use localizer::drive::Drive;
use localizer::eval::START_FRAMES;
use localizer::gps::GpsFix;
use localizer::local_map::LocalMap;
use localizer::run::FrameFeatures;
use localizer::tracker::{FrameInput, Tracker};
use localizer::vision::labels;
use localizer::vision::network::Runtime;
use mapper::PoseSource;
use nalgebra::Vector3;

#[global_allocator]
static ALLOCATOR: AllocProfiler = AllocProfiler::system();

/// Frames after which buffers are as large as the drive needs them.
const WARM_FRAMES: usize = 10;
/// GPS starts, with the seeds 0, 1, ...
const STARTS: u64 = 20;
/// Last frame of the drive.
const LAST: usize = 50;

fn main() {
    println!("{}", CASE.name);
    println!("{}", CASE.quantiles());
    divan::main();
}

/// A drive that was looked at, with its map.
struct Case {
    name: String,
    config: Config,
    map: SemanticMap,
    drive: Drive,
    frames: Vec<FrameFeatures>,
    /// GPS fixes of each start.
    starts: Vec<BTreeMap<usize, GpsFix>>,
}

static CASE: LazyLock<Case> = LazyLock::new(|| {
    let shared = std::env::var_os("WAYMARK_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"), PathBuf::from);
    let (root, sequence, folder) = match segmented(&shared) {
        Some(folder) => (shared.join("kitti"), "04", folder),
        None => generated(),
    };
    let config = Config::default();
    let (map, truth) = mapped(&root, sequence);
    let drive = Drive::open(&root, sequence, Some(&folder), 0, Some(LAST), config.vision.widest_px).unwrap();
    let source = Source::Labels(folder);
    let look = |&frame: &usize| {
        let seen = drive.see(frame, &source, &config.vision).unwrap();
        let time_s = drive.times_s[frame];
        FrameFeatures { frame, time_s, features: seen.features, maps_ms: 0.0, features_ms: 0.0 }
    };
    let frames: Vec<FrameFeatures> = drive.frames.iter().map(look).collect();
    let starts = (0..STARTS)
        .map(|seed| simulated(&frames.iter().map(|seen| seen.frame), &truth, &config, seed).unwrap())
        .collect();
    let name = format!("{} frames of {sequence}, {} GPS starts", frames.len(), STARTS);
    Case { name, config, map, drive, frames, starts }
});

/// The label images of KITTI 04; none without the drive and the networks. They
/// are made once.
fn segmented(shared: &Path) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("kitti_04_labels");
    let nets = ["espnetv2_cityscapes_384x1248.onnx", "twinlitenet_lane_384x1248.onnx"];
    let nets = nets.map(|net| shared.join("models").join(net));
    let config = Config::default().vision;
    let drive = Drive::open(&shared.join("kitti"), "04", None, 0, Some(LAST), config.widest_px).ok()?;
    let source = Source::open(&nets.each_ref().map(PathBuf::as_path), Runtime::Rten, None).ok()?;
    for &frame in &drive.frames {
        // The labels of a frame are written in the order of the classes.
        if !localizer::vision::Class::ALL.iter().all(|&class| labels::path(&folder, class, frame).is_file()) {
            let seen = drive.see(frame, &source, &config).ok()?;
            drive.camera.write_labels(&folder, frame, &seen).ok()?;
        }
    }
    Some(folder)
}

fn generated() -> (PathBuf, &'static str, PathBuf) {
    let root = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bench_tracker");
    let options = fixtures::Options {
        world: fixtures::world::WorldSpec::named("street", 1).with_frames(LAST + 1),
        ..fixtures::Options::default()
    };
    fixtures::generate(&options, &root, &|_| ()).unwrap();
    let labels = root.join("sequences/00/labels_2");
    (root, "00", labels)
}

/// The map of every fifth scan, and the poses that it was built with.
fn mapped(root: &Path, sequence: &str) -> (SemanticMap, Vec<Pose>) {
    let config = mapper::Config::default();
    let drive = mapper::drive::Drive::open(root, sequence, 5, (0, LAST), None, 120.0).unwrap();
    let built = mapper::build::build(&drive, PoseSource::Refine, &config, |_| Ok(())).unwrap();
    (built.map, built.registration.map_from_camera)
}

impl Case {
    /// A localizer in a map that is held for good, a bench being short.
    fn tracker(&self, copies: usize) -> Tracker<'static> {
        let map = Box::leak(Box::new(LocalMap::whole(repeated(&self.map, copies))));
        Tracker::new(map, &self.drive.camera.pinhole, self.drive.camera.seen_px(), &self.config)
    }

    fn input(&self, start: usize, frame: usize) -> FrameInput<'_> {
        let seen = &self.frames[frame];
        let gps = self.starts[start].get(&seen.frame);
        FrameInput { time_s: seen.time_s, features: &seen.features, gps, odometry: None }
    }

    /// Times of the frames behind the start, and of the start, over all starts.
    fn quantiles(&self) -> String {
        let (mut start_ms, mut frame_ms) = (Vec::new(), Vec::new());
        for start in 0..self.starts.len() {
            let mut tracker = self.tracker(1);
            for frame in 0..self.frames.len() {
                let (input, started) = (self.input(start, frame), Instant::now());
                tracker.step(&input).unwrap();
                let times = if frame < START_FRAMES { &mut start_ms } else { &mut frame_ms };
                times.push(started.elapsed().as_secs_f64() * 1e3);
            }
        }
        let row = |mut ms: Vec<f64>| {
            ms.sort_by(f64::total_cmp);
            let at = |share: f64| ms[((ms.len() - 1) as f64 * share).round() as usize];
            format!("median {:.3}, 99 % {:.3}, most {:.3}", at(0.5), at(0.99), at(1.0))
        };
        format!("ms per frame: {}\nof the first {START_FRAMES}: {}", row(frame_ms), row(start_ms))
    }
}

/// Copies of a map, 10 km apart.
fn repeated(map: &SemanticMap, copies: usize) -> SemanticMap {
    let mut all = map.clone();
    for copy in 1..copies {
        let (off, road) = (Vector3::x() * (10_000.0 * copy as f64), RoadId((copy * map.roads.len()) as u32));
        let mut moved = map.clone();
        let lanes = moved.lanes.iter_mut().flat_map(|lane| &mut lane.points_map);
        let ends = moved.poles.iter_mut().flat_map(|pole| [&mut pole.foot_map, &mut pole.top_map]);
        let signs = moved.signs.iter_mut().map(|sign| &mut sign.centroid_map);
        let paths = moved.roads.iter_mut().flat_map(|road| &mut road.path_map);
        lanes.chain(ends).chain(signs).chain(paths).for_each(|point| *point += off);
        let roads = moved.poles.iter_mut().map(|pole| &mut pole.road);
        let roads = roads.chain(moved.signs.iter_mut().map(|sign| &mut sign.road));
        roads.chain(moved.lanes.iter_mut().map(|lane| &mut lane.road)).for_each(|own| own.0 += road.0);
        all.poles.extend(moved.poles);
        all.signs.extend(moved.signs);
        all.lanes.extend(moved.lanes);
        all.roads.extend(moved.roads);
    }
    all
}

/// One frame in a map of this many copies of the drive.
#[divan::bench(args = [1, 10_000], sample_size = 1, sample_count = 205)]
fn frame(bencher: Bencher, copies: usize) {
    let tracked = RefCell::new((CASE.tracker(copies), 0, 0));
    bencher
        .with_inputs(|| {
            let (tracker, start, frame) = &mut *tracked.borrow_mut();
            if *frame >= CASE.frames.len() {
                (*start, *frame) = ((*start + 1) % CASE.starts.len(), 0);
                *tracker = CASE.tracker(copies);
            }
            while *frame < WARM_FRAMES {
                tracker.step(&CASE.input(*start, *frame)).unwrap();
                *frame += 1;
            }
            *frame += 1;
            CASE.input(*start, *frame - 1)
        })
        .bench_local_refs(|input| tracked.borrow_mut().0.step(input).map(|said| said.is_some()));
}

/// The two frames with GPS fixes that a drive is started from.
#[divan::bench(sample_size = 1, sample_count = 20)]
fn start(bencher: Bencher) {
    let mut starts = (0..CASE.starts.len()).cycle();
    bencher.with_inputs(|| (CASE.tracker(1), starts.next().unwrap_or(0))).bench_local_refs(|(tracker, start)| {
        for frame in 0..START_FRAMES {
            tracker.step(&CASE.input(*start, frame)).unwrap();
        }
    });
}
