//! A drive gives the same map whatever it is read from.

use std::path::Path;

use common::geometry::Pose;
use common::map::SemanticMap;

use crate::support::{run, text};

/// A short drive with a survey and packets without error.
fn drive(root: &Path) {
    let config = root.join("exact.toml");
    std::fs::write(&config, "[logs.oxts]\nposition_m = 0.0\ntilt_deg = 0.0\nheading_deg = 0.0\n").unwrap();
    let out = root.join("drive");
    let words = ["generate", "--frames", "30", "--raw", "--config", text(&config), "--out", text(&out)];
    run("fixtures", &words).ok();
}

fn map(root: &Path, name: &str, words: &[&str]) -> SemanticMap {
    let out = root.join(name);
    run("mapper", &[&["build", "--out", text(&out)], words].concat()).ok();
    common::map::read(out).unwrap()
}

/// Poles of one map that stand in the other within 10 cm.
fn share_of_poles(of: &SemanticMap, within: &SemanticMap) -> f64 {
    let stands = |foot| within.poles.iter().any(|p| nalgebra::distance(&p.foot_map, foot) < 0.1);
    of.poles.iter().filter(|p| stands(&p.foot_map)).count() as f64 / of.poles.len() as f64
}

#[test]
fn raw_recordings_and_folders_of_scans_give_the_map_of_the_benchmarks_layout() {
    let root = tempfile::tempdir().unwrap();
    let root = root.path();
    drive(root);
    let truth = root.join("drive/truth/poses.txt");
    let kitti = root.join("drive");
    let sequence = kitti.join("sequences/00");
    let given = ["--poses", "given"];
    let survey = ["--kitti", text(&kitti), "--sequence", "00", "--survey", text(&truth)];
    let expected = map(root, "odometry.csm", &[&survey[..], &given].concat());
    assert!(expected.poles.len() > 5);

    let sync = root.join("drive/raw/2011_09_30/2011_09_30_drive_0001_sync");
    let mut raw = map(root, "raw.csm", &[&["--raw", text(&sync)][..], &given].concat());
    // Its map frame is camera 0 of frame 0 exactly, not as the survey sees it.
    let map_from_first = common::kitti::read_poses(&truth).unwrap()[0];
    for pole in &mut raw.poles {
        pole.foot_map = map_from_first * pole.foot_map;
    }
    assert!(share_of_poles(&expected, &raw) > 0.75 && share_of_poles(&raw, &expected) > 0.75);

    // KITTI rows of the camera, scans by number: the very same.
    let (scans, calib) = (sequence.join("velodyne"), sequence.join("calib.txt"));
    let folder =
        ["--scans", text(&scans), "--survey", text(&truth), "--survey-frame", "camera", "--calib", text(&calib)];
    let same = map(root, "scans.csm", &[&folder[..], &given].concat());
    assert_eq!(SemanticMap { frame_note: expected.frame_note.clone(), ..same }, expected);
}

#[test]
fn what_is_no_drive_is_told() {
    let root = tempfile::tempdir().unwrap();
    let root = root.path();
    let out = root.join("a.csm");
    let poses = root.join("poses.txt");
    common::kitti::write_poses(&poses, &[Pose::identity(); 3]).unwrap();
    let refused = |words: &[&str], parts: &[&str]| {
        run("mapper", &[&["build", "--out", text(&out)], words].concat()).refused(parts);
        assert!(!out.exists());
    };
    refused(&["--raw", text(root)], &["holds no folder `velodyne_points/data`", "give a folder such as"]);
    refused(&["--scans", text(root), "--survey", text(&poses)], &["holds no scan", "give a folder of .las"]);
    let two = run("mapper", &["build", "--scans", text(root), "--survey", text(&poses), "--reduce", "450000,5420000"]);
    assert!(two.code == 2 && two.err.contains("give three finite numbers"), "{two:?}");
    std::fs::write(root.join("000000.pcd"), "VERSION 0.7\n").unwrap();
    refused(&["--scans", text(root), "--survey", text(&poses)], &["000000.pcd", "no line `DATA`", "copy it again"]);
    let cloud = root.join("cloud.laz");
    std::fs::write(&cloud, "no cloud").unwrap();
    refused(&["--stitched", text(&cloud), "--survey", text(&poses)], &["cloud.laz", "no whole LAS or LAZ file"]);
}
