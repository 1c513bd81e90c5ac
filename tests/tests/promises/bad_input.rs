//! Every bad input ends with exit code 2 and one sentence that names the file
//! and says what to do.

use std::path::{Path, PathBuf};

use common::map::{EncodeOptions, SemanticMap};

use crate::support::{CALIBRATION, Ran, build, plain, run, text};

/// `mapper build` of every scan of sequence 04.
fn build_of(root: &Path, more: &[&str]) -> Ran {
    let map = root.join("04.csm");
    let ran = build(root, "04", &map, &[&["--every", "1"], more].concat());
    assert_eq!(ran.code == 0, map.exists(), "a map is written if and only if all went well");
    ran
}

#[test]
fn the_plain_drive_itself_is_fine() {
    build_of(plain().path(), &[]).ok();
}

#[test]
fn a_missing_sequence() {
    let root = plain();
    let ran = build(root.path(), "07", &root.path().join("07.csm"), &[]);
    ran.refused(&["sequence 07 is not in", "which holds 04"]);
}

#[test]
fn a_scan_of_other_columns() {
    for (columns, said) in [(5, "five columns"), (6, "no reflectance")] {
        let root = plain();
        let path = root.path().join("sequences/04/velodyne/000000.bin");
        let point = |i: usize| [(i % 60) as f32 - 30.0, (i / 60) as f32 - 30.0, -1.73, 0.3, 7.0, 0.1];
        let bytes = (0..3600).flat_map(|i| point(i).into_iter().take(columns).flat_map(f32::to_le_bytes));
        std::fs::write(&path, bytes.collect::<Vec<u8>>()).unwrap();
        build_of(root.path(), &[]).refused(&["000000.bin", said]);
    }
}

#[test]
fn a_truncated_scan() {
    let root = plain();
    let scan = root.path().join("sequences/04/velodyne/000001.bin");
    let bytes = std::fs::read(&scan).unwrap();
    std::fs::write(&scan, &bytes[..bytes.len() - 5]).unwrap();
    build_of(root.path(), &[]).refused(&["000001.bin has 57595 bytes", "copy it again"]);
    std::fs::write(&scan, []).unwrap();
    build_of(root.path(), &[]).refused(&["000001.bin has 0 bytes", "copy it again"]);
}

#[test]
fn a_calibration_without_tr() {
    let root = plain();
    let without: Vec<&str> = CALIBRATION.lines().filter(|line| !line.starts_with("Tr")).collect();
    std::fs::write(root.path().join("sequences/04/calib.txt"), without.join("\n")).unwrap();
    build_of(root.path(), &[]).refused(&["calib.txt has no line `Tr:`", "take `calib.txt` from"]);
}

#[test]
fn a_calibration_of_other_axes() {
    let root = plain();
    let other: Vec<&str> = CALIBRATION
        .lines()
        .map(|line| if line.starts_with("Tr") { "Tr: 1 0 0 0 0 1 0 0 0 0 1 0" } else { line })
        .collect();
    std::fs::write(root.path().join("sequences/04/calib.txt"), other.join("\n")).unwrap();
    build_of(root.path(), &[]).refused(&["sequences/04/velodyne: ground lies level under", "check the calibration"]);
}

#[test]
fn no_drive_at_all() {
    run("mapper", &["build", "--out", "04.csm"]).refused(&["no drive is given", "--kitti", "--raw", "--scans"]);
}

#[test]
fn poses_of_the_wrong_length() {
    let root = plain();
    let poses = root.path().join("poses/04.txt");
    let rows = std::fs::read_to_string(&poses).unwrap();
    let short: Vec<&str> = rows.lines().take(2).collect();
    std::fs::write(&poses, short.join("\n")).unwrap();
    build_of(root.path(), &[]).refused(&["04.txt has 2 poses", "times.txt has 3 times"]);
}

#[test]
fn a_survey_that_jumps() {
    let root = plain();
    let poses = root.path().join("poses/04.txt");
    let rows = std::fs::read_to_string(&poses).unwrap();
    let mut rows: Vec<String> = rows.lines().map(str::to_owned).collect();
    let mut far: Vec<&str> = rows[1].split_whitespace().collect();
    far[3] = "600";
    rows[1] = far.join(" ");
    std::fs::write(&poses, rows.join("\n")).unwrap();
    build_of(root.path(), &[]).refused(&["04.txt: from frame 0 to frame 1", "jumps by 600.0 m", "longest_step_m"]);
    // What is not stitched does not matter.
    build_of(root.path(), &["--last", "0"]).ok();
}

#[test]
fn poses_far_from_their_origin() {
    let root = plain();
    let poses = root.path().join("poses/04.txt");
    for far in ["5e6", "1e300"] {
        let rows: Vec<String> = (0..3).map(|z| format!("1 0 0 {far} 0 1 0 0 0 0 1 {z}\n")).collect();
        std::fs::write(&poses, rows.concat()).unwrap();
        build_of(root.path(), &[]).refused(&["04.txt: frame 0 is", "from the origin of the poses", "farthest_m"]);
    }
}

#[test]
fn an_unknown_config_key() {
    let root = plain();
    let config = root.path().join("build.toml");
    std::fs::write(&config, "quantum_m = 0.02\n[poles]\nlargest_tilt_deg = 3\n").unwrap();
    let ran = build_of(root.path(), &["--config", text(&config)]);
    ran.refused(&["build.toml:3", "no setting `largest_tilt_deg`", "did you mean `largest_tilt_rad`"]);
}

