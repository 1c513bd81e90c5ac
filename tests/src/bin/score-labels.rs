//! Scores a map of KITTI against the point labels of its scans.

use std::collections::BTreeMap;
use std::process::ExitCode;

use clap::Parser;
use common::kitti::Sequence;
use waymark_tests::cli::{MapOfSequence, Outcome, ended};
use waymark_tests::labels::{LabelScore, OnLandmark, read, score};

/// Scores a map of KITTI against the point labels of its scans
/// (`SemanticKITTI`, `sequences/NN/labels`): the share of points on each class
/// of landmarks that carry its label, recall and precision of poles, each miss
/// and each false one.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    of: MapOfSequence,
    /// What is farther from the cameras of the labelled frames does not count,
    /// metres.
    #[arg(long, value_name = "M", default_value_t = 15.0)]
    within: f64,
}

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(Arguments { of, within }: &Arguments) -> Outcome {
    let (map, trajectory) = of.read()?;
    let labelled = read(&Sequence::open(&of.kitti, &of.sequence)?, &trajectory)?;
    common::say!("{}: within {within} m of {} labelled frames", of.map.display(), labelled.frames.len());
    print(&score(&map, &labelled, *within));
    Ok(())
}

fn is_right(landmark: &OnLandmark) -> bool {
    2 * landmark.right >= landmark.points
}

fn print(score: &LabelScore) {
    let mut by_kind: BTreeMap<&str, Vec<&OnLandmark>> = BTreeMap::new();
    for landmark in &score.landmarks {
        by_kind.entry(&landmark.kind).or_default().push(landmark);
    }
    common::say!("{:14} {:>9} {:>8} {:>16} {:>16}", "", "landmarks", "points", "with its label", "mostly its label");
    for (kind, landmarks) in &by_kind {
        let points: usize = landmarks.iter().map(|l| l.points).sum();
        let right: usize = landmarks.iter().map(|l| l.right).sum();
        let mostly = landmarks.iter().filter(|l| is_right(l)).count();
        let share = right as f64 / points.max(1) as f64;
        common::say!("{kind:14} {:9} {points:8} {share:16.3} {mostly:16}", landmarks.len());
    }
    let found = score.poles.iter().filter(|pole| pole.is_found).count();
    common::say!("labelled poles found: {found} of {}", score.poles.len());
    for pole in score.poles.iter().filter(|pole| !pole.is_found) {
        common::say!(
            "missed x {:7.2}  z {:7.2}  {} points labelled as pole, {:.1} m high",
            pole.at.x,
            pole.at.y,
            pole.points,
            pole.height_m
        );
    }
    for landmark in score.landmarks.iter().filter(|l| !is_right(l)) {
        common::say!(
            "wrong  x {:7.2}  z {:7.2}  {}: {} of {} points have its label, most have {}",
            landmark.at.x,
            landmark.at.y,
            landmark.kind,
            landmark.right,
            landmark.points,
            landmark.mostly
        );
    }
}
