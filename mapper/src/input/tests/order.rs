//! A stitched cloud gives the same whatever order its points are stored in.

use super::*;
use crate::lanes::{ContrastConfig, Contrasts};

/// Beams of the lidar.
const BEAMS: usize = 24;
/// Their points.
const AROUND: usize = 1800;

/// A road with a line of paint 1.8 m to the left, as the lidar 1.7 m above it sees it beam by beam.
fn scan() -> Vec<ScanPoint> {
    let hit = |beam: usize, i: usize| {
        let (sin, cos) = (0.0035 * i as f32 - 3.1).sin_cos();
        let level_m = 1.7 / (0.12 + 0.0073 * beam as f32).tan();
        let is_paint = (level_m * sin - 1.8).abs() < 0.08;
        let grain = (i * 7 % 5) as f32 * 300.0;
        let reflectance = if is_paint { 40_000.0 } else { 18_000.0 } + grain;
        ScanPoint { x_m: level_m * cos, y_m: level_m * sin, z_m: -1.7, reflectance }
    };
    (0..BEAMS).flat_map(|beam| (0..AROUND).map(move |i| hit(beam, i))).collect()
}

/// Three such scans, 6 m apart, in one world, with the number of each.
fn street() -> Vec<(ScanPoint, usize)> {
    let at =
        |place: usize| scan().into_iter().map(move |p| (ScanPoint { x_m: p.x_m + 6.0 * place as f32, ..p }, place));
    (0..3).flat_map(at).collect()
}

/// 7919 is prime, and so is every place met once.
fn stirred<T: Copy>(points: &[T]) -> Vec<T> {
    (0..points.len()).map(|i| points[i * 7919 % points.len()]).collect()
}

/// The drive of a cloud of such points, with times that `time_s` gives, or none.
fn open_street(points: &[(ScanPoint, usize)], time_s: Option<&dyn Fn(usize) -> f64>) -> (Drive, tempfile::TempDir) {
    let root = tempfile::tempdir().unwrap();
    let (cloud, survey) = (root.path().join("cloud.las"), root.path().join("poses.txt"));
    std::fs::write(&survey, "100 0 0 0 0 0 0 1\n100.4 6 0 0 0 0 0 1\n100.8 12 0 0 0 0 0 1\n").unwrap();
    let places: Vec<ScanPoint> = points.iter().map(|(p, _)| *p).collect();
    write_las_with(&cloud, 6, &places, |i, point| {
        (point.x, point.y) = (f64::from(places[i].x_m), f64::from(places[i].y_m));
        point.gps_time = Some(time_s.map_or(0.0, |time_s| time_s(points[i].1)));
    });
    let lidar = LidarConfig { apex_m: 0.0, azimuth_step_rad: 0.0035, ..LidarConfig::default() };
    let mut drive = open_stitched(&beside(&cloud, &survey), ALL, 120.0, &InputConfig::default(), &lidar).unwrap();
    let scan = drive.read(drive.frames[0], 0.0).unwrap();
    drive.put_lidar(&lidar, &scan).unwrap();
    (drive, root)
}

/// Of the points of paint within 12 m and of those of the road the shares that stand out.
fn standing_out(drive: &Drive) -> [f64; 2] {
    let (config, mut out) = (ContrastConfig::default(), [(0, 0); 2]);
    for frame in &drive.frames {
        let scan = drive.read(*frame, 0.0).unwrap();
        let contrasts = Contrasts::new(&scan, &config);
        for (i, p) in scan.points.iter().enumerate().filter(|(_, p)| p.coords.norm() < 12.0) {
            let (there, all) = &mut out[usize::from((p.y - 1.8).abs() > 0.08)];
            *there += usize::from(contrasts.of(i, p.coords.norm()).is_some_and(|contrast| contrast > 3.0));
            *all += 1;
        }
    }
    out.map(|(there, all): (usize, usize)| there as f64 / all as f64)
}

#[test]
fn points_with_times_come_into_the_order_of_the_beams() {
    let street = street();
    let time_s: &dyn Fn(usize) -> f64 = &|place| 100.0 + 0.4 * place as f64;
    let (as_taken, _root) = open_street(&street, Some(time_s));
    assert!(as_taken.notes.iter().all(|n| !n.contains("in no order")), "{:?}", as_taken.notes);
    let [paint, road] = standing_out(&as_taken);
    assert!(paint > 0.8 && road < 0.02, "{paint} {road}");
    let (drive, _root) = open_street(&stirred(&street), Some(time_s));
    assert!(drive.notes.iter().any(|n| n.contains("put into that of their times")), "{:?}", drive.notes);
    let [other_paint, other_road] = standing_out(&drive);
    assert!(other_paint > 0.85 && other_road < road + 0.01, "{other_paint} {other_road}");
}

#[test]
fn points_without_times_come_into_strips_across_the_way() {
    let street = street();
    let (as_taken, _root) = open_street(&street, None);
    assert!(as_taken.notes.iter().all(|n| !n.contains("in no order")), "{:?}", as_taken.notes);
    let (drive, _root) = open_street(&stirred(&street), None);
    assert!(drive.notes.iter().any(|n| n.contains("strips across the way")), "{:?}", drive.notes);
    let [paint, road] = standing_out(&drive);
    assert!(paint > 0.45 && road < 0.02, "{paint} {road}");
}

#[test]
fn points_of_one_turn_are_told_by_times_of_their_own() {
    // All points of the three scans in one slice, each with its own time: columns, as lidars turn.
    let lidar = LidarConfig { apex_m: 0.0, azimuth_step_rad: 0.0035, ..LidarConfig::default() };
    let steps = Steps::of(&lidar);
    let points: Vec<(ScanPoint, usize)> = stirred(&street().into_iter().zip(0..).collect::<Vec<_>>())
        .into_iter()
        .map(|((p, place), i)| (p, place * 100_000 + i % (BEAMS * AROUND) % AROUND))
        .collect();
    let times_s: Vec<f64> =
        points.iter().map(|(_, n)| (n / 100_000) as f64 * 0.4 + (n % 100_000) as f64 * 0.07 / AROUND as f64).collect();
    let points: Vec<ScanPoint> = points.iter().map(|(p, _)| *p).collect();
    assert!(!steps.are_as_taken(&points));
    let still = |place: usize| Pose::translation(6.0 * place as f64, 0.0, 0.0);
    let tour = super::super::order::Tour {
        times_s: (0..3).flat_map(|place| [0.4 * f64::from(place), 0.4 * f64::from(place) + 0.08]).collect(),
        map_from_velodyne: (0..3).flat_map(|place| [still(place); 2]).collect(),
    };
    let slice = super::super::order::Slice::new(&points, &times_s, &[still(0).inverse()], 0);
    assert!(slice.by_time(steps, None).is_none(), "columns are no beams");
    let ordered = slice.by_time(steps, Some((&tour, 0.1))).unwrap();
    assert_eq!(ordered.len(), points.len());
    let near = |w: &&[ScanPoint]| (w[0].x_m - w[1].x_m).hypot(w[0].y_m - w[1].y_m) < 0.2;
    let along = ordered.windows(2).filter(near).count();
    assert!(along > points.len() * 95 / 100, "{along} of {}", points.len());
}
