//! Scores a map against the truth of the generated drive that it was built
//! from.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use waymark_tests::map_score::{Found, MapScore, alignment, moved, score};

/// Scores a map against the truth of the generated drive that it was built
/// from: recall, precision and errors by class.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    /// The map.
    #[arg(long, value_name = "MAP.csm")]
    map: PathBuf,
    /// The drive, from `fixtures generate --out`.
    #[arg(long, value_name = "ROOT")]
    drive: PathBuf,
    /// The poses that it was built with, from `mapper build --trajectory`: map
    /// and truth are then aligned by them (rigidly), as a survey that drifts
    /// gives a map that lies elsewhere.
    #[arg(long, value_name = "POSES.txt")]
    trajectory: Option<PathBuf>,
    /// What is farther from the driven path does not count, metres.
    #[arg(long, value_name = "M", default_value_t = 20.0)]
    within: f64,
    /// Name each pole that is missing or wrong.
    #[arg(long)]
    list: bool,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), String> {
    let map = common::map::read(&arguments.map).map_err(|error| error.to_string())?;
    let exact =
        common::kitti::read_poses(arguments.drive.join("truth/poses.txt")).map_err(|error| error.to_string())?;
    let truth = waymark_tests::truth::read(&arguments.drive)?;
    let map = match &arguments.trajectory {
        Some(path) => {
            let built = common::kitti::read_poses(path).map_err(|error| error.to_string())?;
            moved(&map, &alignment(&built, &exact))
        }
        None => map,
    };
    let score = score(&map, &truth, &exact, arguments.within);
    print(&score, arguments);
    Ok(())
}

fn print(score: &MapScore, arguments: &Arguments) {
    println!("{} within {} m of the path", arguments.map.display(), arguments.within);
    println!("{:14} {:>7} {:>9} {:>8} {:>10}  ", "", "recall", "precision", "true", "off, m RMS");
    let row = |name: &str, found: &Found, unit: &str| {
        let (recall, precision) = (found.recall(), found.precision());
        println!("{name:14} {recall:7.3} {precision:9.3} {:8.0} {:10.3}  {unit}", found.wanted, found.off_m);
    };
    row("poles", &score.poles, "feet, from above");
    row("signs", &score.signs, "centroids");
    row("lights", &score.lights, "centroids");
    row("lanes", &score.lanes, "across; true: metres");
    println!(
        "poles: feet {:.3} m RMS in height, tilt {:.2} degrees RMS",
        score.foot_height_m,
        score.tilt_rad.to_degrees()
    );
    if arguments.list {
        for pole in &score.missed {
            let [x, _, z] = pole.foot_map_m;
            println!("missed x {x:8.2}  z {z:8.2}  {}", pole.kind);
        }
        for pole in &score.wrong {
            println!("wrong  x {:8.2}  z {:8.2}  {}", pole.foot_map.x, pole.foot_map.z, pole.kind.name());
        }
    }
}
