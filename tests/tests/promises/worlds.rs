//! Every world can be driven through, mapped and looked at, and wrong words
//! are refused.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use common::kitti::Sequence;

use crate::support::{build, run, text};

/// Worlds that need nothing but their name.
fn names() -> Vec<String> {
    let listed = run("fixtures", &["worlds"]).ok();
    let names = listed.lines().filter_map(|line| line.split_whitespace().next());
    names.filter(|name| *name != "from-survey").map(ToOwned::to_owned).collect()
}

fn generate(world: &str, out: &Path, more: &[&str]) -> String {
    let words = ["generate", "--world", world, "--out", text(out), "--frames", "6"];
    run("fixtures", &[&words[..], more].concat()).ok()
}

#[test]
fn the_worlds_of_the_readme_are_all_there() {
    let names = names();
    for name in ["street", "curves", "loop", "city", "square", "sparse", "aged"] {
        assert!(names.iter().any(|known| known == name), "{name} is not in {names:?}");
    }
}

#[test]
fn every_world_reads_as_a_kitti_sequence_and_can_be_mapped() {
    for name in names() {
        let folder = tempfile::tempdir().unwrap();
        let drive = folder.path().join("drive");
        generate(&name, &drive, &[]);
        let sequence = Sequence::open(&drive, "00").unwrap();
        assert_eq!(sequence.scan_frames().unwrap(), [0, 5], "{name}");
        assert_eq!(sequence.poses().unwrap().len(), 6, "{name}");
        for class in ["pole", "sign", "light", "lane", "vegetation"] {
            assert!(sequence.folder().join(format!("labels_2/{class}/000005.png")).is_file(), "{name}: {class}");
        }
        let map = folder.path().join("map.csm");
        build(&drive, "00", &map, &[]).ok();
        let read = common::map::read(&map).unwrap();
        assert!(read.poles.len() + read.lanes.len() > 0, "{name}: an empty map");
    }
}

/// All files below a folder.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = std::fs::read(&path).unwrap();
                found.insert(path.strip_prefix(folder).unwrap().to_path_buf(), bytes);
            }
        }
    }
    found
}

#[test]
fn the_same_seed_gives_the_same_drive_and_another_seed_another() {
    let folder = tempfile::tempdir().unwrap();
    let [one, two, other] = ["one", "two", "other"].map(|name| folder.path().join(name));
    generate("square", &one, &["--seed", "3"]);
    generate("square", &two, &["--seed", "3"]);
    generate("square", &other, &["--seed", "4"]);
    assert!(files(&one) == files(&two));
    let (first, third) = (files(&one), files(&other));
    for name in
        ["sequences/00/velodyne/000000.bin", "truth.json", "poses/00.txt", "sequences/00/labels_2/pole/000000.png"]
    {
        assert!(first[Path::new(name)] != third[Path::new(name)], "{name}");
    }
}

#[test]
fn another_visit_meets_other_traffic_in_the_same_map_frame() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = ["first", "second"].map(|name| folder.path().join(name));
    generate("street", &first, &[]);
    generate("street", &second, &["--visit", "1"]);
    let (first, second) = (files(&first), files(&second));
    assert!(first[Path::new("truth.json")] == second[Path::new("truth.json")]);
    for name in ["sequences/00/velodyne/000000.bin", "truth/poses.txt", "sequences/00/gnss.csv"] {
        assert!(first[Path::new(name)] != second[Path::new(name)], "{name}");
    }
}

#[test]
fn pictures_of_a_world_a_scan_and_a_view() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("look");
    let words = ["preview", "--world", "sparse", "--frames", "12", "--frame", "4", "--out", text(&out)];
    run("fixtures", &words).ok();
    for name in ["world.png", "scan.png", "view.png"] {
        assert!(std::fs::read(out.join(name)).unwrap().starts_with(b"\x89PNG"), "{name}");
    }
}

#[test]
fn wrong_worlds_and_folders_of_others_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("drive");
    let refused = |words: &[&str], parts: &[&str]| {
        run("fixtures", &[&["generate", "--out", text(&out)], words].concat()).refused(parts);
        assert!(!out.exists());
    };
    refused(&["--world", "circle"], &["no world `circle`", "the worlds are"]);
    refused(&["--world", "curvs"], &["did you mean `curves`"]);
    refused(&["--world", "aged", "--of", "streat"], &["`streat`", "did you mean `street`"]);
    refused(&["--frames", "1"], &["number of frames"]);
    refused(&["--world", "from-survey"], &["--poses"]);
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("notes.txt"), "mine").unwrap();
    let words = ["generate", "--frames", "2", "--out", text(&out)];
    run("fixtures", &words).refused(&["drive is not empty", "give an empty or a new folder"]);
    assert_eq!(std::fs::read(out.join("notes.txt")).unwrap(), b"mine");
}
