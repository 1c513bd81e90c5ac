//! The options that say which drive a map is built from.

use std::path::{Path, PathBuf};

use clap::Args;
use common::coordinates_m;
use common::kitti::{RawDrive, Sequence};
use nalgebra::Vector3;

use crate::config::Config;
use crate::drive::{Choice, Drive, MAX_RANGE_M};
use crate::error::{Error, Result};
use crate::input::{Deskew, ScanInput, SurveyFrame, open_raw, open_scans, open_stitched};

/// Which drive, and which frames of it.
#[derive(Debug, Args)]
pub struct SourceArgs {
    /// KITTI odometry: the folder with `sequences/` and `poses/`.
    #[arg(long, value_name = "ROOT", requires = "sequence")]
    kitti: Option<PathBuf>,
    /// The drive of KITTI odometry, such as 04.
    #[arg(long, value_name = "NN", requires = "kitti", conflicts_with_all = ["raw", "scans", "stitched"])]
    sequence: Option<String>,
    /// KITTI raw: the folder `DATE_drive_NNNN_sync`; the calibration of the
    /// day lies beside it.
    #[arg(long, value_name = "SYNC", conflicts_with_all = ["kitti", "scans", "stitched", "survey"])]
    raw: Option<PathBuf>,
    /// A folder of scans (.las, .laz, .pcd, .ply, or .bin as KITTI's) in the frame of
    /// the lidar or the vehicle: x forward, y left, z up.
    #[arg(long, value_name = "FOLDER", requires = "survey", conflicts_with_all = ["kitti", "stitched"])]
    scans: Option<PathBuf>,
    /// A stitched cloud (.las, .laz), z up, in the world of its poses.
    #[arg(long, value_name = "CLOUD.laz", requires = "survey", conflicts_with = "kitti")]
    stitched: Option<PathBuf>,
    /// The survey: one pose per frame as KITTI rows [default with --kitti:
    /// ROOT/poses/NN.txt]; with --scans and --stitched TUM lines, too.
    #[arg(long, value_name = "POSES.txt")]
    survey: Option<PathBuf>,
    /// With --scans and --stitched: whose poses the survey holds.
    #[arg(long, value_enum, default_value_t, conflicts_with_all = ["kitti", "raw"])]
    survey_frame: SurveyFrame,
    /// With --scans and TUM poses: one time per scan, seconds [default: file
    /// names that are times]; with KITTI rows: one time per pose.
    #[arg(long, value_name = "TIMES.txt", conflicts_with_all = ["kitti", "raw"])]
    scan_times: Option<PathBuf>,
    /// With --scans and --stitched: what is taken off the coordinates of the
    /// survey, metres along its axes: the same for all drives of one frame
    /// [default: of coordinates beyond 20 km the multiple of 10 km below those
    /// of the first pose].
    #[arg(
        long,
        value_name = "X,Y,Z",
        value_parser = coordinates_m,
        allow_hyphen_values = true,
        conflicts_with_all = ["kitti", "raw"]
    )]
    reduce: Option<Vector3<f64>>,
    /// With --scans and --stitched: KITTI's `calib.txt`, whose `Tr` leads from
    /// the lidar to the camera [default: a camera at the lidar's place]. With
    /// --raw: the folder of the three files of the day.
    #[arg(long, value_name = "PATH", conflicts_with = "kitti")]
    calib: Option<PathBuf>,
    /// With --raw and --scans: take out the motion during the lidar's turn, by
    /// the sense in which it turns, seen from above. Recordings of KITTI and
    /// most others need it; what `fixtures` makes does not.
    #[arg(long, value_enum, default_value_t, conflicts_with_all = ["kitti", "stitched"])]
    deskew: Deskew,
    /// Stitch every Nth frame only.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// First frame to stitch.
    #[arg(long, value_name = "FRAME", default_value_t = 0)]
    first: usize,
    /// Last frame to stitch [default: the last one that has a scan].
    #[arg(long, value_name = "FRAME")]
    last: Option<usize>,
}

impl SourceArgs {
    /// Opens the drive.
    pub fn open(&self, config: &Config) -> Result<Drive> {
        let mut drive = self.opened(config)?;
        drive.deskew = (self.deskew, config.input.turn_s);
        Ok(drive)
    }

    /// The files that the options name. The scans are not among them.
    pub fn files(&self) -> Vec<PathBuf> {
        let named = [&self.survey, &self.calib, &self.scan_times, &self.stitched].into_iter().flatten().cloned();
        // What cannot be opened is told when the drive is.
        let sequence = self.kitti.iter().zip(&self.sequence).filter_map(|(root, name)| Sequence::open(root, name).ok());
        let drive = sequence.flat_map(|drive| [drive.calibration_path(), drive.times_path(), drive.poses_path()]);
        let raw = self.raw.iter().filter_map(|folder| RawDrive::open(folder, self.calib.as_deref()).ok());
        named.chain(drive).chain(raw.flat_map(|drive| drive.files())).collect()
    }

    fn opened(&self, config: &Config) -> Result<Drive> {
        let every = self.every as usize;
        let choice = Choice { every, first: self.first, last: self.last.unwrap_or(usize::MAX) };
        if let Some(folder) = &self.raw {
            return open_raw(folder, self.calib.as_deref(), choice, MAX_RANGE_M);
        }
        if let (Some(path), Some(survey)) = (self.scans.as_deref().or(self.stitched.as_deref()), &self.survey) {
            let input = self.input(path, survey);
            let open = if self.scans.is_some() { open_scans } else { open_stitched };
            return open(&input, choice, MAX_RANGE_M, &config.input, &config.lidar);
        }
        let (Some(root), Some(sequence)) = (&self.kitti, &self.sequence) else { return Err(Error::NoSource) };
        Drive::open(root, sequence, every, (choice.first, choice.last), self.survey.as_deref(), MAX_RANGE_M)
    }

    fn input<'a>(&'a self, path: &'a Path, survey: &'a Path) -> ScanInput<'a> {
        ScanInput {
            path,
            survey,
            frame: self.survey_frame,
            calibration: self.calib.as_deref(),
            scan_times: self.scan_times.as_deref(),
            reduced_by_m: self.reduce,
        }
    }
}
