//! Scans of 32-bit floats without a header: KITTI's four columns, or these and a fifth, as
//! nuScenes writes the beam (`.pcd.bin`).

use std::path::Path;

use common::kitti::{Scan, ScanPoint, read_scan};

use super::{Points, bad};
use crate::error::Result;

/// Nothing reflects less than nothing. Where more of the fourth numbers are below 0, they are
/// no reflectances: of scans of five columns read as four it is a third, of six a sixth.
const MOST_NEGATIVE: f64 = 0.01;
/// Bytes of a point of five columns.
const FIVE: usize = 20;
/// No lidar has more beams.
const MOST_BEAMS: f32 = 1024.0;

/// What is in a file.
pub enum Bin {
    /// A scan as KITTI has it.
    Kitti(Scan),
    /// Points with more to each.
    More(Points),
}

/// Reads a scan; of KITTI's, points beyond `max_range_m` are dropped.
///
/// # Errors
/// As [`read_scan`], and [`crate::error::Error::BadScan`] where its points have other columns.
pub fn read(path: &Path, max_range_m: f32) -> Result<Bin> {
    let refused = match read_scan(path, max_range_m) {
        Ok(scan) if are_reflectances(&scan.points) => return Ok(Bin::Kitti(scan)),
        Ok(_) => bad(
            path,
            "the fourth float of its points is often below 0, and so no reflectance; write x, y, z, reflectance",
        ),
        Err(error @ common::Error::TruncatedScan { .. }) => error.into(),
        Err(error) => return Err(error.into()),
    };
    five_columns(path)?.map(Bin::More).ok_or(refused)
}

fn are_reflectances(points: &[ScanPoint]) -> bool {
    let negative = points.iter().filter(|point| point.reflectance < 0.0).count();
    negative as f64 <= MOST_NEGATIVE * points.len() as f64
}

/// Points of five floats, if the file can hold such.
fn five_columns(path: &Path) -> Result<Option<Points>> {
    let bytes = std::fs::read(path).map_err(common::Error::io(path))?;
    let (rows, rest) = bytes.as_chunks::<FIVE>();
    if rows.is_empty() || !rest.is_empty() {
        return Ok(None);
    }
    let value = |row: &[u8; FIVE], column: usize| {
        let at = 4 * column;
        f32::from_le_bytes([row[at], row[at + 1], row[at + 2], row[at + 3]])
    };
    let point =
        |row| ScanPoint { x_m: value(row, 0), y_m: value(row, 1), z_m: value(row, 2), reflectance: value(row, 3) };
    let points: Vec<ScanPoint> = rows.iter().map(point).collect();
    if !are_reflectances(&points) {
        return Ok(None);
    }
    let is_beam = |beam: f32| beam.fract() == 0.0 && (0.0..MOST_BEAMS).contains(&beam);
    let mut ring = Vec::new();
    if rows.iter().all(|row| is_beam(value(row, 4))) && rows.iter().any(|row| value(row, 4) > 0.0) {
        ring.extend(rows.iter().map(|row| value(row, 4) as u16));
    }
    Ok(Some(Points { points, ring, noise: 0 }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ring of points about the lidar, of so many columns.
    fn scan(columns: usize) -> Vec<u8> {
        let row = |i: usize| {
            let angle = i as f32 * 0.1;
            let point = [10.0 * angle.cos(), 10.0 * angle.sin(), -1.5, 0.25, (i % 3) as f32, 0.5];
            point.into_iter().take(columns).flat_map(f32::to_le_bytes).collect::<Vec<u8>>()
        };
        (0..400).flat_map(row).collect()
    }

    #[test]
    fn points_with_a_beam_are_read_and_those_of_six_columns_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pcd.bin");
        std::fs::write(&path, scan(4)).unwrap();
        let Ok(Bin::Kitti(kitti)) = read(&path, 100.0) else { panic!() };
        std::fs::write(&path, scan(5)).unwrap();
        let Ok(Bin::More(points)) = read(&path, 100.0) else { panic!() };
        assert_eq!(points.points, kitti.points);
        assert_eq!(points.ring[..5], [0, 1, 2, 0, 1]);
        std::fs::write(&path, scan(6)).unwrap();
        let refused = read(&path, 100.0).err().unwrap().to_string();
        assert!(refused.contains("a.pcd.bin") && refused.contains("write x, y, z, reflectance"), "{refused}");
        // One that was cut off, though its length is a multiple of 20.
        std::fs::write(&path, &scan(4)[..4020]).unwrap();
        assert!(read(&path, 100.0).err().unwrap().to_string().contains("4020 bytes"));
    }
}
