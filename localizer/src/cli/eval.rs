//! `localizer eval`.

use std::path::{Path, PathBuf};

use clap::Args;
use common::geometry::Pose;
use common::trajectory::Trajectory;

use crate::drive::check_range;
use crate::eval::trust::{ALERT_LIMIT_M, Nees, Trust};
use crate::eval::turn::ConstantTurn;
use crate::eval::{Report, StageTime, score};
use crate::output::{Recorded, Timing, read_estimates, read_timing};
use crate::{Error, Result};

/// Arguments of `localizer eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// Output folder of `run`, its estimates.csv, a KITTI pose file or a TUM
    /// file.
    #[arg(long, value_name = "PATH")]
    estimate: PathBuf,
    /// True poses: one KITTI row per frame, or a TUM file.
    #[arg(long, value_name = "FILE")]
    truth: PathBuf,
    /// times.txt of the sequence, for TUM files: they say no frames.
    #[arg(long, value_name = "FILE")]
    times: Option<PathBuf>,
    /// First frame that counts: the two before it are started by GPS.
    #[arg(long, value_name = "F", default_value_t = 2)]
    first: usize,
    /// Last frame that counts.
    #[arg(long, value_name = "L")]
    last: Option<usize>,
    /// Print the figures as JSON, with the errors of every frame.
    #[arg(long)]
    json: bool,
}

pub fn execute(args: &EvalArgs) -> Result<bool> {
    check_range(args.first, args.last)?;
    let truth = by_frame(&trajectory(&args.truth, args.times.as_deref())?);
    let (mut estimates, mut timing) = read(args)?;
    for (path, is_empty) in [(&args.estimate, estimates.is_empty()), (&args.truth, truth.is_empty())] {
        if is_empty {
            return Err(common::Error::NoPoses { path: path.clone() }.into());
        }
    }
    let last = args.last.unwrap_or(usize::MAX);
    estimates.retain(|e| (args.first..=last).contains(&e.frame));
    timing.retain(|t| (args.first..=last).contains(&t.frame));
    let report = score(&estimates, &truth, &timing).ok_or_else(|| Error::NoCommonFrames {
        estimate: args.estimate.clone(),
        truth: args.truth.clone(),
        first: args.first,
        last: args.last,
    })?;
    if args.json {
        let text = serde_json::to_string_pretty(&report).map_err(|e| Error::Json { message: e.to_string() })?;
        common::say!("{text}");
    } else {
        common::output::print(&table(&report));
    }
    Ok(true)
}

/// A file of poses: TUM lines, which need times of the frames, or KITTI rows, which do not.
fn trajectory(path: &Path, times: Option<&Path>) -> Result<Trajectory> {
    if columns(path)? == 8 {
        let times = times.ok_or_else(|| Error::TimesNeeded { path: path.to_path_buf() })?;
        return Ok(Trajectory::read_tum(path, &common::kitti::read_times(times)?)?);
    }
    // Only the order counts here: as many times as there may be rows.
    let rows = common::read_text(path)?.lines().count();
    let times_s: Vec<f64> = (0..rows).map(|i| i as f64).collect();
    Ok(Trajectory::read_kitti(path, &times_s)?)
}

fn by_frame(trajectory: &Trajectory) -> Vec<Option<Pose>> {
    let frames = trajectory.stamps.last().map_or(0, |stamp| stamp.frame + 1);
    (0..frames).map(|frame| trajectory.at_frame(frame).map(|stamp| stamp.map_from_camera)).collect()
}

fn read(args: &EvalArgs) -> Result<(Vec<Recorded>, Vec<Timing>)> {
    let path = &args.estimate;
    if path.is_dir() {
        let timing = path.join("timing.csv");
        let timing = if timing.is_file() { read_timing(&timing)? } else { Vec::new() };
        return Ok((read_estimates(&path.join("estimates.csv"))?, timing));
    }
    if path.extension().is_some_and(|extension| extension == "csv") {
        return Ok((read_estimates(path)?, Vec::new()));
    }
    let trajectory = trajectory(path, args.times.as_deref())?;
    let recorded = |stamp: &common::trajectory::StampedPose| Recorded {
        frame: stamp.frame,
        map_from_camera: stamp.map_from_camera,
        status: None,
        correspondences: None,
        covariance: None,
    };
    Ok((trajectory.stamps.iter().map(recorded).collect(), Vec::new()))
}

