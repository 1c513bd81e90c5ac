//! What one frame costs between an image and its features.
//!
//! On the first KITTI 04 frame and the two networks where `WAYMARK_DATA` (or
//! `../shared`) has them, else on a drawn street without networks.

use std::path::{Path, PathBuf};

use divan::{Bencher, black_box};
use localizer::vision::config::{LaneConfig, PoleConfig, SignConfig};
use localizer::vision::network::{Runtime, run_all};
use localizer::vision::{Class, Network, Plane, ProbabilityMaps, RgbImage, VisionConfig};
use localizer::vision::{extract, lanes, poles, read_image, signs};

/// As in the program.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() {
    divan::main();
}

fn data() -> PathBuf {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    std::env::var_os("WAYMARK_DATA").map_or(beside, PathBuf::from)
}

fn image() -> Option<RgbImage> {
    read_image(data().join("kitti/sequences/04/image_2/000000.png")).ok()
}

fn network(name: &str, runtime: Runtime) -> Option<Network> {
    let folder = data().join("models");
    let network = match name {
        WHOLE_LANES => described(&folder.join(LANES), runtime),
        name => Network::load(folder.join(name), runtime),
    };
    network.inspect_err(|error| eprintln!("nothing to time: {error}")).ok()
}

const POLES: &str = "espnetv2_cityscapes_384x1248.onnx";
const LANES: &str = "twinlitenet_lane_384x1248.onnx";

/// The network of lanes on whole images, which it is not run on unless a
/// description says so.
const WHOLE_LANES: &str = "whole images";

fn described(network: &Path, runtime: Runtime) -> Result<Network, localizer::vision::Error> {
    let unusable = |error| localizer::vision::Error::from(common::Error::io(network)(error));
    let folder = tempfile::tempdir().map_err(unusable)?;
    let copy = folder.path().join("lanes.onnx");
    std::fs::copy(network, &copy).map_err(unusable)?;
    std::fs::write(copy.with_extension("toml"), "[classes]\nlane = [0]\n").map_err(unusable)?;
    Network::load(copy, runtime)
}

/// The maps of the frame, or poles and lanes drawn with straight edges.
fn maps() -> ProbabilityMaps {
    if let (Some(image), Some(poles), Some(lanes)) =
        (image(), network(POLES, Runtime::Rten), network(LANES, Runtime::Rten))
        && let Ok(maps) = run_all(&[poles, lanes], &image)
    {
        return maps;
    }
    let (width, height) = (1226, 370);
    let draw = |inside: fn(f64, f64) -> bool| {
        let value = |i: usize| if inside((i % width) as f64, (i / width) as f64) { 230 } else { 0 };
        Plane::new(width, (0..width * height).map(value).collect())
    };
    let mut maps = ProbabilityMaps::zeros(width, height);
    let poles = draw(|u, v| (u % 60.0) < 5.0 && v < 200.0);
    let lanes = draw(|u, v| v > 190.0 && ((u - 613.0) / (v - 180.0) * 2.0).fract().abs() < 0.1);
    for (class, plane) in [(Class::Pole, poles), (Class::Lane, lanes)] {
        let _ = plane.map(|plane| maps.set(class, plane));
    }
    maps
}

#[divan::bench(args = [POLES, LANES, WHOLE_LANES], sample_count = 10)]
fn run_network(bencher: Bencher, name: &str) {
    time_network(bencher, name, Runtime::Rten);
}

#[cfg(feature = "ort")]
#[divan::bench(args = [POLES, LANES, WHOLE_LANES], sample_count = 10)]
fn run_network_by_onnx_runtime(bencher: Bencher, name: &str) {
    time_network(bencher, name, Runtime::Ort);
}

/// With a library for CUDA and a GPU; says what is missing, else.
#[cfg(feature = "ort")]
#[divan::bench(args = [POLES, LANES, WHOLE_LANES], sample_count = 50)]
fn run_network_on_gpu(bencher: Bencher, name: &str) {
    time_network(bencher, name, Runtime::OrtCuda);
}

fn time_network(bencher: Bencher, name: &str, runtime: Runtime) {
    if let (Some(network), Some(image)) = (network(name, runtime), image()) {
        bencher.bench_local(|| {
            let mut maps = ProbabilityMaps::zeros(image.width(), image.height());
            network.run(black_box(&image), &mut maps).map(|()| maps)
        });
    }
}

#[divan::bench]
fn extract_poles(bencher: Bencher) {
    let (maps, config) = (maps(), PoleConfig::default());
    bencher.bench_local(|| poles::extract(black_box(&maps), &config));
}

#[divan::bench]
fn extract_signs(bencher: Bencher) {
    let (maps, config) = (maps(), SignConfig::default());
    bencher.bench_local(|| signs::extract(black_box(&maps), &config));
}

#[divan::bench]
fn extract_lanes(bencher: Bencher) {
    let (maps, config) = (maps(), LaneConfig::default());
    bencher.bench_local(|| lanes::extract(black_box(&maps), &config));
}

#[divan::bench]
fn extract_all(bencher: Bencher) {
    let (maps, config) = (maps(), VisionConfig::default());
    bencher.bench_local(|| extract(black_box(&maps), None, &config));
}
