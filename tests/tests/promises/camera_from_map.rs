//! A camera finds itself in the demo's map.

use std::path::Path;

use crate::support::{DEMO, FRAMES, run, text};

#[test]
fn the_camera_is_localized_within_half_a_metre_and_says_when_it_is_not() {
    let (estimate, truth) = (DEMO.file("localized"), DEMO.file("drive/truth/poses.txt"));
    let words = ["eval", "--estimate", text(&estimate), "--truth", text(&truth), "--json"];
    let said = run("localizer", &words).ok();
    let json: serde_json::Value = serde_json::from_str(&said).unwrap();
    let figure = |name: &str| json[name].as_f64().unwrap_or_else(|| panic!("no {name} in {said}"));
    assert_eq!(json["frames"].as_u64().unwrap() as usize, FRAMES - 2);
    assert!(figure("rms_position_m") < 0.25, "{said}");
    assert!(figure("share_under_half_metre") >= 0.98, "{said}");
    assert!(figure("mean_angle_rad") < 0.01, "{said}");
}

/// The label images of the demo but for these frames.
fn labels_without(folder: &Path, dark: std::ops::Range<usize>) {
    for class in ["pole", "sign", "light", "lane", "vegetation"] {
        std::fs::create_dir_all(folder.join(class)).unwrap();
        for frame in (0..FRAMES).filter(|frame| !dark.contains(frame)) {
            let name = format!("{class}/{frame:06}.png");
            let from = DEMO.file("drive/sequences/00/labels_2").join(&name);
            if from.exists() {
                std::fs::copy(from, folder.join(&name)).unwrap();
            }
        }
    }
}

#[test]
fn wheels_and_gyroscope_lead_through_two_seconds_without_an_image() {
    let folder = tempfile::tempdir().unwrap();
    let (labels, out) = (folder.path().join("labels"), folder.path().join("out"));
    labels_without(&labels, 25..45);
    let odometry = DEMO.file("drive/sequences/00/odometry.csv");
    DEMO.localize_by(&labels, &DEMO.file("street.csm"), &out, &["--odometry", text(&odometry)]).ok();
    let csv = std::fs::read_to_string(out.join("estimates.csv")).unwrap();
    let truth = common::kitti::read_poses(DEMO.file("drive/truth/poses.txt")).unwrap();
    let seen = csv.lines().find_map(|line| line.strip_prefix("45,")).unwrap();
    let values: Vec<&str> = seen.split(',').collect();
    let at = |i: usize| values[i].parse::<f64>().unwrap();
    let off_m = (nalgebra::Vector3::new(at(2), at(3), at(4)) - truth[45].translation.vector).norm();
    assert!(off_m < 0.3 && values[1] != "lost", "{off_m} m, {}", values[1]);
}
