//! `mapper reduce`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use super::{ConfigArgs, Outcome, print, print_json};
use crate::budget::{Accuracy, Counts, Detail, Stored, reduce};
use crate::config::Config;
use crate::error::Result;
use crate::outputs;
use crate::report::{BuildReport, checksum, path_beside, write_with_map};

/// Write a map within a budget of bytes: of its landmarks those that localize
/// best.
#[derive(Debug, Args)]
pub struct Reduce {
    /// The map. The report of its build beside it says how well each landmark
    /// is known; without one all count as known alike.
    #[arg(value_name = "MAP.csm", required_unless_present = "print_config")]
    map: Option<PathBuf>,
    /// Most bytes that the smaller map may have.
    #[arg(long, value_name = "BYTES", required_unless_present = "print_config")]
    budget: Option<usize>,
    /// The smaller map to write.
    #[arg(long, value_name = "SMALL.csm", required_unless_present = "print_config")]
    out: Option<PathBuf>,
    #[command(flatten)]
    config: ConfigArgs,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary<'a> {
    map: &'a Path,
    bytes: usize,
    kept: Counts,
    of: Counts,
    detail: Detail,
    predicted: Accuracy,
    notes: Vec<String>,
}

impl Reduce {
    /// Runs the command.
    pub fn run(&self) -> Result<Outcome> {
        let config = self.config.load(Config::load)?;
        // The command line lets the others be absent with `--print-config` only.
        let (Some(config), Some(map), Some(budget), Some(out)) = (config, &self.map, self.budget, &self.out) else {
            return Ok(Outcome::Done);
        };
        let [of_map, of_out] = [map, out].map(|map| path_beside(map));
        let outputs = [("--out", &**out), ("the report beside the map", &*of_out)];
        outputs::check(&outputs, [&**map, &*of_map].into_iter().chain(self.config.file()))?;
        let stored = Stored::read(map, &config)?;
        let reduced = reduce(stored.known(), budget, &stored.config)?;
        let notes: Vec<String> = stored.note.into_iter().collect();
        let report = stored.report.map(|report| BuildReport {
            map_bytes: reduced.bytes.len(),
            map_crc32c: checksum(&reduced.bytes),
            evidence: reduced.evidence,
            ..report
        });
        write_with_map(out, &reduced.bytes, report.as_ref())?;
        let (kept, of) = (Counts::of(&reduced.map), Counts::of(&stored.map));
        let (bytes, detail, predicted) = (reduced.bytes.len(), reduced.detail, reduced.predicted);
        if self.json {
            print_json(&Summary { map: out, bytes, kept, of, detail, predicted, notes })?;
            return Ok(Outcome::Done);
        }
        print(&format!("{}: {bytes} bytes of {}\n{}", out.display(), stored.bytes, kept_text(kept, of)));
        for note in &notes {
            print(&format!("{note}\n"));
        }
        print(&format!(
            "expected along the roads: {:.2} m sideways, {:.2} m forward, {:.2} degrees of heading (at the worst place {:.2}, {:.2}, {:.2})\n",
            predicted.lateral_m.median,
            predicted.longitudinal_m.median,
            predicted.heading_rad.median.to_degrees(),
            predicted.lateral_m.worst,
            predicted.longitudinal_m.worst,
            predicted.heading_rad.worst.to_degrees(),
        ));
        Ok(Outcome::Done)
    }
}

/// How many landmarks were kept, as a line of text.
pub fn kept_text(kept: Counts, of: Counts) -> String {
    format!(
        "kept {} of {} poles, {} of {} signs, {} of {} lane lines\n",
        kept.poles, of.poles, kept.signs, of.signs, kept.lanes, of.lanes
    )
}
