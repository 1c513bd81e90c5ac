//! A folder of scans of any lidar, with poses.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use common::geometry::Pose;
use common::kitti::{Scan, read_times};
use common::trajectory::StampedRow;
use nalgebra::Vector3;

use super::ANY_RANGE_M;
use super::Source;
use super::beams::Steps;
use super::config::InputConfig;
use super::formats::ScanFormat;
use super::map_frame::MapFrame;
use super::survey::{Placement, Poses, SurveyFrame, assumed_times_s, poses_at, times_of_rows};
use crate::drive::{Choice, Drive, Survey};
use crate::error::{Error, Result};
use crate::lidar::LidarConfig;

/// A folder of scans and what belongs to it.
#[derive(Debug, Clone)]
pub struct ScanInput<'a> {
    /// The folder, or the stitched cloud.
    pub path: &'a Path,
    /// Poses: TUM lines or KITTI rows.
    pub survey: &'a Path,
    /// Whose poses they are.
    pub frame: SurveyFrame,
    /// A `calib.txt` of KITTI's form, where there is a camera.
    pub calibration: Option<&'a Path>,
    /// A file of one time per scan, or of one per KITTI row, seconds.
    pub scan_times: Option<&'a Path>,
    /// What is taken off the coordinates of the survey's world, metres, where
    /// the first pose shall not decide it.
    pub reduced_by_m: Option<Vector3<f64>>,
}

/// Scans in a folder, all of one format.
#[derive(Debug, Clone)]
pub struct ScanFolder {
    folder: PathBuf,
    format: ScanFormat,
    /// The file of each frame.
    files: BTreeMap<usize, PathBuf>,
    /// Intensity that counts as a reflectance of 1.
    full_scale: f32,
    /// How far apart the points of the lidar are.
    steps: Steps,
}

/// Scans that are looked into for the scale of their intensities.
const LOOKED_INTO: usize = 5;

