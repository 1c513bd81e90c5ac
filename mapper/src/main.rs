//! Builds compact semantic maps from lidar scans.

use std::process::ExitCode;

fn main() -> ExitCode {
    mapper::cli::run(std::env::args_os())
}
