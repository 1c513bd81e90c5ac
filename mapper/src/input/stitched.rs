//! One stitched cloud with a trajectory.
//!
//! The cloud is cut into slices, one per chosen place of the trajectory: a
//! point belongs to the place that is nearest in time, where point and
//! trajectory have times that fit, else to the nearest in space. A slice lies
//! on the disk like a scan, in the frame of the lidar at its place, so that
//! memory is bounded however large the cloud is.
//!
//! Where the trajectory goes on for longer than a gap before the first chosen
//! place or behind the last, its end is a place, too: what was seen on from there
//! would be near none.
//!
//! A slice is no scan: it holds what was seen from elsewhere, too. So poses
//! are taken as they are, and nothing that compares scans can be told. What stands in slices
//! that are cut in space is [dealt](super::deal) to the places that may have seen it.

use std::path::Path;

use common::geometry::Pose;
use common::kitti::ScanPoint;
use nalgebra::{Point2, Point3};
use rayon::prelude::*;

use super::Source;
use super::config::InputConfig;
use super::formats::{are_noise, at_a_time, cut_off, las_reader};
use super::map_frame::MapFrame;
use super::order::Tour;
use super::scans::ScanInput;
use super::slices::{Cut, Held, Slices};
use super::survey::{Placement, Poses, assumed_times_s, times_of_rows};
use crate::cloud::without_standing;
use crate::drive::{Choice, Drive, Survey};
use crate::error::{Error, Result};
use crate::lidar::LidarConfig;
use crate::path::{Path as DrivenPath, QuickPath, Way};

/// Share of the points with a time of the trajectory that must lie within reach of
/// where it was then, for the times to be believed. Points of other times say
/// nothing: a cloud may begin before the trajectory and end after it.
const TIMED_SHARE: f64 = 0.5;

