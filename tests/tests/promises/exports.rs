//! A map in the formats of other programs, from the command line.

use crate::support::{DEMO, run, text};

#[test]
fn a_landmark_has_one_number_in_all_formats() {
    let folder = tempfile::tempdir().unwrap();
    let map = DEMO.file("street.csm");
    let landmarks = run("mapper", &["ascii", text(&map)]).ok().lines().count();
    let export = |name: &str, more: &[&str]| {
        let path = folder.path().join(name);
        run("mapper", &[&["export", text(&map), "--out", text(&path)], more].concat()).ok();
        std::fs::read_to_string(path).unwrap()
    };
    let json: serde_json::Value = serde_json::from_str(&export("map.geojson", &[])).unwrap();
    let features = json["features"].as_array().unwrap();
    assert_eq!(features.iter().filter(|f| f.get("id").is_some()).count(), landmarks);
    assert!(features.iter().all(|f| f.get("id") == f["properties"].get("id")));
    let osm = export("map.osm", &["--origin", "-33.9,151.2,30,45"]);
    assert_eq!(osm.matches("<way id=").count(), landmarks);
    assert!(osm.contains("lat=\"-33.9"));
    let csv = export("rows", &["--format", "csv"]);
    let last = csv.lines().last().unwrap().split(',').next().unwrap().parse::<usize>().unwrap();
    assert_eq!(last, landmarks);
    assert_eq!(export("map.txt", &[]), run("mapper", &["ascii", text(&map)]).ok());
}

#[test]
fn what_cannot_be_exported_is_told_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let map = DEMO.file("street.csm");
    let refused = |name: &str, more: &[&str], parts: &[&str]| {
        let path = folder.path().join(name);
        run("mapper", &[&["export", text(&map), "--out", text(&path)], more].concat()).refused(parts);
        assert!(!path.exists());
    };
    refused("map.shp", &[], &["map.shp", "the extension says no format", "--format"]);
    refused("map.osm", &["--origin", "49,8"], &["--origin 49,8", "it has 2 numbers", "LAT,LON,ALT"]);
    refused("map.osm", &["--origin", "-91,8,0"], &["latitude must be within"]);
    refused("map.txt", &["--origin", "49,8,0"], &["the map's own coordinates only"]);
    refused("map.csv", &["--crs", "EPSG:25832"], &["street.csm", "its first camera", "--origin"]);
    refused("map.txt", &["--coordinates", "survey"], &["the map's own coordinates only"]);
    let both =
        run("mapper", &["export", text(&map), "--out", "m.csv", "--coordinates", "survey", "--origin", "49,8,0"]);
    assert!(both.code == 2 && both.err.contains("cannot be used with"), "{both:?}");
    let alone = run("mapper", &["export", text(&map), "--out", "map.osm", "--projection", "mercator"]);
    assert!(alone.code == 2 && alone.err.contains("--origin <LAT,LON,ALT"), "{alone:?}");
}
