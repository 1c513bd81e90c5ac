//! Drives of one street become one map, whatever the order and the steps; maps
//! can be compared and doubted.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use common::geometry::Pose;
use common::kitti::{read_poses, write_poses};
use common::map::SemanticMap;
use nalgebra::Vector3;
use waymark_tests::map_score::{MapScore, moved, score};

use crate::support::{DEMO, FRAMES, Ran, build, run, text};

/// How far the survey of the second visit lies off, metres.
const OFF_M: [f64; 3] = [0.9, 0.0, -0.7];

/// Maps of the demo's street: the demo's own, a second visit on a survey that
/// lies elsewhere, and a visit after some time.
struct Visits(PathBuf);

static VISITS: LazyLock<Visits> = LazyLock::new(|| {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("visits");
    std::fs::create_dir_all(&folder).unwrap();
    let frames = FRAMES.to_string();
    for (name, words) in [("second", &["--visit", "1"][..]), ("later", &["--world", "aged", "--of", "street"])] {
        let drive = folder.join(name);
        let common = ["generate", "--frames", &frames, "--scan-every", "5", "--out", text(&drive)];
        run("fixtures", &[&common[..], words].concat()).ok();
        let survey = folder.join(format!("{name}.txt"));
        let mut poses = read_poses(drive.join("poses/00.txt")).unwrap();
        let off = if name == "second" { Vector3::from(OFF_M) } else { Vector3::zeros() };
        for pose in &mut poses {
            pose.translation.vector += off;
        }
        write_poses(&survey, &poses).unwrap();
        build(&drive, "00", &folder.join(format!("{name}.csm")), &["--survey", text(&survey)]).ok();
    }
    std::fs::copy(DEMO.file("street.csm"), folder.join("first.csm")).unwrap();
    Visits(folder)
});

impl Visits {
    fn file(&self, name: &str) -> PathBuf {
        self.0.join(format!("{name}.csm"))
    }

    fn map(&self, name: &str) -> SemanticMap {
        common::map::read(self.file(name)).unwrap()
    }

    /// `mapper merge`, and the bytes of the map and of its sources.
    fn merge(&self, inputs: &[&str], out: &str) -> (Vec<u8>, Vec<u8>) {
        let files: Vec<PathBuf> = inputs.iter().map(|name| self.file(name)).collect();
        let mut words: Vec<&str> = files.iter().map(|file| text(file)).collect();
        let out = self.file(out);
        words.extend(["--out", text(&out)]);
        run("mapper", &[&["merge"], &words[..]].concat()).ok();
        (std::fs::read(&out).unwrap(), std::fs::read(out.with_extension("sources")).unwrap())
    }
}

#[test]
fn neither_order_nor_steps_change_the_bytes() {
    let at_once = VISITS.merge(&["first", "second", "later"], "at_once");
    assert_eq!(VISITS.merge(&["later", "first", "second"], "turned"), at_once);
    VISITS.merge(&["first", "second"], "left");
    assert_eq!(VISITS.merge(&["left", "later"], "left_first"), at_once);
    VISITS.merge(&["later", "second"], "right");
    assert_eq!(VISITS.merge(&["first", "right"], "right_first"), at_once);
    assert_eq!(VISITS.merge(&["right", "left", "first"], "all"), at_once);
}

/// The score of a map that lies `off` from the truth.
fn scored(map: &SemanticMap, off: Vector3<f64>) -> MapScore {
    let truth = waymark_tests::truth::read(&DEMO.file("drive")).unwrap();
    let exact = read_poses(DEMO.file("drive/truth/poses.txt")).unwrap();
    let back = Pose::translation(-off.x, -off.y, -off.z);
    score(&moved(map, &back), &truth, &exact, 20.0)
}

