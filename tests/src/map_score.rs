//! A map against the truth of a generated drive.

use common::geometry::{Pose, above, distance_from_above_m, nearest_rotation};
use common::map::{LaneKind, LaneLine, Pole, PoleKind, RoadId, SemanticMap, Sign, SignKind};
use fixtures::truth::{TrueLane, TruePole, Truth};
use nalgebra::{Matrix3, Point2, Point3, Translation3, UnitQuaternion, Vector3};

use crate::matching::one_to_one;

/// Poles of map and truth are the same within this, metres: half the spacing of
/// the densest bollards.
const POLE_WITHIN_M: f64 = 0.5;
/// Signs and lights, metres: two plates on one post are farther apart.
const SIGN_WITHIN_M: f64 = 0.4;
/// How far an end of a mark may be off: half of the shortest marks, metres.
const MARK_WITHIN_M: f64 = 0.5;
/// Lane lines, metres: two of a double line are about as far apart.
const LANE_WITHIN_M: f64 = 0.3;
/// Distance of the samples of lane lines, metres.
const SAMPLE_M: f64 = 0.25;

/// How many of one class were found, and how well.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Found {
    /// True ones.
    pub wanted: f64,
    /// Of these, found.
    pub hits: f64,
    /// Those of the map.
    pub claimed: f64,
    /// Of these, true.
    pub right: f64,
    /// Root mean square of the distance of the pairs, metres.
    pub off_m: f64,
}

impl Found {
    /// Share of the true ones that were found; 1 where there are none.
    pub fn recall(&self) -> f64 {
        share(self.hits, self.wanted)
    }

    /// Share of the map's that are true; 1 where there are none.
    pub fn precision(&self) -> f64 {
        share(self.right, self.claimed)
    }
}

fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 1.0 }
}

/// A map's score.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MapScore {
    /// Poles but trunks; `off_m` is that of the feet above the ground plane
    /// (x, z). Trunks of the truth make no pole of the map wrong or missing.
    pub poles: Found,
    /// Root mean square of the feet's height error, metres.
    pub foot_height_m: f64,
    /// Root mean square of the angle between found and true axis, radians.
    pub tilt_rad: f64,
    /// Signs; `off_m` is that of the centroids.
    pub signs: Found,
    /// Traffic lights, likewise.
    pub lights: Found,
    /// Lane lines by length in metres; `off_m` is across them.
    pub lanes: Found,
    /// Marks of dashed lines; `off_m` is that of their ends.
    pub marks: Found,
    /// Share of the found length that the map has as solid or dashed, as it is.
    pub lane_kinds: f64,
    /// True poles that are missing.
    pub missed: Vec<TruePole>,
    /// Poles of the map that are none.
    pub wrong: Vec<Pole>,
}

/// Scores a map against the truth within `within_m` of the exact path (poses
/// `map_from_camera`, seen from above).
pub fn score(map: &SemanticMap, truth: &Truth, exact: &[Pose], within_m: f64) -> MapScore {
    let path: Vec<Point2<f64>> = exact.iter().map(|pose| above(&pose.translation.vector.into())).collect();
    let counts = |p: &Point3<f64>| path.iter().any(|at| (at - above(p)).norm() < within_m);
    let mut score = MapScore::default();
    poles(map, truth, &counts, &mut score);
    for (kind, name, found) in [
        (SignKind::TrafficSign, "traffic_sign", &mut score.signs),
        (SignKind::TrafficLight, "traffic_light", &mut score.lights),
    ] {
        let wanted: Vec<Point3<f64>> =
            truth.signs.iter().filter(|sign| sign.kind == name).map(|sign| sign.centroid_map_m.into()).collect();
        let claimed: Vec<&Sign> = map.signs.iter().filter(|sign| sign.kind == kind).collect();
        *found = signs(&claimed, &wanted, &counts);
    }
    (score.lanes, score.lane_kinds) = lanes(map, truth, &counts);
    score.marks = marks(map, truth, &counts);
    score
}

