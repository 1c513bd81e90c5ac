//! The three programs in one, chosen by the first argument: so that the tests
//! of the whole run real command lines in processes of their own.

use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1).peekable();
    let program = arguments.peek().cloned().unwrap_or_default();
    match program.to_str() {
        Some("fixtures") => fixtures::cli::run(arguments),
        Some("mapper") => mapper::cli::run(arguments),
        Some("localizer") => localizer::cli::run(arguments),
        _ => {
            eprintln!("usage: tool fixtures|mapper|localizer ..");
            ExitCode::from(2)
        }
    }
}
