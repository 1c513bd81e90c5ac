//! Lane lines and their marks against the truth.

use common::geometry::distance_from_above_m;
use common::map::{LaneKind, LaneLine, RoadId, SemanticMap};
use fixtures::truth::{TrueLane, Truth, lane_name};
use nalgebra::Point3;

use super::{Found, MapScore, rms, share};

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

/// A line that stands in one of the two, map or truth: its kind and its points.
type Line = (String, Vec<Point3<f64>>);

/// A part of a lane line that the other, map or truth, does not have.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// Its first sample in the map frame, metres.
    pub from_map_m: Point3<f64>,
    /// Its last sample, likewise.
    pub to_map_m: Point3<f64>,
    /// Its length, metres.
    pub length_m: f64,
    /// The kind of the line that it is part of.
    pub kind: String,
}

impl Stretch {
    /// What it is, for people.
    pub fn name(&self) -> String {
        if self.kind == lane_name(LaneKind::Kerb) { self.kind.clone() } else { format!("{} line", self.kind) }
    }
}

/// Lane lines of one, map or truth, along those of the other.
#[derive(Default)]
struct Along {
    /// Length that counts, metres.
    length_m: f64,
    /// Length of it that has a line of the other beside it, metres.
    near_m: f64,
    /// Length of that which is of the same kind there, metres.
    same_kind_m: f64,
    /// Squares of the distances across, of its samples.
    squares: Vec<f64>,
    /// What has none.
    alone: Vec<Stretch>,
}

impl Along {
    fn of(lines: &[Line], others: &[Line], counts: &dyn Fn(&Point3<f64>) -> bool) -> Self {
        let mut along = Self::default();
        for (kind, line) in lines {
            let mut open: Option<Stretch> = None;
            for sample in sampled(line) {
                if !counts(&sample) {
                    along.alone.extend(open.take());
                    continue;
                }
                along.length_m += SAMPLE_M;
                let nearest = others.iter().map(|(kind, line)| (distance_from_above_m(&sample, line), kind));
                let near = nearest.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(off_m, _)| *off_m < LANE_WITHIN_M);
                if let Some((off_m, other)) = near {
                    along.near_m += SAMPLE_M;
                    along.same_kind_m += if other == kind { SAMPLE_M } else { 0.0 };
                    along.squares.push(off_m * off_m);
                    along.alone.extend(open.take());
                } else {
                    let stretch = open.get_or_insert_with(|| Stretch {
                        from_map_m: sample,
                        to_map_m: sample,
                        length_m: 0.0,
                        kind: kind.clone(),
                    });
                    (stretch.to_map_m, stretch.length_m) = (sample, stretch.length_m + SAMPLE_M);
                }
            }
            along.alone.extend(open);
        }
        along
    }
}

/// The painted lines of the truth along those of a map, and those of the map along
/// those of the truth; or their kerbs.
fn compared(
    map: &SemanticMap,
    truth: &Truth,
    are_painted: bool,
    counts: &dyn Fn(&Point3<f64>) -> bool,
) -> (Found, Along, Along) {
    let is_kerb = |lane: &&TrueLane| lane.kind == lane_name(LaneKind::Kerb);
    let wanted = truth.lanes.iter().filter(|lane| is_kerb(lane) != are_painted);
    let wanted: Vec<Line> =
        wanted.map(|lane| (lane.kind.clone(), lane.points_map_m.iter().map(|p| Point3::from(*p)).collect())).collect();
    let claimed = map.lanes.iter().filter(|lane| lane.kind.is_painted() == are_painted);
    let claimed: Vec<Line> = claimed.map(|lane| (lane_name(lane.kind).to_owned(), lane.points_map.clone())).collect();
    let (true_ones, claimed) = (Along::of(&wanted, &claimed, counts), Along::of(&claimed, &wanted, counts));
    let found = Found {
        wanted: true_ones.length_m,
        hits: true_ones.near_m,
        claimed: claimed.length_m,
        right: claimed.near_m,
        off_m: rms(&true_ones.squares),
    };
    (found, true_ones, claimed)
}

/// Lane lines and kerbs found, the share of the lines' length with the right kind, and
/// the parts that are missing and wrong.
pub(super) fn lanes(map: &SemanticMap, truth: &Truth, counts: &dyn Fn(&Point3<f64>) -> bool, score: &mut MapScore) {
    let (lanes, true_lanes, claimed_lanes) = compared(map, truth, true, counts);
    let (kerbs, true_kerbs, claimed_kerbs) = compared(map, truth, false, counts);
    (score.lanes, score.kerbs) = (lanes, kerbs);
    score.lane_kinds = share(true_lanes.same_kind_m, true_lanes.near_m);
    score.missed_lanes = [true_lanes.alone, true_kerbs.alone].concat();
    score.wrong_lanes = [claimed_lanes.alone, claimed_kerbs.alone].concat();
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
