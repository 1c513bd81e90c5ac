//! Stretches of the driven road, so that the localizer looks near by.

use std::ops::Range;

use common::geometry::Pose;
use common::map::Road;
use nalgebra::{Point3, Vector2, Vector3, distance};
use serde::{Deserialize, Serialize};

use crate::fuse::Buckets;
use crate::lanes::simplify;
use crate::path::Way;

/// How the drive is cut into roads and windows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RoadConfig {
    /// Length of a road stretch, metres: what a camera sees landmarks over.
    pub length_m: f64,
    /// Tolerance of the path of a stretch, metres: it tells the camera's
    /// height and place to a localizer that starts.
    pub tolerance_m: f64,
    /// Number of stretches whose cloud is held in memory at a time.
    pub per_window: usize,
    /// Farthest from the path of a road at which another pass drives on it,
    /// metres: two lanes to the side; parallel streets are farther apart.
    pub carriageway_m: f64,
    /// Largest angle against it, radians, there or back: more is a crossing.
    pub parallel_rad: f64,
    /// Largest difference in height, metres: a road over another is higher.
    pub storey_m: f64,
    /// Least way driven until a road can be come back to, metres.
    pub least_way_m: f64,
    /// Shorter pieces between others of one kind are of that kind, metres:
    /// paths wander at the edge of a carriageway, and turn into it.
    pub shortest_m: f64,
    /// Longest way from one frame of the survey to the next, metres: that of a
    /// train in some seconds. What is farther apart are two drives, or a fault.
    pub longest_step_m: f64,
    /// Farthest place from the origin of the poses, metres: distances are compared
    /// by squares of coordinates, which there are off by a square centimetre.
    pub farthest_m: f64,
}

impl Default for RoadConfig {
    fn default() -> Self {
        Self {
            length_m: 50.0,
            tolerance_m: 0.1,
            per_window: 3,
            carriageway_m: 8.0,
            parallel_rad: 0.5,
            storey_m: 4.0,
            least_way_m: 50.0,
            shortest_m: 15.0,
            longest_step_m: 500.0,
            farthest_m: 1e6,
        }
    }
}

/// A stretch of the drive: its frames and where it begins.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// First frame.
    pub first: usize,
    /// Last frame: the first of the next stretch, but for the last one.
    pub last: usize,
    /// Whether it runs along a road that an earlier stretch has given: it
    /// gives none, and its landmarks join that road.
    pub is_again: bool,
}

/// Cuts the frames `first..=last` into stretches of about the same length,
/// none of which is partly on a road that is there already.
pub fn stretches(map_from_camera: &[Pose], first: usize, last: usize, config: &RoadConfig) -> Vec<Stretch> {
    let driven_m = driven_m(&map_from_camera[first..=last]);
    let again = driven_again(&map_from_camera[first..=last], &driven_m, config);
    runs(&again)
        .into_iter()
        .flat_map(|run| {
            // Stretches share their ends, also where one kind follows the other.
            let end = (run.end).min(again.len() - 1);
            cut(&driven_m[run.start..=end], config.length_m)
                .into_iter()
                .map(move |(a, b)| (run.start + a, run.start + b))
        })
        .map(|(a, b)| Stretch { first: first + a, last: first + b, is_again: again[a] })
        .collect()
}

/// Way driven to each pose, metres, ascending.
pub(crate) fn driven_m(poses: &[Pose]) -> Vec<f64> {
    let mut way = Way::default();
    poses.iter().map(|pose| way.to(Point3::from(pose.translation.vector))).collect()
}

/// Cuts a way, given by the distance driven to each of its frames, into pieces
/// of about a length; first and last frame of each.
fn cut(driven_m: &[f64], length_m: f64) -> Vec<(usize, usize)> {
    let (Some(start), Some(end)) = (driven_m.first(), driven_m.last()) else { return Vec::new() };
    let count = ((end - start) / length_m).round().max(1.0);
    let each = (end - start) / count;
    let mut cuts = vec![0];
    for (f, way) in driven_m.iter().enumerate().skip(1) {
        if way - start >= each * cuts.len() as f64 - 1e-9 && (cuts.len() as f64) < count {
            cuts.push(f);
        }
    }
    cuts.push(driven_m.len() - 1);
    cuts.windows(2).map(|w| (w[0], w[1])).collect()
}

/// Which frames are on a road that the drive was on before.
fn driven_again(poses: &[Pose], driven_m: &[f64], config: &RoadConfig) -> Vec<bool> {
    let ahead = |p: &Pose| {
        let v = p.rotation * Vector3::z();
        Vector2::new(v.x, v.z).normalize()
    };
    let least_cos = config.parallel_rad.cos();
    let mut roads = Buckets::new(config.carriageway_m.max(1.0));
    let mut again: Vec<bool> = Vec::with_capacity(poses.len());
    let mut added = 0;
    for (f, pose) in poses.iter().enumerate() {
        while added < f && driven_m[f] - driven_m[added] >= config.least_way_m {
            if !again[added] {
                roads.add(&poses[added].translation.vector.into(), added);
            }
            added += 1;
        }
        let along = |k: usize| {
            let apart = poses[k].translation.vector - pose.translation.vector;
            apart.x.hypot(apart.z) <= config.carriageway_m
                && apart.y.abs() <= config.storey_m
                && ahead(&poses[k]).dot(&ahead(pose)).abs() >= least_cos
        };
        again.push(roads.near(&pose.translation.vector.into(), config.carriageway_m).any(along));
    }
    // Short pieces of a road's own first: else a wandering path ends both.
    for kind in [false, true] {
        for run in runs(&again) {
            let is_inner = run.start > 0 && run.end < again.len();
            let length_m = driven_m[run.end.min(again.len() - 1)] - driven_m[run.start];
            if again[run.start] == kind && (is_inner || kind) && length_m < config.shortest_m {
                again[run].fill(!kind);
            }
        }
    }
    again
}

