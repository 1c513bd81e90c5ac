//! The command line.

mod atlas;
mod build;
mod diff;
mod export;
mod merge;
mod reduce;
mod settings;
mod size;
mod source;
pub mod usage;
mod validate;
mod views;

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use common::output::print;

use crate::error::Result;

pub use settings::ConfigArgs;

/// Exit status after a check that says no.
const FAILED: u8 = 1;
/// Exit status after a wrong command line or input.
const USAGE: u8 = 2;

/// Builds compact semantic maps from lidar scans, and shows what is in them.
#[derive(Debug, Parser)]
#[command(name = "mapper", version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Build a map from the scans and the survey of a drive.
    Build(Box<build::Build>),
    /// Say what is in a map, which bytes it takes, and how it was built.
    Inspect(Inspect),
    /// Say how large a map is, exit with 1 if it is over the budget; or how
    /// well it would localize within fewer bytes.
    Size(size::Size),
    /// Write a map within a budget of bytes: of its landmarks those that
    /// localize best.
    Reduce(reduce::Reduce),
    /// Print a map as text, one landmark per line.
    Ascii(MapFile),
    /// Put maps into one file, of which a localizer loads what is around it.
    Atlas(atlas::MakeAtlas),
    /// Draw a map from above.
    Draw(Draw),
    /// Write a map as GeoJSON, Lanelet2 OSM, CSV, or the paper's text.
    Export(export::Export),
    /// Merge maps of one area into one.
    Merge(merge::Merge),
    /// Say what changed from one map to another; exit with 1 if anything did.
    Diff(diff::Diff),
    /// Ask what a careful reader of a map would ask; exit with 1 if there is anything.
    Validate(validate::Validate),
}

#[derive(Debug, Args)]
struct MapFile {
    /// The map.
    #[arg(value_name = "MAP.csm")]
    map: PathBuf,
}

#[derive(Debug, Args)]
struct Inspect {
    #[command(flatten)]
    file: MapFile,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct Draw {
    #[command(flatten)]
    file: MapFile,
    /// The picture to write.
    #[arg(long, value_name = "MAP.svg")]
    out: PathBuf,
}

/// How a command ended that met no error.
enum Outcome {
    /// What was asked for is done.
    Done,
    /// What was checked is not as it should be.
    Failed,
}

/// A distance on the command line, metres.
fn distance_m(text: &str) -> std::result::Result<f64, String> {
    let metres = text.parse().ok().filter(|metres: &f64| (0.0..1e9).contains(metres));
    metres.ok_or_else(|| "it is no distance in metres".into())
}

/// A size on the command line, bytes.
fn some_bytes(text: &str) -> std::result::Result<usize, String> {
    text.parse().ok().filter(|bytes| *bytes > 0).ok_or_else(|| "it is no number of bytes from 1 on".into())
}

/// Runs the command line (program name first) and says how it went: 0; 1 if a
/// check says no; or 2 after a wrong command line or input, with one line on
/// the error stream.
pub fn run<I, T>(args: I) -> ExitCode
where
    I: IntoIterator<Item = T>,
    T: Into<OsString> + Clone,
{
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(error) => {
            let printed = error.print();
            if error.use_stderr() {
                // Nobody is left to tell where that fails.
                return ExitCode::from(USAGE);
            }
            // Help and version come this way, too.
            common::output::written(printed);
            return common::output::ended(ExitCode::SUCCESS);
        }
    };
    let outcome = match &cli.command {
        Command::Build(arguments) => arguments.run(),
        Command::Inspect(arguments) => views::inspect(&arguments.file.map, arguments.json),
        Command::Size(arguments) => arguments.run(),
        Command::Reduce(arguments) => arguments.run(),
        Command::Ascii(arguments) => views::ascii(&arguments.map),
        Command::Atlas(arguments) => arguments.run(),
        Command::Draw(arguments) => views::draw(&arguments.file.map, &arguments.out),
        Command::Export(arguments) => arguments.run(),
        Command::Merge(arguments) => arguments.run(),
        Command::Diff(arguments) => arguments.run(),
        Command::Validate(arguments) => arguments.run(),
    };
    common::output::ended(match outcome {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Failed) => ExitCode::from(FAILED),
        Err(error) => {
            common::output::print_error(error);
            ExitCode::from(USAGE)
        }
    })
}

/// Prints a value as JSON.
fn print_json<T: serde::Serialize>(value: &T) -> Result<()> {
    let text = serde_json::to_string_pretty(value).map_err(crate::Error::Json)?;
    print(&(text + "\n"));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_distance_is_none_of_what_no_map_is_apart() {
        assert!(distance_m("0.1").is_ok_and(|metres| (metres - 0.1).abs() < 1e-12) && distance_m("0").is_ok());
        for none in ["nan", "-1", "inf", "1e300", "far"] {
            assert!(distance_m(none).is_err(), "{none}");
        }
    }

    #[test]
    fn a_tile_of_no_bytes_is_none() {
        assert_eq!(some_bytes("8192"), Ok(8192));
        for none in ["0", "-1", "1.5", "many"] {
            assert!(some_bytes(none).is_err(), "{none}");
            let words = ["mapper", "atlas", "a.csm", "--out", "a.csa", &format!("--tile-bytes={none}")];
            assert!(Cli::try_parse_from(words).is_err(), "{none}");
        }
    }
}
