//! `mapper build`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use common::atomic_file::{Staged, stage};
use common::geometry::Pose;
use common::kitti::poses_text;
use common::map::{EncodeOptions, SemanticMap};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::reduce::kept_text;
use super::source::SourceArgs;
use super::usage::Usage;
use super::{ConfigArgs, Outcome, print, print_json};
use crate::budget::{Counts, Known, reduce};
use crate::config::Config;
use crate::drive::Drive;
use crate::error::{Error, Result};
use crate::export::{CloudCount, CloudFile, Coordinates, Frame};
use crate::inspect::{build_text, count_text, road_length_m};
use crate::lidar::measured;
use crate::outputs::{self, Output};
use crate::report::{BuildReport, ScanCounts, checksum, path_beside, settings, stage_beside};
use crate::{Built, PoseSource, build};

/// Build a map from the scans and the survey of a drive.
#[derive(Debug, Args)]
pub struct Build {
    #[command(flatten)]
    source: SourceArgs,
    /// Poses to stitch with: the survey's as given, or refined with the scans.
    #[arg(long, value_enum, default_value_t)]
    poses: PoseSource,
    /// The map to write; a report of the build goes beside it (04.build.json
    /// beside 04.csm).
    #[arg(long, value_name = "MAP.csm", required_unless_present = "print_config")]
    out: Option<PathBuf>,
    /// Write the poses that the map was built with, one KITTI row for every
    /// frame of the drive.
    #[arg(long, value_name = "POSES.txt")]
    trajectory: Option<PathBuf>,
    /// Write the stitched cloud with a class per point (LAZ, or LAS where it is
    /// named .las).
    #[arg(long, value_name = "CLOUD.laz")]
    cloud: Option<PathBuf>,
    /// Whose coordinates the cloud has, z up: the map's, or those of the survey, where its own
    /// clouds lie.
    #[arg(long, value_enum, default_value_t, requires = "cloud")]
    coordinates: Coordinates,
    #[command(flatten)]
    config: ConfigArgs,
    /// Most bytes that the map may have: of landmarks that do not fit, those
    /// that localize best are kept [default: all].
    #[arg(long, value_name = "BYTES")]
    budget: Option<usize>,
    /// Print the summary as JSON.
    #[arg(long)]
    json: bool,
    /// Number of threads [default: one per core]. More than there are cores cost time.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=MOST_THREADS))]
    threads: Option<u32>,
}

/// More cores than machines have; thousands of threads take minutes to no end.
const MOST_THREADS: i64 = 512;

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary<'a> {
    map: &'a Path,
    poles: usize,
    signs: usize,
    lanes: usize,
    road_m: f64,
    /// What the reader of the input, and who looks at the scans, wants people to know.
    notes: &'a [String],
    usage: Usage,
    report: &'a BuildReport,
}

impl Build {
    /// Runs the command.
    pub fn run(&self) -> Result<Outcome> {
        // The command line lets `--out` be absent with `--print-config` only.
        if let Some((config, out)) = self.config.load(Config::load)?.zip(self.out.as_deref()) {
            let threads = self.threads.unwrap_or(0) as usize;
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .map_err(|e| Error::Threads { threads, reason: e.to_string() })?;
            pool.install(|| self.build(out, &config))?;
        }
        Ok(Outcome::Done)
    }

    /// Opens the drive, once it is known that nothing of it will be written over.
    fn open(&self, out: &Path, config: &Config) -> Result<Drive> {
        let report = path_beside(out);
        let more = [("--trajectory", self.trajectory.as_deref()), ("--cloud", self.cloud.as_deref())];
        let more = more.into_iter().filter_map(|(option, path)| Some((option, path?)));
        let outputs: Vec<Output> =
            [("--out", out), ("the report beside the map", &report)].into_iter().chain(more).collect();
        let files = self.source.files();
        outputs::check(&outputs, files.iter().map(PathBuf::as_path).chain(self.config.file()))?;
        let drive = self.source.open(config)?;
        let scans: Vec<PathBuf> = (0..drive.survey.len()).map(|frame| drive.scan_path(frame)).collect();
        outputs::check(&outputs, scans.iter().map(PathBuf::as_path))?;
        Ok(drive)
    }

