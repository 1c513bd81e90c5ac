//! A map stays in its survey's world: exports, clouds and merged maps can be laid over what the
//! survey was made in.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use common::geometry::Pose;
use common::kitti::{read_poses, write_poses};

use crate::support::{DEMO, run, text};

/// Maps of the demo's street by a survey of the lidar in UTM, x east, which is forward here: one
/// reduced as `build` does it, with its cloud, and one reduced in another way.
static UTM: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("utm");
    std::fs::create_dir_all(&folder).unwrap();
    let truth = read_poses(DEMO.file("drive/truth/poses.txt")).unwrap();
    let east = |pose: &Pose| {
        let v = pose.translation.vector;
        Pose::translation(450_123.0 + v.z, 5_420_456.0 - v.x, 114.0 - v.y)
    };
    let survey = folder.join("utm.txt");
    write_poses(&survey, &truth.iter().map(east).collect::<Vec<_>>()).unwrap();
    let scans = DEMO.file("drive/sequences/00/velodyne");
    let cloud = folder.join("a.laz");
    for (name, more) in [
        ("a.csm", &["--cloud", text(&cloud), "--coordinates", "survey"][..]),
        ("other.csm", &["--reduce", "440000,5420000,0"]),
    ] {
        let out = folder.join(name);
        let words = ["build", "--scans", text(&scans), "--survey", text(&survey), "--out", text(&out), "--last", "20"];
        run("mapper", &[&words[..], more].concat()).ok();
    }
    folder
});

/// The rows of a map exported as CSV: number, kind, and three coordinates.
fn rows(map: &Path, more: &[&str]) -> Vec<(u32, String, [f64; 3])> {
    let out = map.with_extension("csv");
    run("mapper", &[&["export", text(map), "--out", text(&out)], more].concat()).ok();
    let csv = std::fs::read_to_string(out).unwrap();
    let row = |line: &str| {
        let words: Vec<&str> = line.split(',').collect();
        let number = |word: usize| words[word].parse::<f64>().unwrap();
        (number(0) as u32, words[1].to_owned(), [number(4), number(5), number(6)])
    };
    csv.lines().skip(1).map(row).collect()
}

#[test]
fn what_places_a_map_in_the_world_is_kept_and_told() {
    let map = UTM.join("a.csm");
    let report: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(UTM.join("a.build.json")).unwrap()).unwrap();
    assert_eq!(report["frame"]["world"], "z-up");
    assert_eq!(report["frame"]["reduced_by_m"], serde_json::json!([450_000.0, 5_420_000.0, 0.0]));
    let folder = tempfile::tempdir().unwrap();
    let note = |map: &Path| {
        let out = folder.path().join("a.geojson");
        run("mapper", &["export", text(map), "--out", text(&out)]).ok();
        let json: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(out).unwrap()).unwrap();
        json["frame"].as_str().unwrap().to_owned()
    };
    assert!(note(&map).contains("make them (5420000 - Y, X - 450000, Z)"), "{}", note(&map));
    assert!(note(&DEMO.file("street.csm")).contains("of camera 0 at the first frame of the survey"));
    let alone = folder.path().join("alone.csm");
    std::fs::copy(&map, &alone).unwrap();
    assert!(note(&alone).ends_with("of the map's own frame"), "{}", note(&alone));
    let out = folder.path().join("alone.csv");
    let words = ["export", text(&alone), "--out", text(&out), "--coordinates", "survey"];
    run("mapper", &words).refused(&["alone.csm", "nothing beside it says", "alone.build.json"]);
}

#[test]
fn a_map_and_its_cloud_lie_on_each_other_in_the_coordinates_of_the_survey() {
    let map = UTM.join("a.csm");
    let (local, survey) = (rows(&map, &[]), rows(&map, &["--coordinates", "survey"]));
    assert!(!local.is_empty() && local.len() == survey.len());
    for ((_, _, [right, forward, up]), (_, _, [east, north, height])) in local.iter().zip(&survey) {
        let off = [450_000.0 + forward - east, 5_420_000.0 - right - north, up - height];
        assert!(off.iter().all(|off_m| off_m.abs() < 2e-3), "{off:?}");
    }
    let mut reader = las::Reader::from_path(UTM.join("a.laz")).unwrap();
    let points: Vec<las::Point> = reader.read_all().unwrap().points().map(|point| point.unwrap()).collect();
    let mut on_poles = 0;
    for point in &points {
        let id = u32::from_le_bytes(point.extra_bytes[..].try_into().unwrap());
        // A pole has two rows, its foot and its top.
        let ends: Vec<_> = survey.iter().filter(|(row, kind, _)| *row == id && !kind.contains("line")).collect();
        let [(_, _, foot), (_, _, top)] = &ends[..] else { continue };
        let off = |end: &[f64; 3]| (end[0] - point.x).hypot(end[1] - point.y);
        assert!(off(foot).min(off(top)) < 0.5 + off_m(foot, top), "{foot:?} {} {}", point.x, point.y);
        assert!((foot[2] - 0.5..top[2] + 0.5).contains(&point.z), "{foot:?} {top:?} {}", point.z);
        on_poles += 1;
    }
    assert!(on_poles > 20, "{on_poles}");
}

/// How far a pole's ends are apart, seen from above, metres.
fn off_m(foot: &[f64; 3], top: &[f64; 3]) -> f64 {
    (foot[0] - top[0]).hypot(foot[1] - top[1])
}

#[test]
fn a_merged_map_is_still_in_the_survey_s_world() {
    let (map, area) = (UTM.join("a.csm"), UTM.join("area.csm"));
    run("mapper", &["merge", text(&map), "--out", text(&area)]).ok();
    let survey = &["--coordinates", "survey"];
    assert_eq!(rows(&area, survey), rows(&map, survey));
}

#[test]
fn maps_that_were_reduced_in_two_ways_are_not_taken_for_neighbours() {
    let folder = tempfile::tempdir().unwrap();
    let (first, other) = (UTM.join("a.csm"), UTM.join("other.csm"));
    for (command, out) in [("merge", Some("area.csm")), ("atlas", Some("area.csa")), ("diff", None)] {
        let out = out.map(|name| folder.path().join(name));
        let out: Vec<&str> = out.iter().flat_map(|path| ["--out", text(path)]).collect();
        run("mapper", &[&[command, text(&first), text(&other)][..], &out].concat()).refused(&[
            "reduced by (450000, 5420000, 0) m",
            "reduced by (440000, 5420000, 0) m",
            "the same --reduce",
        ]);
    }
    assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none());
}
