//! Scores the uncertainty of a map's landmarks against the truth.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use common::map::SemanticMap;
use waymark_tests::evidence_score::score;

/// Scores the uncertainty that the report beside a map gives to its landmarks
/// against the truth of the generated drive that it was built from.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    /// The map, with the report of its build beside it.
    #[arg(long, value_name = "MAP.csm")]
    map: PathBuf,
    /// The drive, from `fixtures generate --out`.
    #[arg(long, value_name = "ROOT")]
    drive: PathBuf,
    /// The poses that it was built with, from `mapper build --trajectory`.
    #[arg(long, value_name = "POSES.txt")]
    trajectory: PathBuf,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), String> {
    let say = |error: common::Error| error.to_string();
    let bytes = std::fs::read(&arguments.map).map_err(|error| format!("{}: {error}", arguments.map.display()))?;
    let map = SemanticMap::decode(&bytes).map_err(common::Error::in_file(&arguments.map)).map_err(say)?;
    let report = mapper::report::read_beside(&arguments.map, &bytes).map_err(|error| error.to_string())?;
    let evidence = report.map(|report| report.evidence).filter(|evidence| evidence.fits(&map));
    let evidence = evidence
        .ok_or_else(|| format!("{} has no report of its build beside it; build it again", arguments.map.display()))?;
    let truth = waymark_tests::truth::read(&arguments.drive)?;
    let built = common::kitti::read_poses(&arguments.trajectory).map_err(say)?;
    let exact = common::kitti::read_poses(arguments.drive.join("truth/poses.txt")).map_err(say)?;
    println!("{:20} {:>6} {:>9} {:>9} {:>7} {:>7}", "", "number", "RMS, m", "said, m", "ratio", "median");
    for (name, found) in score(&map, &evidence, &truth, &built, &exact) {
        println!(
            "{name:20} {:>6} {:>9.3} {:>9.3} {:>7.2} {:>7.2}",
            found.count, found.rms_m, found.said_m, found.ratio, found.median_ratio
        );
    }
    Ok(())
}
