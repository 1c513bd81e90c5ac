//! What a drive is asked before a map is made of it, and what is said of it beside the map.

use std::path::Path;

use common::geometry::Pose;
use common::kitti::{read_poses, write_poses};

use crate::support::{CALIBRATION, DEMO, Ran, build, plain, run, text};

/// `mapper build` of every scan of sequence 04.
fn build_of(root: &Path, more: &[&str]) -> Ran {
    build(root, "04", &root.join("04.csm"), &[&["--every", "1"], more].concat())
}

#[test]
fn frames_without_a_scan() {
    let root = plain();
    build_of(root.path(), &["--first", "2"]).refused(&["velodyne", "no scan", "its scans are of frames 0, 1;"]);
    let folder = root.path().join("sequences/04/velodyne");
    std::fs::rename(folder.join("000000.bin"), folder.join("000002.bin")).unwrap();
    build(root.path(), "04", &root.path().join("04.csm"), &[]).refused(&["with --every 5", "of frames 1, 2;"]);
    for frame in 1..3 {
        let scan = folder.join(format!("{frame:06}.bin"));
        std::fs::rename(&scan, scan.with_extension("txt")).unwrap();
    }
    build_of(root.path(), &[]).refused(&["holds no scan such as 000000.bin, but 2 files such as 000001.txt;"]);
    std::fs::remove_dir_all(&folder).unwrap();
    std::fs::create_dir(&folder).unwrap();
    build_of(root.path(), &[]).refused(&["velodyne is empty", "scans such as 000000.bin"]);
}

#[test]
fn a_sequence_as_shells_complete_it() {
    let root = plain();
    build(root.path(), "04/", &root.path().join("04.csm"), &["--every", "1"]).ok();
}

#[test]
fn a_calibration_of_the_lidar_and_one_camera() {
    let root = plain();
    let some: Vec<&str> = CALIBRATION.lines().filter(|line| line.starts_with("P2") || line.starts_with("Tr")).collect();
    std::fs::write(root.path().join("sequences/04/calib.txt"), some.join("\n")).unwrap();
    build_of(root.path(), &[]).ok();
}

#[test]
fn nothing_of_a_raw_drive_is_written_over() {
    let day = tempfile::tempdir().unwrap();
    let sync = day.path().join("d_sync");
    for folder in ["velodyne_points/data", "oxts/data"] {
        std::fs::create_dir_all(sync.join(folder)).unwrap();
    }
    let files = ["calib_velo_to_cam.txt", "calib_imu_to_velo.txt", "calib_cam_to_cam.txt"];
    let packets = ["d_sync/oxts/timestamps.txt", "d_sync/oxts/data/0000000000.txt"];
    for name in files.into_iter().chain(packets) {
        let file = day.path().join(name);
        std::fs::write(&file, "").unwrap();
        let out = day.path().join("a.csm");
        let words = ["build", "--raw", text(&sync), "--out", text(&out), "--trajectory", text(&file)];
        run("mapper", &words).refused(&[name, "it is read, and --trajectory would replace it"]);
    }
}

/// The demo's survey, changed, and what its build says.
fn demo_with(change: impl Fn(usize, &mut Pose), more: &[&str]) -> (String, serde_json::Value) {
    let folder = tempfile::tempdir().unwrap();
    let (survey, map) = (folder.path().join("poses.txt"), folder.path().join("a.csm"));
    let mut poses = read_poses(DEMO.file("drive/poses/00.txt")).unwrap();
    poses.iter_mut().enumerate().for_each(|(frame, pose)| change(frame, pose));
    write_poses(&survey, &poses).unwrap();
    let said = build(&DEMO.file("drive"), "00", &map, &[&["--survey", text(&survey)], more].concat()).ok();
    let report = std::fs::read_to_string(map.with_extension("build.json")).unwrap();
    (said, serde_json::from_str(&report).unwrap())
}

#[test]
fn a_survey_that_jumps_once_is_told_with_the_frames_of_the_jump() {
    let jump = |frame: usize, pose: &mut Pose| {
        if frame >= 33 {
            pose.translation.vector.z += 5.0;
        }
    };
    for (poses, why, by) in [
        ("refine", "5.0 m, which the scans contradict", "scans"),
        ("given", "5.0 m, which no vehicle does in that time", "times"),
    ] {
        let (said, report) = demo_with(jump, &["--poses", poses]);
        assert!(said.contains(&format!("from frame 32 to frame 33 the survey jumps by {why}")), "{said}");
        let jumps = report["survey_jumps"].as_array().unwrap();
        assert!(jumps.len() == 1 && jumps[0]["told_by"] == by && jumps[0]["before_frame"] == 32, "{jumps:?}");
    }
    let (said, report) = demo_with(|_, _| (), &[]);
    assert!(!said.contains("the survey jumps") && report["survey_jumps"].as_array().unwrap().is_empty(), "{said}");
}
