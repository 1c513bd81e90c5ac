//! `mapper merge`.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use common::config::load_or_default;
use common::map::EncodeOptions;
use serde::Serialize;

use super::usage::peak_bytes;
use super::{ConfigArgs, Outcome, print, print_json};
use crate::error::Result;
use crate::frames::OneFrame;
use crate::inspect::{count_text, road_length_m};
use crate::merge::{LIMITS, MergeConfig, MergeReport, Sources, merge, path_beside};
use crate::outputs;

/// Merge maps of one area into one.
///
/// All maps have to be in one frame up to what surveys differ by: 2 m and a
/// degree. What several maps have becomes one landmark with a better position;
/// what most of the maps that came near do not have is dropped. The maps that
/// it was made of are kept beside the merged map (area.sources beside
/// area.csm), so that merging in other steps or another order gives the same
/// bytes.
#[derive(Debug, Args)]
pub struct Merge {
    /// The maps; of a merged one those that it was made of.
    #[arg(value_name = "MAP.csm", required_unless_present = "print_config")]
    maps: Vec<PathBuf>,
    /// The map to write.
    #[arg(long, value_name = "AREA.csm", required_unless_present = "print_config")]
    out: Option<PathBuf>,
    #[command(flatten)]
    config: ConfigArgs,
    /// Print the summary as JSON.
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary {
    map: PathBuf,
    bytes: usize,
    sources: PathBuf,
    /// Maps that were given more than once.
    repeated: usize,
    /// What was passed over.
    notes: Vec<String>,
    wall_s: f64,
    peak_bytes: Option<u64>,
    #[serde(flatten)]
    report: MergeReport,
}

impl Merge {
    /// Runs the command.
    pub fn run(&self) -> Result<Outcome> {
        // The command line lets `--out` be absent with `--print-config` only.
        let Some((config, out)) =
            self.config.load(|file| Ok(load_or_default::<MergeConfig>(file, LIMITS)?))?.zip(self.out.as_ref())
        else {
            return Ok(Outcome::Done);
        };
        // One of the maps may be the one that grows.
        outputs::check(&[("--out", &**out), ("the sources beside the map", &*path_beside(out))], self.config.file())?;
        let started = Instant::now();
        let mut sources = Sources::default();
        let (mut repeated, mut notes, mut frame) = (0, Vec::new(), OneFrame::default());
        for path in &self.maps {
            let added = sources.add_file(path)?;
            frame.add(path, added.frame)?;
            repeated += added.repeated;
            notes.extend(added.note);
        }
        let merged = merge(&sources.read()?, &config);
        // One map alone stays as it is, to the byte.
        let bytes = match sources.only() {
            Some(bytes) => bytes.to_vec(),
            None => merged.map.encode(&EncodeOptions { quantum_m: merged.report.quantum_m })?,
        };
        sources.write(out, &bytes)?;
        let wall_s = started.elapsed().as_secs_f64();
        if self.json {
            print_json(&Summary {
                map: out.clone(),
                bytes: bytes.len(),
                sources: path_beside(out),
                repeated,
                notes,
                wall_s,
                peak_bytes: peak_bytes(),
                report: merged.report,
            })?;
            return Ok(Outcome::Done);
        }
        for note in &notes {
            print(&format!("{note}\n"));
        }
        if repeated > 0 {
            let which = if repeated == 1 { "one map was" } else { "some maps were" };
            print(&format!("{which} given more than once and counted once\n"));
        }
        print(&merged.report.text());
        let road_m = road_length_m(&merged.map);
        let counts = count_text(&merged.map);
        print(&format!("{}: {} bytes for {road_m:.0} m of road: {counts}\n", out.display(), bytes.len()));
        Ok(Outcome::Done)
    }
}
