//! `calib.txt`: four projection matrices and the lidar's place.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::Matrix3x4;

use crate::geometry::{PinholeCamera, Pose};
use crate::{Error, Result, atomic_file, text};

/// The calibration of one sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// The rectified cameras of `P0` to `P3`; camera 0 is the reference camera.
    pub cameras: [PinholeCamera; 4],
    /// `Tr`: velodyne coordinates to the reference camera.
    pub camera_from_velodyne: Pose,
}

impl Calibration {
    /// Reads a KITTI `calib.txt`.
    ///
    /// # Errors
    /// [`Error::MissingCalibration`] without one of `P0` to `P3` or `Tr`,
    /// [`Error::BadProjection`] where a projection is no pinhole camera's,
    /// [`Error::BadNumber`], [`Error::BadRow`] or [`Error::NotARotation`] at
    /// their line, [`Error::Io`] where the file cannot be read.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let content = text::read(path)?;
        let entry = |key: &str| {
            text::rows(&content)
                .find_map(|(line, row)| {
                    let (name, values) = row.split_once(':')?;
                    (name.trim() == key).then_some((line, values))
                })
                .ok_or_else(|| Error::MissingCalibration { key: key.to_owned(), path: path.to_path_buf() })
        };
        let camera = |key: &str| {
            let (line, values) = entry(key)?;
            let values: [f64; 12] = text::numbers(path, line, values)?;
            PinholeCamera::from_projection(&Matrix3x4::from_row_slice(&values))
                .ok_or_else(|| Error::BadProjection { key: key.to_owned(), path: path.to_path_buf() })
        };
        let cameras = [camera("P0")?, camera("P1")?, camera("P2")?, camera("P3")?];
        let (line, values) = entry("Tr")?;
        Ok(Self { cameras, camera_from_velodyne: text::pose(path, line, values)? })
    }

    /// Camera 0 to 3 (2 is the left colour camera).
    ///
    /// # Panics
    /// Where `index` is above 3, as indexing [`Self::cameras`] does.
    pub fn camera(&self, index: usize) -> PinholeCamera {
        self.cameras[index]
    }

    /// The projection matrices `P0` to `P3`: reference camera (m) to image (px).
    pub fn projections(&self) -> [Matrix3x4<f64>; 4] {
        self.cameras.map(|camera| camera.projection())
    }
}

/// Writes a KITTI `calib.txt`.
///
/// # Errors
/// As [`atomic_file::write`].
pub fn write_calibration(path: impl AsRef<Path>, calibration: &Calibration) -> Result<()> {
    let mut content = String::new();
    for (index, projection) in calibration.projections().iter().enumerate() {
        let values: Vec<String> = projection.transpose().iter().map(|v| format!("{v:.12e}")).collect();
        // Writing to a string cannot fail.
        let _ = writeln!(content, "P{index}: {}", values.join(" "));
    }
    let _ = writeln!(content, "Tr: {}", text::pose_row(&calibration.camera_from_velodyne));
    atomic_file::write(path, content.as_bytes())
}
