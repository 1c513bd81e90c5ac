//! Scores the poles of a map of KITTI against the pole map of its sequence.

use std::path::Path;
use std::process::ExitCode;

use clap::Parser;
use waymark_tests::cli::{MapOfSequence, Outcome, ended};
use waymark_tests::pole_map::{BESIDE_PATH_M, Score, WITHIN_M, score};

/// Scores the poles of a map of KITTI against the pole map of its sequence
/// (`pole_maps/NN.csv` beside `sequences/`, and `poses_semantickitti.txt` in
/// the sequence): recall, precision, each miss and each false one.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    of: MapOfSequence,
}

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(Arguments { of }: &Arguments) -> Outcome {
    let (map, trajectory) = of.read()?;
    let score = score(&map, &trajectory, &of.kitti, &of.sequence)?;
    print(&score, &map, &of.map);
    Ok(())
}

fn print(score: &Score, map: &common::map::SemanticMap, path: &Path) {
    let found = score.found.len();
    common::say!(
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
        common::say!("missed    x {:7.2}  z {:7.2}  row {} of the reference", missed.at.x, missed.at.y, missed.row + 1);
    }
    for pole in score.wrong.iter().map(|&i| &map.poles[i]) {
        let foot = pole.foot_map;
        common::say!("not in it x {:7.2}  z {:7.2}  {} of {:.1} m", foot.x, foot.z, pole.kind.name(), pole.length_m());
    }
}
