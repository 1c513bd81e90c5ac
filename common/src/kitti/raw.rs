//! One drive of KITTI's raw recordings: `DATE/DATE_drive_NNNN_sync` with its
//! scans and packets, and the calibration of the day beside it.

use std::path::{Path, PathBuf};

use chrono::NaiveDateTime;
use nalgebra::{Matrix3, Translation3, Vector3};

use super::oxts::{Packet, mercator_poses};
use super::sequence::numbered;
use crate::geometry::Pose;
use crate::{Error, Result, text};

/// A synchronized drive of KITTI's raw recordings on disk.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawDrive {
    folder: PathBuf,
    calibration: PathBuf,
}

/// The calibration of a day.
const CALIBRATION_FILES: [&str; 3] = ["calib_velo_to_cam.txt", "calib_imu_to_velo.txt", "calib_cam_to_cam.txt"];

/// The survey of a raw drive.
#[derive(Debug, Clone, PartialEq)]
pub struct RawSurvey {
    /// `map_from_camera` of every frame: the map is the rectified camera 0 of
    /// frame 0.
    pub map_from_camera: Vec<Pose>,
    /// `enu_from_map`: east, north and up of camera 0 of frame 0, metres.
    pub enu_from_map: Pose,
    /// The unit at frame 0.
    pub first: Packet,
}

impl RawDrive {
    /// The drive in `folder`; its calibration files lie in `calibration`, or
    /// in the folder that holds `folder`.
    ///
    /// # Errors
    /// [`Error::NotKittiRaw`] where the folder has no scans or no packets.
    pub fn open(folder: impl AsRef<Path>, calibration: Option<&Path>) -> Result<Self> {
        let folder = folder.as_ref().to_path_buf();
        for missing in ["velodyne_points/data", "oxts/data"] {
            if !folder.join(missing).is_dir() {
                return Err(Error::NotKittiRaw { folder, missing });
            }
        }
        let beside = folder.canonicalize().ok().and_then(|f| f.parent().map(Path::to_path_buf));
        let calibration = calibration.map(Path::to_path_buf).or(beside).unwrap_or_else(|| folder.join(".."));
        Ok(Self { folder, calibration })
    }

    /// The files that a drive is read from, but for its scans: the calibration of the day, the
    /// stamps and those of the packets that are there.
    pub fn files(&self) -> Vec<PathBuf> {
        let data = std::fs::read_dir(self.folder.join("oxts/data")).into_iter().flatten().flatten();
        let packets = data.map(|entry| entry.path());
        CALIBRATION_FILES
            .map(|name| self.calibration.join(name))
            .into_iter()
            .chain([self.folder.join("oxts/timestamps.txt")])
            .chain(packets)
            .collect()
    }

    /// Its name, such as `2011_09_30_drive_0016_sync`.
    pub fn name(&self) -> String {
        let whole = self.folder.canonicalize().unwrap_or_else(|_| self.folder.clone());
        whole.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
    }

    /// The folder of its scans.
    pub fn scans(&self) -> PathBuf {
        self.folder.join("velodyne_points/data")
    }

    /// The scan of a frame.
    pub fn scan_path(&self, frame: usize) -> PathBuf {
        self.scans().join(format!("{frame:010}.bin"))
    }

    /// The frames that have a scan, in order.
    ///
    /// # Errors
    /// [`Error::Io`] where the folder cannot be read.
    pub fn scan_frames(&self) -> Result<Vec<usize>> {
        numbered(&self.scans(), &["bin"], 10)
    }

    /// The time of every frame, seconds from the first: that of its packet.
    ///
    /// # Errors
    /// [`Error::BadStamp`] or [`Error::TimeOrder`] at their line,
    /// [`Error::BadPacket`] where there is none, [`Error::Io`] where the file
    /// cannot be read.
    pub fn times_s(&self) -> Result<Vec<f64>> {
        let path = self.folder.join("oxts/timestamps.txt");
        let content = text::read(&path)?;
        let mut first = None;
        let mut times: Vec<f64> = Vec::new();
        for (line, row) in text::rows(&content) {
            let stamp = NaiveDateTime::parse_from_str(row, "%Y-%m-%d %H:%M:%S%.f").map_err(|_| Error::BadStamp {
                path: path.clone(),
                line,
                text: row.chars().take(40).collect(),
            })?;
            let since = stamp - *first.get_or_insert(stamp);
            let time_s = since.num_seconds() as f64 + f64::from(since.subsec_nanos()) * 1e-9;
            if times.last().is_some_and(|&before| before >= time_s) {
                return Err(Error::TimeOrder { path, line, time_s });
            }
            times.push(time_s);
        }
        if times.is_empty() {
            return Err(Error::BadPacket { path, what: "it holds no stamp".into() });
        }
        Ok(times)
    }

