//! `mapper build`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use common::config;
use common::map::EncodeOptions;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::usage::Usage;
use super::{Outcome, print, print_json};
use crate::config::Config;
use crate::drive::Drive;
use crate::error::{Error, Result};
use crate::export::CloudFile;
use crate::inspect::{build_text, count_text, road_length_m};
use crate::report::{BuildReport, ScanCounts, checksum, write_beside};
use crate::{Built, PoseSource, build};

/// Build a map from the scans and the survey of a drive.
#[derive(Debug, Args)]
pub struct Build {
    /// Folder with `sequences/` and `poses/`, as KITTI odometry has it.
    #[arg(long, value_name = "ROOT", required_unless_present = "print_config")]
    kitti: Option<PathBuf>,
    /// The drive, such as 04.
    #[arg(long, value_name = "NN", required_unless_present = "print_config")]
    sequence: Option<String>,
    /// Stitch every Nth frame only.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// First frame to stitch.
    #[arg(long, value_name = "FRAME", default_value_t = 0)]
    first: usize,
    /// Last frame to stitch [default: the last one that has a scan].
    #[arg(long, value_name = "FRAME")]
    last: Option<usize>,
    /// Poses to stitch with: the survey's as given, or refined with the scans.
    #[arg(long, value_enum, default_value_t)]
    poses: PoseSource,
    /// The survey: one pose per frame of the drive [default: ROOT/poses/NN.txt].
    #[arg(long, value_name = "POSES.txt")]
    survey: Option<PathBuf>,
    /// The map to write; a report of the build goes beside it (04.build.json
    /// beside 04.csm).
    #[arg(long, value_name = "MAP.csm", required_unless_present = "print_config")]
    out: Option<PathBuf>,
    /// Write the poses that the map was built with, one KITTI row for every
    /// frame of the drive.
    #[arg(long, value_name = "POSES.txt")]
    trajectory: Option<PathBuf>,
    /// Write the stitched cloud with a class per point (LAZ: x right, y
    /// forward, z up).
    #[arg(long, value_name = "CLOUD.laz")]
    cloud: Option<PathBuf>,
    /// Settings that differ from the defaults, as TOML.
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Print all settings as TOML and end.
    #[arg(long)]
    print_config: bool,
    /// Print the summary as JSON.
    #[arg(long)]
    json: bool,
    /// Number of threads [default: one per core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    threads: Option<u32>,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary<'a> {
    map: &'a Path,
    poles: usize,
    signs: usize,
    lanes: usize,
    road_m: f64,
    usage: Usage,
    report: &'a BuildReport,
}

impl Build {
    /// Runs the command.
    pub fn run(&self) -> Result<Outcome> {
        let config: Config = self.config.as_ref().map_or_else(|| Ok(Config::default()), config::load)?;
        // The command line lets these be absent with --print-config only.
        if let (Some(kitti), Some(sequence), Some(out)) = (&self.kitti, &self.sequence, &self.out)
            && !self.print_config
        {
            let threads = self.threads.unwrap_or(0) as usize;
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .map_err(|e| Error::Threads { threads, reason: e.to_string() })?;
            pool.install(|| self.build(kitti, sequence, out, &config))?;
        } else {
            print(&config::to_toml(&config)?);
        }
        Ok(Outcome::Done)
    }

    fn build(&self, kitti: &Path, sequence: &str, out: &Path, config: &Config) -> Result<()> {
        let started = Instant::now();
        for path in [Some(out), self.trajectory.as_deref(), self.cloud.as_deref()].into_iter().flatten() {
            can_be_written(path)?;
        }
        let span = (self.first, self.last.unwrap_or(usize::MAX));
        let drive = Drive::open(kitti, sequence, self.every as usize, span, self.survey.as_deref(), MAX_RANGE_M)?;

        let mut scans = ScanCounts::default();
        let mut cloud = self.cloud.as_deref().map(|path| CloudFile::create(path, config)).transpose()?;
        let bar = progress();
        let Built { map, registration } = build(&drive, self.poses, config, |window| {
            // Windows overlap: a scan counts where it is seen first.
            for scan in &window.cloud.scans {
                if scans.scans == 0 || scan.frame > scans.last_frame {
                    scans.add(scan);
                }
            }
            if let Some(cloud) = &mut cloud {
                cloud.add(window, &drive.times_s)?;
            }
            bar.set_length(window.count as u64);
            bar.set_position(window.done as u64);
            Ok(())
        })?;
        bar.finish_and_clear();

        let bytes = map.encode(&EncodeOptions { quantum_m: config.quantum_m })?;
        common::atomic_file::write(out, &bytes)?;
        let usage = Usage::of(started, &drive);
        let report = BuildReport {
            map_bytes: bytes.len(),
            map_crc32c: checksum(&bytes),
            poses: self.poses,
            frames: drive.survey.len(),
            scans,
            registration: registration.report,
            config: config.clone(),
        };
        write_beside(out, &report)?;
        if let Some(path) = &self.trajectory {
            common::kitti::write_poses(path, &registration.map_from_camera)?;
        }
        let road_m = road_length_m(&map);
        let cloud = cloud.map(CloudFile::finish).transpose()?;
        if self.json {
            return print_json(&Summary {
                map: out,
                poles: map.poles.len(),
                signs: map.signs.len(),
                lanes: map.lanes.len(),
                road_m,
                usage,
                report: &report,
            });
        }
        print(&format!("{}: {} bytes for {road_m:.0} m of road: {}\n", out.display(), bytes.len(), count_text(&map)));
        print(&build_text(&report));
        print(&usage.text());
        if let (Some(path), Some(count)) = (&self.cloud, cloud) {
            print(&format!("{}: {} points, {} left out\n", path.display(), count.written, count.left_out));
        }
        Ok(())
    }
}

/// Farthest point read, metres: the reach of the lidar. What is stitched and
/// what is registered ends nearer, by the settings.
const MAX_RANGE_M: f32 = 120.0;

/// Says so before the work, not after it, where a file has no folder.
fn can_be_written(path: &Path) -> Result<()> {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() && !folder.is_dir() => {
            Err(common::Error::MissingFolder { path: path.to_path_buf(), folder: folder.to_path_buf() }.into())
        }
        _ => Ok(()),
    }
}

/// A progress bar; hidden by itself where the error stream is no terminal. It
/// ticks while the poses are refined, before the first window.
fn progress() -> ProgressBar {
    let bar = ProgressBar::new(1);
    if let Ok(style) = ProgressStyle::with_template("build {spinner} {wide_bar} {pos}/{len} windows {elapsed}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(std::time::Duration::from_millis(100));
    bar
}
