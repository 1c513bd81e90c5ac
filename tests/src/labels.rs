//! A map against point labels of real scans (`SemanticKITTI`): what the points
//! on each landmark are labelled, and what labelled poles no landmark explains.

use std::collections::{BTreeMap, BTreeSet};

use common::geometry::{Pose, above, distance_to_segment};
use common::kitti::{Sequence, read_scan};
use common::map::{PoleKind, SemanticMap};
use nalgebra::{Point2, Point3, Vector2};

/// Labels of `SemanticKITTI`.
const LANE_MARKING: u16 = 60;
const TRUNK: u16 = 71;
const POLE: u16 = 80;
const TRAFFIC_SIGN: u16 = 81;

/// Points within this of a pole's axis are on it, metres: its radius and noise.
const POLE_REACH_M: f64 = 0.2;
/// Lower than this above the foot is ground and grass, metres.
const OVER_FOOT_M: f64 = 0.3;
/// Points within this of a lane line are on it, metres: half its width and noise.
const LANE_REACH_M: f64 = 0.1;
/// Farthest point of a lane line that is looked at, metres: farther off, the
/// beams meet the road so flatly that their height tells nothing.
const LANE_FARTHEST_M: f64 = 25.0;
/// Fewest points that tell what a landmark is.
const FEWEST_POINTS: usize = 10;
/// Labelled points within this of each other, seen from above, are one pole, metres.
const JOIN_M: f64 = 0.3;
/// Least height of a labelled pole, metres: less of it was not seen as one.
const LEAST_HEIGHT_M: f64 = 0.6;
/// A pole of the map within this of a labelled one is it, metres.
const WITHIN_M: f64 = 0.5;

/// Labelled points in the frame of the map.
#[derive(Debug, Clone, Default)]
pub struct Labelled {
    /// Positions, map frame, metres, with labels.
    pub points: Vec<(Point3<f64>, u16)>,
    /// The frames that they are from.
    pub frames: Vec<usize>,
    /// Where the camera was in them, map frame, metres.
    pub cameras: Vec<Point3<f64>>,
}

/// What the points on one landmark are labelled.
#[derive(Debug, Clone, PartialEq)]
pub struct OnLandmark {
    /// What the map says that it is.
    pub kind: String,
    /// Its place from above, map (x, z), metres.
    pub at: Point2<f64>,
    /// Points on it.
    pub points: usize,
    /// Of these, those with the right label.
    pub right: usize,
    /// The most frequent label among them.
    pub mostly: u16,
}

/// A labelled pole.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelledPole {
    /// Mean of its points from above, map (x, z), metres.
    pub at: Point2<f64>,
    /// Points.
    pub points: usize,
    /// From its lowest to its highest point, metres.
    pub height_m: f64,
    /// Whether a pole of the map is there.
    pub is_found: bool,
}

/// The score of a map.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LabelScore {
    /// Landmarks with enough labelled points on them, in the map's order.
    pub landmarks: Vec<OnLandmark>,
    /// Labelled poles, by place.
    pub poles: Vec<LabelledPole>,
}

/// Reads the labelled scans of a sequence at the poses that a map was built with.
///
/// # Errors
/// One sentence that names what cannot be read.
pub fn read(sequence: &Sequence, map_from_camera: &[Pose]) -> Result<Labelled, String> {
    let folder = sequence.folder().join("labels");
    let calibration = sequence.calibration().map_err(|error| error.to_string())?;
    let mut labelled = Labelled::default();
    for frame in sequence.scan_frames().map_err(|error| error.to_string())? {
        let path = folder.join(format!("{frame:06}.label"));
        let (Some(pose), true) = (map_from_camera.get(frame), path.is_file()) else { continue };
        let scan = read_scan(sequence.scan_path(frame), f32::INFINITY).map_err(|error| error.to_string())?;
        let bytes = std::fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        let (labels, rest) = bytes.as_chunks::<4>();
        if !rest.is_empty() || labels.len() != scan.points.len() {
            return Err(format!(
                "{} has {} bytes and its scan {} points; take the labels of the same scan",
                path.display(),
                bytes.len(),
                scan.points.len()
            ));
        }
        let map_from_velodyne = pose * calibration.camera_from_velodyne;
        labelled.points.extend(scan.points.iter().zip(labels).map(|(p, label)| {
            let at = Point3::new(f64::from(p.x_m), f64::from(p.y_m), f64::from(p.z_m));
            (map_from_velodyne * at, u16::from_le_bytes([label[0], label[1]]))
        }));
        labelled.frames.push(frame);
        labelled.cameras.push(pose.translation.vector.into());
    }
    if labelled.frames.is_empty() {
        return Err(format!(
            "{} holds no labels of scans; give a sequence with `labels/NNNNNN.label`",
            folder.display()
        ));
    }
    Ok(labelled)
}

