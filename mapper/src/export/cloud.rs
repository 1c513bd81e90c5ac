//! The stitched cloud as LAZ or LAS, with a class and a landmark per point.
//!
//! Columns are held in a pasture buffer, one window of the drive at a time, and
//! wait on the disk until the map is whole; then they go out through `las`.
//! pasture brings a nalgebra of its own: no type of either package leaves
//! this module and [`super::classes`].
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
//! the height, or those of the survey's world; metres in steps of 1 mm. Intensity is the reflectance, full
//! scale 65535; the point source is the frame, 65535 for all later ones; the time
//! is that of the frame.
//!
//! The extra dimension `landmark_id` (LAS 1.4, record 4 of `LASF_Spec`:
//! unsigned 32 bits) is the number of the landmark that the point lies on, as
//! in all exports of the map: [`common::map::Numbering`]. It is 0 on all other
//! points, and on those of a landmark that is not in the map in the end.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};

use common::atomic_file::{Staged, stage_with, work_folder};
use common::map::SemanticMap;
use las::point::{Classification, Format};
use las::{Builder, Transform, Vector, Vlr, Writer};
use nalgebra::Point3;
use pasture_core::containers::{BorrowedBuffer, BorrowedBufferExt, HashMapBuffer};
use pasture_core::layout::attributes::{CLASSIFICATION, GPS_TIME, INTENSITY, POINT_SOURCE_ID, POSITION_3D};
use pasture_core::nalgebra::Vector3 as PastureVector3;

use super::classes::columns;
use super::frame::Frame;
use super::landmarks::LandmarkIndex;
use crate::build::Window;
use crate::config::Config;
use crate::error::{Error, Result};

/// Step of the coordinates in the file, metres.
const STEP_M: f64 = 0.001;
/// Farthest coordinate that the file can hold, metres: 31 bits of steps.
const FARTHEST_M: f64 = 2.0e6;

/// A LAZ file in the making; nothing has its name before [`Self::finish`].
pub struct CloudFile {
    path: PathBuf,
    config: Config,
    frame: Frame,
    /// Points until the map is whole, a [`Waiting`] each: a file without a
    /// name, which the system removes.
    waiting: BufWriter<File>,
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

/// A point that waits for its landmark.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Waiting {
    /// x right, y forward, z up, metres.
    position: [f64; 3],
    time_s: f64,
    intensity: u16,
    source: u16,
    class: u8,
}

/// Bytes of a [`Waiting`].
const WAITING_BYTES: usize = 37;

impl CloudFile {
    /// Begins a file; `config` is that of the build, `frame` that of the coordinates: no
    /// [`Frame::Earth`], whose degrees have no steps of metres.
    ///
    /// # Errors
    /// [`common::Error::Io`] where the folder of the file takes none.
    pub fn create(path: &Path, config: &Config, frame: Frame) -> Result<Self> {
        let file = tempfile::tempfile_in(work_folder(path)).map_err(common::Error::io(path))?;
        let waiting = BufWriter::with_capacity(1 << 16, file);
        Ok(Self { path: path.to_path_buf(), config: config.clone(), frame, waiting, count: CloudCount::default() })
    }

    /// Adds the points that a window owns. `times_s` are the times of the
    /// drive's frames, seconds.
    ///
    /// # Errors
    /// [`common::Error::Io`] where the disk takes no more.
    pub fn add(&mut self, window: &Window, times_s: &[f64]) -> Result<()> {
        self.write(&columns(window, times_s, &self.config))
    }

    fn write(&mut self, columns: &HashMapBuffer) -> Result<()> {
        let positions = columns.view_attribute::<PastureVector3<f64>>(&POSITION_3D);
        let intensities = columns.view_attribute::<u16>(&INTENSITY);
        let classes = columns.view_attribute::<u8>(&CLASSIFICATION);
        let sources = columns.view_attribute::<u16>(&POINT_SOURCE_ID);
        let times_s = columns.view_attribute::<f64>(&GPS_TIME);
        for i in 0..columns.len() {
            let position = positions.at(i);
            // The writer takes NaN without complaint, and panics in the end
            // on what its header cannot hold.
            if !position.iter().all(|v| v.abs() < FARTHEST_M) {
                self.count.left_out += 1;
                continue;
            }
            let point = Waiting {
                position: position.into(),
                time_s: times_s.at(i),
                intensity: intensities.at(i),
                source: sources.at(i),
                class: classes.at(i),
            };
            self.waiting.write_all(&point.to_bytes()).map_err(common::Error::io(&self.path))?;
            self.count.written += 1;
        }
        Ok(())
    }

