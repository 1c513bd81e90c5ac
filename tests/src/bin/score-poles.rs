//! Scores the poles of a map of KITTI against the pole map of its sequence.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use common::Result;
use waymark_tests::pole_map::{BESIDE_PATH_M, Score, WITHIN_M, score};

/// Scores the poles of a map of KITTI against the pole map of its sequence:
/// recall, precision, each miss and each false one.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    /// The map.
    #[arg(long, value_name = "MAP.csm")]
    map: PathBuf,
    /// The poses that it was built with, from `mapper build --trajectory`.
    #[arg(long, value_name = "POSES.txt")]
    trajectory: PathBuf,
    /// Folder with `sequences/` and `pole_maps/`; the sequence needs its
    /// `poses_semantickitti.txt`.
    #[arg(long, value_name = "ROOT")]
    kitti: PathBuf,
    /// The sequence.
    #[arg(long, value_name = "NN")]
    sequence: String,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> Result<()> {
    let map = common::map::read(&arguments.map)?;
    let trajectory = common::kitti::read_poses(&arguments.trajectory)?;
    let score = score(&map, &trajectory, &arguments.kitti, &arguments.sequence)?;
    print(&score, &map, &arguments.map);
    Ok(())
}

fn print(score: &Score, map: &common::map::SemanticMap, path: &Path) {
    let found = score.found.len();
    println!(
        "{}: within {BESIDE_PATH_M} m of the path, one-to-one within {WITHIN_M} m:\n\
         recall    {:.3} ({found} of {} reference poles)\n\
         precision {:.3} ({found} of {} poles of the map)",
        path.display(),
        score.recall(),
        found + score.missed.len(),
        score.precision(),
        found + score.wrong.len(),
    );
    for missed in &score.missed {
        println!("missed    x {:7.2}  z {:7.2}  row {} of the reference", missed.at.x, missed.at.y, missed.row + 1);
    }
    for pole in score.wrong.iter().map(|&i| &map.poles[i]) {
        let foot = pole.foot_map;
        println!("not in it x {:7.2}  z {:7.2}  {} of {:.1} m", foot.x, foot.z, pole.kind.name(), pole.length_m());
    }
}
