//! Image features side by side: what the localizer's own vision code makes of
//! the label images of two drives, held against maps that the mapper built
//! from both drives' scans in the same way.
//!
//! A map is no truth: real landmarks that it lacks count as false regions. That
//! is the same on both sides as far as the mapper finds equal shares of both
//! worlds, and better than truth on one side and a map on the other.

mod expected;
mod lanes;
mod persistence;
mod poles;
mod side;
mod signs;
mod table;

use std::path::PathBuf;

use common::geometry::PinholeCamera;
use localizer::vision::VisionConfig;

use lanes::Lanes;
use poles::Poles;
use side::Side;
use signs::Signs;
use table::Row;

/// What to compare.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Folder with the real drive, as KITTI odometry has it.
    #[arg(long, value_name = "ROOT")]
    kitti: PathBuf,
    /// Its name.
    #[arg(long, value_name = "NN", default_value = "04")]
    sequence: String,
    /// Last frame of both.
    #[arg(long, value_name = "FRAME")]
    last: Option<usize>,
    /// Map that `mapper build --every 1` made of the real drive.
    #[arg(long, value_name = "MAP.csm")]
    map: PathBuf,
    /// Poses that it was built with (`--trajectory`).
    #[arg(long, value_name = "POSES.txt")]
    trajectory: PathBuf,
    /// Probability images of the real drive (`localizer segment`).
    #[arg(long, value_name = "DIR")]
    labels: PathBuf,
    /// The generated drive, with a scan for every frame.
    #[arg(long, value_name = "ROOT")]
    generated: PathBuf,
    /// Map that `mapper build --every 1` made of the generated drive.
    #[arg(long, value_name = "MAP.csm")]
    generated_map: PathBuf,
    /// Poses that it was built with (`--trajectory`).
    #[arg(long, value_name = "POSES.txt")]
    generated_trajectory: PathBuf,
}

/// Prints the table.
///
/// # Errors
/// One sentence that says which input is wrong.
pub fn run(arguments: &Arguments) -> Result<(), String> {
    let Arguments { kitti, sequence, labels, map, trajectory, .. } = arguments;
    let real = figures(&Side::open(kitti, sequence, labels, map, trajectory, arguments.last)?)?;
    let root = &arguments.generated;
    let labels = root.join("sequences").join(fixtures::folder::SEQUENCE).join("labels_2");
    let (map, trajectory) = (&arguments.generated_map, &arguments.generated_trajectory);
    let generated = figures(&Side::open(root, fixtures::folder::SEQUENCE, &labels, map, trajectory, arguments.last)?)?;
    print!("{}", table::side_by_side(&real, &generated));
    Ok(())
}

/// All figures of one drive.
fn figures(side: &Side) -> Result<Vec<Row>, String> {
    let config = VisionConfig::default();
    let (mut poles, mut signs, mut lanes) = (Poles::default(), Signs::default(), Lanes::default());
    for &frame in side.frames() {
        let view = side.view(frame, &config)?;
        poles.add(&view, &side.map, &config.poles);
        signs.add(&view, &side.map, &config.signs);
        lanes.add(&view, &side.map, &config.lanes);
    }
    let frames = side.frames().len();
    Ok([poles.rows(frames), signs.rows(frames), lanes.rows(frames)].concat())
}

/// Limits of the distances that are told apart, metres.
const DISTANCES_M: [f64; 6] = [5.0, 10.0, 20.0, 30.0, 45.0, 70.0];

/// Which of the ranges of [`DISTANCES_M`] a distance lies in.
fn distance_bin(distance_m: f64) -> Option<usize> {
    DISTANCES_M.windows(2).position(|limits| (limits[0]..limits[1]).contains(&distance_m))
}

/// What is printed for a range of distances.
fn distance_name(bin: usize) -> String {
    format!("{:.0}-{:.0} m", DISTANCES_M[bin], DISTANCES_M[bin + 1])
}

/// Size in the image of a length at a depth, pixels.
fn pixels(camera: &PinholeCamera, length_m: f64, depth_m: f64) -> f64 {
    camera.fx_px * length_m / depth_m
}
