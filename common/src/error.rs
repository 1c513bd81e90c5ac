//! The one error type of this crate. Every variant carries its values, and
//! every message is one sentence: the file, the place in it, what to do.

use std::io;
use std::path::{Path, PathBuf};

/// Result of everything here that can fail.
pub type Result<T> = std::result::Result<T, Error>;

/// What can go wrong with files, settings and maps.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("{}: {source}; check that it exists and that its permissions allow this", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the operating system says.
        source: io::Error,
    },
    /// The folder of a file to be written does not exist.
    #[error("{} cannot be written: the folder {} does not exist; create it first", path.display(), folder.display())]
    MissingFolder {
        /// The file to be written.
        path: PathBuf,
        /// The folder that is missing.
        folder: PathBuf,
    },
    /// The folder of a file to be written takes none.
    #[error("{} cannot be written: the folder {} takes no file ({}); make it writable, or give another", path.display(), folder.display(), why)]
    ClosedFolder {
        /// The file to be written.
        path: PathBuf,
        /// The folder that it would be in.
        folder: PathBuf,
        /// What the operating system says.
        why: io::ErrorKind,
    },
    /// A pipe or the like where more is done with a file than to read it once.
    #[error("{} is no file, and it is read more than once; save it as one first", path.display())]
    NoFile {
        /// What is there instead.
        path: PathBuf,
    },
    /// A folder to be written to that cannot be one.
    #[error("{} cannot be an output folder: {} is a file; give another folder", path.display(), file.display())]
    NotAFolder {
        /// The folder to be written to.
        path: PathBuf,
        /// It, or what should hold it.
        file: PathBuf,
    },
    /// A file to be written in the place of a folder.
    #[error("{} cannot be written: it is a folder; give the name of a file", path.display())]
    IsAFolder {
        /// The file to be written.
        path: PathBuf,
    },
    /// Where a map is said to be on the Earth.
    #[error(transparent)]
    Place(#[from] crate::earth::PlaceError),
    /// The file is not text.
    #[error("{} is not text (byte {at} is not UTF-8); check that it is the right file", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// The first byte that is no UTF-8, counted from 0.
        at: usize,
    },

    /// A folder that is no KITTI odometry root.
    #[error("{} holds no folder `sequences`; give the folder that holds `sequences/` and `poses/` of KITTI odometry", root.display())]
    NotKitti {
        /// The folder.
        root: PathBuf,
    },
    /// A sequence that is not there.
    #[error("sequence {name} is not in {}, which holds {}; choose one of these or add it", sequences.display(), list(available))]
    MissingSequence {
        /// The name that was asked for.
        name: String,
        /// The folder that was looked into.
        sequences: PathBuf,
        /// The sequences that are there, sorted.
        available: Vec<String>,
    },
    /// A calibration file without one of its lines.
    #[error("{} has no line `{key}:`; take `calib.txt` from the calibration archive of KITTI odometry", path.display())]
    MissingCalibration {
        /// `P0` to `P3` or `Tr`.
        key: String,
        /// The calibration file.
        path: PathBuf,
    },
    /// A projection matrix that is no rectified pinhole camera.
    #[error("{}: `{key}` is no rectified projection matrix (positive focal lengths, no skew, last row 0 0 1 *); take the KITTI odometry calibration", path.display())]
    BadProjection {
        /// `P0` to `P3`.
        key: String,
        /// The calibration file.
        path: PathBuf,
    },
    /// Something that should be a number and is none, or not finite.
    #[error("{}:{line}: `{}` is not a finite number; correct or replace the file", path.display(), text.escape_debug())]
    BadNumber {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// What stands there.
        text: String,
    },
    /// A line with too few or too many numbers.
    #[error("{}:{line}: {found} numbers stand where {expected} are expected; correct or replace the file", path.display())]
    BadRow {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// Numbers on the line.
        found: usize,
        /// Numbers that belong there.
        expected: usize,
    },
    /// A 3x3 matrix or a quaternion that is no rotation.
    #[error("{}:{line}: the rotation is {deviation:.2e} away from a true one (at most {limit:.0e} is accepted); check that its matrix stands there row by row, or that its quaternion has length 1", path.display())]
    NotARotation {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// Largest difference of an entry from the nearest rotation, or of a
        /// quaternion's length from 1.
        deviation: f64,
        /// The largest that is accepted.
        limit: f64,
    },
    /// Sensors of one vehicle that are too far apart.
    #[error("{}:{line}: it places one sensor {distance_m:.3e} m from another (at most {limit_m} m is accepted); give metres", path.display())]
    FarSensor {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// Their distance, metres.
        distance_m: f64,
        /// The largest that is accepted, metres.
        limit_m: f64,
    },
    /// A 3x3 matrix that mirrors.
    #[error("{}:{line}: the matrix is no rotation, it mirrors (its determinant is not positive); check that none of its rows are exchanged or have the wrong sign", path.display())]
    Mirrors {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
    },
    /// A pose file and a time file of different lengths.
    #[error("{} has {poses} poses but {} has {times} times; use the pose file of this sequence, one row per frame", poses_path.display(), times_path.display())]
    PoseCount {
        /// The pose file.
        poses_path: PathBuf,
        /// Its rows.
        poses: usize,
        /// The file of the times.
        times_path: PathBuf,
        /// Its rows.
        times: usize,
    },
    /// Times that do not increase.
    #[error("{}:{line}: the time {time_s} s is not after the one before it; times must increase", path.display())]
    TimeOrder {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// The time that stands there, seconds.
        time_s: f64,
    },
    /// A pose at a time at which there is no frame.
    #[error("{}:{line}: no frame of the sequence was taken at {time_s} s; use the trajectory of this sequence", path.display())]
    NoFrameAt {
        /// The trajectory file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// The time that stands there, seconds.
        time_s: f64,
    },
    /// A pose file without a pose.
    #[error("{} holds no pose; give TUM lines (t x y z qx qy qz qw) or KITTI rows (3x4, 12 numbers)", path.display())]
    NoPoses {
        /// The file.
        path: PathBuf,
    },
    /// A folder that is no drive of KITTI's raw recordings.
    #[error("{} holds no folder `{missing}`; give a folder such as 2011_09_30/2011_09_30_drive_0016_sync of KITTI's raw data", folder.display())]
    NotKittiRaw {
        /// The folder.
        folder: PathBuf,
        /// What it should hold.
        missing: &'static str,
    },
    /// A calibration file of a raw recording without one of its lines.
    #[error("{} has no line `{key}:`; take the file from the calibration archive of that day of KITTI's raw data", path.display())]
    MissingRawCalibration {
        /// `R`, `T` or `R_rect_00`.
        key: String,
        /// The calibration file.
        path: PathBuf,
    },
    /// A stamp that is no date and time.
    #[error("{}:{line}: `{text}` is no stamp such as 2011-09-30 12:40:25.104662000; correct or replace the file", path.display())]
    BadStamp {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// What stands there.
        text: String,
    },
    /// An OXTS packet, or the file of their stamps, that is none.
    #[error("{}: {what}; take the file from KITTI's raw data again", path.display())]
    BadPacket {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A scan that ends inside a point, or before the first.
    #[error("{} has {bytes} bytes, which are not one or more points of 16 (x, y, z, reflectance as 32-bit floats): it is truncated or no scan; copy it again", path.display())]
    TruncatedScan {
        /// The scan.
        path: PathBuf,
        /// Its length.
        bytes: usize,
    },

    /// A settings file with a key that does not exist.
    #[error("{}:{line}: there is no setting `{key}`{}; `--print-config` lists them all", path.display(), did_you_mean(nearest.as_deref()))]
    UnknownKey {
        /// The settings file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// The key that stands there.
        key: String,
        /// The known key that is most like it.
        nearest: Option<String>,
    },
    /// A settings file that does not say what it should.
    #[error("{}:{line}: {message}; `--print-config` shows a valid file", path.display())]
    BadConfig {
        /// The settings file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// What is wrong there.
        message: String,
    },

    /// Bytes that are no map at all.
    #[error("this is no Waymark map (it does not begin with `CSM`); give a .csm file")]
    NotAMap,
    /// A map of another version of the format.
    #[error(
        "this map has format version {found}, and this program reads versions up to {supported}; build the map again with this program, or use the program that made it"
    )]
    MapVersion {
        /// The version that stands in the file.
        found: u8,
        /// The version that this program reads.
        supported: u8,
    },
    /// A map that ends too early or too late.
    #[error(
        "this map should have {expected} bytes and has {found}: it was cut off or something was added; copy it again"
    )]
    MapLength {
        /// The length that follows from the header, bytes.
        expected: usize,
        /// The length that there is, bytes.
        found: usize,
    },
    /// A map of which some bytes changed.
    #[error("this map is damaged: its checksum is {found:08x} and should be {expected:08x}; copy it again")]
    MapChecksum {
        /// The checksum that stands in the file.
        expected: u32,
        /// The checksum of what is there.
        found: u32,
    },
    /// A map whose checksum is right and whose content is not.
    #[error("this map is malformed: {what}; it was written by a faulty program, so build it again")]
    MapMalformed {
        /// What is wrong.
        what: String,
    },
    /// A map that cannot be stored.
    #[error("the map cannot be stored: {what}")]
    MapUnencodable {
        /// Which item, why, and what to do.
        what: String,
    },
    /// Bytes that are no atlas at all.
    #[error("this is no Waymark atlas (it does not begin with `CSA`); give a .csa file")]
    NotAnAtlas,
    /// An atlas of another version of the format.
    #[error(
        "this atlas has format version {found}, and this program reads version {supported}; make it again with this program, or use the program that made it"
    )]
    AtlasVersion {
        /// The version that stands in the file.
        found: u8,
        /// The version that this program reads.
        supported: u8,
    },
    /// An atlas that ends too early or too late.
    #[error(
        "this atlas should have {expected} bytes and has {found}: it was cut off or something was added; copy it again"
    )]
    AtlasLength {
        /// The length that stands in the header, bytes.
        expected: u64,
        /// The length that there is, bytes.
        found: u64,
    },
    /// A part of an atlas of which some bytes changed.
    #[error(
        "this atlas is damaged: the checksum of its {part} at byte {at} is {found:08x} and should be {expected:08x}; copy it again"
    )]
    AtlasChecksum {
        /// Which part.
        part: &'static str,
        /// Where it begins.
        at: u64,
        /// The checksum that it should have.
        expected: u32,
        /// The checksum of what is there.
        found: u32,
    },
    /// A part of an atlas whose checksum is right and whose content is not.
    #[error(
        "this atlas is malformed: its {part} at byte {at} {what}; it was written by a faulty program, so make it again"
    )]
    AtlasMalformed {
        /// Which part.
        part: &'static str,
        /// Where it begins.
        at: u64,
        /// What is wrong.
        what: String,
    },
    /// An atlas that cannot be stored.
    #[error("the atlas cannot be made: {what}")]
    AtlasUnencodable {
        /// Why, and what to do.
        what: String,
    },
    /// Any of the above, with the file in which it happened.
    #[error("{}: {error}", path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        #[source]
        error: Box<Error>,
    },
}

impl Error {
    /// For `map_err`: an operating-system error together with its file.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(io::Error) -> Self {
        let path = path.as_ref().to_path_buf();
        move |source| Self::Io { path, source }
    }

    /// For `map_err`: an error about bytes together with the file that they
    /// came from.
    pub fn in_file(path: impl AsRef<Path>) -> impl FnOnce(Self) -> Self {
        let path = path.as_ref().to_path_buf();
        move |error| Self::InFile { path, error: Box::new(error) }
    }
}

fn list(names: &[String]) -> String {
    if names.is_empty() { "none".into() } else { names.join(", ") }
}

fn did_you_mean(nearest: Option<&str>) -> String {
    nearest.map_or_else(String::new, |key| format!(" (did you mean `{key}`?)"))
}
