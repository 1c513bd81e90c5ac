//! Figures of nothing are no figures, and a map of nothing is no map: a drive in which
//! nothing is seen or localized gets a sentence.

use std::path::Path;

use common::kitti::{ScanPoint, write_scan};
use common::map::{EncodeOptions, SemanticMap};

use crate::support::{build, plain, run, run_path, text, write_png};

const FAULTS: &str = env!("CARGO_BIN_EXE_faults");
const ABLATION: &str = env!("CARGO_BIN_EXE_ablation");
const BUDGET_CURVE: &str = env!("CARGO_BIN_EXE_budget-curve");
const FIGURES: &str = env!("CARGO_BIN_EXE_figures");
const WEATHER: &str = env!("CARGO_BIN_EXE_weather");

/// The words for the plain drive with black label images in an empty map.
fn black(root: &Path) -> Vec<String> {
    let (labels, map) = (root.join("labels"), root.join("empty.csm"));
    for frame in 0..3 {
        write_png(&labels.join(format!("pole/{frame:06}.png")), (1226, 370), png::ColorType::Grayscale);
    }
    common::map::write(&map, &SemanticMap::default(), &EncodeOptions::default()).unwrap();
    let truth = root.join("poses/04.txt");
    let words = ["--map", text(&map), "--kitti", text(root), "--sequence", "04", "--labels", text(&labels)];
    [&words[..], &["--truth", text(&truth)]].concat().into_iter().map(str::to_owned).collect()
}

#[test]
fn a_drive_in_which_nothing_is_localized_has_no_figures() {
    let root = plain();
    let drive = black(root.path());
    let drive: Vec<&str> = drive.iter().map(String::as_str).collect();
    let said = "no frame was localized: from the first position on";
    run("localizer", &[&["trial", "--draws", "1"], &drive[..]].concat()).refused(&[said]);
    run_path(FAULTS, &[&drive[..], &["--only", "black"]].concat()).refused(&["fault `black`: ", said]);
    run_path(ABLATION, &[&drive[..], &["--only", "bank"]].concat()).refused(&["without `bank`: ", said]);
    // What nothing is found in is a row, too, and those after it are not lost.
    let faults = run_path(FAULTS, &[&drive[..], &["--only", "black,none"]].concat());
    faults.refused(&["fault `black`, `none`: ", said]);
    let ablation = run_path(ABLATION, &[&drive[..], &["--only", "bank,none"]].concat());
    ablation.refused(&["without `bank`, `none`: ", said]);
    for (table, rows) in [(&faults.out, ["black", "none"]), (&ablation.out, ["bank", "none"])] {
        let last: Vec<&str> = table.lines().skip(2).collect();
        assert_eq!(last.len(), 2, "{table}");
        assert!(last.iter().zip(rows).all(|(line, row)| line.starts_with(row) && line.contains(" - ")), "{table}");
    }
    let rows = run_path(FAULTS, &[&drive[..], &["--only", "black,none", "--json"]].concat());
    let rows: serde_json::Value = serde_json::from_str(&rows.out).unwrap();
    assert!(rows[1]["why_none"].as_str().unwrap().starts_with(said) && rows[1].get("rms_m").is_none(), "{rows}");
    // They do not show what the images would in fog.
    run_path(WEATHER, &drive).refused(&["give `--pole-net` and `--lane-net`, no `--labels`"]);
    let out = root.path().join("figures");
    run_path(FIGURES, &[&drive[..], &["--out", text(&out)]].concat()).refused(&[said]);
    assert!(!out.exists());
    let measured = run_path(BUDGET_CURVE, &[&drive[..], &["--at", "4096", "--starts", "1"]].concat()).ok();
    assert_eq!(measured.matches("| no frame was localized").count(), 2, "{measured}");
    let least = run_path(BUDGET_CURVE, &[&drive[..], &["--at", "1", "--starts", "1"]].concat()).ok();
    assert!(least.contains("     1 no map fits: 0 road stretches") && !least.contains("--budget"), "{least}");
}

#[test]
fn a_drive_of_blind_scans() {
    let root = plain();
    let folder = root.path().join("sequences/04/velodyne");
    let scans: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    let high = |i: u16| ScanPoint { x_m: 10.0 + 0.01 * f32::from(i), y_m: 0.0, z_m: 8.0, reflectance: 0.5 };
    let all_high: Vec<ScanPoint> = (0..1000).map(high).collect();
    for (points, said) in [
        (
            &[ScanPoint { x_m: f32::NAN, ..ScanPoint::default() }; 9][..],
            "no scan has a point with finite coordinates within reach",
        ),
        (&all_high, "no scan shows anything of it, so they hold no returns of the ground"),
    ] {
        for scan in &scans {
            write_scan(scan, points).unwrap();
        }
        build(root.path(), "04", &root.path().join("04.csm"), &["--every", "1"])
            .refused(&["sequences/04/velodyne: ", said]);
    }
}

#[test]
fn who_asks_for_all_settings_need_not_say_where_figures_go() {
    assert!(run_path(FIGURES, &["--print-config"]).ok().contains("[vision.poles]"));
    let missing = run_path(FIGURES, &["--map", "a.csm"]);
    assert!(missing.code == 2 && missing.err.contains("--out"), "{missing:?}");
    let root = plain();
    let file = root.path().join("poses/04.txt");
    run_path(FIGURES, &["--map", "a.csm", "--out", text(&file)]).refused(&["04.txt is a file; give another folder"]);
}

#[test]
fn no_start_at_all_is_no_number_of_them() {
    for (option, ran) in [
        ("--draws", run("localizer", &["trial", "--draws", "0"])),
        ("--starts", run_path(BUDGET_CURVE, &["--map", "a.csm", "--kitti", ".", "--starts", "0"])),
    ] {
        assert!(ran.code == 2 && ran.out.is_empty() && ran.err.contains(option), "{ran:?}");
    }
}
