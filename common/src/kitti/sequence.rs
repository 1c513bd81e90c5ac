//! One sequence: where its files are, and its times and poses.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::Calibration;
use crate::geometry::Pose;
use crate::{Error, Result, atomic_file, text};

/// A sequence of KITTI odometry on disk.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sequence {
    root: PathBuf,
    name: String,
}

impl Sequence {
    /// The sequence `name` (such as `04`) under `root`, which holds
    /// `sequences/` and `poses/`.
    ///
    /// # Errors
    /// [`Error::NotKitti`] where `root` has no `sequences`,
    /// [`Error::MissingSequence`] with those that are there.
    pub fn open(root: impl AsRef<Path>, name: &str) -> Result<Self> {
        let root = root.as_ref().to_path_buf();
        let sequences = root.join("sequences");
        if !sequences.is_dir() {
            return Err(Error::NotKitti { root });
        }
        // A name, not a path: `..` or an empty one would open something else.
        let is_name = Path::new(name).components().count() == 1 && !name.starts_with('.');
        if !is_name || !sequences.join(name).is_dir() {
            let available = folders(&sequences)?;
            return Err(Error::MissingSequence { name: name.to_owned(), sequences, available });
        }
        Ok(Self { root, name: name.to_owned() })
    }

    /// Its name, such as `04`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// `ROOT/sequences/NN`.
    pub fn folder(&self) -> PathBuf {
        self.root.join("sequences").join(&self.name)
    }

    /// `ROOT/sequences/NN/times.txt`.
    pub fn times_path(&self) -> PathBuf {
        self.folder().join("times.txt")
    }

    /// `ROOT/poses/NN.txt`.
    pub fn poses_path(&self) -> PathBuf {
        self.root.join("poses").join(format!("{}.txt", self.name))
    }

    /// The lidar scan of a frame.
    pub fn scan_path(&self, frame: usize) -> PathBuf {
        self.folder().join("velodyne").join(format!("{frame:06}.bin"))
    }

    /// The image of a frame from camera 0 to 3.
    pub fn image_path(&self, camera: usize, frame: usize) -> PathBuf {
        self.folder().join(format!("image_{camera}")).join(format!("{frame:06}.png"))
    }

    /// `calib.txt` of this sequence.
    ///
    /// # Errors
    /// As [`Calibration::read`].
    pub fn calibration(&self) -> Result<Calibration> {
        Calibration::read(self.folder().join("calib.txt"))
    }

    /// The time of every frame, seconds from the first.
    ///
    /// # Errors
    /// As [`read_times`].
    pub fn times_s(&self) -> Result<Vec<f64>> {
        read_times(self.times_path())
    }

    /// `map_from_camera` of every frame, from `ROOT/poses/NN.txt`.
    ///
    /// # Errors
    /// As [`Self::poses_from`].
    pub fn poses(&self) -> Result<Vec<Pose>> {
        self.poses_from(self.poses_path())
    }

    /// `map_from_camera` of every frame of this sequence, from another file in
    /// the same form.
    ///
    /// # Errors
    /// [`Error::PoseCount`] where it has not one row per frame, and as
    /// [`read_poses`] and [`read_times`].
    pub fn poses_from(&self, path: impl AsRef<Path>) -> Result<Vec<Pose>> {
        let poses = read_poses(&path)?;
        let times = self.times_s()?.len();
        if poses.len() != times {
            return Err(Error::PoseCount {
                poses_path: path.as_ref().to_path_buf(),
                poses: poses.len(),
                times_path: self.times_path(),
                times,
            });
        }
        Ok(poses)
    }

    /// The frames that have a scan, in order.
    ///
    /// # Errors
    /// [`Error::Io`] where the folder cannot be read.
    pub fn scan_frames(&self) -> Result<Vec<usize>> {
        frames(&self.folder().join("velodyne"), "bin")
    }

    /// The frames that have an image of camera 0 to 3, in order.
    ///
    /// # Errors
    /// [`Error::Io`] where the folder cannot be read.
    pub fn image_frames(&self, camera: usize) -> Result<Vec<usize>> {
        frames(&self.folder().join(format!("image_{camera}")), "png")
    }
}

/// Reads `times.txt`: one time in seconds per frame.
///
/// # Errors
/// [`Error::BadNumber`], [`Error::BadRow`] or [`Error::TimeOrder`] at their
/// line, [`Error::Io`] where the file cannot be read.
pub fn read_times(path: impl AsRef<Path>) -> Result<Vec<f64>> {
    let path = path.as_ref();
    let mut times: Vec<f64> = Vec::new();
    for (line, row) in text::rows(&text::read(path)?) {
        let [time_s] = text::numbers(path, line, row)?;
        if times.last().is_some_and(|&before| before >= time_s) {
            return Err(Error::TimeOrder { path: path.to_path_buf(), line, time_s });
        }
        times.push(time_s);
    }
    Ok(times)
}

/// Writes `times.txt`: one time in seconds per frame.
///
/// # Errors
/// As [`atomic_file::write`].
pub fn write_times(path: impl AsRef<Path>, times_s: &[f64]) -> Result<()> {
    let mut content = String::new();
    for time_s in times_s {
        // Writing to a string cannot fail.
        let _ = writeln!(content, "{time_s:.9e}");
    }
    atomic_file::write(path, content.as_bytes())
}

/// Reads KITTI poses: a 3x4 matrix per row, `map_from_camera`.
///
/// # Errors
/// [`Error::BadNumber`], [`Error::BadRow`] or [`Error::NotARotation`] at their
/// line, [`Error::Io`] where the file cannot be read.
pub fn read_poses(path: impl AsRef<Path>) -> Result<Vec<Pose>> {
    let path = path.as_ref();
    text::rows(&text::read(path)?).map(|(line, row)| text::pose(path, line, row)).collect()
}

/// Writes KITTI poses: a 3x4 matrix per row, `map_from_camera`.
///
/// # Errors
/// As [`atomic_file::write`].
pub fn write_poses(path: impl AsRef<Path>, poses: &[Pose]) -> Result<()> {
    let content: String = poses.iter().map(|pose| text::pose_row(pose) + "\n").collect();
    atomic_file::write(path, content.as_bytes())
}

/// The names of the folders in `folder`, sorted.
fn folders(folder: &Path) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let entry = entry.map_err(Error::io(folder))?;
        if entry.path().is_dir() {
            names.push(entry.file_name().to_string_lossy().into_owned());
        }
    }
    names.sort();
    Ok(names)
}

/// The indices of the files `NNNNNN.extension` in `folder`, sorted.
fn frames(folder: &Path, extension: &str) -> Result<Vec<usize>> {
    let mut frames = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let path = entry.map_err(Error::io(folder))?.path();
        let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
        let is_frame = stem.len() == 6 && path.extension().is_some_and(|e| e == extension);
        if let (true, Ok(frame)) = (is_frame, stem.parse()) {
            frames.push(frame);
        }
    }
    frames.sort_unstable();
    Ok(frames)
}
