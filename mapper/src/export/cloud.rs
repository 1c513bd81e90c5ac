//! The stitched cloud as LAZ, with a class per point.
//!
//! Columns are held in a pasture buffer, one window of the drive at a time,
//! and go out through `las`. pasture brings a nalgebra of its own: no type of
//! either package leaves this module.
//!
//! | class | what |
//! |---|---|
//! | 1 | anything else |
//! | 2 | ground |
//! | 11 | road surface: ground that the vehicle drove over |
//! | 64, 65, 66, 67 | lamp post, sign post, delineator, trunk |
//! | 68, 69 | traffic sign, traffic light |
//! | 70 | paint of a lane line |
//!
//! Axes are x right, y forward, z up (map x, z, -y), for viewers take z for
//! the height; metres in steps of 1 mm. Intensity is the reflectance, full
//! scale 65535; the point source is the frame; the time is that of the frame.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use common::map::{LaneLine, Pole, PoleKind, Sign, SignKind};
use las::point::{Classification, Format};
use las::{Builder, Transform, Vector, Writer};
use nalgebra::Point3;
use pasture_core::containers::{BorrowedBuffer, BorrowedBufferExt, HashMapBuffer};
use pasture_core::layout::PointLayout;
use pasture_core::layout::attributes::{CLASSIFICATION, INTENSITY, POINT_SOURCE_ID, POSITION_3D};
use pasture_core::nalgebra::Vector3 as PastureVector3;
use rayon::prelude::*;

use crate::build::Window;
use crate::cloud::CloudPoint;
use crate::config::Config;
use crate::error::{Error, Result};

/// Step of the coordinates in the file, metres.
const STEP_M: f64 = 0.001;
/// Farthest coordinate that the file can hold, metres: 31 bits of steps.
const FARTHEST_M: f64 = 2.0e6;
/// Distance from a pole's axis within which a point is the pole's, metres: a
/// thick post, and what is left of the poses' errors.
const POLE_RADIUS_M: f64 = 0.25;
/// Distance beyond a sign's radius within which a bright point is the sign's,
/// metres.
const SIGN_MARGIN_M: f64 = 0.15;
/// Half the width of what the vehicle drove over, metres: a narrow car.
const DRIVEN_HALF_WIDTH_M: f64 = 0.8;

const OTHER: u8 = 1;
const GROUND: u8 = 2;
const ROAD_SURFACE: u8 = 11;
const POLE: u8 = 64;
const SIGN: u8 = 68;
const LANE_PAINT: u8 = 70;

/// A LAZ file in the making; nothing is on disk before [`Self::finish`].
pub struct CloudFile {
    path: PathBuf,
    config: Config,
    writer: Writer<Cursor<Vec<u8>>>,
    count: CloudCount,
}

/// Points of a LAZ file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CloudCount {
    /// Points in the file.
    pub written: usize,
    /// Points that are not finite, or farther off than the file can say.
    pub left_out: usize,
}

impl CloudFile {
    /// Begins a file; `config` is that of the build.
    ///
    /// # Errors
    /// [`Error::Cloud`] with what the writer says.
    pub fn create(path: &Path, config: &Config) -> Result<Self> {
        let axis = Transform { scale: STEP_M, offset: 0.0 };
        let mut builder = Builder::from((1, 4));
        // No date: the same cloud is the same bytes tomorrow.
        builder.date = None;
        builder.generating_software = concat!("waymark mapper ", env!("CARGO_PKG_VERSION")).into();
        builder.transforms = Vector { x: axis, y: axis, z: axis };
        let writer = Format::new(6).and_then(|mut format| {
            format.is_compressed = true;
            builder.point_format = format;
            Writer::new(Cursor::new(Vec::new()), builder.into_header()?)
        });
        let writer = writer.map_err(|e| fault(path, &e))?;
        Ok(Self { path: path.to_path_buf(), config: config.clone(), writer, count: CloudCount::default() })
    }

    /// Adds the points that a window owns. `times_s` are the times of the
    /// drive's frames, seconds.
    ///
    /// # Errors
    /// [`Error::Cloud`] with what the writer says.
    pub fn add(&mut self, window: &Window, times_s: &[f64]) -> Result<()> {
        self.write(&columns(window, &self.config), times_s)
    }