/// Scores what lies within `within_m` of a labelled frame's camera.
pub fn score(map: &SemanticMap, labelled: &Labelled, within_m: f64) -> LabelScore {
    let counts = |at: &Point2<f64>| labelled.cameras.iter().any(|camera| (above(camera) - at).norm() < within_m);
    let points: Vec<(Point3<f64>, u16)> = labelled.points.iter().filter(|(p, _)| counts(&above(p))).copied().collect();
    let mut landmarks = Vec::new();
    for pole in map.poles.iter().filter(|pole| counts(&above(&pole.foot_map))) {
        let way = pole.top_map - pole.foot_map;
        let is_on = |p: &Point3<f64>| {
            let along = (p - pole.foot_map).dot(&way) / way.norm_squared().max(1e-12);
            let off = p - (pole.foot_map + way * along);
            along * way.norm() > OVER_FOOT_M && along <= 1.0 && off.norm() < POLE_REACH_M
        };
        let right: &[u16] = if pole.kind == PoleKind::Trunk { &[TRUNK] } else { &[POLE, TRAFFIC_SIGN] };
        landmarks.extend(on_landmark(pole.kind.name(), above(&pole.foot_map), &points, is_on, right));
    }
    for sign in map.signs.iter().filter(|sign| counts(&above(&sign.centroid_map))) {
        let is_on = |p: &Point3<f64>| (p - sign.centroid_map).norm() < sign.size_m / 2.0;
        landmarks.extend(on_landmark(sign.kind.name(), above(&sign.centroid_map), &points, is_on, &[TRAFFIC_SIGN]));
    }
    let is_near = |p: &Point3<f64>| labelled.cameras.iter().any(|camera| (camera - p).norm() < LANE_FARTHEST_M);
    for lane in &map.lanes {
        let Some(first) = lane.points_map.first() else { continue };
        let is_on = |p: &Point3<f64>| {
            lane.points_map.windows(2).any(|pair| distance_to_segment(p, [&pair[0], &pair[1]]) < LANE_REACH_M)
                && is_near(p)
        };
        landmarks.extend(on_landmark(lane.kind.name(), above(first), &points, is_on, &[LANE_MARKING]));
    }
    let poles = labelled_poles(&points, map);
    LabelScore { landmarks, poles }
}

fn on_landmark(
    kind: &str,
    at: Point2<f64>,
    points: &[(Point3<f64>, u16)],
    is_on: impl Fn(&Point3<f64>) -> bool,
    right: &[u16],
) -> Option<OnLandmark> {
    let mut by_label: BTreeMap<u16, usize> = BTreeMap::new();
    for (_, label) in points.iter().filter(|(p, _)| is_on(p)) {
        *by_label.entry(*label).or_default() += 1;
    }
    let count = by_label.values().sum();
    let (mostly, _) = by_label.iter().max_by_key(|(_, n)| **n)?;
    let of_right = right.iter().filter_map(|label| by_label.get(label)).sum();
    (count >= FEWEST_POINTS).then(|| OnLandmark {
        kind: kind.into(),
        at,
        points: count,
        right: of_right,
        mostly: *mostly,
    })
}

/// Clusters of points labelled as poles, seen from above.
fn labelled_poles(points: &[(Point3<f64>, u16)], map: &SemanticMap) -> Vec<LabelledPole> {
    let cell = |p: &Point3<f64>| ((p.x / JOIN_M).floor() as i64, (p.z / JOIN_M).floor() as i64);
    let mut cells: BTreeMap<(i64, i64), Vec<Point3<f64>>> = BTreeMap::new();
    for (p, _) in points.iter().filter(|(_, label)| *label == POLE) {
        cells.entry(cell(p)).or_default().push(*p);
    }
    let mut left: BTreeSet<(i64, i64)> = cells.keys().copied().collect();
    let mut poles = Vec::new();
    while let Some(seed) = left.pop_first() {
        let (mut open, mut members) = (vec![seed], Vec::new());
        while let Some((x, z)) = open.pop() {
            members.extend(cells.get(&(x, z)).into_iter().flatten());
            for next in (-1..=1).flat_map(|dx| (-1..=1).map(move |dz| (x + dx, z + dz))) {
                if left.remove(&next) {
                    open.push(next);
                }
            }
        }
        let (low, high) = members
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p: &&Point3<f64>| (low.min(p.y), high.max(p.y)));
        if members.len() < FEWEST_POINTS || high - low < LEAST_HEIGHT_M {
            continue;
        }
        let sum: Vector2<f64> = members.iter().map(|p| above(p).coords).sum();
        let at = Point2::from(sum / members.len() as f64);
        // Arms and lamps draw the mean away from the post: any of its points may meet the axis.
        let is_found = map.poles.iter().any(|pole| {
            let middle = above(&nalgebra::center(&pole.foot_map, &pole.top_map));
            (middle - at).norm() < WITHIN_M || members.iter().any(|p| (above(p) - middle).norm() < POLE_REACH_M)
        });
        poles.push(LabelledPole { at, points: members.len(), height_m: high - low, is_found });
    }
    poles
}

#[cfg(test)]
mod tests {
    use common::map::{Pole, RoadId};

    use super::*;

    #[test]
    fn shares_misses_and_false_ones_are_told() {
        let pole = |x: f64| Pole {
            kind: PoleKind::LampPost,
            foot_map: Point3::new(x, 1.6, 10.0),
            top_map: Point3::new(x, -1.4, 10.0),
            road: RoadId(0),
        };
        let column = |x: f64, label: u16| {
            (0..20).map(move |k| (Point3::new(x, 1.2 - 0.1 * f64::from(k), 10.0), label)).collect::<Vec<_>>()
        };
        // A pole that is one, a hedge that is none, a pole that is missing, and one too far off to count.
        let labelled = Labelled {
            points: [column(4.0, POLE), column(7.0, 70), column(-5.0, POLE), column(90.0, POLE)].concat(),
            frames: vec![0],
            cameras: vec![Point3::origin()],
        };
        let map = SemanticMap { poles: vec![pole(4.05), pole(7.0), pole(90.0)], ..SemanticMap::default() };
        let score = score(&map, &labelled, 15.0);
        let of: Vec<_> = score.landmarks.iter().map(|l| (l.points, l.right, l.mostly)).collect();
        assert_eq!(of, [(20, 20, POLE), (20, 0, 70)]);
        let poles: Vec<_> = score.poles.iter().map(|p| (p.at.x.round() as i64, p.is_found)).collect();
        assert_eq!(poles, [(-5, false), (4, true)]);
    }
}
