//! `velodyne/*.bin`: points as four little-endian 32-bit floats.

use std::path::Path;

use crate::{Error, Result, atomic_file};

/// Bytes of one point in the file.
const POINT_BYTES: usize = 16;

/// One lidar return in the velodyne frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub struct ScanPoint {
    /// Forward, metres.
    pub x_m: f32,
    /// Left, metres.
    pub y_m: f32,
    /// Up, metres.
    pub z_m: f32,
    /// Strength of the return; KITTI: 0 to 1.
    pub reflectance: f32,
}

/// The usable points of one scan, in file order, and what was left out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scan {
    /// Points with finite values, at a range above 0 and up to the limit.
    pub points: Vec<ScanPoint>,
    /// Points dropped because a value of theirs is NaN or infinite.
    pub dropped_not_finite: usize,
    /// Points dropped because they lie at the origin (no return) or beyond
    /// the limit.
    pub dropped_out_of_range: usize,
    /// Points dropped because their file says that they are withheld or noise: never of KITTI's.
    pub dropped_as_noise: usize,
}

/// Reads one scan; points beyond `max_range_m` (Euclidean, metres) or not
/// finite are dropped and counted.
///
/// # Errors
/// [`Error::TruncatedScan`] where the length is no multiple of 16 bytes or 0,
/// [`Error::Io`] where the file cannot be read.
pub fn read_scan(path: impl AsRef<Path>, max_range_m: f32) -> Result<Scan> {
    let path = path.as_ref();
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    let (points, rest) = bytes.as_chunks::<POINT_BYTES>();
    if !rest.is_empty() || points.is_empty() {
        return Err(Error::TruncatedScan { path: path.to_path_buf(), bytes: bytes.len() });
    }
    let mut scan = Scan { points: Vec::with_capacity(points.len()), ..Scan::default() };
    let limit_m2 = max_range_m * max_range_m;
    for bytes in points {
        let point = ScanPoint::from_le_bytes(bytes);
        let range_m2 = point.x_m * point.x_m + point.y_m * point.y_m + point.z_m * point.z_m;
        if range_m2 > 0.0 && range_m2 <= limit_m2 && point.reflectance.is_finite() {
            scan.points.push(point);
        } else if point.is_finite() {
            scan.dropped_out_of_range += 1;
        } else {
            scan.dropped_not_finite += 1;
        }
    }
    Ok(scan)
}

/// Writes a scan as KITTI does.
///
/// # Errors
/// As [`atomic_file::write`].
pub fn write_scan(path: impl AsRef<Path>, points: &[ScanPoint]) -> Result<()> {
    let bytes: Vec<u8> = points.iter().flat_map(|point| point.to_le_bytes()).collect();
    atomic_file::write(path, &bytes)
}

impl ScanPoint {
    fn from_le_bytes(bytes: &[u8; POINT_BYTES]) -> Self {
        let value = |at: usize| f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        Self { x_m: value(0), y_m: value(4), z_m: value(8), reflectance: value(12) }
    }

    /// Its bytes in a file of KITTI.
    pub fn to_le_bytes(self) -> [u8; POINT_BYTES] {
        let mut bytes = [0; POINT_BYTES];
        let values = [self.x_m, self.y_m, self.z_m, self.reflectance];
        for (slot, value) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(values) {
            *slot = value.to_le_bytes();
        }
        bytes
    }

    fn is_finite(&self) -> bool {
        [self.x_m, self.y_m, self.z_m, self.reflectance].iter().all(|v| v.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x_m: f32) -> ScanPoint {
        ScanPoint { x_m, y_m: -2.0, z_m: 0.5, reflectance: 0.25 }
    }

    #[test]
    fn useless_points_are_dropped_and_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("000000.bin");
        let dark = ScanPoint { reflectance: f32::NAN, ..point(1.0) };
        let points =
            [point(3.0), point(f32::NAN), point(200.0), ScanPoint::default(), point(f32::INFINITY), dark, point(-4.0)];
        write_scan(&path, &points).unwrap();
        let scan = read_scan(&path, 100.0).unwrap();
        assert_eq!(scan.points, [point(3.0), point(-4.0)]);
        assert_eq!((scan.dropped_not_finite, scan.dropped_out_of_range), (3, 2));
    }

    #[test]
    fn a_truncated_scan_says_its_length() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("000000.bin");
        std::fs::write(&path, [0; 33]).unwrap();
        let said = read_scan(&path, 100.0).unwrap_err().to_string();
        assert!(said.contains("000000.bin has 33 bytes") && said.contains("copy it again"), "{said}");
    }

    #[test]
    fn the_file_is_what_kitti_says() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("000000.bin");
        write_scan(&path, &[point(1.0)]).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), [0, 0, 0x80, 0x3f, 0, 0, 0, 0xc0, 0, 0, 0, 0x3f, 0, 0, 0x80, 0x3e]);
    }
}
