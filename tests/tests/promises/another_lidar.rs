//! A drive with another lidar than KITTI's is mapped without a word about it.

use std::path::Path;

use common::geometry::Pose;
use common::kitti::{Calibration, ScanPoint, poses_text, read_poses, read_scan, write_scan};
use nalgebra::{Matrix3, Translation3, UnitQuaternion, Vector3};
use waymark_tests::map_score::{MapScore, score};

use crate::support::{build, generate, run, text};

/// What lies farther from the path does not count, metres.
const BESIDE_PATH_M: f64 = 12.0;

fn scored(map: &Path, drive: &Path) -> MapScore {
    let truth = waymark_tests::truth::read(drive).unwrap();
    let exact = read_poses(drive.join("truth/poses.txt")).unwrap();
    score(&common::map::read(map).unwrap(), &truth, &exact, BESIDE_PATH_M)
}

#[test]
fn scans_say_which_lidar_took_them_and_the_map_is_as_good() {
    let root = tempfile::tempdir().unwrap();
    let (drive, map, config) =
        (root.path().join("drive"), root.path().join("map.csm"), root.path().join("config.toml"));
    let lidar = "[lidar]\nbeams = 48\nfrom_to_deg = [-24.0, 16.0]\ncolumns = 1800\nvertical_error_deg = 0.0\n";
    generate(&drive, lidar, &["--frames", "100", "--scan-every", "5"]).ok();

    let said = build(&drive, "00", &map, &[]).ok();
    let note = said.lines().find(|line| line.contains("another lidar")).unwrap();
    let numbers: Vec<f64> =
        note.split_whitespace().filter_map(|word| word.trim_end_matches([',', ';']).parse().ok()).collect();
    let [low_deg, high_deg, apart_deg, along_deg] = numbers[..] else { panic!("{note}") };
    assert!((low_deg + 24.0).abs() < 1.0 && (high_deg - 16.0).abs() < 1.0, "{note}");
    assert!((apart_deg - 40.0 / 47.0).abs() < 0.1 && (along_deg - 0.2).abs() < 0.03, "{note}");
    // The report has what was taken, and who knows better is believed.
    let report = std::fs::read_to_string(map.with_extension("build.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert!(report["config"]["lidar"]["highest_rad"].as_f64().unwrap() > 0.25, "{}", report["config"]["lidar"]);
    let poles = scored(&map, &drive).poles;
    println!("poles: {poles:?}");
    assert!(poles.wanted >= 10.0 && poles.recall() >= 0.8 && poles.precision() >= 0.8, "{poles:?}");

    std::fs::write(&config, "[lidar.measure]\nis_on = false\n").unwrap();
    let said = build(&drive, "00", &map, &["--config", text(&config)]).ok();
    assert!(!said.contains("another lidar"), "{said}");
}

/// Writes the scans of a drive anew.
fn rewrite(drive: &Path, change: impl Fn(&mut Vec<ScanPoint>)) {
    for file in std::fs::read_dir(drive.join("sequences/00/velodyne")).unwrap() {
        let path = file.unwrap().path();
        let mut points = read_scan(&path, 120.0).unwrap().points;
        change(&mut points);
        write_scan(&path, &points).unwrap();
    }
}

#[test]
fn points_in_another_order_with_other_intensities_give_as_good_a_map() {
    let root = tempfile::tempdir().unwrap();
    let (drive, map) = (root.path().join("drive"), root.path().join("map.csm"));
    // The crossing of the city has lights.
    generate(&drive, "[lidar]\nis_calibrated = true\n", &["--world", "city", "--frames", "160"]).ok();
    rewrite(&drive, |points| {
        points.sort_by_key(|p| (p.y_m.atan2(p.x_m) / 0.003) as i32);
        for p in points {
            p.reflectance = (p.reflectance * 255.0).round();
        }
    });
    let said = build(&drive, "00", &map, &[]).ok();
    for part in ["into the order of the beams", "an intensity of 255 counts as a reflectance of 1", "other intensities"]
    {
        assert!(said.contains(part), "no `{part}` in: {said}");
    }
    let MapScore { poles, signs, lights, lanes, .. } = scored(&map, &drive);
    println!("poles {poles:?}, signs {signs:?}, lights {lights:?}, lanes {lanes:?}");
    for (what, found, [recall, precision]) in [
        ("poles", &poles, [0.9, 0.9]),
        ("signs", &signs, [0.8, 0.9]),
        ("lights", &lights, [0.8, 0.9]),
        ("lanes", &lanes, [0.9, 0.85]),
    ] {
        assert!(found.recall() >= recall && found.precision() >= precision, "{what}: {found:?}");
    }
}

#[test]
fn intensities_that_are_all_alike_make_no_lines_and_no_signs_of_all_that_stands() {
    let root = tempfile::tempdir().unwrap();
    let (drive, map) = (root.path().join("drive"), root.path().join("map.csm"));
    generate(&drive, "", &["--frames", "30", "--scan-every", "5"]).ok();
    for all in [0.0, 1.0] {
        rewrite(&drive, |points| points.iter_mut().for_each(|p| p.reflectance = all));
        let said = build(&drive, "00", &map, &[]).ok();
        assert!(said.contains("no intensities"), "{said}");
        let map = common::map::read(&map).unwrap();
        let painted = map.lanes.iter().filter(|lane| lane.kind.is_painted()).count();
        // Boards on posts are told by their shape alone.
        assert!(map.poles.len() >= 5 && painted == 0 && map.signs.len() <= 5, "{map:?}");
    }
}

#[test]
fn sixteen_beams_do_not_hold_the_survey_back() {
    let root = tempfile::tempdir().unwrap();
    let file = |name: &str| root.path().join(name);
    let (drive, map, poses) = (file("drive"), file("map.csm"), file("poses.txt"));
    let lidar = "[lidar]\nbeams = 16\nfrom_to_deg = [-15.0, 15.0]\ncolumns = 1800\nvertical_error_deg = 0.0\n";
    generate(&drive, lidar, &["--frames", "40", "--scan-every", "1"]).ok();
    build(&drive, "00", &map, &["--every", "1", "--trajectory", text(&poses)]).ok();

    // The survey is right to 2 cm; what single beams leave on the ground and on hedges moves
    // with the lidar.
    let (found, exact) = (read_poses(&poses).unwrap(), read_poses(drive.join("truth/poses.txt")).unwrap());
    let way_m = |poses: &[Pose]| -> Vec<f64> {
        poses.windows(2).map(|pair| (pair[1].translation.vector - pair[0].translation.vector).norm()).collect()
    };
    let off_m: Vec<f64> = way_m(&found).iter().zip(way_m(&exact)).map(|(found, exact)| found - exact).collect();
    assert!(off_m.len() == 39 && off_m.iter().all(|off_m| off_m.abs() < 0.1), "{off_m:?}");
}

#[test]
fn scans_in_the_frame_of_the_vehicle_say_where_the_lidar_is() {
    let root = tempfile::tempdir().unwrap();
    let (drive, map, survey) =
        (root.path().join("drive"), root.path().join("map.csm"), root.path().join("vehicle.txt"));
    generate(&drive, "", &["--world", "street", "--frames", "120", "--scan-every", "5"]).ok();
    // Its origin is on the road, below the rear axle; no camera is known.
    let at = [0.9_f32, 0.2, 1.73];
    rewrite(&drive, |points| {
        for p in points {
            (p.x_m, p.y_m, p.z_m) = (p.x_m + at[0], p.y_m + at[1], p.z_m + at[2]);
        }
    });
    let calibration = Calibration::read(drive.join("sequences/00/calib.txt")).unwrap();
    let camera_from_vehicle =
        calibration.camera_from_velodyne * Translation3::from(Vector3::from(at.map(|v| -f64::from(v))));
    let poses = read_poses(drive.join("poses/00.txt")).unwrap();
    // Of a world with z up, whose map is that of the camera.
    let axes: Matrix3<f64> = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
    let world_from_map = Pose::from_parts(Translation3::identity(), UnitQuaternion::from_matrix(&axes).inverse());
    let poses: Vec<Pose> = poses.iter().map(|pose| world_from_map * pose * camera_from_vehicle).collect();
    std::fs::write(&survey, poses_text(&poses)).unwrap();

    let scans = drive.join("sequences/00/velodyne");
    let by_vehicle = ["--survey", text(&survey)];
    let (given, calib) = (drive.join("poses/00.txt"), root.path().join("calib.txt"));
    write_tr(&drive.join("sequences/00/calib.txt"), &camera_from_vehicle, &calib);
    let by_camera = ["--survey", text(&given), "--survey-frame", "camera", "--calib", text(&calib)];
    for poses in [&by_vehicle[..], &by_camera] {
        let command = ["build", "--scans", text(&scans), "--out", text(&map)];
        let said = run("mapper", &[&command, poses].concat()).ok();
        let note = said.lines().find(|line| line.contains("the origin of the scans is not the lidar")).unwrap();
        let place = &note[note.find('(').unwrap() + 1..note.find(')').unwrap()];
        let place: Vec<f64> = place.split(", ").map(|v| v.parse().unwrap()).collect();
        // The upper beams of an HDL-64E come from 0.21 m over its origin.
        let off: Vector3<f64> =
            Vector3::from_column_slice(&place) - Vector3::from(at.map(f64::from)) - 0.21 * Vector3::z();
        assert!(off.z.abs() < 0.15 && off.xy().norm() < 0.8, "{note}");
        let MapScore { poles, lanes, .. } = scored(&map, &drive);
        println!("poles {poles:?}, lanes {lanes:?}");
        for (found, least) in [(&poles, 0.85), (&lanes, 0.9)] {
            assert!(found.recall() >= least && found.precision() >= least, "{found:?}");
        }
    }
}

#[test]
fn a_lidar_that_looks_to_the_side_gives_the_same_map() {
    let root = tempfile::tempdir().unwrap();
    let drive = root.path().join("drive");
    generate(&drive, "", &["--frames", "60", "--scan-every", "5"]).ok();
    let camera_from_lidar = Calibration::read(drive.join("sequences/00/calib.txt")).unwrap().camera_from_velodyne;
    let poses = read_poses(drive.join("poses/00.txt")).unwrap();
    // What others call x is y of KITTI's: to the left.
    let lidar_from_turned = Pose::rotation(std::f64::consts::FRAC_PI_2 * Vector3::z());
    let mut raised_rad = Vec::new();
    for from_turned in [Pose::identity(), lidar_from_turned] {
        if from_turned != Pose::identity() {
            rewrite(&drive, |points| points.iter_mut().for_each(|p| (p.x_m, p.y_m) = (p.y_m, -p.x_m)));
        }
        let survey = root.path().join("poses.txt");
        let of_lidar = |pose: &Pose| camera_from_lidar.inverse() * pose * camera_from_lidar * from_turned;
        std::fs::write(&survey, poses_text(&poses.iter().map(of_lidar).collect::<Vec<Pose>>())).unwrap();
        let (scans, map) = (drive.join("sequences/00/velodyne"), root.path().join("map.csm"));
        let words = ["build", "--scans", text(&scans), "--survey", text(&survey), "--out", text(&map)];
        run("mapper", &words).ok();
        let report = std::fs::read_to_string(map.with_extension("build.json")).unwrap();
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        raised_rad.push(report["registration"]["vertical_angle_rad"].as_f64().unwrap());
    }
    assert!(raised_rad[0] > 0.002 && (raised_rad[1] - raised_rad[0]).abs() < 2e-4, "{raised_rad:?}");
}

/// Writes a calibration with another `Tr`.
fn write_tr(calib: &Path, camera_from_scans: &Pose, to: &Path) {
    let rows = camera_from_scans.to_homogeneous().fixed_rows::<3>(0).transpose();
    let tr: Vec<String> = rows.iter().map(f64::to_string).collect();
    let kept = std::fs::read_to_string(calib).unwrap();
    let kept: Vec<&str> = kept.lines().filter(|line| !line.starts_with("Tr")).collect();
    std::fs::write(to, format!("{}\nTr: {}\n", kept.join("\n"), tr.join(" "))).unwrap();
}