impl ScanFolder {
    /// Its name, for people.
    pub fn name(&self) -> String {
        let whole = self.folder.canonicalize().unwrap_or_else(|_| self.folder.clone());
        let name = whole.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        format!("scans {name}")
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The file of a frame.
    pub fn scan_path(&self, frame: usize) -> PathBuf {
        self.files.get(&frame).cloned().unwrap_or_else(|| self.folder.clone())
    }

    /// Says how far apart the points of the lidar are.
    pub fn put_steps(&mut self, steps: Steps) {
        self.steps = steps;
    }

    /// The scan of a frame.
    ///
    /// # Errors
    /// As [`ScanFormat::read`].
    pub fn read(&self, frame: usize, max_range_m: f32) -> Result<Scan> {
        let mut scan = self.format.read(&self.scan_path(frame), max_range_m, self.steps)?;
        for p in &mut scan.points {
            p.reflectance /= self.full_scale;
        }
        Ok(scan)
    }

    /// Largest intensity of a few of its scans.
    fn largest_intensity(&self, frames: &[usize]) -> Result<f32> {
        let step = frames.len().div_ceil(LOOKED_INTO).max(1);
        let mut largest = 0.0_f32;
        for &frame in frames.iter().step_by(step) {
            let scan = self.format.read(&self.scan_path(frame), ANY_RANGE_M, self.steps)?;
            largest = scan.points.iter().map(|p| p.reflectance).fold(largest, f32::max);
        }
        Ok(largest)
    }
}

/// Opens a folder of LAS, LAZ, PCD, PLY or KITTI scans in the frame of the
/// lidar. Poses by time (TUM) are interpolated at the scans' times, which come
/// from `scan_times` or from file names that are times; where scans have no
/// times, and for KITTI rows, pose and scan are matched by their number in
/// the file's name, else by their order; with KITTI rows `scan_times` then has
/// one time per row, and with TUM poses one per scan or per frame of the drive.
///
/// # Errors
/// A folder without scans or with two formats, poses that do not match, and as
/// [`Drive::open`].
pub fn open_scans(
    input: &ScanInput,
    choice: Choice,
    max_range_m: f32,
    config: &InputConfig,
    lidar: &LidarConfig,
) -> Result<Drive> {
    let (format, files) = scan_files(input.path)?;
    let poses = Poses::read(input.survey)?;
    let placement = Placement::new(input.frame, input.calibration, poses.first(), input.reduced_by_m)?;
    let Matched { files, poses, times_s, without } = matched(input, files, &poses, config)?;
    let gap = gap_note(&files, &times_s, config.longest_gap_s);
    let survey = Survey {
        path: input.survey.to_path_buf(),
        map_from_camera: poses.iter().map(|pose| placement.map_from_camera(pose)).collect(),
        times_s,
        camera_from_velodyne: placement.camera_from_velodyne,
        camera_is_thought: placement.camera_is_thought,
    };
    let frames: Vec<usize> = files.keys().copied().collect();
    let mut folder =
        ScanFolder { folder: input.path.to_path_buf(), format, files, full_scale: 1.0, steps: Steps::of(lidar) };
    let chosen = choice.of(frames.iter().copied());
    let largest = folder.largest_intensity(&chosen)?;
    folder.full_scale = config.full_scale(largest);
    let mut notes: Vec<String> = placement.note().into_iter().collect();
    if largest > 0.0 {
        notes.push(format!(
            "intensities up to {largest} in {}: {} counts as a reflectance of 1",
            input.path.display(),
            folder.full_scale
        ));
    }
    if without > 0 {
        notes.push(format!("{without} scans have no pose within {} s and are left out", config.longest_gap_s));
    }
    notes.extend(gap);
    let mut drive = Drive::new(Source::Scans(folder.into()), &frames, survey, choice, max_range_m)?;
    // Numbered by their order, they have no gaps but in time.
    notes.append(&mut drive.notes);
    drive.notes = notes;
    drive.frame = MapFrame::of_survey(input.frame, &placement.reduced_by_m);
    Ok(drive)
}

/// What to say of poses without a scan, where scans have the numbers of poses, and else
/// of the longest time without one: a copy may have left some out.
fn gap_note(frames: &BTreeMap<usize, PathBuf>, times_s: &[f64], longest_gap_s: f64) -> Option<String> {
    let missing = times_s.len() - frames.len().min(times_s.len());
    if missing > 0 {
        return Some(format!("{missing} of {} poses have no scan", times_s.len()));
    }
    let mut steps: Vec<(f64, f64)> = times_s.windows(2).map(|pair| (pair[1] - pair[0], pair[0])).collect();
    steps.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (usual_s, (most_s, from_s)) = (steps.get(steps.len() / 2)?.0, *steps.last()?);
    (most_s > longest_gap_s && most_s > GAP_STEPS * usual_s)
        .then(|| format!("no scan for {most_s:.1} s after {from_s:.3} s, and one every {usual_s:.1} s otherwise"))
}

/// A step from one scan to the next that is so many times as long as the usual one lacks
/// some.
const GAP_STEPS: f64 = 2.5;

/// The scans of a folder in the order of their names, numbers as numbers.
fn scan_files(folder: &Path) -> Result<(ScanFormat, Vec<PathBuf>)> {
    let mut found: Vec<(ScanFormat, PathBuf)> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(common::Error::io(folder))? {
        let path = entry.map_err(common::Error::io(folder))?.path();
        if let Some(format) = ScanFormat::of(&path).filter(|_| path.is_file()) {
            found.push((format, path));
        }
    }
    found.sort_by(|(_, a), (_, b)| {
        let (first, second) = ((number(a), natural(stem(a)), a), (number(b), natural(stem(b)), b));
        first.partial_cmp(&second).unwrap_or(std::cmp::Ordering::Equal)
    });
    let Some((format, first)) = found.first().cloned() else {
        return Err(Error::NoScanFiles { folder: folder.to_path_buf() });
    };
    if let Some((_, other)) = found.iter().find(|(other, _)| *other != format) {
        return Err(Error::MixedScans { first, other: other.clone() });
    }
    Ok((format, found.into_iter().map(|(_, path)| path).collect()))
}

fn stem(path: &Path) -> &str {
    path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default()
}

/// The number that a file is named by.
fn number(path: &Path) -> Option<f64> {
    stem(path).parse::<f64>().ok().filter(|v| v.is_finite())
}

/// A name as people sort it, `scan_2` before `scan_10`: what is between its whole
/// numbers, and these by their length and digits.
fn natural(name: &str) -> Vec<(&str, usize, &str)> {
    let (mut parts, mut rest) = (Vec::new(), name);
    while !rest.is_empty() {
        let (text, from) = rest.split_at(rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len()));
        let (digits, behind) = from.split_at(from.find(|c: char| !c.is_ascii_digit()).unwrap_or(from.len()));
        let value = digits.trim_start_matches('0');
        parts.push((text, value.len(), value));
        rest = behind;
    }
    parts
}