/// `exact_from_map`: the rigid motion that brings the poses that a map was built
/// with onto the exact ones, both `map_from_camera` of the same frames. A survey
/// that drifts gives a map that is right in itself and lies elsewhere.
///
/// Kabsch (1976), on the cameras' centres and axes.
pub fn alignment(built: &[Pose], exact: &[Pose]) -> Pose {
    const ARM_M: f64 = 10.0;
    let pairs = || built.iter().zip(exact);
    let count = pairs().count().max(1) as f64;
    // Kabsch on centres and on the tips of the axes 10 m from them, so that a
    // straight drive fixes the roll, too.
    let centre = |poses: &mut dyn Iterator<Item = &Pose>| {
        poses.map(|pose| pose.translation.vector).sum::<Vector3<f64>>() / count
    };
    let (from, to) = (centre(&mut pairs().map(|pair| pair.0)), centre(&mut pairs().map(|pair| pair.1)));
    let mut spread = Matrix3::zeros();
    for (a, b) in pairs() {
        spread += (b.translation.vector - to) * (a.translation.vector - from).transpose();
        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
            spread += (b.rotation * axis) * (a.rotation * axis).transpose() * ARM_M * ARM_M;
        }
    }
    // The axes of two trajectories of one drive never mirror each other.
    let rotation = nearest_rotation(&spread)
        .map_or_else(UnitQuaternion::identity, |rotation| UnitQuaternion::from_rotation_matrix(&rotation));
    Pose::from_parts(Translation3::from(to - rotation * from), rotation)
}

/// The map in another frame of the same earth.
#[must_use]
pub fn moved(map: &SemanticMap, to_from_map: &Pose) -> SemanticMap {
    let mut map = map.clone();
    for pole in &mut map.poles {
        (pole.foot_map, pole.top_map) = (to_from_map * pole.foot_map, to_from_map * pole.top_map);
    }
    for sign in &mut map.signs {
        sign.centroid_map = to_from_map * sign.centroid_map;
    }
    let lanes = map.lanes.iter_mut().flat_map(|lane| &mut lane.points_map);
    for point in lanes.chain(map.roads.iter_mut().flat_map(|road| &mut road.path_map)) {
        *point = to_from_map * *point;
    }
    map
}

fn middle(foot: &Point3<f64>, top: &Point3<f64>) -> Point2<f64> {
    above(&nalgebra::center(foot, top))
}

fn rms(squares: &[f64]) -> f64 {
    if squares.is_empty() { 0.0 } else { (squares.iter().sum::<f64>() / squares.len() as f64).sqrt() }
}

fn poles(map: &SemanticMap, truth: &Truth, counts: &dyn Fn(&Point3<f64>) -> bool, score: &mut MapScore) {
    let found: Vec<&Pole> = map.poles.iter().filter(|pole| pole.kind != PoleKind::Trunk).collect();
    let (trunks, wanted): (Vec<&TruePole>, Vec<&TruePole>) = truth.poles.iter().partition(|pole| pole.kind == "trunk");
    let at_truth = |pole: &&TruePole| middle(&pole.foot_map_m.into(), &pole.top_map_m.into());
    let at_found: Vec<Point2<f64>> = found.iter().map(|pole| middle(&pole.foot_map, &pole.top_map)).collect();
    let pairs = one_to_one(&at_found, &wanted.iter().map(at_truth).collect::<Vec<_>>(), POLE_WITHIN_M);
    let (mut across, mut heights, mut tilts) = (Vec::new(), Vec::new(), Vec::new());
    for (f, w) in &pairs {
        let (pole, true_foot, true_top) =
            (found[*f], Point3::from(wanted[*w].foot_map_m), Point3::from(wanted[*w].top_map_m));
        if counts(&true_foot) {
            across.push((above(&pole.foot_map) - above(&true_foot)).norm_squared());
            heights.push((pole.foot_map.y - true_foot.y).powi(2));
            let axis = |foot: &Point3<f64>, top: &Point3<f64>| -> Vector3<f64> { top - foot };
            tilts.push(axis(&pole.foot_map, &pole.top_map).angle(&axis(&true_foot, &true_top)).powi(2));
        }
    }
    score.missed = (0..wanted.len())
        .filter(|w| counts(&wanted[*w].foot_map_m.into()) && !pairs.iter().any(|pair| pair.1 == *w))
        .map(|w| wanted[w].clone())
        .collect();
    let by_trunk = |at: &Point2<f64>| trunks.iter().any(|trunk| (at_truth(trunk) - at).norm() < POLE_WITHIN_M);
    score.wrong = (0..found.len())
        .filter(|f| counts(&found[*f].foot_map) && !pairs.iter().any(|pair| pair.0 == *f) && !by_trunk(&at_found[*f]))
        .map(|f| *found[f])
        .collect();
    let hits = across.len() as f64;
    score.poles = Found {
        wanted: hits + score.missed.len() as f64,
        hits,
        claimed: hits + score.wrong.len() as f64,
        right: hits,
        off_m: rms(&across),
    };
    score.foot_height_m = rms(&heights);
    score.tilt_rad = rms(&tilts);
}

