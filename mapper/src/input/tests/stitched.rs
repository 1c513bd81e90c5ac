//! Stitched clouds are cut where and when their trajectory was.

use super::*;

#[test]
fn a_stitched_cloud_is_cut_by_time_or_by_position() {
    let root = tempfile::tempdir().unwrap();
    let (cloud, survey) = (root.path().join("cloud.laz"), root.path().join("poses.txt"));
    let rows: Vec<String> = (0..9).map(|i| format!("{} {} 0 1.75 0 0 0 1\n", 50 + i, i * 5)).collect();
    std::fs::write(&survey, rows.concat()).unwrap();
    // Points along the road, each 3 m left of it and level with the lidar.
    let points: Vec<ScanPoint> = (0..160)
        .map(|i| ScanPoint { x_m: f32::from(i as i16) * 0.25, y_m: 3.0, z_m: 1.75, reflectance: 40_000.0 })
        .collect();
    let choice = Choice { every: 4, ..ALL };
    let open = |times: &dyn Fn(usize) -> f64| {
        write_las(&cloud, &points, Some(times));
        let input = beside(&cloud, &survey);
        let config = InputConfig { held_points: 50, longest_gap_s: 1.0, ..InputConfig::default() };
        open_stitched(&input, choice, 120.0, &config, &LidarConfig::default()).unwrap()
    };
    let seen = |drive: &Drive| -> Vec<usize> {
        drive.frames.iter().map(|f| drive.read(*f, 0.0).unwrap().points.len()).collect()
    };
    let by_time = open(&|_| 54.2);
    assert_eq!((by_time.frames.clone(), seen(&by_time)), (vec![0, 4, 8], vec![0, 160, 0]));
    assert!(!by_time.has_single_scans() && by_time.notes.iter().any(|n| n.contains("cut by time")));
    let by_position = open(&|_| 0.0);
    assert_eq!(seen(&by_position), [41, 80, 39]);
    let scan = by_position.read(4, 0.0).unwrap();
    assert!(scan.points.iter().all(|p| (p.y - 3.0).abs() < 1e-3 && p.z.abs() < 1e-3 && p.x.abs() < 10.1));
    assert!((scan.reflectance[0] - 40_000.0 / 65_535.0).abs() < 1e-6);
    std::fs::write(&survey, "1 9000 0 0 0 0 0 1\n2 9001 0 0 0 0 0 1\n").unwrap();
    let input = beside(&cloud, &survey);
    let said =
        open_stitched(&input, ALL, 120.0, &InputConfig::default(), &LidarConfig::default()).unwrap_err().to_string();
    assert!(said.contains("none of its 160 points is near the poses of"), "{said}");
}

#[test]
fn a_stitched_cloud_that_is_longer_than_its_survey_is_cut_by_time_and_to_its_ends() {
    let root = tempfile::tempdir().unwrap();
    let (cloud, survey) = (root.path().join("cloud.las"), root.path().join("poses.txt"));
    // The survey begins after a minute, at 5 m/s; the cloud at once.
    let rows: Vec<String> = (0..12).map(|i| format!("{} {} 0 1.75 0 0 0 1\n", 60 + i, 300 + i * 5)).collect();
    std::fs::write(&survey, rows.concat()).unwrap();
    let x_m = |i: usize| i as f32 * 0.025;
    let points: Vec<ScanPoint> =
        (0..14_200).map(|i| ScanPoint { x_m: x_m(i), y_m: 3.0, z_m: 1.75, reflectance: 40_000.0 }).collect();
    write_las(&cloud, &points, Some(&|i| f64::from(x_m(i)) / 5.0));
    let open = |choice: Choice| {
        let input = beside(&cloud, &survey);
        open_stitched(&input, choice, 120.0, &InputConfig::default(), &LidarConfig::default()).unwrap()
    };
    let ends = |choice: Choice| {
        let drive = open(choice);
        assert!(drive.notes.iter().any(|n| n.contains("cut by time")), "{:?}", drive.notes);
        let seen: usize = drive.frames.iter().map(|f| drive.read(*f, 0.0).unwrap().points.len()).sum();
        (drive.frames, seen / 100)
    };
    // From half a second before the survey to its end and the cloud's, at 200 points a second.
    let every_4th = Choice { every: 4, ..ALL };
    assert_eq!(ends(every_4th), (vec![0, 4, 8, 11], 23));
    // Chosen late, the first points of the cloud are of no chosen place.
    assert_eq!(ends(Choice { first: 9, ..ALL }), (vec![9, 10, 11], 5));
    assert_eq!(ends(Choice { first: 3, last: 9, ..every_4th }), (vec![3, 4, 8, 9], 14));
}

