//! KITTI odometry files: scans, calibration, times, poses.
//!
//! The layout is `ROOT/sequences/NN/{calib.txt,times.txt,velodyne,image_2}`
//! and `ROOT/poses/NN.txt`; a frame's files are named by its six-digit index.
//! [`RawDrive`] reads the layout of the raw recordings.

mod calibration;
mod mercator;
mod oxts;
mod raw;
mod scan;
mod sequence;
#[cfg(test)]
mod tests;

pub use calibration::{Calibration, write_calibration};
pub use mercator::Mercator;
pub use oxts::Packet;
pub use raw::{RawDrive, RawSurvey};
pub use scan::{Scan, ScanPoint, read_scan, write_scan};
pub(crate) use sequence::poses_of;
pub use sequence::{Sequence, poses_text, read_poses, read_times, write_poses, write_times};
