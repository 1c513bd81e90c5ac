//! A vehicle with another camera than KITTI's localizes in a map that says
//! nothing of any camera.

use crate::support::{build, run, text};

#[test]
fn a_camera_of_twice_the_pixels_and_another_view_finds_itself_in_the_map() {
    let root = tempfile::tempdir().unwrap();
    let at = |name: &str| root.path().join(name);
    let (drive, map, config, out) = (at("drive"), at("map.csm"), at("config.toml"), at("out"));
    let camera = "[rig]\nimage_px = [1600, 900]\nfocal_px = 1266.0\nprincipal_px = [816.0, 491.0]\n";
    std::fs::write(&config, camera).unwrap();
    run("fixtures", &["generate", "--frames", "60", "--config", text(&config), "--out", text(&drive)]).ok();
    build(&drive, "00", &map, &[]).ok();
    let (labels, truth) = (drive.join("sequences/00/labels_2"), drive.join("truth/poses.txt"));
    let words = ["run", "--map", text(&map), "--kitti", text(&drive), "--sequence", "00", "--labels", text(&labels)];
    run("localizer", &[&words[..], &["--truth", text(&truth), "--out", text(&out)]].concat()).ok();
    let said = run("localizer", &["eval", "--estimate", text(&out), "--truth", text(&truth), "--json"]).ok();
    let report: serde_json::Value = serde_json::from_str(&said).unwrap();
    let rms_m = report["rms_position_m"].as_f64().unwrap();
    assert!(rms_m < 0.15, "{rms_m} m");
    assert_eq!(report["ok_but_off"].as_u64(), Some(0), "{report}");

    // Images of another camera than the one that the calibration is of are refused.
    std::fs::write(&config, camera.replace("816.0", "1400.0")).unwrap();
    run("fixtures", &["generate", "--frames", "2", "--config", text(&config), "--out", text(&at("aside"))]).ok();
    let (aside, labels) = (at("aside"), at("aside").join("sequences/00/labels_2"));
    let words = ["motion", "--kitti", text(&aside), "--sequence", "00", "--labels", text(&labels)];
    run("localizer", &words).refused(&["1600x900", "1400"]);
    std::fs::write(&config, camera.replace("[1600, 900]", "[1600, 0]")).unwrap();
    run("fixtures", &["generate", "--config", text(&config), "--out", text(&at("none"))]).refused(&["rig.image_px"]);
}
