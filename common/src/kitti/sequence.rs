//! One sequence: where its files are, and its times and poses.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::Calibration;
use crate::geometry::{PinholeCamera, Pose};
use crate::{Error, Result, atomic_file, text};

/// How the names of images may end, the first where there are several of a frame: KITTI's are
/// PNG, those of many other cameras JPEG.
const IMAGE_EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

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
        // Shells complete the name of a folder with one.
        let name = name.trim_end_matches(std::path::is_separator);
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

    /// `ROOT/sequences/NN/calib.txt`.
    pub fn calibration_path(&self) -> PathBuf {
        self.folder().join("calib.txt")
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

    /// The image of a frame from camera 0 to 3: the first of `.png`, `.jpg` and `.jpeg` of which
    /// there is a file, a PNG where there is none.
    pub fn image_path(&self, camera: usize, frame: usize) -> PathBuf {
        let folder = self.folder().join(format!("image_{camera}"));
        let mut paths = IMAGE_EXTENSIONS.iter().map(|extension| folder.join(format!("{frame:06}.{extension}")));
        paths.find(|path| path.is_file()).unwrap_or_else(|| folder.join(format!("{frame:06}.{}", IMAGE_EXTENSIONS[0])))
    }

    /// `calib.txt` of this sequence.
    ///
    /// # Errors
    /// As [`Calibration::read`].
    pub fn calibration(&self) -> Result<Calibration> {
        Calibration::read(self.folder().join("calib.txt"))
    }

    /// One camera of it.
    ///
    /// # Errors
    /// As [`Calibration::read_camera`].
    pub fn camera(&self, index: usize) -> Result<PinholeCamera> {
        Calibration::read_camera(self.folder().join("calib.txt"), index)
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
        numbered(&self.folder().join("velodyne"), &["bin"], DIGITS)
    }

    /// The frames that have an image of camera 0 to 3, in order.
    ///
    /// # Errors
    /// [`Error::Io`] where the folder cannot be read.
    pub fn image_frames(&self, camera: usize) -> Result<Vec<usize>> {
        numbered(&self.folder().join(format!("image_{camera}")), &IMAGE_EXTENSIONS, DIGITS)
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
/// [`Error::BadNumber`], [`Error::BadRow`], [`Error::NotARotation`] or
/// [`Error::Mirrors`] at their line, [`Error::Io`] where the file cannot be read.
pub fn read_poses(path: impl AsRef<Path>) -> Result<Vec<Pose>> {
    let path = path.as_ref();
    poses_of(path, &text::read(path)?)
}

/// The KITTI poses of a file that was read.
pub(crate) fn poses_of(path: &Path, content: &str) -> Result<Vec<Pose>> {
    text::rows_below_names(content).map(|(line, row)| text::pose(path, line, row)).collect()
}

/// Writes KITTI poses: a 3x4 matrix per row, `map_from_camera`.
///
/// # Errors
/// As [`atomic_file::write`].
pub fn write_poses(path: impl AsRef<Path>, poses: &[Pose]) -> Result<()> {
    atomic_file::write(path, poses_text(poses).as_bytes())
}

/// Poses as [`write_poses`] writes them.
pub fn poses_text(poses: &[Pose]) -> String {
    poses.iter().map(|pose| text::pose_row(pose) + "\n").collect()
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

/// Digits in the names of scans and images.
const DIGITS: usize = 6;

/// The indices of the files in `folder` that are named by so many digits and end so,
/// each once, sorted.
pub(super) fn numbered(folder: &Path, extensions: &[&str], digits: usize) -> Result<Vec<usize>> {
    let mut frames = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let path = entry.map_err(Error::io(folder))?.path();
        let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
        let is_frame =
            stem.len() == digits && path.extension().is_some_and(|found| extensions.iter().any(|one| found == *one));
        if let (true, Ok(frame)) = (is_frame, stem.parse()) {
            frames.push(frame);
        }
    }
    frames.sort_unstable();
    frames.dedup();
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A root with sequences 03 and 04; 04 has two times, one scan, one image.
    fn root() -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("sequences/04");
        for name in ["velodyne", "image_2", "../03", "../../poses"] {
            std::fs::create_dir_all(folder.join(name)).unwrap();
        }
        write_times(folder.join("times.txt"), &[0.0, 0.103_662]).unwrap();
        for name in ["velodyne/000010.bin", "velodyne/000002.bin", "velodyne/notes.bin", "image_2/000001.png"] {
            std::fs::write(folder.join(name), b"").unwrap();
        }
        root
    }

    #[test]
    fn a_missing_sequence_says_which_ones_are_there() {
        let root = root();
        for name in ["05", "..", "", "/", "04/velodyne"] {
            let error = Sequence::open(root.path(), name).unwrap_err();
            assert!(error.to_string().contains("which holds 03, 04; choose one"), "{error}");
        }
        assert_eq!(Sequence::open(root.path(), "04/").unwrap(), Sequence::open(root.path(), "04").unwrap());
        let elsewhere = Sequence::open(root.path().join("poses"), "04").unwrap_err();
        assert!(matches!(elsewhere, Error::NotKitti { .. }));
    }

    #[test]
    fn frames_are_those_with_a_file_in_order() {
        let root = root();
        let sequence = Sequence::open(root.path(), "04").unwrap();
        assert_eq!(sequence.scan_frames().unwrap(), [2, 10]);
        assert_eq!(sequence.image_frames(2).unwrap(), [1]);
        assert!(sequence.scan_path(10).is_file() && sequence.image_path(2, 1).is_file());
        // Cameras that write JPEG, one of a frame that has a PNG, too.
        let images = sequence.folder().join("image_2");
        for name in ["000003.jpeg", "000001.jpg", "000002.jpg", "000004.txt"] {
            std::fs::write(images.join(name), "").unwrap();
        }
        assert_eq!(sequence.image_frames(2).unwrap(), [1, 2, 3]);
        let names = [1, 2, 3, 4].map(|frame| sequence.image_path(2, frame));
        assert_eq!(names, ["000001.png", "000002.jpg", "000003.jpeg", "000004.png"].map(|name| images.join(name)));
        let said = sequence.image_frames(3).unwrap_err().to_string();
        assert!(said.contains("image_3"), "{said}");
    }

    #[test]
    fn poses_of_the_wrong_length_say_both_counts() {
        let root = root();
        let sequence = Sequence::open(root.path(), "04").unwrap();
        write_poses(sequence.poses_path(), &[Pose::identity(); 3]).unwrap();
        let said = sequence.poses().unwrap_err().to_string();
        assert!(said.contains("04.txt has 3 poses but") && said.contains("times.txt has 2 times; use"), "{said}");
        write_poses(sequence.poses_path(), &[Pose::identity(); 2]).unwrap();
        assert_eq!(sequence.poses().unwrap(), [Pose::identity(); 2]);
    }

    #[test]
    fn a_faulty_row_is_named() {
        let root = root();
        let path = root.path().join("rows.txt");
        let read = |content: &str| {
            std::fs::write(&path, content).unwrap();
            (read_poses(&path), read_times(&path))
        };
        assert!(matches!(read("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0\n").0, Err(Error::BadRow { line: 2, found: 3, .. })));
        assert!(matches!(read("1 0 0 x 0 1 0 0 0 0 1 0\n").0, Err(Error::BadNumber { line: 1, .. })));
        assert!(matches!(read("2 0 0 0 0 2 0 0 0 0 2 0\n").0, Err(Error::NotARotation { line: 1, .. })));
        assert!(matches!(read("0\n0.1\n\n0.1\n").1, Err(Error::TimeOrder { line: 4, .. })));
        std::fs::write(&path, b"0\n\xff").unwrap();
        assert!(matches!(read_times(&path), Err(Error::NotText { at: 2, .. })));
    }

    #[test]
    fn rounded_rotations_become_rotations() {
        let root = root();
        let path = root.path().join("rounded.txt");
        let c = 0.1_f64.cos();
        let s = 0.1_f64.sin();
        std::fs::write(&path, format!("{c:.4} 0 {s:.4} 7 0 1 0 8 -{s:.4} 0 {c:.4} 9\n")).unwrap();
        let pose = read_poses(&path).unwrap()[0];
        assert!((pose.rotation.norm() - 1.0).abs() < 1e-12);
        assert!((pose.rotation.angle() - 0.1).abs() < 1e-4);
        assert!((pose.translation.vector - nalgebra::Vector3::new(7.0, 8.0, 9.0)).norm() < 1e-12);
    }
}
