//! Settings are printed as they are read, and what a build did can be read by
//! a program.

use std::process::{Command, Stdio};

use common::config::{Limits, load_within, to_toml};
use common::kitti::{ScanPoint, write_scan};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::support::{build, plain, run, run_path, text};

#[test]
fn printed_settings_can_be_given_back() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("all.toml");
    let tool = env!("CARGO_BIN_EXE_tool");
    let programs: [(&str, &[&str]); 16] = [
        (tool, &["mapper", "build"]),
        (tool, &["mapper", "merge"]),
        (tool, &["mapper", "validate"]),
        (tool, &["mapper", "diff"]),
        (tool, &["mapper", "reduce"]),
        (tool, &["mapper", "size", "--curve"]),
        (tool, &["localizer", "run"]),
        (tool, &["localizer", "trial"]),
        (tool, &["localizer", "motion"]),
        (tool, &["fixtures", "generate"]),
        (env!("CARGO_BIN_EXE_ablation"), &[]),
        (env!("CARGO_BIN_EXE_budget-curve"), &[]),
        (env!("CARGO_BIN_EXE_drives"), &[]),
        (env!("CARGO_BIN_EXE_faults"), &[]),
        (env!("CARGO_BIN_EXE_score-turned"), &[]),
        (env!("CARGO_BIN_EXE_weather"), &[]),
    ];
    for (program, words) in programs {
        let printed = run_path(program, &[words, &["--print-config"]].concat()).ok();
        std::fs::write(&file, &printed).unwrap();
        let again = run_path(program, &[words, &["--print-config", "--config", text(&file)]].concat()).ok();
        assert!(printed.lines().count() > 5 && printed == again, "{program} {words:?}: {printed}");
    }
}

#[test]
fn a_reader_that_is_gone_is_no_fault() {
    let programs: [&[&str]; 3] =
        [&["mapper", "build", "--print-config"], &["localizer", "run", "--print-config"], &["fixtures", "worlds"]];
    for words in programs {
        let mut program = Command::new(env!("CARGO_BIN_EXE_tool"));
        let mut running = program.args(words).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(running.stdout.take());
        let ended = running.wait_with_output().unwrap();
        assert!(ended.status.success() && ended.stderr.is_empty(), "{words:?}: {ended:?}");
    }
}

/// The defaults are within their limits, and every limit is of a setting.
fn hold<T: Serialize + DeserializeOwned + Default + PartialEq + std::fmt::Debug>(limits: &[Limits]) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("all.toml");
    std::fs::write(&file, to_toml(&T::default()).unwrap()).unwrap();
    assert_eq!(load_within::<T>(&file, limits).unwrap(), T::default());
    for wanted in limits {
        // Nothing is within a limit that ends below where it begins.
        let none = [Limits { least: 1.0, most: 0.0, ..*wanted }];
        assert!(load_within::<T>(&file, &none).is_err(), "{}", wanted.key);
    }
}

/// Every number has limits that a trillion below zero is beyond, and there are more
/// than `fewest`.
fn limit_all<T: Serialize + DeserializeOwned + Default>(limits: &[Limits], fewest: usize) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("one.toml");
    let all = to_toml(&T::default()).unwrap();
    let (mut table, mut tried) = ("", 0);
    for line in all.lines() {
        if line.starts_with('[') {
            table = line;
        } else if let Some((key, value)) = line.split_once(" = ")
            && value.parse::<f64>().is_ok()
        {
            // Whole numbers would be refused for a fraction.
            let far = if value.contains(['.', 'e']) { "-1e12" } else { "-1000000000000" };
            std::fs::write(&file, format!("{table}\n{key} = {far}\n")).unwrap();
            assert!(load_within::<T>(&file, limits).is_err(), "{table} {key} may be {far}");
            tried += 1;
        }
    }
    assert!(tried > fewest, "{tried} settings");
}

#[test]
fn limits_are_of_settings_and_hold_their_defaults() {
    hold::<mapper::Config>(mapper::config::LIMITS);
    hold::<mapper::validate::ValidateConfig>(mapper::validate::LIMITS);
    hold::<mapper::merge::MergeConfig>(mapper::merge::LIMITS);
    hold::<mapper::diff::DiffConfig>(mapper::diff::LIMITS);
    hold::<localizer::config::Config>(localizer::config::LIMITS);
}

#[test]
fn every_number_has_limits() {
    limit_all::<mapper::Config>(mapper::config::LIMITS, 300);
    limit_all::<mapper::merge::MergeConfig>(mapper::merge::LIMITS, 30);
    limit_all::<mapper::diff::DiffConfig>(mapper::diff::LIMITS, 8);
    limit_all::<localizer::config::Config>(localizer::config::LIMITS, 250);
}

#[test]
fn settings_of_a_merge_or_a_comparison_by_which_nothing_can_be_divided_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bad.toml");
    for (command, settings, said) in [
        ("merge", "[roads]\nstep_m = 0.0\n", "`roads.step_m` is 0 and has to be from 0.1"),
        ("merge", "[align]\nnode_m = 0.0\n", "`align.node_m` is 0"),
        ("merge", "[align]\nlandmark_sigma_m = 0.0\n", "`align.landmark_sigma_m` is 0"),
        ("merge", "[fuse]\nlane_step_m = 0.0\n", "`fuse.lane_step_m` is 0"),
        ("diff", "[roads]\nstep_m = 0.0\n", "`roads.step_m` is 0"),
        ("diff", "same_m = -1.0\n", "`same_m` is -1"),
    ] {
        std::fs::write(&file, settings).unwrap();
        run("mapper", &[command, "--print-config", "--config", text(&file)]).refused(&["bad.toml:", said]);
    }
}

