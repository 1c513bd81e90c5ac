//! Landmarks that are there twice.

use std::collections::BTreeMap;

use common::map::{SemanticMap, Sign};
use nalgebra::{Point3, Vector3};

use super::{Fault, Findings, Names, ValidateConfig};
use crate::fuse::Buckets;

pub(super) fn check(map: &SemanticMap, config: &ValidateConfig, findings: &mut Findings) {
    let mut names = Names(Vec::new());
    let poles: Vec<Named> = map.poles.iter().map(|p| (names.next(p.kind.name()), 0, p.foot_map)).collect();
    points(&poles, config.same_pole_m, findings);
    let sign = |s: &Sign, names: &mut Names| (names.next(s.kind.name()), s.kind as usize, s.centroid_map);
    let signs: Vec<Named> = map.signs.iter().map(|s| sign(s, &mut names)).collect();
    points(&signs, config.same_sign_m, findings);
    lanes(map, config, findings);
}

/// Name, class and place.
type Named = (String, usize, Point3<f64>);

fn points(landmarks: &[Named], within_m: f64, findings: &mut Findings) {
    let buckets = Buckets::of(within_m, landmarks.iter().map(|landmark| &landmark.2));
    for (index, (name, class, at)) in landmarks.iter().enumerate() {
        let others = buckets.near(at, within_m).filter(|&other| other < index && landmarks[other].1 == *class);
        let nearest = others.min_by(|a, b| {
            let distance = |other: &usize| (landmarks[*other].2 - at).norm();
            distance(a).total_cmp(&distance(b)).then(a.cmp(b))
        });
        if let Some(other) = nearest.map(|other| &landmarks[other])
            && (other.2 - at).norm() <= within_m
        {
            let what = format!("is {:.2} m from {}", (other.2 - at).norm(), other.0);
            findings.add(Fault::Duplicate, name, at, what);
        }
    }
}

/// Distance of the samples of lane lines, metres.
const SAMPLE_M: f64 = 0.5;

struct Sample {
    line: usize,
    at: Point3<f64>,
    along: Vector3<f64>,
}

fn lanes(map: &SemanticMap, config: &ValidateConfig, findings: &mut Findings) {
    let mut names = Names(Vec::new());
    let names: Vec<String> = map.lanes.iter().map(|lane| names.next(lane.kind.name())).collect();
    let mut samples: Vec<Sample> = Vec::new();
    for (line, lane) in map.lanes.iter().enumerate() {
        for pair in lane.points_map.windows(2) {
            let way = pair[1] - pair[0];
            let Some(along) = way.try_normalize(1e-6) else { continue };
            let count = (way.norm() / SAMPLE_M).ceil().clamp(1.0, 1e6);
            let at = |k: usize| pair[0] + way * ((k as f64 + 0.5) / count);
            samples.extend((0..count as usize).map(|k| Sample { line, at: at(k), along }));
        }
    }
    let buckets = Buckets::of(1.0, samples.iter().map(|sample| &sample.at));
    // For each pair of lines where they begin to be one, and for how long.
    let mut shared: BTreeMap<(usize, usize), (Point3<f64>, usize)> = BTreeMap::new();
    for sample in &samples {
        let mut others: Vec<usize> = buckets
            .near(&sample.at, SAMPLE_M)
            .map(|other| &samples[other])
            .filter(|other| {
                let off = other.at - sample.at;
                other.line < sample.line
                    && off.dot(&sample.along).abs() <= 0.5 * SAMPLE_M
                    && (off - sample.along * off.dot(&sample.along)).norm() <= config.same_line_m
                    && other.along.dot(&sample.along).abs() > 0.95
            })
            .map(|other| other.line)
            .collect();
        others.sort_unstable();
        others.dedup();
        for other in others {
            shared.entry((sample.line, other)).or_insert((sample.at, 0)).1 += 1;
        }
    }
    for ((line, other), (at, count)) in shared {
        let length_m = count as f64 * SAMPLE_M;
        if length_m >= config.same_line_length_m {
            let what = format!("runs along {} for {length_m:.1} m", names[other]);
            findings.add(Fault::Duplicate, &names[line], &at, what);
        }
    }
}
