//! `mapper validate`.

use std::path::PathBuf;

use clap::Args;
use common::config::{self, load_within};

use super::{Outcome, print, print_json};
use crate::error::Result;
use crate::validate::{LIMITS, ValidateConfig, text, validate};

/// Ask what a careful reader of a map would ask, one line for each finding;
/// exit with 1 if there is any.
#[derive(Debug, Args)]
pub struct Validate {
    /// The map.
    #[arg(value_name = "MAP.csm", required_unless_present = "print_config")]
    map: Option<PathBuf>,
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

impl Validate {
    /// Runs the command.
    pub fn run(&self) -> Result<Outcome> {
        let load = |file| load_within(file, LIMITS);
        let config: ValidateConfig = self.config.as_ref().map_or_else(|| Ok(ValidateConfig::default()), load)?;
        let Some(map) = self.map.as_ref().filter(|_| !self.print_config) else {
            print(&config::to_toml(&config)?);
            return Ok(Outcome::Done);
        };
        let findings = validate(&common::map::read(map)?, &config);
        if self.json {
            print_json(&findings)?;
        } else {
            print(&text(&findings));
        }
        Ok(if findings.is_empty() { Outcome::Done } else { Outcome::Failed })
    }
}
