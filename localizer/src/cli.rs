//! The command line: `run`, `live`, `trial`, `segment`, `motion`, `eval`.

mod earth;
mod eval;
pub mod input;
mod live;
mod motion;
mod run;
mod segment;
mod trial;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use crate::config::{Config, LIMITS};
use crate::{Error, Result};

/// Localizes a camera against a compact semantic map.
#[derive(Debug, Parser)]
#[command(name = "localizer", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Localize the frames of a drive.
    Run(run::RunArgs),
    /// Localize images as they come, in a vehicle: lines in, lines out.
    Live(live::LiveArgs),
    /// Localize a drive from many simulated GPS starts, with both methods.
    Trial(trial::TrialArgs),
    /// Write the networks' probabilities as images, for `--labels`.
    Segment(segment::SegmentArgs),
    /// Say how fast the camera drove and turned, from the images alone.
    Motion(motion::MotionArgs),
    /// Score estimates against true poses, without alignment.
    Eval(eval::EvalArgs),
}

/// Where the settings come from.
#[derive(Debug, Clone, Default, Args)]
pub struct ConfigArgs {
    /// TOML file with what differs from the defaults.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Print all settings as TOML and stop.
    #[arg(long)]
    print_config: bool,
}

impl ConfigArgs {
    /// The settings; none where they were to be printed, and are.
    ///
    /// # Errors
    /// As [`common::config::load_within`].
    pub fn load(&self) -> Result<Option<Config>> {
        let config: Config = common::config::load_or_default(self.config.as_deref(), LIMITS)?;
        if self.print_config {
            common::output::print(&common::config::to_toml(&config)?);
            return Ok(None);
        }
        Ok(Some(config))
    }
}

/// Runs the program with these arguments (the first is its name): 0 where all
/// went well, 1 where a check failed, 2 on wrong usage or input.
pub fn run(args: impl IntoIterator<Item = std::ffi::OsString>) -> ExitCode {
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are no errors.
            let printed = error.print();
            if error.use_stderr() {
                return ExitCode::from(2);
            }
            // Help and version are no errors.
            common::output::written(printed);
            return common::output::ended(ExitCode::SUCCESS);
        }
    };
    common::output::ended(match dispatch(&cli.command) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            common::output::print_error(error);
            ExitCode::from(2)
        }
    })
}

/// Runs a command: false where a check of it failed.
fn dispatch(command: &Command) -> Result<bool> {
    match command {
        Command::Run(args) => run::execute(args),
        Command::Live(args) => live::execute(args),
        Command::Trial(args) => trial::execute(args),
        Command::Segment(args) => segment::execute(args),
        Command::Motion(args) => motion::execute(args),
        Command::Eval(args) => eval::execute(args),
    }
}

/// The value of an option that `--print-config` alone may leave out.
fn required<T>(value: Option<&T>, option: &'static str) -> Result<T>
where
    T: Clone,
{
    value.cloned().ok_or(Error::MissingOption { option })
}

#[cfg(test)]
mod tests;