    /// Writes the file, with the landmarks of `map`, as it is read from its
    /// file.
    ///
    /// # Errors
    /// [`Error::Cloud`] with what the writer says, and as
    /// [`common::atomic_file::stage_with`].
    pub fn finish(self, map: &SemanticMap) -> Result<(CloudCount, Staged)> {
        let Self { path, config, frame, waiting, count } = self;
        let io = || common::Error::io(&path);
        let mut waiting = waiting.into_inner().map_err(|e| io()(e.into_error()))?;
        waiting.rewind().map_err(io())?;
        let mut waiting = BufReader::with_capacity(1 << 16, waiting);
        let landmarks = LandmarkIndex::new(map, config.lanes.half_line_m);
        let target = tempfile::tempfile_in(work_folder(&path)).map_err(io())?;
        let mut whole = target.try_clone().map_err(io())?;
        let offset_m = frame.metres(&Point3::origin());
        let mut writer = writer(BufWriter::new(target), &offset_m, is_plain(&path)).map_err(|e| fault(&path, &e))?;
        let mut bytes = [0; WAITING_BYTES];
        for _ in 0..count.written {
            waiting.read_exact(&mut bytes).map_err(io())?;
            let point = Waiting::from_bytes(&bytes).point(&landmarks, &frame);
            writer.write_point(point).map_err(|e| fault(&path, &e))?;
        }
        writer.close().map_err(|e| fault(&path, &e))?;
        drop(writer);
        whole.rewind().map_err(io())?;
        let staged = stage_with(&path, |out| {
            std::io::copy(&mut whole, out).map_err(io())?;
            Ok::<(), Error>(())
        })?;
        Ok((count, staged))
    }
}

impl Waiting {
    fn to_bytes(self) -> [u8; WAITING_BYTES] {
        let mut bytes = [0; WAITING_BYTES];
        let [x, y, z] = self.position;
        for (slot, value) in bytes.as_chunks_mut::<8>().0.iter_mut().zip([x, y, z, self.time_s]) {
            *slot = value.to_le_bytes();
        }
        let [i0, i1] = self.intensity.to_le_bytes();
        let [s0, s1] = self.source.to_le_bytes();
        bytes[32..].copy_from_slice(&[i0, i1, s0, s1, self.class]);
        bytes
    }

    fn from_bytes(bytes: &[u8; WAITING_BYTES]) -> Self {
        let mut values = [0.0; 4];
        for (value, eight) in values.iter_mut().zip(bytes.as_chunks::<8>().0) {
            *value = f64::from_le_bytes(*eight);
        }
        let [x, y, z, time_s] = values;
        Self {
            position: [x, y, z],
            time_s,
            intensity: u16::from_le_bytes([bytes[32], bytes[33]]),
            source: u16::from_le_bytes([bytes[34], bytes[35]]),
            class: bytes[36],
        }
    }

    fn point(&self, landmarks: &LandmarkIndex, frame: &Frame) -> las::Point {
        let [x, y, z] = self.position;
        let at_map = Point3::new(x, -z, y);
        let id = landmarks.number(self.class, &at_map);
        // As the file will have it: its header tells the bounds of what it is given.
        let offset_m = frame.metres(&Point3::origin());
        let steps = (frame.metres(&at_map) - offset_m).map(|metres| (metres / STEP_M).round());
        let [x, y, z] = (offset_m + steps * STEP_M).into();
        las::Point {
            x,
            y,
            z,
            intensity: self.intensity,
            return_number: 1,
            number_of_returns: 1,
            classification: Classification::new(self.class).unwrap_or_default(),
            point_source_id: self.source,
            gps_time: Some(self.time_s),
            extra_bytes: id.to_le_bytes().to_vec(),
            ..las::Point::default()
        }
    }
}

