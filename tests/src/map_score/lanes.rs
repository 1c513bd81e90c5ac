//! Lane lines and their marks against the truth.

use common::geometry::distance_from_above_m;
use common::map::{LaneKind, LaneLine, RoadId, SemanticMap};
use fixtures::truth::{TrueLane, Truth};
use nalgebra::Point3;

use super::{Found, rms, share};

/// How far an end of a mark may be off: half of the shortest marks, metres.
const MARK_WITHIN_M: f64 = 0.5;
/// Lane lines, metres: two of a double line are about as far apart.
const LANE_WITHIN_M: f64 = 0.3;
/// Distance of the samples of lane lines, metres.
const SAMPLE_M: f64 = 0.25;

/// Marks of dashed lines that are found: both ends where they are.
pub(super) fn marks(map: &SemanticMap, truth: &Truth, counts: &dyn Fn(&Point3<f64>) -> bool) -> Found {
    let line = |lane: &TrueLane| LaneLine {
        kind: LaneKind::Dashed,
        points_map: lane.points_map_m.iter().map(|p| Point3::from(*p)).collect(),
        road: RoadId(0),
        marks_m: lane.marks_m.clone(),
    };
    let inside = |mark: &[Point3<f64>; 2]| mark.iter().all(counts);
    let wanted: Vec<[Point3<f64>; 2]> =
        truth.lanes.iter().flat_map(|lane| line(lane).marks_map().collect::<Vec<_>>()).filter(inside).collect();
    let claimed: Vec<[Point3<f64>; 2]> = map.lanes.iter().flat_map(LaneLine::marks_map).filter(inside).collect();
    let apart_m = |a: &[Point3<f64>; 2], b: &[Point3<f64>; 2]| {
        let both = |p: &Point3<f64>, q: &Point3<f64>| (a[0] - p).norm().max((a[1] - q).norm());
        both(&b[0], &b[1]).min(both(&b[1], &b[0]))
    };
    let nearest_m = |mark: &[Point3<f64>; 2], others: &[[Point3<f64>; 2]]| {
        others.iter().map(|other| apart_m(mark, other)).fold(f64::INFINITY, f64::min)
    };
    let found: Vec<f64> = wanted.iter().map(|mark| nearest_m(mark, &claimed)).filter(|m| *m < MARK_WITHIN_M).collect();
    let right = claimed.iter().filter(|mark| nearest_m(mark, &wanted) < MARK_WITHIN_M).count();
    let squares: Vec<f64> = found.iter().map(|off_m| off_m * off_m).collect();
    Found {
        wanted: wanted.len() as f64,
        hits: found.len() as f64,
        claimed: claimed.len() as f64,
        right: right as f64,
        off_m: rms(&squares),
    }
}

/// Lane lines found, and the share of their length with the right kind.
pub(super) fn lanes(map: &SemanticMap, truth: &Truth, counts: &dyn Fn(&Point3<f64>) -> bool) -> (Found, f64) {
    let kind = |lane: &LaneLine| match lane.kind {
        LaneKind::Solid => "solid",
        LaneKind::Dashed => "dashed",
    };
    let claimed: Vec<(&str, Vec<Point3<f64>>)> =
        map.lanes.iter().map(|lane| (kind(lane), lane.points_map.clone())).collect();
    let wanted: Vec<(&str, Vec<Point3<f64>>)> = truth
        .lanes
        .iter()
        .map(|lane| (lane.kind.as_str(), lane.points_map_m.iter().map(|p| Point3::from(*p)).collect()))
        .collect();
    let (mut squares, mut right_kind) = (Vec::new(), 0.0);
    let mut covered = |lines: &[(&str, Vec<Point3<f64>>)], others: &[(&str, Vec<Point3<f64>>)], keep: bool| {
        let (mut near, mut all) = (0.0, 0.0);
        for (kind, line) in lines {
            for sample in sampled(line).iter().filter(|p| counts(p)) {
                all += SAMPLE_M;
                let nearest = others.iter().map(|(kind, line)| (distance_from_above_m(sample, line), kind));
                let Some((off_m, found)) = nearest.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
                if off_m < LANE_WITHIN_M {
                    near += SAMPLE_M;
                    if keep {
                        squares.push(off_m * off_m);
                        right_kind += if found == kind { SAMPLE_M } else { 0.0 };
                    }
                }
            }
        }
        (near, all)
    };
    let (hits, wanted_m) = covered(&wanted, &claimed, true);
    let (right, claimed_m) = covered(&claimed, &wanted, false);
    (Found { wanted: wanted_m, hits, claimed: claimed_m, right, off_m: rms(&squares) }, share(right_kind, hits))
}

/// Points along a polyline.
fn sampled(line: &[Point3<f64>]) -> Vec<Point3<f64>> {
    line.windows(2)
        .flat_map(|pair| {
            let way = pair[1] - pair[0];
            let steps = (way.norm() / SAMPLE_M).round().max(1.0) as usize;
            (0..steps).map(move |i| pair[0] + way * ((i as f64 + 0.5) / steps as f64))
        })
        .collect()
}
