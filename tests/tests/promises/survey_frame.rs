//! A map stays in its survey's world: exports, clouds and merged maps can be laid over what the
//! survey was made in.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use common::earth::Grid;
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

/// Degrees north and east of a place in the survey's grid.
fn degrees(east_m: f64, north_m: f64) -> [f64; 2] {
    "EPSG:25832".parse::<Grid>().unwrap().degrees([east_m, north_m])
}

#[test]
fn a_map_of_a_grid_is_exported_in_degrees() {
    let map = UTM.join("a.csm");
    let (survey, earth) = (rows(&map, &["--coordinates", "survey"]), rows(&map, &["--crs", "EPSG:25832"]));
    assert!(survey.len() == earth.len() && !survey.is_empty());
    for ((_, _, [east_m, north_m, height_m]), (_, _, [longitude, latitude, altitude_m])) in survey.iter().zip(&earth) {
        let [north_deg, east_deg] = degrees(*east_m, *north_m);
        assert!((north_deg - latitude).abs() < 2e-8 && (east_deg - longitude).abs() < 2e-8, "{latitude} {longitude}");
        assert!((height_m - altitude_m).abs() < 2e-3);
    }
    let out = UTM.join("none.csv");
    for (crs, parts) in [("EPSG:4326", ["EPSG:4326", "no grid of metres"]), ("UTM32", ["--crs UTM32", "an EPSG code"])]
    {
        run("mapper", &["export", text(&map), "--out", text(&out), "--crs", crs]).refused(&parts);
    }
    assert!(!out.exists());
}

#[test]
fn a_camera_with_a_receiver_finds_itself_in_a_map_of_a_grid() {
    let folder = tempfile::tempdir().unwrap();
    let (gps, out) = (folder.path().join("gps.txt"), folder.path().join("out"));
    let survey = read_poses(UTM.join("utm.txt")).unwrap();
    let fixes: Vec<String> = (0..2)
        .map(|frame: usize| {
            let at = survey[frame].translation.vector;
            let [latitude, longitude] = degrees(at.x + 1.0, at.y - 0.8);
            format!("{} {latitude} {longitude} {}\n", 0.1 * frame as f64, at.z)
        })
        .collect();
    std::fs::write(&gps, fixes.concat()).unwrap();
    let (map, labels) = (UTM.join("a.csm"), DEMO.file("drive/sequences/00/labels_2"));
    let given = ["--gps", text(&gps), "--crs", "EPSG:25832", "--reduced", "450000,5420000,0", "--last", "15"];
    DEMO.localize_by(&labels, &map, &out, &given).ok();
    let estimates = std::fs::read_to_string(out.join("estimates.csv")).unwrap();
    let last: Vec<f64> = estimates.lines().last().unwrap().rsplit(',').take(4).map(|w| w.parse().unwrap()).collect();
    let [heading_deg, height_m, longitude, latitude] = last[..] else { unreachable!() };
    // The survey's poses are those of a camera here that looks east, but for the calibration.
    let at = survey[15].translation.vector;
    let [north_deg, east_deg] = degrees(at.x, at.y);
    let off_m = ((latitude - north_deg) * 111_200.0).hypot((longitude - east_deg) * 73_000.0);
    assert!(off_m < 1.0 && (height_m - at.z).abs() < 1.0 && (heading_deg - 90.0).abs() < 5.0, "{off_m} {last:?} {at}");
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