#[test]
fn a_drive_by_a_settings_file_and_settings_that_make_no_drive() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("drive.toml"), folder.path().join("drive"));
    let generate = |settings: &str, more: &[&str]| {
        std::fs::write(&file, settings).unwrap();
        let words = ["generate", "--config", text(&file), "--out", text(&out)];
        run("fixtures", &[&words[..], more].concat())
    };
    generate("scan_every = 2\n[world]\nname = \"sparse\"\nframes = 3\n", &["--seed", "9"]).ok();
    let manifest: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("manifest.json")).unwrap()).unwrap();
    let options = &manifest["options"];
    assert_eq!((&options["world"]["name"], &options["world"]["seed"]), (&"sparse".into(), &9.into()));
    assert_eq!((&options["world"]["frames"], &options["scan_every"]), (&3.into(), &2.into()));
    generate("[lidar]\nmax_rang_m = 3\n", &[]).refused(&["drive.toml:2", "did you mean `max_range_m`"]);
    generate("[labels]\nmax_range_m = -1.0\n", &[]).refused(&["labels.max_range_m is -1"]);
    generate("[lidar]\ndropout = nan\n", &[]).refused(&["drive.toml:2", "`lidar.dropout` is NaN", "no finite number"]);
    generate("[logs.gnss]\nrate_hz = 0.0\n", &[]).refused(&["gnss.rate_hz is 0"]);
}

#[test]
fn points_that_are_no_numbers_are_dropped_and_counted() {
    let root = plain();
    let scan = root.path().join("sequences/04/velodyne/000001.bin");
    let point = |x_m: f32| ScanPoint { x_m, y_m: 3.0, z_m: -1.7, reflectance: 0.5 };
    write_scan(&scan, &[point(5.0), point(f32::NAN), point(f32::INFINITY), point(9000.0), ScanPoint::default()])
        .unwrap();
    let said = build(root.path(), "04", &root.path().join("04.csm"), &["--every", "1", "--json"]).ok();
    let json: serde_json::Value = serde_json::from_str(&said).unwrap();
    let scans = &json["report"]["scans"];
    let count = |name: &str| scans[name].as_u64().unwrap();
    assert_eq!((count("scans"), count("first_frame"), count("last_frame")), (2, 0, 1));
    assert_eq!((count("points"), count("dropped_not_finite"), count("dropped_out_of_range")), (3601, 2, 2));
    assert!(json["usage"]["wall_s"].as_f64().unwrap() > json["usage"]["read_s"].as_f64().unwrap());
}

#[test]
fn what_people_are_told_stands_in_the_json_too() {
    let root = plain();
    let (map, scan) = (root.path().join("04.csm"), root.path().join("sequences/04/velodyne/000001.bin"));
    let point = ScanPoint { x_m: f32::NAN, y_m: 3.0, z_m: -1.7, reflectance: 0.5 };
    write_scan(&scan, &[point; 3]).unwrap();
    let note = "the scan of frame 1 has no point with finite coordinates within reach";
    assert!(build(root.path(), "04", &map, &["--every", "1"]).ok().contains(note));
    let json = |said: String| serde_json::from_str::<serde_json::Value>(&said).unwrap();
    let built = json(build(root.path(), "04", &map, &["--every", "1", "--json"]).ok());
    assert_eq!(built["notes"], serde_json::json!([note]));

    // The report of one map beside another.
    let other = root.path().join("other.csm");
    build(root.path(), "04", &other, &["--last", "0"]).ok();
    let reduce = |more: &[&str]| {
        let small = root.path().join("small.csm");
        run("mapper", &[&["reduce", text(&map), "--budget", "4000", "--out", text(&small)], more].concat()).ok()
    };
    assert_eq!(json(reduce(&["--json"]))["notes"], serde_json::json!([]));
    std::fs::copy(root.path().join("other.build.json"), root.path().join("04.build.json")).unwrap();
    let foreign = "04.build.json is the report of another map";
    assert!(reduce(&[]).contains(foreign));
    assert_eq!(json(reduce(&["--json"]))["notes"].as_array().unwrap().len(), 1);
    // So do all that read it.
    let area = root.path().join("area.csm");
    let merge = ["merge", text(&map), text(&other), "--out", text(&area)];
    for words in [&["inspect", text(&map)][..], &["size", text(&map), "--curve"], &merge] {
        assert!(run("mapper", words).ok().contains(foreign), "{words:?}");
    }
    let merged = json(run("mapper", &[&merge[..], &["--json"]].concat()).ok());
    assert_eq!(merged["notes"].as_array().unwrap().len(), 1);
    let curve = run("mapper", &["size", text(&map), "--curve", "--json"]);
    assert!(curve.err.starts_with("note: ") && curve.err.contains(foreign));
    assert!(json(curve.ok()).is_array());
}