#[test]
fn times_at_which_the_survey_was_elsewhere_are_not_believed() {
    let root = tempfile::tempdir().unwrap();
    let (cloud, survey) = (root.path().join("cloud.las"), root.path().join("poses.txt"));
    let rows: Vec<String> = (0..100).map(|i| format!("{i} {} 0 1.75 0 0 0 1\n", i * 10)).collect();
    std::fs::write(&survey, rows.concat()).unwrap();
    let points: Vec<ScanPoint> =
        (0..4000).map(|i| ScanPoint { x_m: i as f32 * 0.25, y_m: 3.0, z_m: 1.75, reflectance: 9.0 }).collect();
    // Points without times of their own have that of the beginning.
    write_las(&cloud, &points, Some(&|_| 0.0));
    let input = beside(&cloud, &survey);
    let drive = open_stitched(&input, ALL, 120.0, &InputConfig::default(), &LidarConfig::default()).unwrap();
    assert!(
        drive.notes.iter().any(|n| n.starts_with("4000 of 4000") && n.contains("cut by position")),
        "{:?}",
        drive.notes
    );
}

#[test]
fn a_stitched_cloud_of_a_drive_with_a_stop_is_cut_where_its_places_are() {
    let root = tempfile::tempdir().unwrap();
    let (cloud, survey) = (root.path().join("cloud.las"), root.path().join("poses.txt"));
    // 20 m, 300 poses that shake, 20 m.
    let x_m = |i: i32| if i < 300 { 5.0 * f64::from(i.min(4)) } else { 5.0 * f64::from(i - 295) };
    let row = |i: i32| format!("{} {} {} 1.75 0 0 0 1\n", 50 + i, x_m(i), 0.03 * f64::from(i % 3));
    std::fs::write(&survey, (0..304).map(row).collect::<String>()).unwrap();
    let points: Vec<ScanPoint> = (0..160)
        .map(|i| ScanPoint { x_m: f32::from(i as i16) * 0.25, y_m: 3.0, z_m: 1.75, reflectance: 40_000.0 })
        .collect();
    write_las(&cloud, &points, None);
    let input = beside(&cloud, &survey);
    let drive = open_stitched(&input, ALL, 120.0, &InputConfig::default(), &LidarConfig::default()).unwrap();
    for frame in &drive.frames {
        let scan = drive.read(*frame, 0.0).unwrap();
        assert!(scan.points.iter().all(|p| p.x.abs() < 2.7), "{frame}: {:?}", scan.points);
    }
}

#[test]
fn times_beside_a_trajectory_are_used_or_refused() {
    let root = tempfile::tempdir().unwrap();
    let [cloud, survey, times] = ["cloud.las", "poses.txt", "times.txt"].map(|name| root.path().join(name));
    let points: Vec<ScanPoint> =
        (0..40).map(|i| ScanPoint { x_m: f32::from(i as i16), y_m: 3.0, z_m: 1.75, reflectance: 9.0 }).collect();
    write_las(&cloud, &points, Some(&|_| 100.2));
    let open = |times_s: &[f64]| {
        write_times(&times, times_s).unwrap();
        let input = ScanInput { scan_times: Some(&times), ..beside(&cloud, &survey) };
        open_stitched(&input, ALL, 120.0, &InputConfig::default(), &LidarConfig::default())
    };
    write_poses(&survey, &[0.0, 2.0, 4.0].map(|x_m| Pose::translation(x_m, 0.0, 1.75))).unwrap();
    let drive = open(&[100.0, 100.2, 100.4]).unwrap();
    assert!(drive.notes.iter().any(|n| n.contains("cut by time")), "{:?}", drive.notes);
    let said = |times_s: &[f64]| open(times_s).unwrap_err().to_string();
    assert!(said(&[100.0, 100.2]).contains("times.txt has 2 times and "));
    std::fs::write(&survey, TUM).unwrap();
    assert!(said(&[100.0, 100.2, 100.4]).contains("poses.txt has a time for each pose already"));
}

#[test]
fn times_that_are_none_of_the_survey_are_told_with_what_to_do() {
    let root = tempfile::tempdir().unwrap();
    let [cloud, survey] = ["cloud.las", "poses.txt"].map(|name| root.path().join(name));
    std::fs::write(&survey, TUM).unwrap();
    let points: Vec<ScanPoint> =
        (0..40).map(|i| ScanPoint { x_m: f32::from(i as i16) * 0.1, y_m: 3.0, z_m: -1.75, reflectance: 9.0 }).collect();
    let notes = |time_s: &dyn Fn(usize) -> f64| {
        write_las(&cloud, &points, Some(time_s));
        let input = beside(&cloud, &survey);
        open_stitched(&input, ALL, 120.0, &InputConfig::default(), &LidarConfig::default()).unwrap().notes
    };
    let apart = notes(&|i| 7000.5 + i as f64);
    let told = apart.iter().find(|n| n.contains("the GPS times of")).unwrap();
    assert!(
        told.contains("from 7000.500 to 7039.500 s and those of") && told.contains("from 100.000 to 100.400 s"),
        "{told}"
    );
    assert!(
        told.contains("no point has a time of it") && told.contains("give poses in the time of the cloud"),
        "{told}"
    );
    // Who has no times, or those of the survey, needs not be told.
    for time_s in [7000.0, 100.2] {
        assert!(notes(&|_| time_s).iter().all(|n| !n.contains("GPS times")));
    }
}
