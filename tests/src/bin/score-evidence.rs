//! Scores the uncertainty of a map's landmarks against the truth.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use common::kitti::read_poses;
use mapper::Config;
use mapper::budget::Stored;
use waymark_tests::cli::{MapOfDrive, Outcome, ended};
use waymark_tests::evidence_score::score;

/// Scores the uncertainty that the report beside a map gives to its landmarks
/// against the truth of the generated drive that it was built from.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    of: MapOfDrive,
    /// The poses that it was built with, from `mapper build --trajectory`.
    #[arg(long, value_name = "POSES.txt")]
    trajectory: PathBuf,
}

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Outcome {
    let Stored { map, report, note, .. } = Stored::read(&arguments.of.map, &Config::default())?;
    let evidence = report.map(|report| report.evidence).filter(|evidence| evidence.fits(&map)).ok_or_else(|| {
        let none = || format!("{} has no report of its build beside it; build it again", arguments.of.map.display());
        note.unwrap_or_else(none)
    })?;
    let (truth, exact) = arguments.of.truth()?;
    let built = read_poses(&arguments.trajectory)?;
    common::say!("{:20} {:>6} {:>9} {:>9} {:>7} {:>7}", "", "number", "RMS, m", "said, m", "ratio", "median");
    for (name, found) in score(&map, &evidence, &truth, &built, &exact) {
        common::say!(
            "{name:20} {:>6} {:>9.3} {:>9.3} {:>7.2} {:>7.2}",
            found.count,
            found.rms_m,
            found.said_m,
            found.ratio,
            found.median_ratio
        );
    }
    Ok(())
}
