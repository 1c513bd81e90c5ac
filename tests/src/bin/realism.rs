//! Is a generated drive as hard as a real one? Tables of both, side by side.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use waymark_tests::cli::ended;
use waymark_tests::realism::{features, scans};

/// Generated drives side by side with real ones: every figure of both, and how
/// far apart they are.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Lidar scans: points, ground, ranges, poles, paint, walls.
    Scans(scans::Arguments),
    /// Label images: regions, landmarks found, false ones, line fits.
    Features(features::Arguments),
}

fn main() -> ExitCode {
    ended(match Arguments::parse().what {
        What::Scans(arguments) => scans::run(&arguments),
        What::Features(arguments) => features::run(&arguments),
    })
}
