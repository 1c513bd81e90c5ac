//! Scores the poles of maps of one drive in frames that are turned.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use mapper::Config;
use mapper::cli::ConfigArgs;
use mapper::drive::{Drive, MAX_RANGE_M};
use waymark_tests::cli::{Outcome, ended};
use waymark_tests::pole_map::Score;
use waymark_tests::turned::{Turned, turned};

/// Maps a sequence of KITTI in frames that are turned about the vertical, scores the
/// poles of each map as `score-poles` does, and names those that only some of them
/// have: what is found in half of the frames is found by luck.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    /// Folder with `sequences/`, as KITTI odometry has it.
    #[arg(long, value_name = "ROOT", required_unless_present = "print_config")]
    kitti: Option<PathBuf>,
    /// The sequence.
    #[arg(long, value_name = "NN", required_unless_present = "print_config")]
    sequence: Option<String>,
    /// Stitch the scans of every frame whose number is a multiple of this.
    #[arg(long, value_name = "N", default_value_t = 5)]
    every: usize,
    /// Last frame.
    #[arg(long, value_name = "F", default_value_t = usize::MAX)]
    last: usize,
    /// Frames, the survey's own among them.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    #[command(flatten)]
    config: ConfigArgs,
}

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Outcome {
    let Arguments { kitti, sequence, every, last, frames, config } = arguments;
    // The command line lets the others be absent with `--print-config` only.
    let (Some(config), Some(kitti), Some(sequence)) = (config.load(Config::load)?, kitti, sequence) else {
        return Ok(());
    };
    let drive = Drive::open(kitti, sequence, *every, (0, *last), None, MAX_RANGE_M)?;
    print(&turned(&drive, *frames, &config, kitti, sequence)?);
    Ok(())
}

fn print(turned: &Turned) {
    let frames = turned.scores.len();
    common::say!("poles in {frames} frames: mean (least to largest)");
    for (name, of) in [("recall", Score::recall as fn(&Score) -> f64), ("precision", Score::precision)] {
        let [mean, least, most] = turned.spread(of);
        common::say!("{name:<9} {mean:.3} ({least:.3} to {most:.3})");
    }
    let mut some: Vec<_> = turned.poles.iter().filter(|pole| pole.kinds.len() < frames).collect();
    some.sort_by(|a, b| b.kinds.len().cmp(&a.kinds.len()).then(a.at.y.total_cmp(&b.at.y)));
    for pole in some {
        let row = pole.row.map_or_else(String::new, |row| format!(", row {} of the reference", row + 1));
        let kind = pole.kinds.first().map_or("", |kind| kind.name());
        common::say!("in {:>3} of them x {:7.2}  z {:7.2}  {kind}{row}", pole.kinds.len(), pole.at.x, pole.at.y);
    }
}
