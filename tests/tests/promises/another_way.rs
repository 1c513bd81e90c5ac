//! A map of one drive serves those who come towards it, and surveys of both ways make one.

use std::path::Path;

use common::kitti::read_poses;
use waymark_tests::map_score::score;

use crate::support::{DEMO, FRAMES, build, localized, run, text};

#[test]
fn who_comes_towards_the_survey_finds_itself_in_its_map_and_both_ways_make_one_map() {
    let root = tempfile::tempdir().unwrap();
    let at = |name: &str| root.path().join(name);
    let (drive, frames) = (at("back"), FRAMES.to_string());
    let words = ["generate", "--back", "--frames", &frames, "--scan-every", "5", "--out", text(&drive)];
    run("fixtures", &words).ok();
    let check = |map: &Path, drive: &Path| {
        let report = localized(map, drive, &drive.join("truth/poses.txt"), &at("out"));
        let rms_m = report["rms_position_m"].as_f64().unwrap();
        assert!(rms_m < 0.2, "{} along {}: {rms_m} m", map.display(), drive.display());
        assert_eq!(report["ok_but_off"].as_u64(), Some(0), "{report}");
    };
    let there = DEMO.file("street.csm");
    check(&there, &drive);

    let (back, both) = (at("back.csm"), at("both.csm"));
    build(&drive, "00", &back, &[]).ok();
    run("mapper", &["merge", text(&there), text(&back), "--out", text(&both)]).ok();
    check(&both, &drive);
    check(&both, &DEMO.file("drive"));
    // No post, line or road twice.
    let truth = waymark_tests::truth::read(&DEMO.file("drive")).unwrap();
    let exact = read_poses(DEMO.file("drive/truth/poses.txt")).unwrap();
    let [of_one, of_both] = [&there, &both].map(|map| {
        let map = common::map::read(map).unwrap();
        (map.roads.len(), score(&map, &truth, &exact, 20.0))
    });
    let ((roads, one), (merged_roads, both)) = (of_one, of_both);
    assert!(both.poles.recall() >= one.poles.recall() && both.poles.precision() >= 0.9, "{:?}", both.poles);
    assert!(both.lanes.recall() >= one.lanes.recall() - 0.02 && both.lanes.precision() >= 0.9, "{:?}", both.lanes);
    assert!(merged_roads <= roads, "{merged_roads} roads of {roads}");
}