fn signs(claimed: &[&Sign], wanted: &[Point3<f64>], counts: &dyn Fn(&Point3<f64>) -> bool) -> Found {
    let nearest = |from: &Point3<f64>, to: &mut dyn Iterator<Item = Point3<f64>>| {
        to.map(|p| (p - from).norm()).fold(f64::INFINITY, f64::min)
    };
    let mut found = Found::default();
    let mut squares = Vec::new();
    for truth in wanted.iter().filter(|p| counts(p)) {
        let off_m = nearest(truth, &mut claimed.iter().map(|sign| sign.centroid_map));
        found.wanted += 1.0;
        if off_m < SIGN_WITHIN_M {
            found.hits += 1.0;
            squares.push(off_m * off_m);
        }
    }
    for sign in claimed.iter().filter(|sign| counts(&sign.centroid_map)) {
        found.claimed += 1.0;
        found.right += f64::from(u8::from(nearest(&sign.centroid_map, &mut wanted.iter().copied()) < SIGN_WITHIN_M));
    }
    found.off_m = rms(&squares);
    found
}

/// Marks of dashed lines that are found: both ends where they are.
fn marks(map: &SemanticMap, truth: &Truth, counts: &dyn Fn(&Point3<f64>) -> bool) -> Found {
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
fn lanes(map: &SemanticMap, truth: &Truth, counts: &dyn Fn(&Point3<f64>) -> bool) -> (Found, f64) {
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

#[cfg(test)]
mod tests {
    use fixtures::truth::TrueSign;

    use super::*;

    fn truth() -> Truth {
        let pole = |x: f64, kind: &str| TruePole {
            kind: kind.into(),
            foot_map_m: [x, 1.6, 10.0],
            top_map_m: [x, -3.0, 10.0],
            radius_m: 0.1,
        };
        Truth {
            frame: String::new(),
            poles: vec![pole(5.0, "lamp_post"), pole(-5.0, "sign_post"), pole(8.0, "trunk"), pole(90.0, "lamp_post")],
            signs: vec![TrueSign { kind: "traffic_sign".into(), centroid_map_m: [-5.0, -1.0, 10.0], size_m: 0.6 }],
            lanes: vec![TrueLane {
                kind: "solid".into(),
                points_map_m: vec![[1.5, 1.6, 0.0], [1.5, 1.6, 20.0]],
                width_m: 0.12,
                marks_m: Vec::new(),
                worn_m: Vec::new(),
            }],
        }
    }

    fn map() -> SemanticMap {
        let road = RoadId(0);
        let pole = |x: f64, kind| Pole {
            kind,
            foot_map: Point3::new(x, 1.6, 10.0),
            top_map: Point3::new(x, -3.0, 10.0),
            road,
        };
        let line = vec![Point3::new(1.55, 1.6, 0.0), Point3::new(1.55, 1.6, 10.0), Point3::new(4.0, 1.6, 10.0)];
        SemanticMap {
            // One 3 cm off, one by a trunk, one out of nothing.
            poles: [5.03, 8.1, 2.0].map(|x| pole(x, PoleKind::LampPost)).to_vec(),
            lanes: vec![LaneLine { kind: LaneKind::Solid, points_map: line, road, marks_m: Vec::new() }],
            ..SemanticMap::default()
        }
    }

    #[test]
    fn a_map_that_lies_elsewhere_is_brought_back() {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.02, -0.1, 0.05));
        let elsewhere = Pose::from_parts(Translation3::new(3.0, -1.0, 2.0), turn);
        let exact: Vec<Pose> = (0..30).map(|z| Pose::translation(0.0, 0.0, f64::from(z))).collect();
        let built: Vec<Pose> = exact.iter().map(|pose| elsewhere * pose).collect();
        let back = alignment(&built, &exact) * elsewhere;
        assert!((back.to_matrix() - nalgebra::Matrix4::identity()).norm() < 1e-9);
        let there = moved(&map(), &elsewhere);
        let here = moved(&there, &alignment(&built, &exact));
        assert!((here.poles[0].foot_map - map().poles[0].foot_map).norm() < 1e-9);
    }

    #[test]
    fn a_dashed_line_that_the_map_has_as_solid_is_found_and_of_the_wrong_kind() {
        let path: Vec<Pose> = (0..20).map(|z| Pose::translation(0.0, 0.0, f64::from(z))).collect();
        let mut truth = truth();
        truth.lanes[0].kind = "dashed".into();
        let score = score(&map(), &truth, &path, 20.0);
        assert!((score.lanes.recall() - 0.5).abs() < 0.02 && score.lane_kinds < 1e-12);
    }

    #[test]
    fn a_mark_is_found_where_both_of_its_ends_are() {
        let path: Vec<Pose> = (0..20).map(|z| Pose::translation(0.0, 0.0, f64::from(z))).collect();
        let (mut map, mut truth) = (map(), truth());
        truth.lanes[0].kind = "dashed".into();
        truth.lanes[0].marks_m = vec![[1.0, 4.0], [7.0, 9.0], [12.0, 15.0], [60.0, 63.0]];
        // Drawn the other way: one that ends 0.1 m off, one that is a metre too
        // long, one where there is none.
        map.lanes[0].points_map = vec![Point3::new(1.5, 1.6, 20.0), Point3::new(1.5, 1.6, 0.0)];
        map.lanes[0].marks_m = vec![[5.0, 8.1], [10.0, 13.0], [17.0, 18.0]];
        let marks = score(&map, &truth, &path, 20.0).marks;
        assert!((marks.recall() - 1.0 / 3.0).abs() < 1e-12 && (marks.precision() - 1.0 / 3.0).abs() < 1e-12);
        assert!((marks.off_m - 0.1).abs() < 1e-9, "{marks:?}");
    }

    #[test]
    fn misses_false_ones_and_errors_are_counted_within_reach_only() {
        let path: Vec<Pose> = (0..20).map(|z| Pose::translation(0.0, 0.0, f64::from(z))).collect();
        let score = score(&map(), &truth(), &path, 20.0);
        assert!((score.poles.recall() - 0.5).abs() < 1e-12 && (score.poles.precision() - 0.5).abs() < 1e-12);
        assert!((score.poles.off_m - 0.03).abs() < 1e-9 && score.tilt_rad < 1e-9);
        assert_eq!(score.missed[0].kind, "sign_post");
        assert!((score.wrong[0].foot_map.x - 2.0).abs() < 1e-12);
        assert!(score.signs.recall() < 1e-12 && (score.lights.recall() - 1.0).abs() < 1e-12);
        assert!((score.lanes.recall() - 0.5).abs() < 0.02, "{:?}", score.lanes);
        assert!((score.lanes.precision() - 10.25 / 12.5).abs() < 0.03);
        assert!((score.lanes.off_m - 0.05).abs() < 0.01);
        assert!((score.lane_kinds - 1.0).abs() < 1e-12);
    }
}
