//! The survey's poses are made consistent with the scans, in the survey's
//! frame, and the report says what was estimated.

use common::geometry::Pose;
use common::kitti::read_poses;

use crate::support::{DEMO, build, run, text};

fn rms(errors: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = errors.fold((0.0, 0.0), |(sum, count), e| (sum + e * e, count + 1.0));
    (sum / count).sqrt()
}

/// How far the ends of a 20 m lever are apart in two poses: what an error of
/// orientation does to the map.
fn lever_m(a: &Pose, b: &Pose) -> f64 {
    let ahead = nalgebra::Point3::new(0.0, 0.0, 20.0);
    (a * ahead - b * ahead).norm()
}

#[test]
fn refined_poses_are_nearer_to_the_exact_ones_than_the_survey() {
    let exact = read_poses(DEMO.file("drive/truth/poses.txt")).unwrap();
    let survey = read_poses(DEMO.file("drive/poses/00.txt")).unwrap();
    let refined = read_poses(DEMO.file("street_poses.txt")).unwrap();
    assert_eq!(refined.len(), exact.len(), "one pose for every frame, stitched or not");
    let off = |poses: &[Pose]| rms(poses.iter().zip(&exact).map(|(a, b)| lever_m(a, b)));
    assert!(off(&refined) < 0.5 * off(&survey), "{} {}", off(&refined), off(&survey));
    let apart = rms(refined.iter().zip(&exact).map(|(a, b)| (a.translation.vector - b.translation.vector).norm()));
    assert!(apart < 0.05, "{apart}");
}

#[test]
fn inspect_says_what_was_estimated() {
    let map = DEMO.file("street.csm");
    let said = run("mapper", &["inspect", text(&map)]).ok();
    assert!(said.contains("poses refined: survey axes turned by") && said.contains("scans stitched"), "{said}");
    let json = run("mapper", &["inspect", text(&map), "--json"]).ok();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let report = &json["build"]["registration"];
    let turned = |axis: usize| report["misalignment_rad"][axis].as_f64().unwrap().to_degrees();
    // What the fixtures turn the survey by, about x and y; about the driving
    // axis it is the survey's own error that the scans hardly see.
    assert!((turned(0) + 0.165).abs() < 0.05 && (turned(1) - 0.336).abs() < 0.05, "{report}");
    let rms = |name: &str| report[name].as_f64().unwrap();
    assert!(rms("rms_refined_m") < rms("rms_given_m"));
}

#[test]
fn given_poses_stay_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let (map, trajectory) = (folder.path().join("a.csm"), folder.path().join("a.txt"));
    build(&DEMO.file("drive"), "00", &map, &["--poses", "given", "--trajectory", text(&trajectory)]).ok();
    let survey = read_poses(DEMO.file("drive/poses/00.txt")).unwrap();
    let written = read_poses(trajectory).unwrap();
    assert!(survey.iter().zip(&written).all(|(a, b)| lever_m(a, b) < 1e-6));
}
