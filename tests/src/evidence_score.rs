//! Whether landmarks are as uncertain as their evidence says.

use common::geometry::{Pose, above};
use common::map::{LaneLine, PoleKind, SemanticMap};
use fixtures::truth::Truth;
use mapper::evidence::{MapEvidence, PointEvidence};
use nalgebra::{Point2, Point3, Vector3};

use crate::matching::one_to_one;

/// Landmarks of map and truth are the same within this, metres.
const WITHIN_M: f64 = 0.5;
/// A sample of a lane line within this of a true one is of it, metres: two of
/// a double line are about as far apart.
const LINE_WITHIN_M: f64 = 0.3;
/// Distance of the samples of lane lines, metres.
const SAMPLE_M: f64 = 2.0;
/// Median of the absolute value of a standard normal deviate.
const MEDIAN_DEVIATE: f64 = 0.6745;

/// Errors of one class against what they are said to be.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Normalised {
    /// Number of landmarks.
    pub count: usize,
    /// Root mean square error per axis, metres.
    pub rms_m: f64,
    /// Root mean square of the standard deviations, metres.
    pub said_m: f64,
    /// Root mean square of error over standard deviation: 1 where it is right.
    pub ratio: f64,
    /// Median of the absolute error over what is the median of a normal
    /// deviate: 1 where it is right for most, whatever the outliers.
    pub median_ratio: f64,
}

impl Normalised {
    fn of(pairs: &[(f64, f64)]) -> Self {
        let count = pairs.len().max(1) as f64;
        let rms =
            |value: &dyn Fn(&(f64, f64)) -> f64| (pairs.iter().map(|p| value(p).powi(2)).sum::<f64>() / count).sqrt();
        let mut ratios: Vec<f64> = pairs.iter().map(|(error, sigma)| (error / sigma).abs()).collect();
        ratios.sort_by(f64::total_cmp);
        Self {
            count: pairs.len(),
            rms_m: rms(&|p| p.0),
            said_m: rms(&|p| p.1),
            ratio: rms(&|p| p.0 / p.1),
            median_ratio: ratios.get(ratios.len() / 2).copied().unwrap_or(0.0) / MEDIAN_DEVIATE,
        }
    }
}

/// The errors of all classes, named.
///
/// A landmark is compared where the built and the exact pose of the nearest
/// frame are the same: what drifts with the trajectory is none of its error.
pub fn score(
    map: &SemanticMap,
    evidence: &MapEvidence,
    truth: &Truth,
    built: &[Pose],
    exact: &[Pose],
) -> Vec<(&'static str, Normalised)> {
    let exact_from_built = |p: &Point3<f64>| {
        let nearest = built.iter().zip(exact).min_by(|a, b| {
            let distance = |pose: &Pose| (pose.translation.vector - p.coords).norm();
            distance(a.0).total_cmp(&distance(b.0))
        });
        nearest.map_or_else(Pose::identity, |(built, exact)| exact * built.inverse())
    };
    let mut rows = Vec::new();
    let poles: Vec<(Point3<f64>, &PointEvidence)> = map
        .poles
        .iter()
        .zip(&evidence.poles)
        .filter(|(pole, _)| pole.kind != PoleKind::Trunk)
        .map(|(pole, own)| (exact_from_built(&pole.foot_map) * pole.foot_map, own))
        .collect();
    let wanted: Vec<Point3<f64>> =
        truth.poles.iter().filter(|p| p.kind != "trunk").map(|p| p.foot_map_m.into()).collect();
    rows.extend(points(["pole feet, across", "pole feet, height"], &poles, &wanted));
    let signs: Vec<(Point3<f64>, &PointEvidence)> = map
        .signs
        .iter()
        .zip(&evidence.signs)
        .map(|(sign, own)| (exact_from_built(&sign.centroid_map) * sign.centroid_map, own))
        .collect();
    let wanted: Vec<Point3<f64>> = truth.signs.iter().map(|sign| sign.centroid_map_m.into()).collect();
    rows.extend(points(["signs, across", "signs, height"], &signs, &wanted));
    let lines: Vec<Vec<Point3<f64>>> =
        truth.lanes.iter().map(|lane| lane.points_map_m.iter().map(|p| Point3::from(*p)).collect()).collect();
    let (mut lateral, mut vertical) = (Vec::new(), Vec::new());
    for (lane, own) in map.lanes.iter().zip(&evidence.lanes) {
        for p in samples(lane) {
            let p = exact_from_built(&p) * p;
            if let Some((across_m, down_m)) = beside(&p, &lines) {
                lateral.push((across_m, own.lateral_sigma_m));
                vertical.push((down_m, own.vertical_sigma_m));
            }
        }
    }
    rows.push(("lines, lateral", Normalised::of(&lateral)));
    rows.push(("lines, height", Normalised::of(&vertical)));
    rows
}

fn points(
    names: [&'static str; 2],
    found: &[(Point3<f64>, &PointEvidence)],
    wanted: &[Point3<f64>],
) -> [(&'static str, Normalised); 2] {
    let at: Vec<Point2<f64>> = found.iter().map(|(p, _)| above(p)).collect();
    let (mut across, mut height) = (Vec::new(), Vec::new());
    for (f, w) in one_to_one(&at, &wanted.iter().map(above).collect::<Vec<_>>(), WITHIN_M) {
        let (place, own) = &found[f];
        let off = place - wanted[w];
        // Two plates on one post are seen as one from above.
        if off.norm() > WITHIN_M {
            continue;
        }
        across.extend([Vector3::x(), Vector3::z()].map(|axis| (off.dot(&axis), own.sigma_m(&axis))));
        height.push((off.y, own.sigma_m(&Vector3::y())));
    }
    [(names[0], Normalised::of(&across)), (names[1], Normalised::of(&height))]
}

fn samples(lane: &LaneLine) -> Vec<Point3<f64>> {
    let edge = |ends: &[Point3<f64>]| {
        let (from, along) = (ends[0], ends[1] - ends[0]);
        let steps = (along.norm() / SAMPLE_M).ceil().max(1.0);
        (0..steps as usize).map(move |i| from + along * ((i as f64 + 0.5) / steps))
    };
    lane.points_map.windows(2).flat_map(edge).collect()
}

/// How far a point lies to the side of the nearest line and below it, metres;
/// none where no line is near.
fn beside(p: &Point3<f64>, lines: &[Vec<Point3<f64>>]) -> Option<(f64, f64)> {
    let off = |ends: &[Point3<f64>]| {
        let along = ends[1] - ends[0];
        let flat = along.x * along.x + along.z * along.z;
        let d = p - ends[0];
        let share = ((d.x * along.x + d.z * along.z) / flat.max(1e-12)).clamp(0.0, 1.0);
        let off = d - along * share;
        (off.x.hypot(off.z), off.y)
    };
    let nearest = lines.iter().flat_map(|line| line.windows(2)).map(off).min_by(|a, b| a.0.total_cmp(&b.0))?;
    (nearest.0 < LINE_WITHIN_M).then_some(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_right_standard_deviation_has_a_ratio_of_one() {
        // Quantiles of a normal deviate of 2 cm, at 1/8, 3/8, 5/8 and 7/8.
        let pairs: Vec<(f64, f64)> = [-1.15, -0.32, 0.32, 1.15].map(|z| (0.02 * z * 1.18, 0.02)).to_vec();
        let found = Normalised::of(&pairs);
        assert!((found.ratio - 1.0).abs() < 0.05 && found.count == 4, "{found:?}");
    }
}
