//! Real KITTI files, where they are.

use super::*;
use std::path::PathBuf;

/// `kitti` in the folder of `WAYMARK_DATA`, else in `../shared` from the root
/// of the workspace; none, with a line that says so, where there is none.
fn real() -> Option<PathBuf> {
    let root = std::env::var_os("WAYMARK_DATA")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")), PathBuf::from)
        .join("kitti");
    if !root.is_dir() {
        println!("no real KITTI data (set WAYMARK_DATA): not tested on it");
        return None;
    }
    Some(root)
}

#[test]
fn real_sequences_are_read() {
    let Some(root) = real() else { return };
    for (name, scans) in [("00", 10), ("04", 51)] {
        let sequence = Sequence::open(&root, name).unwrap();
        assert_eq!(sequence.poses().unwrap().len(), sequence.times_s().unwrap().len());
        assert_eq!(sequence.scan_frames().unwrap().len(), scans);
        assert_eq!(sequence.image_frames(2).unwrap().len(), scans);
        // The lidar is about 30 cm behind camera 0 and 8 cm above it.
        let calibration = sequence.calibration().unwrap();
        let lidar = calibration.camera_from_velodyne.translation.vector;
        assert!((lidar - nalgebra::Vector3::new(0.0, -0.08, -0.27)).norm() < 0.1, "{lidar}");
        let scan = read_scan(sequence.scan_path(0), 120.0).unwrap();
        assert!(scan.points.len() > 100_000 && scan.dropped_not_finite == 0);
        let on_the_ground = scan.points.iter().filter(|p| (-1.9..-1.5).contains(&p.z_m)).count();
        assert!(on_the_ground * 3 > scan.points.len(), "{on_the_ground} of {}", scan.points.len());
    }
}
