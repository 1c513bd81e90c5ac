//! `mapper reduce`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use super::{Outcome, print, print_json};
use crate::budget::{Accuracy, Counts, Detail, Stored, reduce};
use crate::error::Result;
use crate::outputs;
use crate::report::{BuildReport, checksum, path_beside, write_with_map};

/// Write a map within a budget of bytes: of its landmarks those that localize
/// best.
#[derive(Debug, Args)]
pub struct Reduce {
    /// The map. The report of its build beside it says how well each landmark
    /// is known; without one all count as known alike.
    #[arg(value_name = "MAP.csm")]
    map: PathBuf,
    /// Most bytes that the smaller map may have.
    #[arg(long, value_name = "BYTES")]
    budget: usize,
    /// The smaller map to write.
    #[arg(long, value_name = "SMALL.csm")]
    out: PathBuf,
    /// Settings that differ from the defaults, as TOML, in `[budget]`.
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
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
        let [of_map, of_out] = [&self.map, &self.out].map(|map| path_beside(map));
        let outputs = [("--out", &*self.out), ("the report beside the map", &*of_out)];
        outputs::check(&outputs, [&*self.map, &*of_map].into_iter().chain(self.config.as_deref()))?;
        let stored = Stored::read(&self.map, self.config.as_deref())?;
        let reduced = reduce(stored.known(), self.budget, &stored.config)?;
        let notes: Vec<String> = stored.note.into_iter().collect();
        let report = stored.report.map(|report| BuildReport {
            map_bytes: reduced.bytes.len(),
            map_crc32c: checksum(&reduced.bytes),
            evidence: reduced.evidence,
            ..report
        });
        write_with_map(&self.out, &reduced.bytes, report.as_ref())?;
        let (kept, of) = (Counts::of(&reduced.map), Counts::of(&stored.map));
        let (bytes, detail, predicted) = (reduced.bytes.len(), reduced.detail, reduced.predicted);
        if self.json {
            print_json(&Summary { map: &self.out, bytes, kept, of, detail, predicted, notes })?;
            return Ok(Outcome::Done);
        }
        print(&format!("{}: {bytes} bytes of {}\n{}", self.out.display(), stored.bytes, kept_text(kept, of)));
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