    /// Writes the map and what goes with it. All is on the disk before anything gets its
    /// name, the map last: no map is without its report.
    fn write(
        &self,
        (out, bytes): (&Path, &[u8]),
        report: &BuildReport,
        map_from_camera: &[Pose],
        cloud: Option<CloudFile>,
    ) -> Result<Option<CloudCount>> {
        let mut staged: Vec<Staged> = Vec::new();
        // Landmarks are numbered as in the file, which has an order of its own.
        let cloud = cloud.map(|cloud| cloud.finish(&SemanticMap::decode(bytes)?)).transpose()?;
        let count = cloud.map(|(count, file)| {
            staged.push(file);
            count
        });
        if let Some(path) = &self.trajectory {
            staged.push(stage(path, poses_text(map_from_camera).as_bytes())?);
        }
        staged.extend(stage_beside(out, report)?);
        staged.push(stage(out, bytes)?);
        staged.into_iter().try_for_each(Staged::commit)?;
        Ok(count)
    }

    fn build(&self, out: &Path, config: &Config) -> Result<()> {
        let started = Instant::now();
        let mut drive = self.open(out, config)?;
        let config = &Config { lidar: measured(&mut drive, &config.lidar)?, ..config.clone() };
        // What is no scan cannot be registered against another.
        let poses = if drive.has_single_scans() { self.poses } else { PoseSource::Given };

        let (mut scans, mut blind) = (ScanCounts::default(), Vec::new());
        let frame = match self.coordinates {
            Coordinates::Map => Frame::Local(Some(drive.frame)),
            Coordinates::Survey => Frame::Survey(drive.frame),
        };
        let mut cloud = self.cloud.as_deref().map(|path| CloudFile::create(path, config, frame)).transpose()?;
        let bar = progress();
        let Built { map, registration, evidence } = build(&drive, poses, config, |window| {
            // Windows overlap: a scan counts where it is seen first.
            for scan in &window.cloud.scans {
                if scans.scans == 0 || scan.frame > scans.last_frame {
                    scans.add(scan);
                    blind.extend((scan.points == 0).then_some(scan.frame));
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

        let found = map.encode(&EncodeOptions { quantum_m: config.quantum_m })?;
        // In the order of the file, which is not that of the map that was built.
        let stored = SemanticMap::decode(&found)?;
        let evidence = evidence.of_map(&stored, config.quantum_m, &config.evidence);
        let whole = Known { map: &stored, evidence: &evidence, quantum_m: config.quantum_m };
        let reduced = self.budget.map(|bytes| reduce(whole, bytes, &config.budget)).transpose()?;
        let (map, bytes, evidence) = match reduced {
            Some(reduced) => (reduced.map, reduced.bytes, reduced.evidence),
            None => (map, found, evidence),
        };
        let report = BuildReport {
            map_bytes: bytes.len(),
            map_crc32c: checksum(&bytes),
            poses,
            frames: drive.survey.len(),
            frame: Some(drive.frame),
            scans,
            registration: registration.report,
            survey_jumps: registration.jumps,
            evidence,
            config: settings(out, config)?,
        };
        let cloud = self.write((out, &bytes), &report, &registration.map_from_camera, cloud)?;
        let mut notes = drive.notes.clone();
        notes.extend(blind_note(&blind).filter(|_| drive.has_single_scans()));
        let usage = Usage::of(started, &drive);
        let road_m = road_length_m(&map);
        if self.json {
            return print_json(&Summary {
                map: out,
                poles: map.poles.len(),
                signs: map.signs.len(),
                lanes: map.lanes.len(),
                road_m,
                notes: &notes,
                usage,
                report: &report,
            });
        }
        print(&format!("{}: {} bytes for {road_m:.0} m of road: {}\n", out.display(), bytes.len(), count_text(&map)));
        for note in &notes {
            print(&format!("{note}\n"));
        }
        if self.budget.is_some() {
            print(&kept_text(Counts::of(&map), Counts::of(&stored)));
        }
        print(&build_text(&report));
        print(&usage.text());
        if let (Some(path), Some(count)) = (&self.cloud, cloud) {
            print(&format!("{}: {} points, {} left out\n", path.display(), count.written, count.left_out));
        }
        Ok(())
    }
}

/// What to say of scans without a point that can be used: a file that is empty would have
/// been refused.
fn blind_note(frames: &[usize]) -> Option<String> {
    let first = frames.first()?;
    let more = if frames.len() > 1 { format!(" and {} more", frames.len() - 1) } else { String::new() };
    Some(format!("the scan of frame {first}{more} has no point with finite coordinates within reach"))
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
