//! `localizer segment`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::input::{all_but, progress, tell_passed_over};
use crate::Result;
use crate::camera::Source;
use crate::drive::Drive;
use crate::vision::VisionConfig;
use crate::vision::network::Runtime;

/// Arguments of `localizer segment`.
#[derive(Debug, Args)]
pub struct SegmentArgs {
    /// Folder with `sequences/` in KITTI odometry layout.
    #[arg(long, value_name = "ROOT")]
    kitti: PathBuf,
    /// Name of the sequence.
    #[arg(long, value_name = "NN", default_value = "04")]
    sequence: String,
    /// Network for poles, signs and lights (.onnx).
    #[arg(long, value_name = "FILE")]
    pole_net: Option<PathBuf>,
    /// Network for lane lines (.onnx).
    #[arg(long, value_name = "FILE")]
    lane_net: Option<PathBuf>,
    /// What runs the networks; `ort` needs a program built with the feature
    /// `ort`, and the library that `ORT_DYLIB_PATH` names.
    #[arg(long, value_enum, default_value_t)]
    runtime: Runtime,
    /// First frame.
    #[arg(long, value_name = "F", default_value_t = 0)]
    first: usize,
    /// Last frame; default: the last that has an image.
    #[arg(long, value_name = "L")]
    last: Option<usize>,
    /// Output folder; is created.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub fn execute(args: &SegmentArgs) -> Result<bool> {
    let networks: Vec<&Path> = [&args.pole_net, &args.lane_net].into_iter().flatten().map(PathBuf::as_path).collect();
    common::atomic_file::check_folder(&args.out)?;
    let source = Source::open(&networks, args.runtime, None)?;
    let config = VisionConfig::default();
    let drive = Drive::open(&args.kitti, &args.sequence, None, args.first, args.last, config.widest_px)?;
    let bar = progress(drive.frames.len(), "segment");
    let mut unread = 0;
    drive.see_all(drive.frames.iter().copied(), &source, &config, |frame, seen| {
        bar.inc(1);
        match seen {
            Err(error) if error.is_of_an_image() => {
                bar.suspend(|| tell_passed_over(frame, error));
                unread += 1;
            }
            seen => drive.camera.write_labels(&args.out, frame, &seen?)?,
        }
        Ok(())
    })?;
    bar.finish_and_clear();
    common::say!("{} frames written to {}", drive.frames.len() - unread, args.out.display());
    all_but(unread)
}
