//! A camera finds itself in the demo's map.

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
