//! A vehicle with another camera than KITTI's localizes in a map that says
//! nothing of any camera.

use common::kitti::{read_poses, write_poses};

use crate::support::{build, generate, localized, run, text};

/// Height of the survey's camera, metres.
const SURVEY_M: f64 = 1.65;

#[test]
fn a_camera_of_twice_the_pixels_and_another_view_finds_itself_in_the_map() {
    let root = tempfile::tempdir().unwrap();
    let at = |name: &str| root.path().join(name);
    let (drive, map, out) = (at("drive"), at("map.csm"), at("out"));
    let camera = "[rig]\nimage_px = [1600, 900]\nfocal_px = 1266.0\nprincipal_px = [816.0, 491.0]\n";
    generate(&drive, camera, &["--frames", "60"]).ok();
    build(&drive, "00", &map, &[]).ok();
    let report = localized(&map, &drive, &drive.join("truth/poses.txt"), &out);
    let rms_m = report["rms_position_m"].as_f64().unwrap();
    assert!(rms_m < 0.15, "{rms_m} m");
    assert_eq!(report["ok_but_off"].as_u64(), Some(0), "{report}");

    // Images of another camera than the one that the calibration is of are refused.
    generate(&at("aside"), &camera.replace("816.0", "1400.0"), &["--frames", "2"]).ok();
    let (aside, labels) = (at("aside"), at("aside").join("sequences/00/labels_2"));
    let words = ["motion", "--kitti", text(&aside), "--sequence", "00", "--labels", text(&labels)];
    run("localizer", &words).refused(&["1600x900", "1400"]);
    generate(&at("none"), &camera.replace("[1600, 900]", "[1600, 0]"), &[]).refused(&["rig.image_px"]);
}

#[test]
fn vehicles_with_a_camera_that_sits_lower_or_higher_than_the_surveys_find_themselves() {
    let root = tempfile::tempdir().unwrap();
    let at = |name: &str| root.path().join(name);
    let (survey, map) = (at("survey"), at("map.csm"));
    let world = ["--world", "city", "--frames", "80"];
    generate(&survey, "", &world).ok();
    build(&survey, "00", &map, &[]).ok();
    for (name, height_m) in [("robot", 0.6), ("bus", 2.6)] {
        let drive = at(name);
        generate(&drive, &format!("[rig]\nheight_m = {height_m}\n"), &world).ok();
        // Its poses in the frame of the survey's camera, which stood there.
        let mut poses = read_poses(drive.join("truth/poses.txt")).unwrap();
        for pose in &mut poses {
            pose.translation.vector.y += SURVEY_M - height_m;
        }
        let truth = at(&format!("{name}.txt"));
        write_poses(&truth, &poses).unwrap();
        let report = localized(&map, &drive, &truth, &at(&format!("{name}_out")));
        let share = report["share_under_half_metre"].as_f64().unwrap();
        println!("{name}: {share}, {}", report["rms_position_m"]);
        assert!(share >= 0.85, "{name}: {share}");
        assert_eq!(report["ok_but_off"].as_u64(), Some(0), "{report}");
    }
}
