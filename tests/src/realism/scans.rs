//! Lidar scans side by side.

/// What to compare.
#[derive(Debug, clap::Args)]
pub struct Arguments {}

/// Prints the table.
///
/// # Errors
/// One sentence that says which input is wrong.
pub fn run(_arguments: &Arguments) -> Result<(), String> {
    Ok(())
}