/// Opens a stitched LAS or LAZ cloud, in the world of its trajectory.
///
/// # Errors
/// A cloud or a trajectory that cannot be read, [`Error::CloudApart`] where no
/// point is near the trajectory, and as [`Drive::open`].
pub fn open_stitched(
    input: &ScanInput,
    choice: Choice,
    max_range_m: f32,
    config: &InputConfig,
    lidar: &LidarConfig,
) -> Result<Drive> {
    let poses = Poses::read(input.survey)?;
    let placement = Placement::new(input.frame, input.calibration, poses.first(), input.reduced_by_m)?;
    let (poses, times_s): (Vec<Pose>, Option<Vec<f64>>) = match (poses, input.scan_times) {
        (Poses::Stamped(_), Some(times)) => {
            let (survey, times) = (input.survey.to_path_buf(), times.to_path_buf());
            return Err(Error::TimesTwice { survey, times });
        }
        (Poses::Stamped(rows), None) => {
            (rows.iter().map(|r| r.pose).collect(), Some(rows.iter().map(|r| r.time_s).collect()))
        }
        (Poses::Rows(poses), times) => {
            let times_s = times.map(|path| times_of_rows(path, input.survey, poses.len())).transpose()?;
            (poses, times_s)
        }
    };
    let map_from_camera: Vec<Pose> = poses.iter().map(|pose| placement.map_from_camera(pose)).collect();
    let chosen = choice.of(0..poses.len());
    if chosen.is_empty() {
        return Err(Error::NoScans { folder: input.path.to_path_buf(), every: choice.every });
    }
    let cutter = |places| Cutter::new(&placement, &map_from_camera, places, times_s.as_deref(), max_range_m, config);
    let all: Vec<usize> = (0..poses.len()).collect();
    let fit = times_s.as_ref().map(|_| times_fit(input.path, &cutter(&all))).transpose()?;
    let timed = matches!(fit, Some(TimesFit::Yes));
    let places = match times_s.as_ref().filter(|_| timed) {
        Some(times_s) => with_ends(&chosen, times_s, &choice, config.longest_gap_s),
        // Who stands sees nothing else, and nothing is nearer to one place than to the next.
        None => without_standing(&chosen, &map_from_camera, 1),
    };
    let cutter = cutter(&places);
    let mut slices = Slices::new(input.path, lidar)?;
    let tally = cutter.cut(input.path, slices.folder(), timed)?;
    if tally.used == 0 {
        return Err(Error::CloudApart {
            cloud: input.path.to_path_buf(),
            survey: input.survey.to_path_buf(),
            points: tally.points,
        });
    }
    slices.put_full_scale(config.full_scale(tally.largest_intensity));
    let tour = times_s.as_ref().filter(|_| timed).map(|times_s| Tour {
        times_s: times_s.clone(),
        map_from_velodyne: map_from_camera.iter().map(|pose| pose * placement.camera_from_velodyne).collect(),
    });
    slices.put_cut(Cut {
        places: places.iter().copied().zip(cutter.velodyne_from_map).collect(),
        tour,
        config: *config,
    });
    let mut notes: Vec<String> = placement.note().into_iter().collect();
    notes.push(format!(
        "{} of {} points lie along the trajectory, cut by {}; intensities up to {}, of which {} counts as a reflectance of 1",
        tally.used,
        tally.points,
        if timed { "time" } else { "position, and what stands dealt to the places that may have seen it" },
        tally.largest_intensity,
        slices.full_scale()
    ));
    notes.extend(fit.zip(times_s.as_ref()).and_then(|(fit, times_s)| fit.note(input, times_s)));
    if tally.noise > 0 {
        notes.push(format!(
            "{} points are withheld or of the classes of noise, 7 and 18, and are left out",
            tally.noise
        ));
    }
    notes.push("a stitched cloud has no single scans: its poses are taken as given, and what moved stays in it".into());
    let times_s = times_s.unwrap_or_else(|| assumed_times_s(poses.len()));
    let path = input.survey.to_path_buf();
    let frame = MapFrame::of_survey(input.frame, &placement.reduced_by_m);
    let Placement { camera_from_velodyne, camera_is_thought, .. } = placement;
    let survey = Survey { path, map_from_camera, times_s, camera_from_velodyne, camera_is_thought };
    let mut drive = Drive::new(Source::Stitched(slices.into()), &places, survey, choice, max_range_m)?;
    drive.notes = notes;
    drive.frame = frame;
    drive.frames = places;
    Ok(drive)
}

/// Chosen places, and the ends of what they are chosen from where these are farther
/// off than a gap.
fn with_ends(chosen: &[usize], times_s: &[f64], choice: &Choice, longest_gap_s: f64) -> Vec<usize> {
    let (first, last) = (choice.first, choice.last.min(times_s.len().saturating_sub(1)));
    let is_beyond = |end: usize, place: Option<&usize>| {
        place.is_some_and(|place| (times_s[end] - times_s[*place]).abs() > longest_gap_s)
    };
    let mut places = chosen.to_vec();
    if is_beyond(first, chosen.first()) {
        places.insert(0, first);
    }
    if is_beyond(last, chosen.last()) {
        places.push(last);
    }
    places
}

/// Whether most of the points of a cloud that have a time of the trajectory lie where
/// it was then; `cutter` has all its poses for places.
fn times_fit(cloud: &Path, cutter: &Cutter) -> Result<TimesFit> {
    let mut reader = las_reader(cloud)?;
    let (mut timed, mut fit) = (0_usize, 0_usize);
    let are_adjusted = reader.header().gps_time_type().is_standard();
    let mut span_s = (f64::INFINITY, f64::NEG_INFINITY);
    loop {
        let data = reader.read_points(at_a_time(&reader)).map_err(|e| Error::las(cloud, &e))?;
        let Some(times) = data.gps_time().filter(|_| !data.is_empty()) else { break };
        let positions = data.x().zip(data.y()).zip(data.z()).zip(times).zip(are_noise(&data));
        for ((((x, y), z), time_s), _) in positions.filter(|(_, is_noise)| !is_noise) {
            span_s = (span_s.0.min(time_s), span_s.1.max(time_s));
            let Some(place) = cutter.by_time(time_s) else { continue };
            let point_map = cutter.placement.map_from_cloud(&Point3::new(x, y, z));
            timed += 1;
            fit += usize::from(cutter.seen_from(place, &point_map).is_some());
        }
    }
    Ok(if fit > 0 && fit as f64 >= TIMED_SHARE * timed as f64 {
        TimesFit::Yes
    } else if span_s.0 < span_s.1 {
        TimesFit::No { cloud_s: span_s, are_elsewhere: timed > 0, are_adjusted }
    } else {
        TimesFit::NoTimes
    })
}

