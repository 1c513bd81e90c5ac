//! What comes of a drive where something goes wrong: one row for each fault.

use std::process::ExitCode;

use clap::{Parser, ValueEnum};
use waymark_tests::cli::{Outcome, ended};
use waymark_tests::faults::{Fault, Row};
use waymark_tests::trial::{TrialArgs, all_scored};

/// Localizes a drive without fault and with each fault alone.
///
/// Hazardous are frames that are called ok and are off by 0.5 m or more.
/// Frames to recover count from the end of the fault to the first frame that is
/// called ok and is: the most of all stretches, and `never` if there is none. A row
/// without figures is one in which nothing was localized.
/// Images that are spoilt, or their times, are looked at again, as they come: so
/// is what they say of the motion.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    of: TrialArgs,
    /// Only these, separated by commas.
    #[arg(long, value_name = "NAME,..", value_enum, value_delimiter = ',')]
    only: Vec<Fault>,
}

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Outcome {
    let Some(clean) = arguments.of.look.read()? else { return Ok(()) };
    let seed = arguments.of.look.seed;
    let faults = if arguments.only.is_empty() { Fault::value_variants() } else { &arguments.only };
    if !arguments.of.json {
        common::say!("{} frames, GPS start {seed}", clean.frames.len());
        common::say!("{HEADER}");
    }
    let mut rows = Vec::new();
    for &fault in faults {
        let row = Row::of(fault, &clean, seed).map_err(|error| format!("fault `{}`: {error}", fault.name()))?;
        if !arguments.of.json {
            common::say!("{}", line(&row));
        }
        if arguments.of.list && !arguments.of.json {
            for stretch in row.outcome.stretches() {
                common::say!("    {stretch}");
            }
        }
        rows.push(row);
    }
    if arguments.of.json {
        common::say!("{}", serde_json::to_string_pretty(&rows)?);
    }
    Ok(all_scored("fault", rows.iter().map(|row| (row.fault.as_str(), &row.outcome)))?)
}

const HEADER: &str =
    "fault             RMS m   max m  <0.5 m %  flagged %  hazardous  frames to recover  lost at the end";

fn line(row: &Row) -> String {
    let of = &row.outcome;
    format!(
        "{:<15} {:>7} {:>7} {:>9} {:>10} {:>10} {:>18} {:>16}",
        row.fault,
        of.cell(|figures| format!("{:.3}", figures.rms_m)),
        of.cell(|figures| format!("{:.2}", figures.max_m)),
        of.cell(|figures| format!("{:.1}", 100.0 * figures.under_half_metre)),
        of.cell(|figures| format!("{:.1}", 100.0 * figures.flagged)),
        of.cell(|figures| figures.hazards.len().to_string()),
        row.slowest_recovery(),
        of.cell(|figures| if figures.is_lost_at_end { "yes" } else { "no" }.to_owned())
    )
}
