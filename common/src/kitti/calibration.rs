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
    /// [`Error::BadNumber`], [`Error::BadRow`], [`Error::NotARotation`],
    /// [`Error::Mirrors`] or [`Error::FarSensor`] at their line, [`Error::Io`]
    /// where the file cannot be read.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let content = text::read(path)?;
        let camera = |key: &str| camera_of(path, &content, key);
        let cameras = [camera("P0")?, camera("P1")?, camera("P2")?, camera("P3")?];
        Ok(Self { cameras, camera_from_velodyne: camera_from_velodyne_of(path, &content)? })
    }

    /// Reads one camera of a `calib.txt`, which need not have more than its line: who
    /// localizes has one camera, and no lidar.
    ///
    /// # Errors
    /// As [`Self::read`], of that line.
    pub fn read_camera(path: impl AsRef<Path>, index: usize) -> Result<PinholeCamera> {
        let path = path.as_ref();
        camera_of(path, &text::read(path)?, &format!("P{index}"))
    }

    /// Camera 0 to 3 (2 is the left colour camera).
    ///
    /// # Panics
    /// Where `index` is above 3, as indexing [`Self::cameras`] does.
    pub fn camera(&self, index: usize) -> PinholeCamera {
        self.cameras[index]
    }

    /// Reads `Tr` alone of a KITTI `calib.txt` (`camera_from_velodyne`): who needs no image
    /// needs no projection.
    ///
    /// # Errors
    /// Of `Tr` as [`Self::read`].
    pub fn read_camera_from_velodyne(path: impl AsRef<Path>) -> Result<Pose> {
        let path = path.as_ref();
        camera_from_velodyne_of(path, &text::read(path)?)
    }

    /// The projection matrices `P0` to `P3`: reference camera (m) to image (px).
    pub fn projections(&self) -> [Matrix3x4<f64>; 4] {
        self.cameras.map(|camera| camera.projection())
    }
}

/// The line of a key in a `calib.txt`, with its number.
fn entry<'c>(path: &Path, content: &'c str, key: &str) -> Result<(usize, &'c str)> {
    let of_key = |(line, row): (usize, &'c str)| {
        let (name, values) = row.split_once(':')?;
        (name.trim() == key).then_some((line, values))
    };
    let missing = || Error::MissingCalibration { key: key.to_owned(), path: path.to_path_buf() };
    text::rows(content).find_map(of_key).ok_or_else(missing)
}

/// The camera of a key.
fn camera_of(path: &Path, content: &str, key: &str) -> Result<PinholeCamera> {
    let (line, values) = entry(path, content, key)?;
    let values: [f64; 12] = text::numbers(path, line, values)?;
    PinholeCamera::from_projection(&Matrix3x4::from_row_slice(&values))
        .ok_or_else(|| Error::BadProjection { key: key.to_owned(), path: path.to_path_buf() })
}

/// The lidar's place.
fn camera_from_velodyne_of(path: &Path, content: &str) -> Result<Pose> {
    let (line, values) = entry(path, content, "Tr")?;
    text::mounting(path, line, text::pose(path, line, values)?)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A calibration with KITTI's digits.
    const CALIB: &str = "\
P0: 7.070912e+02 0 6.018873e+02 0 0 7.070912e+02 1.831104e+02 0 0 0 1 0
P1: 7.070912e+02 0 6.018873e+02 -3.798145e+02 0 7.070912e+02 1.831104e+02 0 0 0 1 0
P2: 7.070912e+02 0 6.018873e+02 4.688783e+01 0 7.070912e+02 1.831104e+02 1.178601e-01 0 0 1 6.203223e-03
P3: 7.070912e+02 0 6.018873e+02 -3.334597e+02 0 7.070912e+02 1.831104e+02 1.93013e+00 0 0 1 3.318498e-03
Tr: 0 -1 0 0.01 0 0 -1 -0.08 1 0 0 -0.27
";

    fn read(content: &str) -> Result<Calibration> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("calib.txt");
        std::fs::write(&path, content).unwrap();
        Calibration::read(&path)
    }

    #[test]
    fn the_lidar_looks_along_the_camera_and_camera_2_is_left_of_camera_0() {
        let calibration = read(CALIB).unwrap();
        let ahead = calibration.camera_from_velodyne * nalgebra::Point3::new(10.0, 1.0, 0.0);
        assert!((ahead - nalgebra::Point3::new(-0.99, -0.08, 9.73)).norm() < 1e-12);
        let x_m = calibration.camera(2).from_reference_m.x;
        assert!((0.05..0.07).contains(&x_m), "{x_m}");
    }

    #[test]
    fn a_written_calibration_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("calib.txt");
        let calibration = read(CALIB).unwrap();
        write_calibration(&path, &calibration).unwrap();
        let back = Calibration::read(&path).unwrap();
        for (a, b) in calibration.projections().iter().zip(back.projections()) {
            assert!((a - b).amax() < 1e-9);
        }
        let difference = calibration.camera_from_velodyne.inverse() * back.camera_from_velodyne;
        assert!(difference.translation.vector.norm() + difference.rotation.angle() < 1e-9);
    }

    #[test]
    fn the_place_of_the_lidar_needs_no_projection_and_a_camera_needs_no_lidar() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("calib.txt");
        let keep = |keys: &[&str]| {
            let lines: Vec<&str> = CALIB.lines().filter(|line| keys.iter().any(|key| line.starts_with(key))).collect();
            std::fs::write(&path, lines.join("\n")).unwrap();
        };
        let lidar = |keys: &[&str]| {
            keep(keys);
            Calibration::read_camera_from_velodyne(&path)
        };
        let camera = |keys: &[&str]| {
            keep(keys);
            Calibration::read_camera(&path, 2)
        };
        let whole = read(CALIB).unwrap();
        assert_eq!(lidar(&["P2", "Tr"]).unwrap(), whole.camera_from_velodyne);
        assert!(matches!(lidar(&["P2"]), Err(Error::MissingCalibration { key, .. }) if key == "Tr"));
        assert_eq!(camera(&["P2"]).unwrap(), whole.camera(2));
        assert!(matches!(camera(&["P0", "Tr"]), Err(Error::MissingCalibration { key, .. }) if key == "P2"));
    }

    #[test]
    fn a_missing_or_wrong_line_is_named() {
        let without = |key: &str| {
            let lines: Vec<&str> = CALIB.lines().filter(|line| !line.starts_with(key)).collect();
            read(&lines.join("\n")).unwrap_err()
        };
        assert!(matches!(without("Tr"), Error::MissingCalibration { key, .. } if key == "Tr"));
        assert!(matches!(without("P2"), Error::MissingCalibration { key, .. } if key == "P2"));
        let said = read(&CALIB.replace("0.01", "nan")).unwrap_err().to_string();
        assert!(said.contains("calib.txt:5: `nan` is not a finite number"), "{said}");
        assert!(matches!(read(&CALIB.replace(" 0.01", "")), Err(Error::BadRow { line: 5, found: 11, .. })));
        assert!(
            matches!(read(&CALIB.replace("P2: 7", "P2: -7")), Err(Error::BadProjection { key, .. }) if key == "P2")
        );
        assert!(matches!(read(&CALIB.replace("Tr: 0 -1", "Tr: 0 -1.1")), Err(Error::NotARotation { line: 5, .. })));
        assert!(matches!(read(&CALIB.replace("Tr: 0 -1", "Tr: 0 1")), Err(Error::Mirrors { line: 5, .. })));
        // In millimetres.
        assert!(matches!(read(&CALIB.replace("-0.27", "-270")), Err(Error::FarSensor { line: 5, .. })));
    }
}