/// The time that a file is named by, seconds: a number with a point is one of
/// seconds, one of 19, 16 or 13 digits is one of nano-, micro- or milliseconds
/// of this century.
fn time_of(path: &Path) -> Option<f64> {
    let value = number(path)?;
    match stem(path).len() {
        _ if stem(path).contains('.') => Some(value),
        19 => Some(value * 1e-9),
        16 => Some(value * 1e-6),
        13 => Some(value * 1e-3),
        _ => None,
    }
}

struct Matched {
    files: BTreeMap<usize, PathBuf>,
    poses: Vec<Pose>,
    times_s: Vec<f64>,
    /// Scans that have no pose.
    without: usize,
}

fn matched(input: &ScanInput, files: Vec<PathBuf>, poses: &Poses, config: &InputConfig) -> Result<Matched> {
    let times_s = match poses {
        Poses::Stamped(rows) => scan_times(input, &files, rows)?,
        // Their times are those of the rows.
        Poses::Rows(_) => files.iter().map(|file| time_of(file)).collect(),
    };
    let miscounted = |poses: usize| Error::PosesAndScans {
        survey: input.survey.to_path_buf(),
        poses,
        folder: input.path.to_path_buf(),
        scans: files.len(),
    };
    match (poses, times_s) {
        (Poses::Stamped(rows), Some(times_s)) => {
            let found = poses_at(rows, &times_s, config.longest_gap_s, (input.survey, input.path))?;
            let without = found.iter().filter(|pose| pose.is_none()).count();
            let with = files.into_iter().zip(times_s).zip(found);
            let with: Vec<_> = with.filter_map(|((file, t), pose)| Some((file, t, pose?))).collect();
            Ok(Matched {
                poses: with.iter().map(|(_, _, pose)| *pose).collect(),
                times_s: with.iter().map(|(_, t, _)| *t).collect(),
                files: with.into_iter().map(|(file, _, _)| file).enumerate().collect(),
                without,
            })
        }
        (Poses::Stamped(rows), None) if rows.len() == files.len() => Ok(Matched {
            poses: rows.iter().map(|row| row.pose).collect(),
            times_s: rows.iter().map(|row| row.time_s).collect(),
            files: files.into_iter().enumerate().collect(),
            without: 0,
        }),
        (Poses::Stamped(rows), None) => {
            let frames = numbers(&files, rows.len()).ok_or_else(|| miscounted(rows.len()))?;
            Ok(Matched {
                files: frames.into_iter().zip(files).collect(),
                poses: rows.iter().map(|row| row.pose).collect(),
                times_s: rows.iter().map(|row| row.time_s).collect(),
                without: 0,
            })
        }
        (Poses::Rows(poses), times_s) => {
            let frames = match numbers(&files, poses.len()) {
                Some(numbers) => numbers,
                None if poses.len() == files.len() => (0..files.len()).collect(),
                None => return Err(miscounted(poses.len())),
            };
            let times_s = match input.scan_times {
                Some(path) => times_of_rows(path, input.survey, poses.len())?,
                None => times_s.filter(|t| t.len() == poses.len()).unwrap_or_else(|| assumed_times_s(poses.len())),
            };
            Ok(Matched { files: frames.into_iter().zip(files).collect(), poses: poses.clone(), times_s, without: 0 })
        }
    }
}

/// The frame of each scan, where they are named by numbers of so many frames.
fn numbers(files: &[PathBuf], frames: usize) -> Option<Vec<usize>> {
    let numbers: Option<Vec<usize>> = files.iter().map(|f| stem(f).parse().ok()).collect();
    numbers.filter(|n| n.iter().all(|n| *n < frames) && n.windows(2).all(|w| w[0] < w[1]))
}

/// The time of each scan, if it can be known.
fn scan_times(input: &ScanInput, files: &[PathBuf], rows: &[StampedRow]) -> Result<Option<Vec<f64>>> {
    let Some(path) = input.scan_times else {
        return Ok(files.iter().map(|f| time_of(f)).collect());
    };
    let times = read_times(path)?;
    if times.len() != files.len() {
        // One for each frame of the drive, of which some have a scan.
        let frames = numbers(files, times.len()).unwrap_or_default();
        let of_scans: Vec<f64> = frames.into_iter().map(|frame| times[frame]).collect();
        let span_s = rows.first().zip(rows.last()).map(|(first, last)| first.time_s..=last.time_s);
        if span_s.is_some_and(|span_s| of_scans.iter().any(|t| span_s.contains(t))) {
            return Ok(Some(of_scans));
        }
        return Err(Error::TimesAndScans {
            path: path.to_path_buf(),
            times: times.len(),
            folder: input.path.to_path_buf(),
            scans: files.len(),
        });
    }
    Ok(Some(times))
}
