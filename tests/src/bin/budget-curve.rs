//! Accuracy against bytes: a map is reduced to several sizes, and a drive is
//! localized in each.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use common::map::SemanticMap;
use mapper::Config;
use mapper::budget::{Accuracy, Stored, reduce};
use mapper::cli::ConfigArgs;
use waymark_tests::budget_curve::{Measured, Naive, measure, naive};
use waymark_tests::cli::{Outcome, ended};
use waymark_tests::trial::LookArgs;

/// Predicted and measured accuracy of a map reduced to several sizes.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    /// The map, with the report of its build beside it.
    #[arg(long, value_name = "MAP.csm", required_unless_present = "print_config")]
    map: Option<PathBuf>,
    /// Folder with `sequences/`, as KITTI odometry has it.
    #[arg(long, value_name = "ROOT", required_unless_present = "print_config")]
    kitti: Option<PathBuf>,
    /// Name of the sequence.
    #[arg(long, value_name = "NN", default_value = "00")]
    sequence: String,
    /// Folder with probability images [default: `labels_2` in the sequence].
    #[arg(long, value_name = "DIR")]
    labels: Option<PathBuf>,
    /// True poses [default: `truth/poses.txt` in ROOT].
    #[arg(long, value_name = "POSES.txt")]
    truth: Option<PathBuf>,
    /// The sizes, bytes, separated by commas; the whole map comes last.
    #[arg(long, value_name = "BYTES,..", value_delimiter = ',', default_values_t = [512, 1024, 2048, 4096])]
    at: Vec<usize>,
    /// GPS starts, with the seeds 0, 1, ...; their errors are pooled.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..))]
    starts: u64,
    /// Also keep landmarks by size, by count and at random.
    #[arg(long)]
    naive: bool,
    #[command(flatten)]
    config: ConfigArgs,
}

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Outcome {
    let config = arguments.config.load(Config::load)?;
    // The command line lets the others be absent with `--print-config` only.
    let (Some(config), Some(map), Some(kitti)) = (config, &arguments.map, &arguments.kitti) else {
        return Ok(());
    };
    let stored = Stored::read(map, &config)?;
    let whole = stored.known();
    if let Some(note) = &stored.note {
        common::say!("{note}");
    }
    let trial = look(map, kitti, arguments).read_by(localizer::config::Config::default())?;
    common::say!(
        "{}: {} bytes; errors of {} starts, metres and degrees",
        map.display(),
        stored.bytes,
        arguments.starts
    );
    common::say!(
        "{:>6} {:>10} {:>6} {:>14} {:>7} | expected {:>5} {:>7} {:>5} | measured {:>5} {:>7} {:>5} {:>6} {:>6} {:>7}",
        "bytes",
        "kept",
        "used",
        "poles signs ln",
        "quantum",
        "RMS",
        "lateral",
        "long",
        "RMS",
        "lateral",
        "long",
        "angle",
        "worst",
        "<0.5 m"
    );
    for budget in arguments.at.iter().copied().chain([usize::MAX]) {
        let reduced = match reduce(whole, budget, &stored.config) {
            Ok(reduced) => reduced,
            // What it says is of `reduce --budget`, which is not asked for here.
            Err(mapper::Error::BudgetTooSmall { least_bytes, roads, .. }) => {
                common::say!("{budget:>6} no map fits: {roads} road stretches without any landmark take {least_bytes}");
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        let used = reduced.bytes.len();
        let measured = measure(&trial, &reduced.map, arguments.starts)?;
        row(budget, "best", used, &reduced.map, reduced.detail.quantum_m, Some(&reduced.predicted), measured.as_ref());
        if !arguments.naive || budget == usize::MAX {
            continue;
        }
        for (name, order) in [("by size", Naive::BySize), ("by count", Naive::ByCount), ("random", Naive::Random)] {
            let map = naive(whole, &reduced.detail, budget, order)?;
            let measured = measure(&trial, &map, arguments.starts)?;
            row(budget, name, budget, &map, reduced.detail.quantum_m, None, measured.as_ref());
        }
    }
    Ok(())
}

fn look(map: &Path, root: &Path, arguments: &Arguments) -> LookArgs {
    let or = |given: &Option<PathBuf>, usual: PathBuf| given.clone().unwrap_or(usual);
    let labels = or(&arguments.labels, root.join("sequences").join(&arguments.sequence).join("labels_2"));
    let truth = or(&arguments.truth, root.join("truth/poses.txt"));
    let mut look = LookArgs::of_labels(root, map, &truth, None);
    look.input.sequence.clone_from(&arguments.sequence);
    look.input.source.labels = Some(labels);
    look
}

fn row(
    budget: usize,
    name: &str,
    used: usize,
    map: &SemanticMap,
    quantum_m: f64,
    predicted: Option<&Accuracy>,
    measured: Option<&Measured>,
) {
    let budget = if budget == usize::MAX { "all".to_owned() } else { budget.to_string() };
    let counts = format!("{} {} {}", map.poles.len(), map.signs.len(), map.lanes.len());
    let expected = predicted.map_or_else(
        || format!("{:>14} {:>7} {:>5}", "", "", ""),
        |p| format!("{:>14.3} {:>7.3} {:>5.3}", p.position_rms_m, p.lateral_m.median, p.longitudinal_m.median),
    );
    let found = measured.map_or_else(
        || "no frame was localized".to_owned(),
        |m| {
            format!(
                "{:>14.3} {:>7.3} {:>5.3} {:>6.2} {:>6.2} {:>7.3}",
                m.position_m,
                m.lateral_m,
                m.longitudinal_m,
                m.angle_rad.to_degrees(),
                m.worst_m,
                m.under_half_metre
            )
        },
    );
    common::say!("{budget:>6} {name:>10} {used:>6} {counts:>14} {quantum_m:>7} | {expected} | {found}");
}
