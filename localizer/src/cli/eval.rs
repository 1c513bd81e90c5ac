//! `localizer eval`.

use std::path::{Path, PathBuf};

use clap::Args;
use common::geometry::Pose;
use common::trajectory::Trajectory;

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
    /// True poses, one KITTI row per frame.
    #[arg(long, value_name = "FILE")]
    truth: PathBuf,
    /// times.txt of the sequence, for TUM files.
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
    let truth = read_truth(&args.truth)?;
    let (mut estimates, timing) = read(args, truth.len())?;
    let last = args.last.unwrap_or(usize::MAX);
    estimates.retain(|e| (args.first..=last).contains(&e.frame));
    let report = score(&estimates, &truth, &timing).ok_or_else(|| Error::NoCommonFrames {
        estimate: args.estimate.clone(),
        truth: args.truth.clone(),
        first: args.first,
    })?;
    if args.json {
        let text = serde_json::to_string_pretty(&report).map_err(|e| Error::Json { message: e.to_string() })?;
        println!("{text}");
    } else {
        print!("{}", table(&report));
    }
    Ok(true)
}

fn read_truth(path: &Path) -> Result<Vec<Option<Pose>>> {
    Ok(by_frame(&read_rows(path)?))
}

/// KITTI rows without their times.
fn read_rows(path: &Path) -> Result<Trajectory> {
    // Only the order counts here: as many times as there may be rows.
    let rows = std::fs::read_to_string(path)
        .map_err(|source| common::Error::Io { path: path.to_path_buf(), source })?
        .lines()
        .count();
    let times_s: Vec<f64> = (0..rows).map(|i| i as f64).collect();
    Ok(Trajectory::read_kitti(path, &times_s)?)
}

fn by_frame(trajectory: &Trajectory) -> Vec<Option<Pose>> {
    let frames = trajectory.stamps.last().map_or(0, |stamp| stamp.frame + 1);
    (0..frames).map(|frame| trajectory.at_frame(frame).map(|stamp| stamp.map_from_camera)).collect()
}

fn read(args: &EvalArgs, frames: usize) -> Result<(Vec<Recorded>, Vec<Timing>)> {
    let path = &args.estimate;
    if path.is_dir() {
        let timing = path.join("timing.csv");
        let timing = if timing.is_file() { read_timing(&timing)? } else { Vec::new() };
        return Ok((read_estimates(&path.join("estimates.csv"))?, timing));
    }
    if path.extension().is_some_and(|extension| extension == "csv") {
        return Ok((read_estimates(path)?, Vec::new()));
    }
    let trajectory = if columns(path)? == 8 {
        // Without times a TUM file counts its frames from the truth's first.
        let times_s = match &args.times {
            Some(times) => common::kitti::read_times(times)?,
            None => return Err(Error::MissingOption { option: "--times" }),
        };
        Trajectory::read_tum(path, &times_s[..frames.min(times_s.len())])?
    } else {
        read_rows(path)?
    };
    let recorded = |stamp: &common::trajectory::StampedPose| Recorded {
        frame: stamp.frame,
        map_from_camera: stamp.map_from_camera,
        status: None,
        correspondences: None,
    };
    Ok((trajectory.stamps.iter().map(recorded).collect(), Vec::new()))
}

/// Columns of the first row of a text file.
fn columns(path: &Path) -> Result<usize> {
    let text = std::fs::read_to_string(path)
        .map_err(|source| common::Error::Io { path: path.to_path_buf(), source })?;
    let mut rows = text.lines().map(str::trim).filter(|row| !row.is_empty() && !row.starts_with('#'));
    Ok(rows.next().map_or(0, |row| row.split_whitespace().count()))
}

fn table(report: &Report) -> String {
    let stage = |name: &str, stage: Option<StageTime>| {
        stage.map_or(String::new(), |s| format!("{name:<24}{:>10.2} ms median {:>10.2} ms p99\n", s.median_ms, s.p99_ms))
    };
    let paper = &report.paper;
    let mut text = format!("{:<24}{:>10}{:>16}\n", format!("{} frames", report.frames), "here", "paper");
    text += &format!("{:<24}{:>10.3}{:>16.3}\n", "position RMS, m", report.rms_position_m, paper.rms_position_m);
    text += &format!("{:<24}{:>10.3}   mean {:+.3}\n", "  lateral RMS, m", report.rms_lateral_m, report.mean_lateral_m);
    text += &format!("{:<24}{:>10.3}   mean {:+.3}\n", "  longitudinal RMS, m", report.rms_longitudinal_m, report.mean_longitudinal_m);
    text += &format!("{:<24}{:>10.3}   mean {:+.3}\n", "  vertical RMS, m", report.rms_vertical_m, report.mean_vertical_m);
    text += &format!("{:<24}{:>10.3}\n", "position max, m", report.max_position_m);
    text += &format!(
        "{:<24}{:>10.1}{:>16.1}\n",
        "under 0.5 m, %",
        100.0 * report.share_under_half_metre,
        100.0 * paper.share_under_half_metre
    );
    text += &format!("{:<24}{:>10.4}{:>16.4}\n", "angle mean, rad", report.mean_angle_rad, paper.mean_angle_rad);
    text += &format!("{:<24}{:>10.4}\n", "angle max, rad", report.max_angle_rad);
    if let Some(mean) = report.mean_correspondences {
        text += &format!("{:<24}{mean:>10.1}\n", "correspondences");
    }
    if let Some([ok, degraded, lost]) = report.ok_degraded_lost {
        text += &format!("{:<24}{ok} ok, {degraded} degraded, {lost} lost\n", "status");
        text += &format!("{:<24}{:>10}\n", "ok but off by 0.5 m", report.ok_but_off);
    }
    text += &stage("probabilities", report.maps);
    text += &stage("features", report.features);
    text += &stage("association and pose", report.localize);
    text
}