    /// `camera_from_velodyne`, of the rectified camera 0: `R_rect_00 [R|t]` of
    /// `calib_velo_to_cam.txt`.
    ///
    /// # Errors
    /// [`Error::MissingRawCalibration`], [`Error::BadNumber`],
    /// [`Error::BadRow`], [`Error::NotARotation`], [`Error::Mirrors`] or
    /// [`Error::FarSensor`] in a calibration file, [`Error::Io`] where it cannot
    /// be read.
    pub fn camera_from_velodyne(&self) -> Result<Pose> {
        let path = self.calibration.join("calib_cam_to_cam.txt");
        let content = text::read(&path)?;
        let rectify = rotation(&path, &content, "R_rect_00")?;
        Ok(Pose::from_parts(Translation3::identity(), rectify) * self.rigid("calib_velo_to_cam.txt")?)
    }

    /// The poses of frames 0 to `frames`, exclusive, from the packets.
    ///
    /// # Errors
    /// As [`Packet::read`] and [`Self::camera_from_velodyne`].
    pub fn survey(&self, frames: usize) -> Result<RawSurvey> {
        let camera_from_unit = self.camera_from_velodyne()? * self.rigid("calib_imu_to_velo.txt")?;
        let data = self.folder.join("oxts/data");
        let packets: Vec<Packet> =
            (0..frames).map(|frame| Packet::read(&data.join(format!("{frame:010}.txt")))).collect::<Result<_>>()?;
        let no_packet = || Error::BadPacket { path: data, what: "it holds no packet".into() };
        let first = *packets.first().ok_or_else(no_packet)?;
        let unit_from_camera = camera_from_unit.inverse();
        let enu_from_camera: Vec<Pose> =
            mercator_poses(&packets).iter().map(|enu_from_unit| enu_from_unit * unit_from_camera).collect();
        let enu_from_map = enu_from_camera.first().copied().unwrap_or_else(Pose::identity);
        let map_from_enu = enu_from_map.inverse();
        let map_from_camera = enu_from_camera.iter().map(|pose| map_from_enu * pose).collect();
        Ok(RawSurvey { map_from_camera, enu_from_map, first })
    }

    fn rigid(&self, name: &str) -> Result<Pose> {
        let path = self.calibration.join(name);
        let content = text::read(&path)?;
        let rotation = rotation(&path, &content, "R")?;
        let (line, row) = entry(&path, &content, "T")?;
        let translation: [f64; 3] = text::numbers(&path, line, row)?;
        text::mounting(&path, line, Pose::from_parts(Vector3::from(translation).into(), rotation))
    }
}

fn rotation(path: &Path, content: &str, key: &str) -> Result<nalgebra::UnitQuaternion<f64>> {
    let (line, row) = entry(path, content, key)?;
    let values: [f64; 9] = text::numbers(path, line, row)?;
    text::rotation(path, line, &Matrix3::from_row_slice(&values))
}