    fn write(&mut self, columns: &HashMapBuffer, times_s: &[f64]) -> Result<()> {
        let positions = columns.view_attribute::<PastureVector3<f64>>(&POSITION_3D);
        let intensities = columns.view_attribute::<u16>(&INTENSITY);
        let classes = columns.view_attribute::<u8>(&CLASSIFICATION);
        let frames = columns.view_attribute::<u16>(&POINT_SOURCE_ID);
        for i in 0..columns.len() {
            let position = positions.at(i);
            // The writer takes NaN without complaint, and panics in the end
            // on what its header cannot hold.
            if !position.iter().all(|v| v.abs() < FARTHEST_M) {
                self.count.left_out += 1;
                continue;
            }
            let frame = frames.at(i);
            let point = las::Point {
                x: position.x,
                y: position.y,
                z: position.z,
                intensity: intensities.at(i),
                return_number: 1,
                number_of_returns: 1,
                classification: Classification::new(classes.at(i)).unwrap_or_default(),
                point_source_id: frame,
                gps_time: Some(times_s.get(usize::from(frame)).copied().unwrap_or(0.0)),
                ..las::Point::default()
            };
            self.writer.write_point(point).map_err(|e| fault(&self.path, &e))?;
            self.count.written += 1;
        }
        Ok(())
    }

    /// Writes the file.
    ///
    /// # Errors
    /// [`Error::Cloud`] with what the writer says, and as
    /// [`common::atomic_file::write`].
    pub fn finish(mut self) -> Result<CloudCount> {
        self.writer.close().map_err(|e| fault(&self.path, &e))?;
        let bytes = self.writer.into_inner().map_err(|e| fault(&self.path, &e))?.into_inner();
        common::atomic_file::write(&self.path, &bytes)?;
        Ok(self.count)
    }
}

fn fault(path: &Path, error: &las::Error) -> Error {
    Error::Cloud { path: path.to_path_buf(), reason: error.to_string() }
}

/// The points that a window owns, in the order of the scans, as columns.
fn columns(window: &Window, config: &Config) -> HashMapBuffer {
    let cloud = window.cloud;
    let owned: Vec<(&CloudPoint, u8)> = cloud
        .points
        .par_iter()
        .filter_map(|p| {
            let place = cloud.place(&p.position);
            window.owned.contains(&place.station_m).then(|| (p, class(p, place.offset_m, window, config)))
        })
        .collect();
    let frame = |p: &CloudPoint| cloud.scans.get(usize::from(p.scan)).map_or(0, |s| s.frame);
    let position = |p: &CloudPoint| PastureVector3::new(p.position.x, p.position.z, -p.position.y);
    let intensity = |p: &CloudPoint| (p.reflectance.clamp(0.0, 1.0) * 65535.0).round() as u16;
    // No drive of KITTI has as many frames as the field has numbers.
    let source = |p: &CloudPoint| frame(p).min(usize::from(u16::MAX)) as u16;
    buffer(
        &owned.iter().map(|(p, _)| position(p)).collect::<Vec<_>>(),
        &owned.iter().map(|(p, _)| intensity(p)).collect::<Vec<_>>(),
        &owned.iter().map(|(_, class)| *class).collect::<Vec<_>>(),
        &owned.iter().map(|(p, _)| source(p)).collect::<Vec<_>>(),
    )
}

fn buffer(positions: &[PastureVector3<f64>], intensities: &[u16], classes: &[u8], sources: &[u16]) -> HashMapBuffer {
    let layout = PointLayout::from_attributes(&[POSITION_3D, INTENSITY, CLASSIFICATION, POINT_SOURCE_ID]);
    let mut buffer = HashMapBuffer::with_capacity(positions.len(), layout);
    let mut pusher = buffer.begin_push_attributes();
    pusher.push_attribute_range(&POSITION_3D, positions);
    pusher.push_attribute_range(&INTENSITY, intensities);
    pusher.push_attribute_range(&CLASSIFICATION, classes);
    pusher.push_attribute_range(&POINT_SOURCE_ID, sources);
    pusher.done();
    buffer
}

