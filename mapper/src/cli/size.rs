//! `mapper size`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use common::map::atlas::is_atlas;
use common::output::print_note;
use serde::Serialize;

use super::{ConfigArgs, Outcome, print, print_json};
use crate::atlas::AtlasInspection;
use crate::budget::{Accuracy, Counts, Detail, Figure, Stored, reduce};
use crate::config::Config;
use crate::error::{Error, Result};
use crate::inspect::Inspection;

/// Say how large a map is; or how well it would localize within fewer bytes.
#[derive(Debug, Args)]
pub struct Size {
    /// The map.
    #[arg(value_name = "MAP.csm", required_unless_present = "print_config")]
    map: Option<PathBuf>,
    /// Most bytes that the map may have; exit with 1 if it has more.
    #[arg(long, value_name = "BYTES", conflicts_with = "json")]
    budget: Option<usize>,
    /// Print how well the map is expected to localize within 512, 1,024,
    /// 2,048 and 4,096 bytes, and whole.
    #[arg(long)]
    curve: bool,
    /// With --curve: other sizes, bytes, separated by commas.
    #[arg(long, value_name = "BYTES,..", value_delimiter = ',', requires = "curve")]
    at: Vec<usize>,
    /// With --curve: settings that differ from the defaults, as TOML.
    #[arg(long, value_name = "FILE.toml", requires = "curve")]
    config: Option<PathBuf>,
    /// With --curve: print all settings as TOML and end.
    #[arg(long, requires = "curve")]
    print_config: bool,
    /// With --curve: print JSON.
    #[arg(long, requires = "curve")]
    json: bool,
}

/// The sizes that are looked at, bytes.
const SIZES: [usize; 4] = [512, 1024, 2048, 4096];

/// One size of the curve.
#[derive(Debug, Clone, Serialize)]
pub struct CurveRow {
    /// Most bytes that the map may have; none for the whole map.
    pub budget_bytes: Option<usize>,
    /// The map within it; none where the roads alone take more.
    pub map: Option<CurveMap>,
}

/// The map of one size.
#[derive(Debug, Clone, Serialize)]
pub struct CurveMap {
    /// Its bytes.
    pub bytes: usize,
    /// Its landmarks.
    pub kept: Counts,
    /// How finely it is written.
    pub detail: Detail,
    /// How well it is expected to localize.
    pub predicted: Accuracy,
}

impl Size {
    /// Runs the command.
    pub fn run(&self) -> Result<Outcome> {
        let settings = ConfigArgs { config: self.config.clone(), print_config: self.print_config };
        // The command line lets the map be absent with `--print-config` only.
        let Some((config, map)) = settings.load(Config::load)?.zip(self.map.as_ref()) else {
            return Ok(Outcome::Done);
        };
        // The whole map is read: a damaged one has no size worth telling.
        let bytes = if is_atlas(map)? {
            AtlasInspection::of_file(map)?.bytes as usize
        } else {
            Inspection::of_file(map)?.bytes
        };
        if self.curve {
            let stored = Stored::read(map, &config)?;
            let rows = self.rows(&stored)?;
            if self.json {
                // The rows alone are the document.
                stored.note.iter().for_each(print_note);
                print_json(&rows)?;
            } else {
                let note = stored.note.map_or_else(String::new, |note| note + "\n");
                print(&format!("{}: {bytes} bytes\n{note}{}", map.display(), table(&rows)));
            }
        } else if self.budget.is_none() {
            print(&format!("{}: {bytes} bytes\n", map.display()));
        }
        Ok(self.budget.map_or(Outcome::Done, |budget| within(map, bytes, budget)))
    }

    fn rows(&self, stored: &Stored) -> Result<Vec<CurveRow>> {
        let sizes: &[usize] = if self.at.is_empty() { &SIZES } else { &self.at };
        let sizes = sizes.iter().copied().map(Some).chain([None]);
        let row = |budget_bytes: Option<usize>| {
            let map = match reduce(stored.known(), budget_bytes.unwrap_or(usize::MAX), &stored.config) {
                Ok(reduced) => Some(CurveMap {
                    bytes: reduced.bytes.len(),
                    kept: Counts::of(&reduced.map),
                    detail: reduced.detail,
                    predicted: reduced.predicted,
                }),
                Err(Error::BudgetTooSmall { .. }) => None,
                Err(error) => return Err(error),
            };
            Ok(CurveRow { budget_bytes, map })
        };
        sizes.map(row).collect()
    }
}

fn within(map: &Path, bytes: usize, budget: usize) -> Outcome {
    if bytes > budget {
        print(&format!("{}: {bytes} bytes, {} over the budget of {budget}\n", map.display(), bytes - budget));
        return Outcome::Failed;
    }
    print(&format!("{}: {bytes} bytes, {} left of {budget}\n", map.display(), budget - bytes));
    Outcome::Done
}

/// The curve as a table.
fn table(rows: &[CurveRow]) -> String {
    let mut out = String::from(
        "expected standard deviations along the roads, median and at the worst place\n\
         budget   bytes  poles  signs  lanes  quantum m     sideways m      forward m    heading deg\n",
    );
    for row in rows {
        let budget = row.budget_bytes.map_or_else(|| "all".to_owned(), |bytes| bytes.to_string());
        // Writing to a string cannot fail.
        let _ = match &row.map {
            None => writeln!(out, "{budget:>6}  the roads alone take more"),
            Some(map) => {
                let pair = |figure: Figure, scale: f64| {
                    format!("{:>7.3} {:>6.3}", figure.median * scale, figure.worst * scale)
                };
                writeln!(
                    out,
                    "{budget:>6} {:>7} {:>6} {:>6} {:>6} {:>10} {} {} {}",
                    map.bytes,
                    map.kept.poles,
                    map.kept.signs,
                    map.kept.lanes,
                    map.detail.quantum_m,
                    pair(map.predicted.lateral_m, 1.0),
                    pair(map.predicted.longitudinal_m, 1.0),
                    pair(map.predicted.heading_rad, 1_f64.to_degrees()),
                )
            }
        };
    }
    out
}
