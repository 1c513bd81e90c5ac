//! Files of one scan: LAS, LAZ, PCD, PLY, and KITTI's.

mod bin;
mod las;
mod las_check;
mod lzf;
mod pcd;
mod ply;

use std::path::Path;

use common::kitti::{Scan, ScanPoint};

use self::bin::Bin;
pub use self::las::{are_noise, at_a_time, cut_off, reader as las_reader};
use super::beams::Steps;
use crate::error::{Error, Result};

/// A format of scans.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScanFormat {
    /// KITTI: x, y, z, reflectance as 32-bit floats; or these and the beam.
    Bin,
    /// ASPRS LAS, compressed or not.
    Las,
    /// Point Cloud Library.
    Pcd,
    /// Stanford polygons.
    Ply,
}

/// Points as they stand in a file: lidar frame, metres; intensity in any
/// scale.
#[derive(Debug, Default)]
#[allow(clippy::struct_field_names, reason = "points are what it holds, and the rest is said of them")]
pub struct Points {
    /// Position and intensity, 0 where the file has none.
    pub points: Vec<ScanPoint>,
    /// Beam of each point; empty where the file does not say.
    pub ring: Vec<u16>,
    /// Points that the file says to be withheld or noise, which are not among them.
    pub noise: usize,
}

/// Names under which recorders write the intensity.
const INTENSITY: [&str; 7] =
    ["intensity", "scalar_intensity", "reflectance", "reflectivity", "remission", "scalar_reflectance", "i"];
/// Names under which recorders write the beam.
const RING: [&str; 4] = ["ring", "channel", "laser_id", "line"];

impl ScanFormat {
    /// The format that the extension of a file says.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "bin" => Some(Self::Bin),
            "las" | "laz" => Some(Self::Las),
            "pcd" => Some(Self::Pcd),
            "ply" => Some(Self::Ply),
            _ => None,
        }
    }

    /// Reads a scan whose points lie in the frame of the lidar, and puts them
    /// into the order of the beams, whose points are `steps` apart.
    ///
    /// # Errors
    /// [`Error::BadScan`] where the file is not what it should be, and as
    /// [`bin::read`].
    pub fn read(self, path: &Path, max_range_m: f32, steps: Steps) -> Result<Scan> {
        let points = match self {
            Self::Bin => match bin::read(path, max_range_m)? {
                Bin::Kitti(mut scan) => {
                    steps.put_in_order(&mut scan.points, &[]);
                    return Ok(scan);
                }
                Bin::More(points) => points,
            },
            Self::Las => las::read(path)?,
            Self::Pcd => pcd::read(path)?,
            Self::Ply => ply::read(path)?,
        };
        if points.points.is_empty() && points.noise == 0 {
            return Err(bad(path, "it holds no point; export it again"));
        }
        Ok(usable(&points, max_range_m, steps))
    }
}

/// Reads a scan of a drive in KITTI's layout.
///
/// # Errors
/// As [`bin::read`], and [`Error::BadScan`] where its points have five columns.
pub fn kitti_scan(path: &Path, max_range_m: f32) -> Result<Scan> {
    match bin::read(path, max_range_m)? {
        Bin::Kitti(scan) => Ok(scan),
        Bin::More(_) => Err(bad(path, "its points have five columns, and KITTI's four; give the folder as --scans")),
    }
}

/// Drops what is not finite or out of range, and orders the rest.
fn usable(all: &Points, max_range_m: f32, steps: Steps) -> Scan {
    let points = Vec::with_capacity(all.points.len());
    let mut scan = Scan { points, dropped_as_noise: all.noise, ..Scan::default() };
    let mut ring = Vec::with_capacity(all.ring.len());
    for (i, p) in all.points.iter().enumerate() {
        let range_m = (p.x_m * p.x_m + p.y_m * p.y_m + p.z_m * p.z_m).sqrt();
        if range_m > 0.0 && range_m <= max_range_m && p.reflectance.is_finite() {
            scan.points.push(*p);
            ring.extend(all.ring.get(i));
        } else if range_m.is_finite() && p.reflectance.is_finite() {
            scan.dropped_out_of_range += 1;
        } else {
            scan.dropped_not_finite += 1;
        }
    }
    steps.put_in_order(&mut scan.points, &ring);
    scan
}

/// A scan that is not what it should be; `what` says where, and what to do.
fn bad(path: &Path, what: impl Into<String>) -> Error {
    Error::BadScan { path: path.to_path_buf(), what: what.into() }
}
