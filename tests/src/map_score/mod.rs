//! A map against the truth of a generated drive.

mod lanes;

use common::geometry::{Pose, above, nearest_rotation};
use common::map::{Pole, PoleKind, SemanticMap, Sign, SignKind};
use fixtures::truth::{TruePole, TrueSign, Truth, sign_name};
use nalgebra::{Matrix3, Point2, Point3, Translation3, UnitQuaternion, Vector3};

use crate::matching::one_to_one;
pub use lanes::Stretch;
use lanes::{lanes, marks};

/// What is farther from the driven path does not count, metres, where nothing else is said.
pub const WITHIN_M: f64 = 20.0;
/// Poles of map and truth are the same within this, metres: half the spacing of
/// the densest bollards.
const POLE_WITHIN_M: f64 = 0.5;
/// Signs and lights, metres: two plates on one post are farther apart.
const SIGN_WITHIN_M: f64 = 0.4;

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

    /// With those of another map.
    pub fn add(&mut self, other: &Self) {
        let squares = [*self, *other].map(|found| found.hits * found.off_m.powi(2));
        self.wanted += other.wanted;
        self.hits += other.hits;
        self.claimed += other.claimed;
        self.right += other.right;
        self.off_m = (squares.iter().sum::<f64>() / self.hits.max(f64::MIN_POSITIVE)).sqrt();
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
    /// Trunks that the map has, of these those that it calls trunks, those that
    /// it calls so, and of these those that are no post; `off_m` is 0.
    pub trunks: Found,
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
    /// Kerbs of roads without paint, likewise.
    pub kerbs: Found,
    /// Marks of dashed lines; `off_m` is that of their ends.
    pub marks: Found,
    /// Share of the found length that the map has as solid or dashed, as it is.
    pub lane_kinds: f64,
    /// True poles that are missing.
    pub missed: Vec<TruePole>,
    /// Poles of the map that are none.
    pub wrong: Vec<Pole>,
    /// True signs and lights that are missing.
    pub missed_signs: Vec<TrueSign>,
    /// Signs and lights of the map that are none.
    pub wrong_signs: Vec<Sign>,
    /// Parts of true lane lines and kerbs that are missing.
    pub missed_lanes: Vec<Stretch>,
    /// Parts of the map's that are none.
    pub wrong_lanes: Vec<Stretch>,
}

/// Scores a map against the truth within `within_m` of the exact path (poses
/// `map_from_camera`, seen from above).
pub fn score(map: &SemanticMap, truth: &Truth, exact: &[Pose], within_m: f64) -> MapScore {
    let path: Vec<Point2<f64>> = exact.iter().map(|pose| above(&pose.translation.vector.into())).collect();
    let counts = |p: &Point3<f64>| path.iter().any(|at| (at - above(p)).norm() < within_m);
    let mut score = MapScore::default();
    poles(map, truth, &counts, &mut score);
    score.signs = signs(map, truth, SignKind::TrafficSign, &counts, &mut score);
    score.lights = signs(map, truth, SignKind::TrafficLight, &counts, &mut score);
    lanes(map, truth, &counts, &mut score);
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

/// The map as it lies where the exact poses do, with the poses that it was built with.
#[must_use]
pub fn aligned(map: &SemanticMap, built: &[Pose], exact: &[Pose]) -> SemanticMap {
    moved(map, &alignment(built, exact))
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
    score.trunks = trunk_kinds(map, truth, counts);
}

/// Which trunks of the map are called so.
fn trunk_kinds(map: &SemanticMap, truth: &Truth, counts: &dyn Fn(&Point3<f64>) -> bool) -> Found {
    let of_map = |is_trunk: bool| map.poles.iter().filter(move |pole| (pole.kind == PoleKind::Trunk) == is_trunk);
    let of_truth = |is_trunk: bool| truth.poles.iter().filter(move |pole| (pole.kind == "trunk") == is_trunk);
    let at_map = |pole: &Pole| middle(&pole.foot_map, &pole.top_map);
    let at_truth = |pole: &TruePole| middle(&pole.foot_map_m.into(), &pole.top_map_m.into());
    let near = |a: Point2<f64>, b: Point2<f64>| (a - b).norm() < POLE_WITHIN_M;
    let mut found = Found::default();
    for trunk in of_truth(true).filter(|trunk| counts(&trunk.foot_map_m.into())) {
        let is_called = |is_trunk: bool| of_map(is_trunk).any(|pole| near(at_map(pole), at_truth(trunk)));
        let is_hit = is_called(true);
        found.hits += f64::from(u8::from(is_hit));
        found.wanted += f64::from(u8::from(is_hit || is_called(false)));
    }
    for pole in of_map(true).filter(|pole| counts(&pole.foot_map)) {
        let is_by = |is_trunk: bool| of_truth(is_trunk).any(|truth| near(at_map(pole), at_truth(truth)));
        found.claimed += 1.0;
        found.right += f64::from(u8::from(is_by(true) || !is_by(false)));
    }
    found
}

/// Signs of one kind; those that are missing or wrong are appended to the score's.
fn signs(
    map: &SemanticMap,
    truth: &Truth,
    kind: SignKind,
    counts: &dyn Fn(&Point3<f64>) -> bool,
    score: &mut MapScore,
) -> Found {
    let wanted = || truth.signs.iter().filter(|sign| sign.kind == sign_name(kind));
    let claimed = || map.signs.iter().filter(|sign| sign.kind == kind);
    let nearest_m = |from: &Point3<f64>, to: &mut dyn Iterator<Item = Point3<f64>>| {
        to.map(|p| (p - from).norm()).fold(f64::INFINITY, f64::min)
    };
    let mut found = Found::default();
    let mut squares = Vec::new();
    for sign in wanted().filter(|sign| counts(&sign.centroid_map_m.into())) {
        let off_m = nearest_m(&sign.centroid_map_m.into(), &mut claimed().map(|sign| sign.centroid_map));
        found.wanted += 1.0;
        if off_m < SIGN_WITHIN_M {
            found.hits += 1.0;
            squares.push(off_m * off_m);
        } else {
            score.missed_signs.push(sign.clone());
        }
    }
    for sign in claimed().filter(|sign| counts(&sign.centroid_map)) {
        found.claimed += 1.0;
        if nearest_m(&sign.centroid_map, &mut wanted().map(|sign| sign.centroid_map_m.into())) < SIGN_WITHIN_M {
            found.right += 1.0;
        } else {
            score.wrong_signs.push(*sign);
        }
    }
    found.off_m = rms(&squares);
    found
}

#[cfg(test)]
mod tests;
