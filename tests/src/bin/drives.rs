//! Drives of many worlds: how well each is mapped and localized.

use std::process::ExitCode;

use clap::Parser;
use common::config::load_or_default;
use fixtures::Options;
use mapper::cli::ConfigArgs;
use waymark_tests::cli::{Outcome, ended};
use waymark_tests::drives::{Localized, Row, Seeds, Totals, measure};
use waymark_tests::map_score::Found;
use waymark_tests::trial::Figures;

/// Generates drives, maps each from every fifth scan and localizes it in its map, from its
/// label images alone and with wheels: a row of a Markdown table for each, and what all of
/// them give together.
///
/// The settings are those of `fixtures generate`: another rig, another lidar, and under
/// `[world]` what `from-survey` and `aged` need.
///
/// A drive is deleted once it is measured. Poles, signs and lanes are those within 20 m of
/// the path; positions are scored against the exact poses, or, where the survey drifts so much
/// that the map lies elsewhere, against those that the map was built with.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    /// Worlds and their seeds, as `street:1-3 city:7,9`; `fixtures worlds` lists them.
    #[arg(value_name = "WORLD:SEEDS", required_unless_present = "print_config")]
    drives: Vec<Seeds>,
    #[command(flatten)]
    config: ConfigArgs,
    /// Number of frames of each [default: as many as its world is made for].
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
}

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Outcome {
    let given = arguments.config.load(|file| Ok(load_or_default::<Options>(file, &[])?))?;
    let Some(given) = given else { return Ok(()) };
    let mut totals = Totals::default();
    for Seeds { world, seeds } in &arguments.drives {
        for &seed in seeds {
            let mut options = given.clone();
            options.world.name.clone_from(world);
            options.world.seed = seed;
            options.world.frames = arguments.frames.or(options.world.frames);
            let folder = tempfile::tempdir()?;
            let row = measure(&options, folder.path()).map_err(|error| format!("`{world}`, seed {seed}: {error}"))?;
            if totals.drives == 0 {
                common::say!("{HEADER}\n|{}", "---|".repeat(HEADER.matches('|').count() - 1));
            }
            common::say!("{}", line(&row));
            totals.add(&row);
        }
    }
    common::say!("\n{}", summary(&totals));
    Ok(())
}

const HEADER: &str = "| world | map, bytes | poles: recall, precision | signs | lanes | RMS, m; under 0.5 m, % | frames \
                      ok, degraded, lost | ok, but off by 0.5 m | with `--odometry`: RMS, m; under 0.5 m, %; ok, but \
                      off |";

/// A row of the table.
fn line(row: &Row) -> String {
    let map = &row.map;
    let labels = row.from_labels.as_ref();
    format!(
        "| `{}`, seed {} | {} | {} | {} | {} | {} | {} | {} | {}; {} |",
        row.world,
        row.seed,
        thousands(row.map_bytes),
        shares(&map.poles),
        shares(&map.signs),
        shares(&map.lanes),
        accuracy(labels),
        labels.map_or_else(|| "-".to_owned(), statuses),
        hazards(labels),
        accuracy(row.with_odometry.as_ref()),
        hazards(row.with_odometry.as_ref()),
    )
}

/// What all drives give.
fn summary(totals: &Totals) -> String {
    let of = |name: &str, localized: &Localized| {
        format!(
            "{name}: RMS {:.3} m on average, {:.3} m at worst; of {} frames {} % under 0.5 m, {} % ok; {} ok, but off",
            localized.mean_rms_m(),
            localized.worst_rms_m,
            thousands(localized.frames),
            percent(localized.share(localized.under_half_metre)),
            percent(localized.share(localized.ok)),
            localized.hazardous,
        )
    };
    format!(
        "{} drives: recall, precision of poles {}, signs {}, lanes {}\n{}\n{}",
        totals.drives,
        shares(&totals.poles),
        shares(&totals.signs),
        shares(&totals.lanes),
        of("from label images", &totals.from_labels),
        of("with `--odometry`", &totals.with_odometry),
    )
}

/// Recall and precision.
fn shares(found: &Found) -> String {
    if found.wanted + found.claimed > 0.0 {
        format!("{:.2}, {:.2}", found.recall(), found.precision())
    } else {
        "none, none".to_owned()
    }
}

fn accuracy(figures: Option<&Figures>) -> String {
    figures.map_or_else(
        || "-".to_owned(),
        |of| {
            let percent = percent(of.under_half_metre);
            format!("{:.3}; {}", of.rms_m, percent.strip_suffix(".0").unwrap_or(&percent))
        },
    )
}

/// A share in percent, rounded down: 100 are all.
fn percent(share: f64) -> String {
    format!("{:.1}", (1000.0 * share + 1e-6).floor() / 10.0)
}

fn statuses(of: &Figures) -> String {
    let [ok, degraded, lost] = of.ok_degraded_lost();
    format!("{ok}, {degraded}, {lost}")
}

fn hazards(figures: Option<&Figures>) -> String {
    figures.map_or_else(|| "-".to_owned(), |of| of.hazards.len().to_string())
}

/// With a comma between thousands.
fn thousands(number: usize) -> String {
    let digits = number.to_string();
    let groups: Vec<&str> = digits.as_bytes().rchunks(3).rev().filter_map(|g| std::str::from_utf8(g).ok()).collect();
    groups.join(",")
}
