//! `mapper validate`.

use std::path::PathBuf;

use clap::Args;
use common::config::load_or_default;

use super::{ConfigArgs, Outcome, print, print_json};
use crate::error::Result;
use crate::extent;
use crate::validate::{LIMITS, ValidateConfig, text, validate};

/// Ask what a careful reader of a map would ask, one line for each finding;
/// exit with 1 if there is any.
#[derive(Debug, Args)]
pub struct Validate {
    /// The map.
    #[arg(value_name = "MAP.csm", required_unless_present = "print_config")]
    map: Option<PathBuf>,
    #[command(flatten)]
    config: ConfigArgs,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Validate {
    /// Runs the command.
    pub fn run(&self) -> Result<Outcome> {
        // The command line lets the map be absent with `--print-config` only.
        let Some((config, map)) =
            self.config.load(|file| Ok(load_or_default::<ValidateConfig>(file, LIMITS)?))?.zip(self.map.as_ref())
        else {
            return Ok(Outcome::Done);
        };
        let findings = validate(&extent::read(map)?, &config);
        if self.json {
            print_json(&findings)?;
        } else {
            print(&text(&findings));
        }
        Ok(if findings.is_empty() { Outcome::Done } else { Outcome::Failed })
    }
}
