//! The program `localizer`; everything it does is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    localizer::cli::run(std::env::args_os())
}