/// Whether a file is named as one that is not compressed.
fn is_plain(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("las"))
}

/// The writer of a file whose coordinates are steps from `offset_m`.
fn writer(target: BufWriter<File>, offset_m: &Point3<f64>, is_plain: bool) -> las::Result<Writer<BufWriter<File>>> {
    let axis = |offset| Transform { scale: STEP_M, offset };
    let mut builder = Builder::from((1, 4));
    // No date: the same cloud is the same bytes tomorrow.
    builder.date = None;
    builder.generating_software = concat!("waymark mapper ", env!("CARGO_PKG_VERSION")).into();
    builder.transforms = Vector { x: axis(offset_m.x), y: axis(offset_m.y), z: axis(offset_m.z) };
    builder.vlrs.push(landmark_dimension());
    let mut format = Format::new(6)?;
    format.is_compressed = !is_plain;
    format.extra_bytes = 4;
    builder.point_format = format;
    Writer::new(target, builder.into_header()?)
}

/// The record that names the extra bytes of a point (LAS 1.4 R15, table 24).
fn landmark_dimension() -> Vlr {
    let mut data = vec![0; 192];
    // Unsigned long, 4 bytes; no options: no scale, no limits.
    data[2] = 5;
    for (at, text) in [(4, "landmark_id"), (160, "number in the map, 0: none")] {
        data[at..at + text.len()].copy_from_slice(text.as_bytes());
    }
    Vlr { user_id: "LASF_Spec".into(), record_id: 4, description: "extra bytes".into(), data }
}

fn fault(path: &Path, error: &las::Error) -> Error {
    Error::Cloud { path: path.to_path_buf(), reason: error.to_string() }
}

#[cfg(test)]
mod tests {
    use super::super::classes::buffer;
    use super::*;
    use crate::input::{MapFrame, SurveyFrame};
    use common::map::{Pole, PoleKind, RoadId};

    fn map() -> SemanticMap {
        let pole = |x| Pole {
            kind: PoleKind::LampPost,
            foot_map: Point3::new(x, 4.0, 2.0),
            top_map: Point3::new(x, 1.0, 2.0),
            road: RoadId(0),
        };
        SemanticMap { poles: vec![pole(30.0), pole(1.1)], ..SemanticMap::default() }
    }

    fn written(folder: &Path, name: &str) -> (CloudCount, Vec<u8>) {
        let path = folder.join(name);
        let mut file = CloudFile::create(&path, &Config::default(), Frame::Local(None)).unwrap();
        let far = [1.0, f64::NAN, 2.5e6, f64::INFINITY, 1.0].map(|x| PastureVector3::new(x, 2.0, -3.0));
        let classes = [2, 64, 64, 64, 64];
        file.write(&buffer(&far, &[7; 5], &classes, &[5; 5], &[0.5; 5])).unwrap();
        file.write(&buffer(&[], &[], &[], &[], &[])).unwrap();
        let (count, staged) = file.finish(&map()).unwrap();
        staged.commit().unwrap();
        (count, std::fs::read(path).unwrap())
    }

