//! What comes of a drive in other weather, light or through another lens: one row
//! for each.

use std::process::ExitCode;

use clap::{Parser, ValueEnum};
use waymark_tests::cli::{Outcome, ended};
use waymark_tests::trial::{TrialArgs, all_scored};
use waymark_tests::weather::{Row, Weather};

/// Spoils the images of a drive, has the networks look at them, and localizes it.
///
/// Hazardous are frames that are called ok and are off by 0.5 m or more. A row
/// without figures is one in which nothing was localized.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    of: TrialArgs,
    /// Only these, separated by commas.
    #[arg(long, value_name = "NAME,..", value_enum, value_delimiter = ',')]
    only: Vec<Weather>,
}

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Outcome {
    let TrialArgs { look, json, list } = &arguments.of;
    let Some(config) = look.config.load()? else { return Ok(()) };
    let input = &look.input;
    let source = &input.source;
    if source.labels.is_some() || (source.pole_net.is_none() && source.lane_net.is_none()) {
        return Err(
            "networks have to look at the spoilt images; give `--pole-net` and `--lane-net`, no `--labels`".into()
        );
    }
    let all = if arguments.only.is_empty() { Weather::value_variants() } else { &arguments.only };
    let mut rows = Vec::new();
    for &weather in all {
        let row = Row::of(weather, look, &config).map_err(|error| format!("weather `{}`: {error}", weather.name()))?;
        if !json {
            if rows.is_empty() {
                common::say!("{HEADER}");
            }
            common::say!("{}", line(&row));
        }
        if *list && !json {
            for stretch in row.outcome.stretches() {
                common::say!("    {stretch}");
            }
        }
        rows.push(row);
    }
    if *json {
        common::say!("{}", serde_json::to_string_pretty(&rows)?);
    }
    Ok(all_scored("weather", rows.iter().map(|row| (row.weather.as_str(), &row.outcome)))?)
}

const HEADER: &str = "weather     poles  lanes  signs   RMS m   max m  <0.5 m %  flagged %  hazardous  lost at the end";

fn line(row: &Row) -> String {
    let of = &row.outcome;
    let [poles, lanes, signs] = row.features;
    format!(
        "{:<10} {:>6.1} {:>6.1} {:>6.1} {:>7} {:>7} {:>9} {:>10} {:>10} {:>16}",
        row.weather,
        poles,
        lanes,
        signs,
        of.cell(|figures| format!("{:.3}", figures.rms_m)),
        of.cell(|figures| format!("{:.2}", figures.max_m)),
        of.cell(|figures| format!("{:.1}", 100.0 * figures.under_half_metre)),
        of.cell(|figures| format!("{:.1}", 100.0 * figures.flagged)),
        of.cell(|figures| figures.hazards.len().to_string()),
        of.cell(|figures| if figures.is_lost_at_end { "yes" } else { "no" }.to_owned())
    )
}
