//! What each step of the localizer beyond the paper is worth: one row for each,
//! switched off alone.

use std::process::ExitCode;

use clap::{Parser, ValueEnum};
use waymark_tests::ablation::{Row, Step};
use waymark_tests::cli::{Outcome, ended};
use waymark_tests::faults::Fault;
use waymark_tests::trial::{TrialArgs, stretches};

/// Localizes a drive with each step beyond the paper switched off, alone.
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
        if arguments.of.json {
            rows.push(row);
            continue;
        }
        common::say!("{}", line(&row));
        if arguments.of.list {
            for stretch in stretches(&row.figures.hazards) {
                common::say!("    {stretch}");
            }
        }
    }
    if arguments.of.json {
        common::say!("{}", serde_json::to_string_pretty(&rows)?);
    }
    Ok(())
}

const HEADER: &str =
    "without         RMS m   max m  <0.5 m %    ok %  hazardous  NEES  lost at the end  median ms   p99 ms";

fn line(row: &Row) -> String {
    let figures = &row.figures;
    let nees = figures.mean_nees.map_or_else(|| "-".to_owned(), |nees| format!("{nees:.1}"));
    let (median_ms, p99_ms) = figures.time.map_or((0.0, 0.0), |time| (time.median_ms, time.p99_ms));
    format!(
        "{:<13} {:>7.3} {:>7.2} {:>9.1} {:>7.1} {:>10} {:>5} {:>16} {:>10.3} {:>8.2}",
        row.without,
        figures.rms_m,
        figures.max_m,
        100.0 * figures.under_half_metre,
        100.0 * (1.0 - figures.flagged),
        figures.hazards.len(),
        nees,
        if figures.is_lost_at_end { "yes" } else { "no" },
        median_ms,
        p99_ms
    )
}