    #[test]
    fn what_the_file_cannot_hold_is_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let (count, _) = written(folder.path(), "a.laz");
        assert_eq!(count, CloudCount { written: 2, left_out: 3 });
        let mut reader = las::Reader::from_path(folder.path().join("a.laz")).unwrap();
        assert!(reader.header().date().is_none() && reader.header().point_format().is_compressed);
        let points: Vec<las::Point> = reader.read_all().unwrap().points().map(|p| p.unwrap()).collect();
        assert_eq!(points.len(), 2);
        let p = &points[0];
        assert!((p.x - 1.0).abs() < 1e-9 && (p.y - 2.0).abs() < 1e-9 && (p.z + 3.0).abs() < 1e-9);
        assert_eq!((u8::from(p.classification), p.intensity, p.point_source_id), (2, 7, 5));
        assert_eq!(p.gps_time, Some(0.5));
    }

    #[test]
    fn the_header_has_the_bounds_of_the_points() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.las");
        let mut file = CloudFile::create(&path, &Config::default(), Frame::Local(None)).unwrap();
        let points = [24.612_6, -3.000_4].map(|x| PastureVector3::new(x, 2.000_7, x));
        file.write(&buffer(&points, &[7; 2], &[2; 2], &[5; 2], &[0.5; 2])).unwrap();
        file.finish(&map()).unwrap().1.commit().unwrap();
        let mut reader = las::Reader::from_path(&path).unwrap();
        let bounds = reader.header().bounds();
        let points: Vec<las::Point> = reader.read_all().unwrap().points().map(|p| p.unwrap()).collect();
        let (low, high) = (&points[1], &points[0]);
        let said = [bounds.min.x, bounds.min.z, bounds.max.x, bounds.max.y, bounds.max.z];
        for (said, is) in said.into_iter().zip([low.x, low.z, high.x, high.y, high.z]) {
            assert!((said - is).abs() < 1e-9, "{said} {is}");
        }
    }

    #[test]
    fn a_cloud_in_a_national_grid_keeps_its_millimetres() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.laz");
        let reduced_by_m = nalgebra::Vector3::new(450_000.0, 5_420_000.0, 100.0);
        let frame = Frame::Survey(MapFrame::of_survey(SurveyFrame::Lidar, &reduced_by_m));
        let mut file = CloudFile::create(&path, &Config::default(), frame).unwrap();
        // On the second pole of the map, 1.1 m right, 2 m forward.
        let at = PastureVector3::new(1.101, 2.002, -3.003);
        file.write(&buffer(&[at], &[7], &[64], &[5], &[0.5])).unwrap();
        file.finish(&map()).unwrap().1.commit().unwrap();
        let mut reader = las::Reader::from_path(&path).unwrap();
        let bounds = reader.header().bounds();
        let point = reader.read_all().unwrap().points().next().unwrap().unwrap();
        let off = [point.x - 450_002.002, point.y - 5_419_998.899, point.z - 96.997];
        assert!(off.iter().all(|off_m| off_m.abs() < 1e-6), "{point:?}");
        assert_eq!(point.extra_bytes[0], 2);
        // The header rounds outwards, by a step at most.
        let beyond = [point.x - bounds.min.x, bounds.max.x - point.x, point.y - bounds.min.y, bounds.max.y - point.y];
        assert!(beyond.iter().all(|beyond_m| (-1e-6..1.5 * STEP_M).contains(beyond_m)), "{beyond:?}");
    }

    #[test]
    fn a_point_on_a_landmark_has_its_number() {
        let folder = tempfile::tempdir().unwrap();
        written(folder.path(), "a.laz");
        let mut reader = las::Reader::from_path(folder.path().join("a.laz")).unwrap();
        let record = reader.header().vlrs().iter().find(|v| v.record_id == 4).unwrap().clone();
        assert_eq!((record.user_id.as_str(), record.data.len(), record.data[2]), ("LASF_Spec", 192, 5));
        assert!(record.data[4..].starts_with(b"landmark_id\0"));
        let points: Vec<las::Point> = reader.read_all().unwrap().points().map(|p| p.unwrap()).collect();
        let ids: Vec<Vec<u8>> = points.iter().map(|p| p.extra_bytes.clone()).collect();
        // Ground has none, although it lies as near to the second pole.
        assert_eq!(ids, [[0, 0, 0, 0], [2, 0, 0, 0]]);
    }

    #[test]
    fn the_same_cloud_is_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(written(folder.path(), "a.laz").1, written(folder.path(), "b.laz").1);
    }

    #[test]
    fn a_file_is_compressed_unless_it_is_named_as_one_that_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let [plain, packed] = ["a.LAS", "a.laz"].map(|name| {
            written(folder.path(), name);
            let mut reader = las::Reader::from_path(folder.path().join(name)).unwrap();
            let is_compressed = reader.header().point_format().is_compressed;
            (is_compressed, reader.read_all().unwrap().points().map(|p| p.unwrap()).collect::<Vec<_>>())
        });
        assert_eq!((plain.0, packed.0), (false, true));
        assert!(!plain.1.is_empty() && plain.1 == packed.1);
    }

    #[test]
    fn an_unfinished_file_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        drop(CloudFile::create(&folder.path().join("a.laz"), &Config::default(), Frame::Local(None)).unwrap());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
