//! `localizer motion`.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Instant;

use clap::Args;

use super::ConfigArgs;
use super::input::progress;
use crate::drive::Drive;
use crate::odometry::Odometry;
use crate::{Error, Result};

/// Arguments of `localizer motion`.
#[derive(Debug, Args)]
pub struct MotionArgs {
    /// Folder with `sequences/` in KITTI odometry layout.
    #[arg(long, value_name = "ROOT")]
    kitti: Option<PathBuf>,
    /// Name of the sequence.
    #[arg(long, value_name = "NN", default_value = "04")]
    sequence: String,
    /// Probability images CLASS/NNNNNN.png to tell it from, instead of the images
    /// of the drive; they tell the turn alone.
    #[arg(long, value_name = "DIR")]
    labels: Option<PathBuf>,
    /// First frame.
    #[arg(long, value_name = "F", default_value_t = 0)]
    first: usize,
    /// Last frame; default: the last that has an image (or labels).
    #[arg(long, value_name = "L")]
    last: Option<usize>,
    /// True poses to hold it against, a file of KITTI poses.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Write it as a CSV file: the time of an image, and the mean motion since
    /// the one before; empty where the images do not tell.
    #[arg(long, value_name = "FILE.csv")]
    out: Option<PathBuf>,
    #[command(flatten)]
    config: ConfigArgs,
}

/// A figure of a motion, where it is told.
type Figure = fn(&Odometry) -> Option<f64>;

/// One step between two images.
struct Step {
    shown: Option<Odometry>,
    /// The same, told by true poses.
    truth: Option<Odometry>,
}

pub fn execute(args: &MotionArgs) -> Result<bool> {
    let Some(config) = args.config.load()? else { return Ok(true) };
    if let Some(path) = &args.out {
        common::atomic_file::check(path)?;
    }
    let root = super::required(args.kitti.as_ref(), "--kitti")?;
    let drive =
        Drive::open(&root, &args.sequence, args.labels.as_deref(), args.first, args.last, config.vision.widest_px)?;
    let truth = args.truth.as_ref().map(|path| drive.sequence.poses_from(path)).transpose()?.unwrap_or_default();
    let mut odometer = match args.labels {
        Some(_) => drive.camera.label_odometer(&config),
        None => drive.camera.odometer(&config),
    };
    let mut csv = String::from("t_s,speed_m_s,yaw_rate_rad_s\n");
    let mut steps = Vec::new();
    let mut spent_s = 0.0;
    let bar = progress(drive.frames.len(), "motion");
    let mut before: Option<usize> = None;
    for &frame in &drive.frames {
        let plane = drive.plane(frame, args.labels.as_deref())?;
        let started = Instant::now();
        let shown = odometer.step(&plane, drive.times_s[frame]);
        spent_s += started.elapsed().as_secs_f64();
        let is_another = odometer.last_s() == Some(drive.times_s[frame]);
        if let Some(before) = is_another.then(|| before.replace(frame)).flatten() {
            let dt_s = drive.times_s[frame] - drive.times_s[before];
            let truth = truth.get(before).zip(truth.get(frame)).map(|(from, to)| {
                let moved = from.inverse() * to;
                let turn_rad_s = moved.rotation.scaled_axis() / dt_s;
                Odometry {
                    speed_m_s: Some(moved.translation.vector.z / dt_s),
                    yaw_rate_rad_s: -turn_rad_s.y,
                    sway_rad_s: Some([turn_rad_s.x, turn_rad_s.z]),
                }
            });
            steps.push(Step { shown, truth });
            let field = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.4}"));
            let (speed, turn) = (shown.and_then(|s| s.speed_m_s), shown.map(|s| s.yaw_rate_rad_s));
            // Writing to a string does not fail.
            let _ = writeln!(csv, "{:.6},{},{}", drive.times_s[frame], field(speed), field(turn));
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    if steps.is_empty() {
        return Err(Error::NoMotion);
    }
    if let Some(path) = &args.out {
        common::atomic_file::write(path, csv.as_bytes())?;
    }
    common::say!("{}", table(&steps, 1e3 * spent_s / drive.frames.len().max(1) as f64));
    Ok(true)
}

fn table(steps: &[Step], each_ms: f64) -> String {
    let told = |is: fn(&Odometry) -> bool| steps.iter().filter(|step| step.shown.as_ref().is_some_and(is)).count();
    let mut text = format!(
        "{} steps: turn told in {}, speed in {}; {each_ms:.1} ms an image",
        steps.len(),
        told(|_| true),
        told(Odometry::tells_speed)
    );
    let pairs = || steps.iter().filter_map(|step| step.shown.zip(step.truth));
    let figures: [(&str, Figure); 4] = [
        ("speed, m/s", |motion| motion.speed_m_s),
        ("yaw rate, rad/s", |motion| Some(motion.yaw_rate_rad_s)),
        ("pitch rate, rad/s", |motion| motion.sway_rad_s.map(|[pitch_rad_s, _]| pitch_rad_s)),
        ("roll rate, rad/s", |motion| motion.sway_rad_s.map(|[_, roll_rad_s]| roll_rad_s)),
    ];
    for (what, figure) in figures {
        let off: Vec<f64> = pairs().filter_map(|(shown, truth)| Some(figure(&shown)? - figure(&truth)?)).collect();
        if !off.is_empty() {
            let count = off.len() as f64;
            let mean = off.iter().sum::<f64>() / count;
            let rms = (off.iter().map(|off| off * off).sum::<f64>() / count).sqrt();
            let most = off.iter().fold(0.0_f64, |most, off| most.max(off.abs()));
            let _ = write!(text, "\n{what:<17} off by {rms:.4} RMS, {mean:+.4} mean, {most:.4} at most");
        }
    }
    text
}
