//! `mapper diff`.

use std::path::{Path, PathBuf};

use clap::Args;
use common::config::load_or_default;
use common::map::SemanticMap;

use super::{ConfigArgs, Outcome, print, print_json};
use crate::diff::{DiffConfig, LIMITS, MapDiff};
use crate::error::Result;
use crate::extent;
use crate::frames::{self, OneFrame};

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
    #[command(flatten)]
    config: ConfigArgs,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Diff {
    /// Runs the command.
    pub fn run(&self) -> Result<Outcome> {
        let config = self.config.load(|file| {
            let config: DiffConfig = load_or_default(file, LIMITS)?;
            Ok(DiffConfig { same_m: self.same.unwrap_or(config.same_m), ..config })
        })?;
        // The command line lets the maps be absent with `--print-config` only.
        let (Some(config), Some(old), Some(new)) = (config, &self.old, &self.new) else {
            return Ok(Outcome::Done);
        };
        let mut frame = OneFrame::default();
        let diff = MapDiff::of(&read(old, &mut frame)?, &read(new, &mut frame)?, &config);
        if self.json {
            print_json(&diff)?;
        } else {
            print(&diff.text());
        }
        Ok(if diff.is_empty() { Outcome::Done } else { Outcome::Failed })
    }
}

/// A map of the same frame as those before it. What is no file is read but once.
fn read(path: &Path, frame: &mut OneFrame) -> Result<SemanticMap> {
    let bytes = std::fs::read(path).map_err(common::Error::io(path))?;
    let map = SemanticMap::decode(&bytes).map_err(common::Error::in_file(path))?;
    extent::check(&map, &path.display().to_string())?;
    frame.add(path, frames::beside(path, &bytes))?;
    Ok(map)
}