/// Whether the times of a cloud are those of a trajectory.
enum TimesFit {
    Yes,
    /// The cloud has none, or all are one.
    NoTimes,
    /// First and last time of the cloud, seconds; at those of the trajectory its points are
    /// elsewhere, or there are none. Adjusted are those of LAS 1.4 R15, bit 0 of the global
    /// encoding: GPS time less 1e9 s.
    No {
        cloud_s: (f64, f64),
        are_elsewhere: bool,
        are_adjusted: bool,
    },
}

impl TimesFit {
    /// What to say where points have times of no use.
    fn note(&self, input: &ScanInput, times_s: &[f64]) -> Option<String> {
        let Self::No { cloud_s: (first_s, last_s), are_elsewhere, are_adjusted } = self else { return None };
        let why =
            if *are_elsewhere { "most points are far from where it was then" } else { "no point has a time of it" };
        // The epoch of GPS is 315,964,800 s after that of Unix, which leaves out leap seconds.
        let how =
            if *are_adjusted { " (adjusted standard GPS time; from 2017 on Unix time less 1315964782 s)" } else { "" };
        Some(format!(
            "the GPS times of {} are from {first_s:.3} to {last_s:.3} s and those of {} from {:.3} to {:.3} s, and {why}, so \
             times are passed over: give poses in the time of the cloud{how} to have it cut by time",
            input.path.display(),
            input.survey.display(),
            times_s.first().copied().unwrap_or(f64::NAN),
            times_s.last().copied().unwrap_or(f64::NAN)
        ))
    }
}

/// A point of a cloud.
struct CloudPoint {
    /// Map frame, metres.
    position_map: Point3<f64>,
    intensity: f32,
    /// Seconds.
    time_s: Option<f64>,
}

/// What became of a cloud.
struct Tally {
    points: usize,
    used: usize,
    /// Those that the cloud says to be withheld or noise.
    noise: usize,
    largest_intensity: f32,
}

/// Cuts a cloud along a trajectory.
struct Cutter<'a> {
    placement: &'a Placement,
    places: &'a [usize],
    velodyne_from_map: Vec<Pose>,
    times_s: Option<Vec<f64>>,
    path: DrivenPath,
    /// Station of each place along the path, metres, ascending.
    stations_m: Vec<f64>,
    max_range_m: f64,
    config: &'a InputConfig,
}

impl<'a> Cutter<'a> {
    fn new(
        placement: &'a Placement,
        map_from_camera: &[Pose],
        places: &'a [usize],
        times_s: Option<&[f64]>,
        max_range_m: f32,
        config: &'a InputConfig,
    ) -> Self {
        let of = |place: &usize| map_from_camera[*place] * placement.camera_from_velodyne;
        let centres: Vec<Point3<f64>> = places.iter().map(|p| of(p).translation.vector.into()).collect();
        let path = DrivenPath::new(&centres, 0.0);
        let mut way = Way::default();
        let stations_m = centres.iter().map(|c| way.to(Point2::new(c.x, c.z))).collect();
        Self {
            placement,
            places,
            velodyne_from_map: places.iter().map(|p| of(p).inverse()).collect(),
            times_s: times_s.map(|t| places.iter().map(|p| t[*p]).collect()),
            path,
            stations_m,
            max_range_m: f64::from(max_range_m),
            config,
        }
    }

