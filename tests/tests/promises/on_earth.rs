//! A receiver says latitude and longitude, and a vehicle wants them back.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use common::earth::{Geodetic, OnEarth, Projection};
use nalgebra::Point3;

use crate::support::{DEMO, text};

/// Where the demo's street is, in the projection that KITTI's poses have.
const WORDS: [&str; 4] = ["--origin", "49.0337,8.3950,114,62", "--projection", "mercator"];

/// Rows of a CSV file by the names of some columns.
fn columns<const N: usize>(csv: &str, names: [&str; N]) -> Vec<[f64; N]> {
    let mut lines = csv.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = lines.next().unwrap();
    let at = names.map(|name| header.iter().position(|word| *word == name).unwrap());
    // Before the vehicle was first fast enough there is no course.
    lines.map(|words| at.map(|column| words[column].parse().unwrap_or(f64::NAN))).collect()
}

/// `localizer run` of the demo with these fixes.
fn localized(folder: &Path, name: &str, fixes: &str, more: &[&str]) -> String {
    let (gps, out) = (folder.join(format!("{name}.txt")), folder.join(name));
    std::fs::write(&gps, fixes).unwrap();
    let labels = DEMO.file("drive/sequences/00/labels_2");
    DEMO.localize_by(&labels, &DEMO.file("street.csm"), &out, &[&["--gps", text(&gps)], more].concat()).ok();
    std::fs::read_to_string(out.join("estimates.csv")).unwrap()
}

#[test]
fn fixes_in_degrees_give_the_poses_that_they_give_in_metres_and_poses_come_back_in_degrees() {
    let folder = tempfile::tempdir().unwrap();
    let log = std::fs::read_to_string(DEMO.file("drive/sequences/00/gnss.csv")).unwrap();
    let names = ["t_s", "x_map_m", "y_map_m", "z_map_m", "latitude_deg", "longitude_deg", "altitude_m", "course_deg"];
    let (mut metres, mut degrees) = (String::new(), String::new());
    let on_earth = OnEarth::new(WORDS[1].parse().unwrap(), Projection::Mercator);
    for [t, x, y, z, latitude_deg, longitude_deg, altitude_m, _] in columns(&log, names) {
        let there = on_earth.map_from_place(&Geodetic { latitude_deg, longitude_deg, altitude_m });
        // The log says both. Camera 0, whose axes the map has, does not look quite level.
        let at = Point3::new(x, y, z);
        assert!((there - at).norm() < 0.01 + 0.025 * at.coords.norm(), "{there} {at}");
        writeln!(metres, "{t} {} {} {}", there.x, there.y, there.z).unwrap();
        writeln!(degrees, "{t} {latitude_deg} {longitude_deg} {altitude_m}").unwrap();
    }
    let pose = ["frame", "x_m", "y_m", "z_m"];
    let by_metres = localized(folder.path(), "metres", &metres, &[]);
    let by_degrees = localized(folder.path(), "degrees", &degrees, &WORDS);
    let (of_metres, of_degrees) = (columns(&by_metres, pose), columns(&by_degrees, pose));
    assert!(of_metres.len() > 50 && of_metres.len() == of_degrees.len());
    let places = columns(&by_degrees, ["latitude_deg", "longitude_deg", "altitude_m", "heading_deg"]);
    for ((ours, [_, x, y, z]), [latitude_deg, longitude_deg, altitude_m, heading_deg]) in
        of_metres.iter().zip(of_degrees).zip(places)
    {
        let at = Point3::new(x, y, z);
        assert!((at - Point3::new(ours[1], ours[2], ours[3])).norm() < 5e-3, "{ours:?} {at}");
        let there = on_earth.map_from_place(&Geodetic { latitude_deg, longitude_deg, altitude_m });
        assert!((there - at).norm() < 2e-3, "{there} {at}");
        // The street goes where the map looks, but for its bend.
        assert!((heading_deg - 62.0).abs() < 10.0, "{heading_deg}");
    }
    // With the course that the receiver tells, it starts at once.
    let mut with_course = String::new();
    for [t, .., latitude_deg, longitude_deg, altitude_m, course_deg] in columns(&log, names) {
        if course_deg.is_finite() {
            writeln!(with_course, "{t} {latitude_deg} {longitude_deg} {altitude_m} {course_deg}").unwrap();
        }
    }
    let courses = columns(&localized(folder.path(), "courses", &with_course, &WORDS), pose);
    let last = [of_metres.last().unwrap(), courses.last().unwrap()].map(|[_, x, y, z]| Point3::new(*x, *y, *z));
    assert!((last[0] - last[1]).norm() < 0.3, "{last:?}");
}

#[test]
fn a_vehicle_is_answered_with_latitude_and_longitude() {
    let (map, sequence) = (DEMO.file("street.csm"), DEMO.file("drive/sequences/00"));
    let (calibration, labels) = (sequence.join("calib.txt"), sequence.join("labels_2"));
    let words = ["live", "--map", text(&map), "--calib", text(&calibration), "--labels", text(&labels)];
    let mut command = Command::new(env!("CARGO_BIN_EXE_tool"));
    command.arg("localizer").args(words).args(WORDS).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut vehicle = command.spawn().unwrap();
    let mut says = vehicle.stdin.take().unwrap();
    writeln!(says, "gps 0 49.0337 8.3950 114 62\nimage 0 0\nimage 0.1 1").unwrap();
    drop(says);
    let answers = String::from_utf8(vehicle.wait_with_output().unwrap().stdout).unwrap();
    let places = columns(&answers, ["latitude_deg", "longitude_deg", "heading_deg"]);
    let [latitude_deg, longitude_deg, heading_deg] = places[1];
    assert!((latitude_deg - 49.0337).abs() < 5e-5 && (longitude_deg - 8.3950).abs() < 5e-5, "{answers}");
    assert!((heading_deg - 62.0).abs() < 5.0, "{answers}");
}

#[test]
fn what_is_no_place_on_the_earth_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let (gps, out) = (folder.path().join("gps.txt"), folder.path().join("out"));
    let (map, labels) = (DEMO.file("street.csm"), DEMO.file("drive/sequences/00/labels_2"));
    let refused = |rows: &str, origin: &str, parts: &[&str]| {
        std::fs::write(&gps, rows).unwrap();
        DEMO.localize_by(&labels, &map, &out, &["--gps", text(&gps), "--origin", origin]).refused(parts);
        assert!(!out.exists());
    };
    // In the other order; in metres; an origin that is none.
    refused("0 49 8 100\n1 8 49 100\n", "49,8,100", &["gps.txt line 2 is no place", "t latitude longitude altitude"]);
    refused("0 1.5 0.2\n", "49,8,100", &["gps.txt line 1 is no place"]);
    refused("0 49 8 100\n", "49,8", &["--origin 49,8", "it has 2 numbers"]);
}
