//! Figures of the paper's own kind, as tables to be drawn.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use common::atomic_file;
use waymark_tests::cli::{Outcome, ended};
use waymark_tests::figures::{Matched, correspondences, errors};
use waymark_tests::trial::LookArgs;

/// Localizes a drive and writes `correspondences.csv` (Fig. 9 of the paper),
/// `iterations.csv` (Fig. 13), `errors.csv` (Fig. 14) and `terrain.csv`
/// (Fig. 15).
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    of: LookArgs,
    /// The frame whose cost is looked at [default: the one in the middle].
    #[arg(long, value_name = "F")]
    frame: Option<usize>,
    /// Output folder; is created.
    #[arg(long, value_name = "DIR", required_unless_present = "print_config")]
    out: Option<PathBuf>,
}

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Outcome {
    arguments.out.as_ref().map(atomic_file::check_folder).transpose()?;
    let Some((trial, out)) = arguments.of.read()?.zip(arguments.out.as_ref()) else { return Ok(()) };
    let results = trial.run()?;
    if results.is_empty() {
        return Err(localizer::Error::NothingLocalized.into());
    }
    let middle = results.get(results.len() / 2).map(|result| result.frame);
    let frame = arguments.frame.or(middle).unwrap_or(0);
    let result = results.iter().find(|result| result.frame == frame);
    let result = result.ok_or_else(|| format!("frame {frame} was not localized; give another with `--frame`"))?;
    let matched = Matched::new(&trial, result)?
        .ok_or_else(|| format!("nothing is matched in frame {frame}; give another with `--frame`"))?;
    std::fs::create_dir_all(out).map_err(|source| common::Error::Io { path: out.clone(), source })?;
    atomic_file::write(out.join("correspondences.csv"), correspondences(&results).as_bytes())?;
    atomic_file::write(out.join("iterations.csv"), matched.iterations().as_bytes())?;
    atomic_file::write(out.join("errors.csv"), errors(&results, &trial.errors(&results)).as_bytes())?;
    atomic_file::write(out.join("terrain.csv"), matched.terrain().as_bytes())?;
    common::say!("{} frames, frame {frame} looked at; written to {}", results.len(), out.display());
    Ok(())
}
