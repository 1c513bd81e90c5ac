//! `mapper diff`.

use std::path::PathBuf;

use clap::Args;
use common::config;

use super::{Outcome, print, print_json};
use crate::diff::{DiffConfig, LIMITS, MapDiff};
use crate::error::Result;

/// Say what changed from one map to another, one line for each landmark; exit
/// with 1 if anything did.
///
/// Both maps have to be in one frame; `mapper merge` aligns maps, this command
/// does not.
#[derive(Debug, Args)]
pub struct Diff {
    /// The map before.
    #[arg(value_name = "OLD.csm", required_unless_present = "print_config")]
    old: Option<PathBuf>,
    /// The map after.
    #[arg(value_name = "NEW.csm", required_unless_present = "print_config")]
    new: Option<PathBuf>,
    /// What has not moved by more than this is where it was, metres [default:
    /// 0.1, what two builds of one drive differ by].
    #[arg(long, value_name = "M", value_parser = super::distance_m)]
    same: Option<f64>,
    /// Settings that differ from the defaults, as TOML.
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Print all settings as TOML and end.
    #[arg(long)]
    print_config: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Diff {
    /// Runs the command.
    pub fn run(&self) -> Result<Outcome> {
        let read = |path| config::load_within(path, LIMITS);
        let mut config = self.config.as_ref().map_or_else(|| Ok(DiffConfig::default()), read)?;
        config.same_m = self.same.unwrap_or(config.same_m);
        // The command line lets them be absent with --print-config only.
        let Some((old, new)) = self.old.as_ref().zip(self.new.as_ref()).filter(|_| !self.print_config) else {
            print(&config::to_toml(&config)?);
            return Ok(Outcome::Done);
        };
        let diff = MapDiff::of(&common::map::read(old)?, &common::map::read(new)?, &config);
        if self.json {
            print_json(&diff)?;
        } else {
            print(&diff.text());
        }
        Ok(if diff.is_empty() { Outcome::Done } else { Outcome::Failed })
    }
}
