//! `localizer trial`.

use std::path::PathBuf;

use clap::Args;
use common::geometry::Pose;

use super::ConfigArgs;
use super::input::{Input, InputArgs, simulated};
use crate::eval::{LOST_M, Report, START_FRAMES, StageTime, nothing_scored, score};
use crate::odometry::OdometryLog;
use crate::output::{Recorded, Timing};
use crate::run::{FrameResult, Localizer, Method, localize};
use crate::watch::odometry;
use crate::{Result, config::Config};

/// Arguments of `localizer trial`.
#[derive(Debug, Args)]
pub struct TrialArgs {
    #[command(flatten)]
    input: InputArgs,
    /// GPS starts, with the seeds 0, 1, ...
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..))]
    draws: u64,
    /// Only this method; default: both.
    #[arg(long, value_enum)]
    method: Option<Method>,
    /// Wheels and gyroscope, as of `run`; the paper's method asks images alone.
    #[arg(long, value_name = "FILE")]
    odometry: Option<PathBuf>,
    /// Print a row for each draw, too.
    #[arg(long)]
    each: bool,
    #[command(flatten)]
    config: ConfigArgs,
}

/// One run from one start.
struct Draw {
    report: Report,
    localize_ms: Vec<f64>,
    lost: bool,
}

pub fn execute(args: &TrialArgs) -> Result<bool> {
    let Some(mut config) = args.config.load()? else { return Ok(true) };
    if let Some(method) = args.method {
        method.check(&[(args.odometry.is_some(), "--odometry"), (config.gps.fuse, "gps.fuse")])?;
    }
    let wheels = args.input.read_odometry(args.odometry.as_deref(), &config)?;
    let mut input = args.input.read(wheels.is_some(), &config)?;
    let odometry = odometry(wheels, &input.motion, &mut config);
    let truth = args.input.true_poses(&input.drive)?;
    let methods = args.method.map_or_else(|| vec![Method::Robust, Method::Paper], |method| vec![method]);
    common::say!(
        "{} frames, {} GPS starts ({} m, {} degrees)",
        input.frames.len(),
        args.draws,
        config.gps.horizontal_sigma_m,
        config.gps.heading_sigma_deg
    );
    common::say!("{HEADER}");
    for method in methods {
        let mut draws = Vec::new();
        for seed in 0..args.draws {
            let draw = localize_once(&mut input, &truth, &odometry, method, &config, seed)?;
            if args.each {
                common::say!("{}", row(&format!("{} {seed}", name(method)), std::slice::from_ref(&draw)));
            }
            draws.push(draw);
        }
        common::say!("{}", row(name(method), &draws));
    }
    Ok(true)
}

fn name(method: Method) -> &'static str {
    match method {
        Method::Robust => "robust",
        Method::Paper => "paper",
    }
}

fn localize_once(
    input: &mut Input,
    truth: &[Pose],
    odometry: &OdometryLog,
    method: Method,
    config: &Config,
    seed: u64,
) -> Result<Draw> {
    let fixes = simulated(&input.drive.frames.iter().copied(), truth, config, seed)?;
    let localizer =
        Localizer::new(method, &mut input.map, &input.drive.camera.pinhole, input.drive.camera.seen_px(), config);
    let results = localize(&input.frames, &fixes, odometry, localizer)?;
    let scored = results.get(START_FRAMES.min(results.len())..).unwrap_or(&[]);
    let recorded: Vec<Recorded> = scored.iter().map(Recorded::from).collect();
    let timing: Vec<Timing> = scored.iter().map(FrameResult::timing).collect();
    let truth: Vec<Option<Pose>> = truth.iter().copied().map(Some).collect();
    let report = score(&recorded, &truth, &timing).ok_or_else(|| nothing_scored(results.len()))?;
    let lost = report.errors.last().is_some_and(|e| e.position_m() > LOST_M);
    Ok(Draw { report, localize_ms: timing.iter().map(|t| t.localize_ms).collect(), lost })
}

const HEADER: &str = "method        RMS m  held m  lat m  lon m  ver m  max m  <0.5 m %  angle rad  max rad  matches  lost  ok %  ok but off  median ms   p99 ms";

/// A length in a column of six; where a run has left the map, its magnitude.
fn metres(length_m: f64) -> String {
    if length_m < 1000.0 { format!("{length_m:>6.3}") } else { format!("{length_m:>6.0e}") }
}

/// One row over all draws: errors pooled, runs counted.
fn row(name: &str, draws: &[Draw]) -> String {
    let errors: Vec<_> = draws.iter().flat_map(|d| &d.report.errors).collect();
    let count = errors.len().max(1) as f64;
    let rms = |value: &dyn Fn(&&crate::eval::FrameError) -> f64| {
        (errors.iter().map(|e| value(e).powi(2)).sum::<f64>() / count).sqrt()
    };
    let under = errors.iter().filter(|e| e.position_m() < 0.5).count() as f64 / count;
    let angle = errors.iter().map(|e| e.angle_rad).sum::<f64>() / count;
    let most_rad = errors.iter().map(|e| e.angle_rad).fold(0.0, f64::max);
    let most_m = errors.iter().map(|e| e.position_m()).fold(0.0, f64::max);
    // Of the draws that were not lost: a lost one may be anywhere.
    let held: Vec<f64> =
        draws.iter().filter(|d| !d.lost).flat_map(|d| &d.report.errors).map(|e| e.position_m().powi(2)).collect();
    let held_m = (!held.is_empty()).then(|| (held.iter().sum::<f64>() / held.len() as f64).sqrt());
    let runs = draws.len().max(1) as f64;
    let matches = draws.iter().filter_map(|d| d.report.mean_correspondences).sum::<f64>() / runs;
    let lost = draws.iter().filter(|d| d.lost).count();
    let ok: usize = draws.iter().filter_map(|d| d.report.ok_degraded_lost).map(|s| s[0]).sum();
    let off: usize = draws.iter().map(|d| d.report.ok_but_off).sum();
    let times = StageTime::of(draws.iter().flat_map(|d| d.localize_ms.iter().copied()).collect());
    let (median_ms, p99_ms) = times.map_or((0.0, 0.0), |t| (t.median_ms, t.p99_ms));
    format!(
        "{name:<12} {} {} {} {} {} {} {:>9.1} {angle:>10.4} {most_rad:>8.4} {matches:>8.1} {lost:>5} {:>5.1} {off:>11} {median_ms:>10.3} {p99_ms:>8.2}",
        metres(rms(&|e| e.position_m())),
        held_m.map_or_else(|| format!("{:>6}", "-"), metres),
        metres(rms(&|e| e.lateral_m)),
        metres(rms(&|e| e.longitudinal_m)),
        metres(rms(&|e| e.vertical_m)),
        metres(most_m),
        100.0 * under,
        100.0 * ok as f64 / count,
    )
}