/// Runs of equal values.
pub(crate) fn runs<T: PartialEq>(values: &[T]) -> Vec<Range<usize>> {
    let mut start = 0;
    values
        .chunk_by(|a, b| a == b)
        .map(|run| {
            start += run.len();
            start - run.len()..start
        })
        .collect()
}

/// The road of a stretch.
pub fn road(map_from_camera: &[Pose], stretch: &Stretch, config: &RoadConfig) -> Road {
    let mut centres: Vec<Point3<f64>> =
        map_from_camera[stretch.first..=stretch.last].iter().map(|p| p.translation.vector.into()).collect();
    // A vehicle that stands is at one place, however long: but for the end, where
    // the next stretch begins.
    let end = centres.pop();
    centres.dedup_by(|next, kept| distance(next, kept) < config.tolerance_m);
    centres.extend(end);
    let kept = simplify(&centres, config.tolerance_m);
    Road { path_map: kept.into_iter().map(|i| centres[i]).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_cover_the_drive_without_a_gap() {
        let poses: Vec<Pose> = (0..271).map(|i| Pose::translation(0.0, 0.0, f64::from(i) * 1.46)).collect();
        let cut = stretches(&poses, 0, 270, &RoadConfig::default());
        assert_eq!(cut.len(), 8);
        assert_eq!((cut[0].first, cut[7].last), (0, 270));
        assert!(cut.windows(2).all(|w| w[0].last == w[1].first));
    }

    #[test]
    fn a_vehicle_that_stands_still_has_one_stretch() {
        let cut = stretches(&[Pose::identity(); 4], 0, 3, &RoadConfig::default());
        assert_eq!(cut, vec![Stretch { first: 0, last: 3, is_again: false }]);
    }

    /// 60 m, three minutes at a light, where the positions shake, and 60 m.
    fn with_a_stop() -> Vec<Pose> {
        let ahead = |i: i32| Pose::translation(0.0, 0.0, f64::from(i));
        let shaking = |i: i32| Pose::translation(0.02 * f64::from(i % 3), 0.0, 60.0 + 0.02 * f64::from(i % 2));
        (0..60).map(ahead).chain((0..1800).map(shaking)).chain((60..=120).map(ahead)).collect()
    }

    #[test]
    fn a_stop_makes_no_stretch_and_nothing_behind_it_is_driven_again() {
        let poses = with_a_stop();
        let cut = stretches(&poses, 0, poses.len() - 1, &RoadConfig::default());
        assert_eq!(cut.len(), 2, "{cut:?}");
        assert!(cut.iter().all(|stretch| !stretch.is_again), "{cut:?}");
    }

    /// Up a street of 300 m, round a block, and the street again: on the next
    /// lane, the other way.
    fn there_and_back() -> Vec<Pose> {
        let up = (0..300).map(|i| Pose::translation(0.0, 0.0, f64::from(i)));
        let turn = |a: f64| {
            Pose::new(Vector3::new(10.0 - 10.0 * a.cos(), 0.0, 300.0 + 10.0 * a.sin()), Vector3::new(0.0, a, 0.0))
        };
        let bend = (0..12).map(|i| turn(f64::from(i) * 0.1));
        let side = (0..100).map(|i| Pose::translation(10.0 + f64::from(i), 0.0, 310.0));
        let back = |i: i32| {
            Pose::new(Vector3::new(3.5, 0.0, f64::from(300 - i)), Vector3::new(0.0, std::f64::consts::PI, 0.0))
        };
        up.chain(bend).chain(side).chain((0..300).map(back)).collect()
    }

    #[test]
    fn a_street_driven_again_is_one_road() {
        let poses = there_and_back();
        let cut = stretches(&poses, 0, poses.len() - 1, &RoadConfig::default());
        assert!(cut.windows(2).all(|w| w[0].last == w[1].first), "{cut:?}");
        let new: f64 = cut.iter().filter(|s| !s.is_again).map(|s| (s.last - s.first) as f64).sum();
        assert!((395.0..430.0).contains(&new), "{new}");
        assert!(cut.iter().filter(|s| s.is_again).all(|s| s.first >= 400), "{cut:?}");
        let bridge: Vec<Pose> = poses
            .iter()
            .enumerate()
            .map(|(i, p)| Pose::translation(0.0, if i > 405 { -6.0 } else { 0.0 }, 0.0) * p)
            .collect();
        assert!(stretches(&bridge, 0, bridge.len() - 1, &RoadConfig::default()).iter().all(|s| !s.is_again));
    }

    #[test]
    fn a_stop_costs_the_road_no_vertex() {
        let poses = with_a_stop();
        let stretch = Stretch { first: 0, last: poses.len() - 1, is_again: false };
        assert_eq!(road(&poses, &stretch, &RoadConfig::default()).path_map.len(), 2);
    }

    #[test]
    fn a_crossing_is_no_road_driven_again() {
        let along = (0..200).map(|i| Pose::translation(0.0, 0.0, f64::from(i)));
        let across = (0..200).map(|i| {
            Pose::new(
                Vector3::new(f64::from(i) - 100.0, 0.0, 80.0),
                Vector3::new(0.0, std::f64::consts::FRAC_PI_2, 0.0),
            )
        });
        let poses: Vec<Pose> = along.chain(across).collect();
        assert!(stretches(&poses, 0, 399, &RoadConfig::default()).iter().all(|s| !s.is_again));
    }
}