#[test]
fn two_visits_with_surveys_a_metre_apart_make_one_map_without_doubles() {
    VISITS.merge(&["first", "second"], "both");
    let [first, second, both] = ["first", "second", "both"].map(|name| VISITS.map(name));
    assert!(both.poles.len() < first.poles.len() + second.poles.len() / 2, "{} poles", both.poles.len());
    let found = run("mapper", &["validate", text(&VISITS.file("both")), "--json"]);
    assert!(!found.out.contains("\"duplicate\""), "{}", found.out);
    // Neither survey is believed more: the map lies half way between them.
    let off = Vector3::from(OFF_M);
    let [a, b, both] = [scored(&first, Vector3::zeros()), scored(&second, off), scored(&both, off * 0.5)];
    assert!(both.poles.recall() >= a.poles.recall().max(b.poles.recall()), "{:?}", both.poles);
    assert!(both.poles.precision() >= a.poles.precision().min(b.poles.precision()) - 0.08, "{:?}", both.poles);
    assert!(
        both.poles.off_m <= a.poles.off_m.max(b.poles.off_m) + 0.005,
        "{:?} {:?} {:?}",
        both.poles,
        a.poles,
        b.poles
    );
    assert!(both.lanes.recall() >= a.lanes.recall().max(b.lanes.recall()) - 0.01, "{:?}", both.lanes);
    // A mark that only one visit saw stays, one that both saw is one.
    let marks = [&a.marks, &b.marks, &both.marks];
    assert!(both.marks.recall() >= a.marks.recall().max(b.marks.recall()), "{marks:?}");
    assert!(both.marks.precision() >= a.marks.precision().min(b.marks.precision()) - 0.05, "{marks:?}");
    // The visits are aligned along the road to some centimetres.
    assert!(both.marks.off_m <= a.marks.off_m.max(b.marks.off_m) + 0.03, "{marks:?}");
}

#[test]
fn what_changed_is_told_one_line_each() {
    let [first, later] = ["first", "later"].map(|name| VISITS.file(name));
    let same = run("mapper", &["diff", text(&first), text(&first)]);
    assert_eq!((same.code, same.out.lines().count()), (0, 1), "{}", same.out);
    let changed = run("mapper", &["diff", text(&first), text(&later)]);
    assert_eq!(changed.code, 1);
    let counted = changed.out.lines().last().unwrap().to_owned();
    assert!(counted.contains(" added, ") && changed.out.lines().count() > 3, "{}", changed.out);
    let json = run("mapper", &["diff", text(&first), text(&later), "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json.out).unwrap();
    assert_eq!(json["differences"].as_array().unwrap().len() + 1, changed.out.lines().count());
}

#[test]
fn a_map_given_twice_counts_once() {
    let (map, _) = VISITS.merge(&["first", "first"], "twice");
    assert_eq!(map, std::fs::read(VISITS.file("first")).unwrap());
}

#[test]
fn what_cannot_be_merged_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (out, bad) = (folder.path().join("area.csm"), folder.path().join("bad.csm"));
    let merge = |input: &Path| -> Ran {
        run("mapper", &["merge", text(&VISITS.file("first")), text(input), "--out", text(&out)])
    };
    merge(&bad).refused(&["bad.csm", "check that it exists"]);
    let mut bytes = std::fs::read(VISITS.file("second")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&bad, &bytes).unwrap();
    merge(&bad).refused(&["bad.csm", "damaged"]);
    // Sources of another map of that name.
    VISITS.merge(&["first", "second"], "stale");
    std::fs::copy(VISITS.file("second"), &bad).unwrap();
    std::fs::copy(VISITS.file("stale").with_extension("sources"), bad.with_extension("sources")).unwrap();
    merge(&bad).refused(&["bad.sources", "another map", "remove it"]);
    assert!(!out.exists());
    std::fs::write(&bad, "no map").unwrap();
    for words in [&["diff", text(&bad), text(&bad)][..], &["validate", text(&bad)]] {
        run("mapper", words).refused(&["bad.csm", "no Waymark map"]);
    }
}

#[test]
fn maps_of_another_quantum_are_merged_on_the_finest() {
    let coarse = VISITS.file("coarse");
    let options = common::map::EncodeOptions { quantum_m: 0.02 };
    common::map::write(&coarse, &VISITS.map("second"), &options).unwrap();
    let out = VISITS.file("mixed");
    let said = run("mapper", &["merge", text(&coarse), text(&VISITS.file("first")), "--out", text(&out)]).ok();
    assert!(said.contains("the finest, 0.01 m, is taken"), "{said}");
}
