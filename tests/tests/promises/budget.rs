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
