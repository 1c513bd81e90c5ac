//! KITTI 04, frames 0 to 50, every fifth scan: what the issue of this project
//! asks for. And a street without paint, KITTI 00.

use std::path::{Path, PathBuf};

use common::map::LaneKind;
use waymark_tests::{data, pole_map};

use crate::support::{build, run, run_path, text};

/// The map of a real drive and the poses that it was built with.
struct Real {
    root: PathBuf,
    sequence: &'static str,
    last: &'static str,
    folder: tempfile::TempDir,
}

impl Real {
    /// Builds the map from every `every`-th scan of KITTI 04, where there is real data.
    fn build(every: &str) -> Option<Self> {
        Self::build_of("04", "50", every)
    }

    fn build_of(sequence: &'static str, last: &'static str, every: &str) -> Option<Self> {
        let root = data::folder()?.join("kitti");
        let real = Self { root, sequence, last, folder: tempfile::tempdir().unwrap() };
        let trajectory = real.trajectory();
        let more = ["--every", every, "--last", last, "--trajectory", text(&trajectory)];
        println!("{}", build(&real.root, sequence, &real.map(), &more).ok());
        Some(real)
    }

    /// What `eval` says, as JSON, of the drive localized through the networks, where there
    /// are any.
    fn localized(&self, truth: &Path) -> Option<String> {
        let networks = self.networks()?;
        let (map, out) = (self.map(), self.folder.path().join("localized"));
        let words = ["run", "--map", text(&map), "--sequence", self.sequence, "--kitti", text(&self.root)];
        let more = ["--last", self.last, "--truth", text(truth), "--out", text(&out)];
        let words = [&words[..], &networks.each_ref().map(String::as_str), &more].concat();
        println!("{}", run("localizer", &words).ok());
        Some(run("localizer", &["eval", "--estimate", text(&out), "--truth", text(truth), "--json"]).ok())
    }

    fn map(&self) -> PathBuf {
        self.folder.path().join("map.csm")
    }

    fn trajectory(&self) -> PathBuf {
        self.folder.path().join("poses.txt")
    }

    /// The options that name the networks, where there are any.
    fn networks(&self) -> Option<[String; 4]> {
        let models = self.root.join("../models");
        let nets = ["espnetv2_cityscapes_384x1248.onnx", "twinlitenet_lane_384x1248.onnx"].map(|net| models.join(net));
        if !nets.iter().all(|net| net.is_file()) {
            eprintln!("no networks in {}: nothing is tested with them", models.display());
            return None;
        }
        Some(["--pole-net", text(&nets[0]), "--lane-net", text(&nets[1])].map(str::to_owned))
    }

    fn score(&self) -> pole_map::Score {
        let map = common::map::read(self.map()).unwrap();
        let trajectory = common::kitti::read_poses(self.trajectory()).unwrap();
        pole_map::score(&map, &trajectory, &self.root, "04").unwrap()
    }
}

#[test]
fn every_fifth_scan_gives_a_map_of_at_most_1024_bytes() {
    let Some(real) = Real::build("5") else { return };
    let bytes = std::fs::metadata(real.map()).unwrap().len();
    assert!(bytes <= 1024, "{bytes}");
}

#[test]
fn its_poles_are_those_of_the_pole_map() {
    let Some(real) = Real::build("5") else { return };
    let score = real.score();
    println!("recall {:.3}, precision {:.3}", score.recall(), score.precision());
    assert!(score.recall() >= 0.65 && score.precision() >= 0.73, "{score:?}");
}

#[test]
fn the_camera_of_the_drive_is_localized_through_the_networks_better_than_the_paper_says() {
    let Some(real) = Real::build("5") else { return };
    let Some(said) = real.localized(&real.root.join("poses/04.txt")) else { return };
    assert!(figure(&said, "rms_position_m") <= 0.20, "{said}");
    assert!(figure(&said, "share_under_half_metre") >= 0.98, "{said}");
    assert!(figure(&said, "mean_angle_rad") <= 0.010, "{said}");
}

/// A figure of what `eval` says: one that is not there holds no bound.
fn figure(said: &str, name: &str) -> f64 {
    let json: serde_json::Value = serde_json::from_str(said).unwrap();
    json[name].as_f64().unwrap_or(f64::NAN)
}

#[test]
fn the_kerbs_of_a_street_without_paint_are_found_and_hold_the_camera() {
    let Some(real) = Real::build_of("00", "9", "1") else { return };
    let map = common::map::read(real.map()).unwrap();
    assert_eq!(map.lanes.iter().filter(|lane| lane.kind == LaneKind::Kerb).count(), 2);
    // 0.2 to 0.4 m without them.
    let Some(said) = real.localized(&real.trajectory()) else { return };
    assert!(figure(&said, "rms_position_m") <= 0.18, "{said}");
}

#[test]
fn in_fog_it_is_localized_better_than_the_paper_says_and_no_frame_is_ok_and_off() {
    let Some(real) = Real::build("5") else { return };
    let Some(networks) = real.networks() else { return };
    let (map, truth) = (real.map(), real.trajectory());
    let words = ["--map", text(&map), "--sequence", "04", "--kitti", text(&real.root), "--truth", text(&truth)];
    let more = ["--last", "25", "--only", "fog", "--json"];
    let words = [&words[..], &networks.each_ref().map(String::as_str), &more].concat();
    let said = run_path(env!("CARGO_BIN_EXE_weather"), &words).ok();
    let rows: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert!(rows[0]["rms_m"].as_f64().unwrap() <= 0.345, "{said}");
    assert_eq!(rows[0]["hazards"].as_array().unwrap().len(), 0, "{said}");
}