/// The line of a key, and what stands behind it.
fn entry<'a>(path: &Path, content: &'a str, key: &str) -> Result<(usize, &'a str)> {
    text::rows(content)
        .find_map(|(line, row)| row.split_once(':').filter(|(name, _)| name.trim() == key).map(|(_, v)| (line, v)))
        .ok_or_else(|| Error::MissingRawCalibration { key: key.to_owned(), path: path.to_path_buf() })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A day with a drive of three frames to the north-east, and two scans.
    fn day() -> tempfile::TempDir {
        let day = tempfile::tempdir().unwrap();
        let sync = day.path().join("d_sync");
        for folder in ["velodyne_points/data", "oxts/data"] {
            std::fs::create_dir_all(sync.join(folder)).unwrap();
        }
        let write = |name: &str, content: &str| std::fs::write(day.path().join(name), content).unwrap();
        // Camera axes of a lidar that looks ahead; rectified by a quarter turn.
        write("calib_velo_to_cam.txt", "calib_time: x\nR: 0 -1 0 0 0 -1 1 0 0\nT: 0 -0.08 -0.27\n");
        write("calib_imu_to_velo.txt", "calib_time: x\nR: 1 0 0 0 1 0 0 0 1\nT: -0.8 0.3 -0.8\n");
        write("calib_cam_to_cam.txt", "calib_time: x\nR_rect_00: 0 -1 0 1 0 0 0 0 1\n");
        let stamps = ["23:59:59.95", "00:00:00.05", "00:00:00.15"];
        let stamps: Vec<String> = stamps
            .iter()
            .enumerate()
            .map(|(i, s)| format!("2011-{:02}-{:02} {s}\n", 9 + i.min(1), 30 - 29 * i.min(1)))
            .collect();
        write("d_sync/oxts/timestamps.txt", &stamps.concat());
        for frame in 0..3 {
            let line = format!("49 {} 100 0 0 0{}\n", 8.0 + 1e-5 * f64::from(frame), " 0".repeat(24));
            write(&format!("d_sync/oxts/data/{frame:010}.txt"), &line);
        }
        for frame in [0, 2] {
            write(&format!("d_sync/velodyne_points/data/{frame:010}.bin"), "");
        }
        day
    }

    #[test]
    fn the_map_is_camera_0_of_frame_0_and_midnight_is_no_break() {
        let day = day();
        let drive = RawDrive::open(day.path().join("d_sync"), None).unwrap();
        assert_eq!((drive.name().as_str(), drive.scan_frames().unwrap()), ("d_sync", vec![0, 2]));
        let times = drive.times_s().unwrap();
        assert!((times[1] - 0.1).abs() < 1e-9 && (times[2] - 0.2).abs() < 1e-9, "{times:?}");
        let files = drive.files();
        assert!(files.len() == 7 && files.iter().all(|file| file.is_file()), "{files:?}");
        let survey = drive.survey(3).unwrap();
        // Due east with a yaw of 0: straight ahead, z.
        let ahead = survey.map_from_camera[2].translation.vector;
        assert!((ahead - Vector3::new(0.0, 0.0, 1.4607)).norm() < 1e-3, "{ahead}");
        let east = survey.enu_from_map.rotation * Vector3::z();
        assert!((east - Vector3::x()).norm() < 1e-9, "{east}");
        // By the quarter turn what was up is right.
        let up = survey.enu_from_map.rotation * Vector3::x();
        assert!((up - Vector3::z()).norm() < 1e-9, "{up}");
    }

    #[test]
    fn what_is_missing_or_wrong_is_named() {
        let day = day();
        let sync = day.path().join("d_sync");
        let said = |name: &str, content: &str| {
            let path = day.path().join(name);
            let before = std::fs::read(&path).unwrap();
            std::fs::write(&path, content).unwrap();
            let drive = RawDrive::open(&sync, None).unwrap();
            let error = drive.times_s().and_then(|times| drive.survey(times.len())).unwrap_err().to_string();
            std::fs::write(&path, before).unwrap();
            error
        };
        let wrong = said("calib_cam_to_cam.txt", "calib_time: x\n");
        assert!(wrong.contains("has no line `R_rect_00:`"), "{wrong}");
        let wrong = said("calib_velo_to_cam.txt", "R: 0 -1 0 0 0 -1 1 0 0\nT: 0 1\n");
        assert!(wrong.contains("calib_velo_to_cam.txt:2: 2 numbers stand where 3"), "{wrong}");
        let wrong = said("d_sync/oxts/timestamps.txt", "2011-09-30 12:00\n");
        assert!(wrong.contains("timestamps.txt:1: `2011-09-30 12:00` is no stamp"), "{wrong}");
        let wrong = said("d_sync/oxts/timestamps.txt", "2011-09-30 12:00:01.0\n2011-09-30 12:00:00.5\n");
        assert!(wrong.contains("timestamps.txt:2: the time -0.5 s is not after"), "{wrong}");
        let wrong = said("d_sync/oxts/timestamps.txt", "");
        assert!(wrong.contains("timestamps.txt: it holds no stamp; take the file"), "{wrong}");
        let elsewhere = RawDrive::open(day.path(), None).unwrap_err().to_string();
        assert!(elsewhere.contains("holds no folder `velodyne_points/data`"), "{elsewhere}");
    }
}
