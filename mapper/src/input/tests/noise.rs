//! Points that a LAS file says to be withheld or noise are no points.

use las::point::Classification;

use super::*;

/// A scan of which a tenth is withheld, and as much of each class of noise.
fn write_noisy(path: &Path, format: u8) {
    let far =
        |i: usize, p: &ScanPoint| if i % 10 < 3 { ScanPoint { z_m: 40.0, reflectance: 60_000.0, ..*p } } else { *p };
    let points: Vec<ScanPoint> = points().iter().enumerate().map(|(i, p)| far(i, p)).collect();
    write_las_with(path, format, &points, |i, point| {
        point.is_withheld = i % 10 == 0;
        point.gps_time = Some(i as f64);
        match i % 10 {
            1 => point.classification = Classification::LowPoint,
            2 => point.classification = Classification::HighNoise,
            // Of another flag.
            3 => point.is_synthetic = true,
            _ => {}
        }
    });
}

#[test]
fn withheld_points_and_noise_are_left_out_of_scans_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    for (name, format) in [("a.las", 1), ("b.laz", 1), ("c.las", 6), ("d.laz", 6)] {
        let path = folder.path().join(name);
        write_noisy(&path, format);
        let scan = read(&path).unwrap();
        assert_eq!((scan.points.len(), scan.dropped_as_noise), (560, 240), "{name}");
        assert!(scan.points.iter().all(|p| p.z_m < 0.0), "{name}");
    }
    // Where nothing else is there the lidar was blind, and the file is whole.
    let path = folder.path().join("e.las");
    write_las_with(&path, 0, &points(), |_, point| point.is_withheld = true);
    assert_eq!(read(&path).unwrap().dropped_as_noise, 800);
}

#[test]
fn withheld_points_and_noise_are_left_out_of_stitched_clouds_and_told() {
    let root = tempfile::tempdir().unwrap();
    let (cloud, survey) = (root.path().join("cloud.laz"), root.path().join("poses.txt"));
    write_noisy(&cloud, 6);
    std::fs::write(&survey, TUM).unwrap();
    let drive =
        open_stitched(&beside(&cloud, &survey), ALL, 120.0, &InputConfig::default(), &LidarConfig::default()).unwrap();
    assert!(drive.notes.iter().any(|n| n.starts_with("560 of 800") && n.contains("intensities up to 199")));
    assert!(drive.notes.iter().any(|n| n.starts_with("240 points are withheld")), "{:?}", drive.notes);
    let seen = drive.frames.iter().flat_map(|f| drive.read(*f, 0.0).unwrap().points);
    assert!(seen.filter(|p| p.z > 0.0).count() == 0, "noise is high up");
}