/// The class of a point: of all that it could be, the one that says most.
fn class(p: &CloudPoint, offset_m: f64, window: &Window, config: &Config) -> u8 {
    let at = &p.position;
    if p.reflectance >= config.signs.least_reflectance
        && let Some(sign) = window.signs.iter().find(|s| is_on_sign(at, s))
    {
        return SIGN + u8::from(sign.kind == SignKind::TrafficLight);
    }
    let is_ground = f64::from(p.height_m).abs() <= config.ground.thickness_m;
    let is_paint = is_ground && p.contrast.is_some_and(|c| c >= config.lanes.least_contrast);
    if is_paint && window.lanes.iter().any(|l| is_on_lane(at, l, config.lanes.half_line_m)) {
        return LANE_PAINT;
    }
    if is_ground {
        return if offset_m.abs() <= DRIVEN_HALF_WIDTH_M { ROAD_SURFACE } else { GROUND };
    }
    window.poles.iter().find(|pole| is_on_pole(at, pole)).map_or(OTHER, |pole| POLE + pole_index(pole.kind))
}

fn pole_index(kind: PoleKind) -> u8 {
    PoleKind::ALL.iter().position(|k| *k == kind).unwrap_or(0) as u8
}

fn is_on_sign(p: &Point3<f64>, sign: &Sign) -> bool {
    (p - sign.centroid_map).norm() <= 0.5 * sign.size_m + SIGN_MARGIN_M
}

fn is_on_pole(p: &Point3<f64>, pole: &Pole) -> bool {
    distance_to_segment(p, &pole.foot_map, &pole.top_map) <= POLE_RADIUS_M
}

fn is_on_lane(p: &Point3<f64>, lane: &LaneLine, half_line_m: f64) -> bool {
    let flat = |q: &Point3<f64>| Point3::new(q.x, 0.0, q.z);
    lane.points_map.windows(2).any(|w| distance_to_segment(&flat(p), &flat(&w[0]), &flat(&w[1])) <= half_line_m)
}

fn distance_to_segment(p: &Point3<f64>, a: &Point3<f64>, b: &Point3<f64>) -> f64 {
    let along = b - a;
    let length2 = along.norm_squared();
    let share = if length2 > 0.0 { ((p - a).dot(&along) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (p - (a + along * share)).norm()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(folder: &Path, name: &str) -> (CloudCount, Vec<u8>) {
        let path = folder.join(name);
        let mut file = CloudFile::create(&path, &Config::default()).unwrap();
        let far = [1.0, f64::NAN, 2.5e6, f64::INFINITY].map(|x| PastureVector3::new(x, 2.0, -3.0));
        file.write(&buffer(&far, &[7; 4], &[2, 64, 64, 64], &[5; 4]), &[0.0, 0.1, 0.2, 0.3, 0.4, 0.5]).unwrap();
        file.write(&buffer(&[], &[], &[], &[]), &[]).unwrap();
        (file.finish().unwrap(), std::fs::read(path).unwrap())
    }

    #[test]
    fn what_the_file_cannot_hold_is_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let (count, _) = written(folder.path(), "a.laz");
        assert_eq!(count, CloudCount { written: 1, left_out: 3 });
        let mut reader = las::Reader::from_path(folder.path().join("a.laz")).unwrap();
        assert!(reader.header().date().is_none() && reader.header().point_format().is_compressed);
        let points: Vec<las::Point> = reader.read_all().unwrap().points().map(|p| p.unwrap()).collect();
        assert_eq!(points.len(), 1);
        let p = &points[0];
        assert!((p.x - 1.0).abs() < 1e-9 && (p.y - 2.0).abs() < 1e-9 && (p.z + 3.0).abs() < 1e-9);
        assert_eq!((u8::from(p.classification), p.intensity, p.point_source_id), (2, 7, 5));
        assert_eq!(p.gps_time, Some(0.5));
    }

    #[test]
    fn the_same_cloud_is_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(written(folder.path(), "a.laz").1, written(folder.path(), "b.laz").1);
    }

    #[test]
    fn an_unfinished_file_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        drop(CloudFile::create(&folder.path().join("a.laz"), &Config::default()).unwrap());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
