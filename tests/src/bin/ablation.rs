//! What each step of the localizer beyond the paper is worth: one row for each,
//! switched off alone.

use std::process::ExitCode;

use clap::{Parser, ValueEnum};
use waymark_tests::ablation::{Row, Step};
use waymark_tests::cli::{Outcome, ended};
use waymark_tests::faults::Fault;
use waymark_tests::trial::{TrialArgs, all_scored};

/// Localizes a drive with each step beyond the paper switched off, alone.
///
/// A row without figures is one in which nothing was localized.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    of: TrialArgs,
    /// Only these, separated by commas.
    #[arg(long, value_name = "NAME,..", value_enum, value_delimiter = ',')]
    only: Vec<Step>,
    /// With this fault all along (`faults --help` names them): some steps only
    /// show what they are worth when something goes wrong.
    #[arg(long, value_name = "NAME", value_enum, default_value = "none")]
    fault: Fault,
}

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Outcome {
    let Some(clean) = arguments.of.look.read()? else { return Ok(()) };
    let whole = arguments.fault.applied(&clean, arguments.of.look.seed).look_again()?.trial;
    let steps = if arguments.only.is_empty() { Step::value_variants() } else { &arguments.only };
    if !arguments.of.json {
        common::say!(
            "{} frames, GPS start {}, fault {}",
            whole.frames.len(),
            arguments.of.look.seed,
            arguments.fault.name()
        );
        common::say!("{HEADER}");
    }
    let mut rows = Vec::new();
    for &step in steps {
        let row = Row::of(step, &whole).map_err(|error| format!("without `{}`: {error}", step.name()))?;
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
    Ok(all_scored("without", rows.iter().map(|row| (row.without.as_str(), &row.outcome)))?)
}

const HEADER: &str =
    "without         RMS m   max m  <0.5 m %    ok %  hazardous  NEES  lost at the end  median ms   p99 ms";

fn line(row: &Row) -> String {
    let of = &row.outcome;
    let dash = || "-".to_owned();
    format!(
        "{:<13} {:>7} {:>7} {:>9} {:>7} {:>10} {:>5} {:>16} {:>10} {:>8}",
        row.without,
        of.cell(|figures| format!("{:.3}", figures.rms_m)),
        of.cell(|figures| format!("{:.2}", figures.max_m)),
        of.cell(|figures| format!("{:.1}", 100.0 * figures.under_half_metre)),
        of.cell(|figures| format!("{:.1}", 100.0 * (1.0 - figures.flagged))),
        of.cell(|figures| figures.hazards.len().to_string()),
        of.cell(|figures| figures.mean_nees.map_or_else(dash, |nees| format!("{nees:.1}"))),
        of.cell(|figures| if figures.is_lost_at_end { "yes" } else { "no" }.to_owned()),
        of.cell(|figures| figures.time.map_or_else(dash, |time| format!("{:.3}", time.median_ms))),
        of.cell(|figures| figures.time.map_or_else(dash, |time| format!("{:.2}", time.p99_ms)))
    )
}