    /// The place nearest in time; none beyond the ends of the trajectory.
    fn by_time(&self, time_s: f64) -> Option<usize> {
        let times = self.times_s.as_ref()?;
        let (first, last) = (times.first()?, times.last()?);
        let beyond_s = (first - time_s).max(time_s - last);
        (beyond_s <= self.config.longest_gap_s).then(|| nearest(times, time_s))
    }

    /// A point in the frame of the lidar at a place; none that it cannot see so far.
    fn seen_from(&self, place: usize, point_map: &Point3<f64>) -> Option<Point3<f64>> {
        let point = self.velodyne_from_map[place] * point_map;
        (point.coords.norm() <= self.max_range_m).then_some(point)
    }

    /// The place nearest in space.
    fn by_position(&self, path: &QuickPath, point_map: &Point3<f64>) -> usize {
        let place = path.place(&Point2::new(point_map.x, point_map.z));
        nearest(&self.stations_m, place.station_m)
    }

    fn cut(&self, cloud: &Path, folder: &Path, timed: bool) -> Result<Tally> {
        let mut reader = las_reader(cloud)?;
        let promised = reader.header().number_of_points();
        let mut tally = Tally { points: 0, used: 0, noise: 0, largest_intensity: 0.0 };
        let mut held = Held::new(folder, self.places, self.config.held_points);
        let mut path = QuickPath::new(&self.path);
        loop {
            let data = reader.read_points(at_a_time(&reader)).map_err(|e| Error::las(cloud, &e))?;
            if data.is_empty() {
                break;
            }
            tally.points += data.len();
            let times: Vec<f64> = data.gps_time().map_or_else(Vec::new, Iterator::collect);
            let positions =
                data.x().zip(data.y()).zip(data.z()).zip(data.intensity()).zip(are_noise(&data)).enumerate();
            let points: Vec<CloudPoint> = positions
                .filter(|(_, (_, is_noise))| !is_noise)
                .map(|(i, ((((x, y), z), intensity), _))| CloudPoint {
                    position_map: self.placement.map_from_cloud(&Point3::new(x, y, z)),
                    intensity: f32::from(intensity),
                    time_s: times.get(i).copied(),
                })
                .collect();
            tally.noise += data.len() - points.len();
            let is_in_space = |p: &CloudPoint| !timed || p.time_s.is_none();
            let ground = |p: &CloudPoint| Point2::new(p.position_map.x, p.position_map.z);
            path.expect(&points.iter().filter(|p| is_in_space(p)).map(ground).collect::<Vec<_>>());
            let seen = |p: &CloudPoint| {
                let place = match p.time_s.filter(|_| timed) {
                    Some(time_s) => self.by_time(time_s)?,
                    None => self.by_position(&path, &p.position_map),
                };
                Some((place, self.seen_from(place, &p.position_map)?))
            };
            let seen: Vec<Option<(usize, Point3<f64>)>> = points.par_iter().map(seen).collect();
            for (CloudPoint { intensity, time_s, .. }, seen) in points.iter().zip(seen) {
                let Some((place, point)) = seen else { continue };
                tally.largest_intensity = tally.largest_intensity.max(*intensity);
                let [x_m, y_m, z_m] = [point.x as f32, point.y as f32, point.z as f32];
                held.add(place, ScanPoint { x_m, y_m, z_m, reflectance: *intensity }, *time_s)?;
                tally.used += 1;
            }
        }
        if (tally.points as u64) < promised {
            return Err(cut_off(cloud, promised, tally.points));
        }
        held.put_away()?;
        Ok(tally)
    }
}

/// Index of the ascending value that is nearest.
fn nearest(ascending: &[f64], value: f64) -> usize {
    let after = ascending.partition_point(|v| *v < value).min(ascending.len().saturating_sub(1));
    let before = after.saturating_sub(1);
    if (value - ascending[before]).abs() <= (ascending[after] - value).abs() { before } else { after }
}