#[test]
fn a_folder_that_does_not_exist() {
    let root = plain();
    let map = root.path().join("maps/04.csm");
    build(root.path(), "04", &map, &[]).refused(&["04.csm cannot be written", "create it first"]);
}

/// A good map, its bytes, and a folder for worse ones.
struct Maps(tempfile::TempDir);

impl Maps {
    fn new() -> (Self, Vec<u8>) {
        let map = SemanticMap { frame_note: "made".into(), ..SemanticMap::default() };
        (Self(tempfile::tempdir().unwrap()), map.encode(&EncodeOptions::default()).unwrap())
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("bad.csm")
    }

    /// Every command that reads a map refuses these bytes with a sentence.
    fn refused(&self, bytes: &[u8], part: &str) {
        let (path, picture) = (self.path(), self.0.path().join("bad.svg"));
        std::fs::write(&path, bytes).unwrap();
        let map = text(&path);
        for words in [
            &["inspect", map][..],
            &["size", map, "--budget", "4096"],
            &["ascii", map],
            &["draw", map, "--out", text(&picture)],
        ] {
            run("mapper", words).refused(&["bad.csm", part]);
        }
        assert!(!picture.exists());
        let folder = text(self.0.path());
        let words = ["run", "--map", map, "--kitti", folder, "--labels", folder, "--out", folder];
        run("localizer", &words).refused(&["bad.csm", part]);
    }
}

#[test]
fn a_map_with_a_flipped_byte() {
    let (maps, bytes) = Maps::new();
    // The magic, the version and the length have sentences of their own.
    for at in 8..bytes.len() {
        let mut flipped = bytes.clone();
        flipped[at] ^= 0x10;
        std::fs::write(maps.path(), &flipped).unwrap();
        run("mapper", &["ascii", text(&maps.path())]).refused(&["bad.csm", "damaged"]);
    }
    let mut flipped = bytes;
    flipped[12] ^= 1;
    maps.refused(&flipped, "damaged");
}

#[test]
fn a_truncated_map() {
    let (maps, bytes) = Maps::new();
    maps.refused(&bytes[..bytes.len() - 3], "it was cut off");
}

#[test]
fn a_map_of_a_future_version() {
    let (maps, mut bytes) = Maps::new();
    bytes[3] = 9;
    maps.refused(&bytes, "format version 9, and this program reads versions up to 5");
}

#[test]
fn what_is_no_map() {
    let (maps, _) = Maps::new();
    maps.refused(b"hello, this is text", "no Waymark map");
}

/// `/dev/full` takes nothing, as a full disk does.
#[cfg(target_os = "linux")]
#[test]
fn an_output_that_takes_nothing() {
    for (program, words) in [
        ("fixtures", "worlds"),
        ("localizer", "run --print-config"),
        ("mapper", "--help"),
        ("mapper", "build --help"),
        ("fixtures", "--version"),
    ] {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        crate::support::run_into(full, program, &words.split(' ').collect::<Vec<_>>())
            .refused(&["could not be written", "room"]);
    }
}

#[test]
fn an_output_that_is_an_input_or_another_output() {
    let root = plain();
    let (map, poses) = (root.path().join("04.csm"), root.path().join("poses/04.txt"));
    let scan = root.path().join("sequences/04/velodyne/000001.bin");
    let before = [&poses, &scan].map(|file| std::fs::read(file).unwrap());
    let around = root.path().join("poses/../04.csm");
    let report = root.path().join("04.build.json");
    for (option, path, said) in [
        ("--trajectory", &map, "04.csm: --out and --trajectory would be one file"),
        ("--cloud", &around, "04.csm: --out and --cloud would be one file"),
        ("--trajectory", &report, "the report beside the map and --trajectory would be one file"),
        ("--trajectory", &poses, "04.txt: it is read, and --trajectory would replace it"),
        ("--cloud", &scan, "000001.bin: it is read, and --cloud would replace it"),
    ] {
        build_of(root.path(), &[option, text(path)]).refused(&[said, "name"]);
    }
    assert_eq!([&poses, &scan].map(|file| std::fs::read(file).unwrap()), before);
    build_of(root.path(), &[]).ok();
    for words in [&["draw"][..], &["export", "--format", "csv"], &["reduce", "--budget", "500"]] {
        run("mapper", &[words, &[text(&map), "--out", text(&around)]].concat()).refused(&["04.csm: it is read"]);
    }
}

#[test]
fn a_report_that_cannot_be_written_leaves_no_map() {
    let root = plain();
    std::fs::create_dir(root.path().join("04.build.json")).unwrap();
    build_of(root.path(), &[]).refused(&["04.build.json"]);
}

#[test]
fn a_sequence_of_what_has_none() {
    let root = plain();
    let (folder, poses) = (root.path().join("sequences/04/velodyne"), root.path().join("poses/04.txt"));
    let map = root.path().join("a.csm");
    let words = ["build", "--scans", text(&folder), "--survey", text(&poses), "--sequence", "04", "--out", text(&map)];
    let ran = run("mapper", &words);
    for part in ["'--sequence <NN>'", "cannot be used with", "'--scans <FOLDER>'"] {
        assert!(ran.code == 2 && ran.err.contains(part), "{ran:?}");
    }
}
