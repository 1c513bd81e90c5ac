//! A map stays within its budget, and `size` says so.

use crate::support::{DEMO, run, text};

#[test]
fn the_demo_map_takes_less_than_the_paper_s_4_kb() {
    let bytes = std::fs::metadata(DEMO.file("street.csm")).unwrap().len();
    assert!(bytes <= 4096, "{bytes}");
}

#[test]
fn size_fails_a_map_over_the_budget_and_passes_one_that_just_fits() {
    let map = DEMO.file("street.csm");
    let bytes = std::fs::metadata(&map).unwrap().len();
    let size = |budget: u64| run("mapper", &["size", text(&map), "--budget", &budget.to_string()]);
    let fits = size(bytes);
    assert_eq!(fits.code, 0);
    assert!(fits.out.contains(&format!("{bytes} bytes, 0 left of {bytes}")), "{}", fits.out);
    let over = size(bytes - 1);
    assert_eq!(over.code, 1);
    assert!(over.out.contains("1 over the budget"), "{}", over.out);
}

#[test]
fn inspect_accounts_for_every_byte() {
    let map = DEMO.file("street.csm");
    let said = run("mapper", &["inspect", text(&map), "--json"]).ok();
    let json: serde_json::Value = serde_json::from_str(&said).unwrap();
    let sections = json["sections"].as_array().unwrap();
    let sum: u64 = sections.iter().map(|section| section["bytes"].as_u64().unwrap()).sum();
    assert_eq!(sum, std::fs::metadata(&map).unwrap().len());
}

/// The demo's map reduced to a share of its bytes, with the bytes allowed.
fn reduced(folder: &std::path::Path, percent: usize) -> (std::path::PathBuf, usize) {
    let map = DEMO.file("street.csm");
    let budget = std::fs::metadata(&map).unwrap().len() as usize * percent / 100;
    let small = folder.join(format!("street_{percent}.csm"));
    let said = run("mapper", &["reduce", text(&map), "--budget", &budget.to_string(), "--out", text(&small)]).ok();
    assert!(said.contains("kept ") && said.contains("expected along the roads"), "{said}");
    (small, budget)
}

#[test]
fn a_reduced_map_keeps_to_its_bytes_and_still_localizes() {
    let folder = tempfile::tempdir().unwrap();
    let (small, budget) = reduced(folder.path(), 60);
    assert!(std::fs::metadata(&small).unwrap().len() as usize <= budget);
    let (truth, out) = (DEMO.file("drive/truth/poses.txt"), folder.path().join("localized"));
    DEMO.localize(&small, &out).ok();
    let said = run("localizer", &["eval", "--estimate", text(&out), "--truth", text(&truth), "--json"]).ok();
    let json: serde_json::Value = serde_json::from_str(&said).unwrap();
    // The paper's own figure, in 60 % of the bytes.
    assert!(json["rms_position_m"].as_f64().unwrap() < 0.345, "{said}");
}

#[test]
fn a_reduced_map_has_a_report_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let (small, _) = reduced(folder.path(), 70);
    let said = run("mapper", &["inspect", text(&small), "--json"]).ok();
    let json: serde_json::Value = serde_json::from_str(&said).unwrap();
    let count = |name: &str| json["build"]["evidence"][name].as_array().map(Vec::len);
    assert_eq!(count("poles"), Some(common::map::read(&small).unwrap().poles.len()), "{said}");
}

#[test]
fn the_curve_never_promises_more_for_fewer_bytes() {
    let map = DEMO.file("street.csm");
    let said = run("mapper", &["size", text(&map), "--curve", "--json"]).ok();
    let rows: serde_json::Value = serde_json::from_str(&said).unwrap();
    let rows = rows.as_array().unwrap();
    assert_eq!(rows.len(), 5);
    let expected: Vec<f64> = rows.iter().filter_map(|row| row["map"]["predicted"]["position_rms_m"].as_f64()).collect();
    assert!(expected.len() >= 4 && expected.windows(2).all(|pair| pair[1] <= pair[0] * 1.05), "{said}");
    let table = run("mapper", &["size", text(&map), "--curve"]).ok();
    assert!(table.lines().count() == 8 && table.contains("   all"), "{table}");
}

#[test]
fn a_budget_that_nothing_fits_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (map, small) = (DEMO.file("street.csm"), folder.path().join("small.csm"));
    let ran = run("mapper", &["reduce", text(&map), "--budget", "30", "--out", text(&small)]);
    ran.refused(&["no map fits 30 bytes", "give --budget "]);
    assert!(!small.exists());
}
