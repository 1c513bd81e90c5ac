//! Maps in one atlas localize as they do alone, and a faulty atlas is told.

use std::path::Path;

use crate::support::{DEMO, run, text};

#[test]
fn a_drive_in_an_atlas_gives_the_poses_of_its_map() {
    let folder = tempfile::tempdir().unwrap();
    let (map, atlas) = (DEMO.file("street.csm"), folder.path().join("street.csa"));
    run("mapper", &["atlas", text(&map), "--tile-bytes", "300", "--out", text(&atlas)]).ok();
    let said = DEMO.localize(&atlas, folder.path()).ok();
    assert!(said.contains("tiles of the atlas read"), "{said}");
    let poses = |folder: &Path| std::fs::read(folder.join("poses.txt")).unwrap();
    assert_eq!(poses(folder.path()), poses(&DEMO.file("localized")));

    let looked = run("mapper", &["inspect", text(&atlas), "--json"]).ok();
    let json: serde_json::Value = serde_json::from_str(&looked).unwrap();
    let bytes = std::fs::metadata(&atlas).unwrap().len();
    assert_eq!(json["bytes"].as_u64(), Some(bytes));
    assert_eq!(run("mapper", &["size", text(&atlas), "--budget", &(bytes - 1).to_string()]).code, 1);
}

#[test]
fn a_faulty_atlas_is_told_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let (map, atlas) = (DEMO.file("street.csm"), folder.path().join("street.csa"));
    let make = ["atlas", text(&map), "--tile-bytes", "300", "--out", text(&atlas)];
    run("mapper", &make).ok();
    run("mapper", &["ascii", text(&atlas)]).refused(&["street.csa", "give a .csm file"]);
    let good = std::fs::read(&atlas).unwrap();
    let with = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = good.clone();
        change(&mut bytes);
        std::fs::write(&atlas, bytes).unwrap();
        DEMO.localize(&atlas, folder.path())
    };
    with(&|bytes| bytes[200] ^= 1).refused(&["street.csa", "damaged", "tile at byte 146", "copy it again"]);
    let cut = good.len() - 10;
    let length = format!("has {cut}");
    with(&|bytes| bytes.truncate(cut)).refused(&["street.csa", length.as_str(), "cut off"]);
    with(&|bytes| bytes[3] = 9).refused(&["street.csa", "version 9", "reads version 1"]);
    run("mapper", &["atlas", text(&map), text(&map), "--out", text(&atlas)]).refused(&["the same map"]);
}
