//! Where the scans of a drive come from. All of it gives a [`Drive`]: the
//! rest of the program does not know which.
//!
//! | input | opened by |
//! |---|---|
//! | KITTI odometry | [`Drive::open`] |
//! | KITTI raw | [`open_raw`] |
//! | a folder of scans with poses | [`open_scans`] |
//! | one stitched cloud with a trajectory | [`open_stitched`] |
//!
//! [`Drive`]: crate::drive::Drive
//! [`Drive::open`]: crate::drive::Drive::open

mod beams;
mod config;
mod deal;
mod deskew;
mod formats;
mod map_frame;
mod order;
mod raw;
mod scans;
mod slices;
mod stitched;
mod survey;

use std::path::PathBuf;
use std::sync::Arc;

use common::kitti::{RawDrive, Scan, Sequence};

pub(crate) use self::beams::Steps;
pub use self::config::InputConfig;
pub use self::deskew::Deskew;
pub use self::map_frame::MapFrame;
pub use self::raw::open_raw;
pub use self::scans::{ScanInput, open_scans};
pub use self::stitched::open_stitched;
pub use self::survey::SurveyFrame;
pub(crate) use self::survey::assumed_times_s;
use crate::error::Result;
use crate::lidar::LidarConfig;

/// No point is farther than this, metres: squared it is a number still.
const ANY_RANGE_M: f32 = 1e18;

/// Where scans are read from.
#[derive(Debug, Clone)]
pub(crate) enum Source {
    /// KITTI odometry.
    Odometry(Sequence),
    /// KITTI raw.
    Raw(RawDrive),
    /// A folder of scans.
    Scans(Arc<scans::ScanFolder>),
    /// A stitched cloud, cut along its trajectory.
    Stitched(Arc<slices::Slices>),
}

impl Source {
    /// Name of the drive, for people: it goes into the map.
    pub fn name(&self) -> String {
        let name = match self {
            Self::Odometry(sequence) => format!("kitti {}", sequence.name()),
            Self::Raw(drive) => format!("kitti raw {}", drive.name()),
            Self::Scans(folder) => folder.name(),
            Self::Stitched(slices) => slices.name(),
        };
        fitting(&name)
    }

    /// The file of a frame's scan.
    pub fn scan_path(&self, frame: usize) -> PathBuf {
        match self {
            Self::Odometry(sequence) => sequence.scan_path(frame),
            Self::Raw(drive) => drive.scan_path(frame),
            Self::Scans(folder) => folder.scan_path(frame),
            Self::Stitched(slices) => slices.scan_path(frame),
        }
    }

    /// Where the scans lie.
    pub fn folder(&self) -> PathBuf {
        match self {
            Self::Odometry(sequence) => sequence.folder().join("velodyne"),
            Self::Raw(drive) => drive.scans(),
            Self::Scans(folder) => folder.folder().to_path_buf(),
            Self::Stitched(slices) => slices.cloud().to_path_buf(),
        }
    }

    /// The scan of a frame, in the frame of the lidar, its reflectance from 0
    /// to 1.
    pub fn read(&self, frame: usize, max_range_m: f32) -> Result<Scan> {
        match self {
            Self::Odometry(_) | Self::Raw(_) => formats::kitti_scan(&self.scan_path(frame), max_range_m),
            Self::Scans(folder) => folder.read(frame, max_range_m),
            Self::Stitched(slices) => slices.read(frame, max_range_m),
        }
    }

    /// Whether scans are those of KITTI, whose points are in the order of the beams.
    pub fn is_kitti(&self) -> bool {
        matches!(self, Self::Odometry(_) | Self::Raw(_))
    }

    /// What people should know about the order of the points, if anything.
    pub fn order_note(&self) -> Option<&'static str> {
        if let Self::Stitched(slices) = self { slices.order_note() } else { None }
    }

    /// Whether points that follow each other in a scan are not one step of the lidar apart.
    pub fn is_uneven(&self) -> bool {
        matches!(self, Self::Stitched(slices) if slices.are_in_lines())
    }

    /// Says what the lidar is like, where scans are put into the order of its beams.
    ///
    /// # Errors
    /// Where slices of a cloud cannot be read or written.
    pub fn put_lidar(&mut self, lidar: &LidarConfig) -> Result<()> {
        match self {
            Self::Scans(folder) => Arc::make_mut(folder).put_steps(Steps::of(lidar)),
            // Opened, and nowhere else yet.
            Self::Stitched(slices) => {
                if let Some(slices) = Arc::get_mut(slices) {
                    slices.put_lidar(lidar)?;
                }
            }
            Self::Odometry(_) | Self::Raw(_) => {}
        }
        Ok(())
    }
}

/// A name that a map can hold: no control characters, not too long.
fn fitting(name: &str) -> String {
    let mut out = String::new();
    for c in name.chars().filter(|c| !c.is_control()) {
        if out.len() + c.len_utf8() > common::map::MAX_NOTE_BYTES {
            break;
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests;