/// Columns of the first row of a text file; a row of names has as many as those below it.
fn columns(path: &Path) -> Result<usize> {
    let text = common::read_text(path)?;
    let mut rows = text.lines().map(str::trim).filter(|row| !row.is_empty() && !row.starts_with('#'));
    Ok(rows.next().map_or(0, |row| common::words(row).count()))
}

/// The figures as lines of text, the paper's beside.
fn table(report: &Report) -> String {
    let paper = &report.paper;
    let beside = |name: &str, here: String, paper: String| format!("{name:<24}{here:>10}{paper:>16}");
    let axis = |name: &str, rms: f64, mean: f64| format!("{name:<24}{rms:>10.3}   mean {mean:+.3}");
    let mut lines = vec![
        beside(&format!("{} frames", report.frames), "here".into(), "paper".into()),
        beside("position RMS, m", format!("{:.3}", report.rms_position_m), format!("{:.3}", paper.rms_position_m)),
        axis("  lateral RMS, m", report.rms_lateral_m, report.mean_lateral_m),
        axis("  longitudinal RMS, m", report.rms_longitudinal_m, report.mean_longitudinal_m),
        axis("  vertical RMS, m", report.rms_vertical_m, report.mean_vertical_m),
        beside("position max, m", format!("{:.3}", report.max_position_m), String::new()),
        beside(
            "under 0.5 m, %",
            format!("{:.1}", 100.0 * report.share_under_half_metre),
            format!("{:.1}", 100.0 * paper.share_under_half_metre),
        ),
        beside("angle mean, rad", format!("{:.4}", report.mean_angle_rad), format!("{:.4}", paper.mean_angle_rad)),
        beside("angle max, rad", format!("{:.4}", report.max_angle_rad), String::new()),
    ];
    if let Some(mean) = report.mean_correspondences {
        lines.push(beside("correspondences", format!("{mean:.1}"), String::new()));
    }
    if let Some([ok, degraded, lost]) = report.ok_degraded_lost {
        lines.push(format!("{:<24}{ok} ok, {degraded} degraded, {lost} lost", "status"));
        lines.push(beside("ok but off by 0.5 m", report.ok_but_off.to_string(), String::new()));
    }
    lines.extend(report.trust.iter().flat_map(trust_lines));
    lines.extend(report.constant_turn.iter().map(turn_line));
    let stages =
        [("probabilities", report.maps), ("features", report.features), ("association and pose", report.localize)];
    for (name, stage) in stages {
        if let Some(StageTime { median_ms, p99_ms }) = stage {
            lines.push(format!("{name:<24}{median_ms:>10.2} ms median {p99_ms:>10.2} ms p99"));
        }
    }
    lines.iter().map(|line| line.trim_end()).chain([""]).collect::<Vec<_>>().join("\n")
}

/// What the covariances are worth, as lines.
fn trust_lines(trust: &Trust) -> [String; 2] {
    let nees = trust.nees.map_or_else(
        || "of none: no frame is called ok with a covariance that can be one".to_owned(),
        |Nees { mean_nees, independent, nees_bounds: [low, high], share_within }| {
            let under = 100.0 * share_within;
            format!(
                "{mean_nees:>10.2}   of ok frames; 6 expected, {low:.2} to {high:.2} of {independent:.0} independent; {under:.1} % under 12.6"
            )
        },
    );
    [
        format!("{:<24}{nees}", "NEES mean"),
        format!(
            "{:<24}{} available, {} misleading, {} hazardous (95 %, alert limit {} m)",
            "claims", trust.available, trust.misleading, trust.hazardous, ALERT_LIMIT_M
        ),
    ]
}

/// By how much truth and estimates are turned against each other throughout, as a line.
fn turn_line(turn: &ConstantTurn) -> String {
    let [pitch_rad, yaw_rad, roll_rad] = turn.turn_rad;
    format!(
        "{:<24}pitch {pitch_rad:+.4}, yaw {yaw_rad:+.4}, roll {roll_rad:+.4}; without it angle mean {:.4}, NEES {:.2}",
        "constant turn, rad", turn.mean_angle_rad, turn.mean_nees
    )
}
