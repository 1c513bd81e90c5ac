//! Places that the drive comes back to: the motion between both passes, from
//! their scans, so that a survey that drifted draws nothing twice.

use std::collections::BTreeMap;

use common::geometry::Pose;
use nalgebra::Point3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::RefineConfig;
use super::align::{Alignment, align, scan_surfaces};
use super::graph::{Motion, Revisit, squared_sigmas};
use super::local_map::LocalMap;
use super::odometry::{BATCH, adjoint, raised_cells, read_cells};
use super::search::{SearchConfig, shifted};
use crate::drive::Drive;
use crate::error::Result;
use crate::fuse::Buckets;
use crate::roads::driven_m;
use crate::voxel::Moments;

/// Which places count as seen again, and when both passes are tied together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RevisitConfig {
    /// Whether passes are tied together.
    pub tie: bool,
    /// Farthest from an earlier place, metres from above: the other lanes of
    /// the road, and what the survey may have drifted.
    pub within_m: f64,
    /// Largest difference in height, metres: a road over a road is farther
    /// off, what surveys drift is less.
    pub storey_m: f64,
    /// Least way driven between both passes, metres: nearer scans have seen
    /// each other already.
    pub least_way_m: f64,
    /// Way driven between two such places, metres.
    pub spacing_m: f64,
    /// Scans of the earlier pass on each side of the nearest that the later
    /// one is laid on: they see what it sees from its own side.
    pub scans_beside: usize,
    /// Search of the first guess.
    pub search: SearchConfig,
    /// Least share of the scan's surfaces that lie on surfaces of the other
    /// pass.
    pub least_overlap: f64,
    /// Way driven within which other places have to agree, metres.
    pub agree_within_m: f64,
    /// Largest difference of the shift between two places that agree, metres:
    /// what registration drifts over the way between them.
    pub agree_m: f64,
    /// The same, radians.
    pub agree_rad: f64,
    /// Fewest places near by that have to agree.
    pub fewest_agreeing: usize,
    /// What is farther than this from the refined poses is left out in the
    /// end, standard deviations over all six directions (0.1 % of chance).
    pub largest_sigmas: f64,
}

impl Default for RevisitConfig {
    fn default() -> Self {
        Self {
            tie: true,
            within_m: 10.0,
            storey_m: 4.0,
            least_way_m: 50.0,
            spacing_m: 8.0,
            scans_beside: 2,
            search: SearchConfig::default(),
            least_overlap: 0.3,
            agree_within_m: 30.0,
            agree_m: 0.2,
            agree_rad: 0.01,
            fewest_agreeing: 2,
            largest_sigmas: 4.7,
        }
    }
}

/// What the places that the drive comes back to gave.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct RevisitReport {
    /// Places at which the drive comes back.
    pub places: usize,
    /// Of these, the scans of both passes could be laid on each other at.
    pub aligned: usize,
    /// Of these, places that agree with each other and tie the passes.
    pub kept: usize,
    /// Root mean square distance of both passes at the places kept without
    /// tying them, metres.
    pub apart_before_m: f64,
    /// The same with the passes tied, metres.
    pub apart_after_m: f64,
}

/// Indices of two stitched frames at one place, the earlier first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    before: usize,
    after: usize,
}

/// Places, one in `spacing_m`, at which the drive is back near an earlier one,
/// each with the nearest.
fn places(poses: &[Pose], driven: &[f64], config: &RevisitConfig) -> Vec<Place> {
    let mut seen = Buckets::new(config.within_m.max(1.0));
    let (mut found, mut added) = (Vec::new(), 0);
    let mut last_m = f64::NEG_INFINITY;
    for (after, pose) in poses.iter().enumerate() {
        while added < after && driven[after] - driven[added] >= config.least_way_m {
            seen.add(&poses[added].translation.vector.into(), added);
            added += 1;
        }
        if driven[after] - last_m < config.spacing_m {
            continue;
        }
        let apart = |k: usize| poses[k].translation.vector - pose.translation.vector;
        let nearest = seen
            .near(&pose.translation.vector.into(), config.within_m)
            .map(|k| (apart(k), k))
            .filter(|(d, _)| d.y.abs() <= config.storey_m)
            .map(|(d, k)| (d.x.hypot(d.z), k))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        if let Some((distance_m, before)) = nearest
            && distance_m <= config.within_m
        {
            found.push(Place { before, after });
            last_m = driven[after];
        }
    }
    found
}

/// The passes laid on each other at the places that the drive comes back to,
/// given poses (`map_from_camera`) of its stitched frames without them and the
/// motions between these, which tell what agrees: they drift, but never jump.
///
/// # Errors
/// A scan that cannot be read.
pub(super) fn find_revisits(
    drive: &Drive,
    poses: &[Pose],
    motions: &[Motion],
    angle_rad: f64,
    config: &RefineConfig,
) -> Result<(Vec<Revisit>, RevisitReport)> {
    let settings = &config.revisits;
    let driven = driven_m(poses);
    let places = if settings.tie { places(poses, &driven, settings) } else { Vec::new() };
    let mut cells: BTreeMap<usize, Vec<Moments>> = BTreeMap::new();
    let mut aligned: Vec<Revisit> = Vec::new();
    for batch in places.chunks(BATCH) {
        let beside =
            |k: usize| k.saturating_sub(settings.scans_beside)..=(k + settings.scans_beside).min(poses.len() - 1);
        let mut needed: Vec<usize> = batch.iter().flat_map(|p| beside(p.before).chain([p.after])).collect();
        needed.sort_unstable();
        needed.dedup();
        // Neighbouring places share scans; those of earlier batches may go.
        cells.retain(|k, _| needed.binary_search(k).is_ok());
        let missing: Vec<usize> = needed.into_iter().filter(|k| !cells.contains_key(k)).collect();
        let read: Vec<Result<_>> = missing
            .par_iter()
            .map(|&k| Ok((k, raised_cells(&read_cells(drive, drive.frames[k], &config.align)?, angle_rad))))
            .collect();
        for scan in read {
            let (k, scan) = scan?;
            cells.insert(k, scan);
        }
        let found: Vec<Option<Revisit>> = batch
            .par_iter()
            .map(|place| lay(place, beside(place.before), &cells, poses, &drive.camera_from_velodyne, config))
            .collect();
        aligned.extend(found.into_iter().flatten());
    }
    let kept = agreeing(&aligned, &composed(motions), &driven, settings);
    let report = RevisitReport {
        places: places.len(),
        aligned: aligned.len(),
        kept: kept.len(),
        apart_before_m: apart_m(&kept, poses),
        apart_after_m: 0.0,
    };
    Ok((kept, report))
}

/// Lays the scan of the later pass on those of the earlier one.
fn lay(
    place: &Place,
    beside: std::ops::RangeInclusive<usize>,
    cells: &BTreeMap<usize, Vec<Moments>>,
    poses: &[Pose],
    camera_from_velodyne: &Pose,
    config: &RefineConfig,
) -> Option<Revisit> {
    let settings = &config.revisits;
    let mut map = LocalMap::new(config.align.map_voxel_m, usize::MAX / 2, config.align.surface);
    for k in beside {
        map.insert(0, cells.get(&k)?, &(poses[k] * camera_from_velodyne));
    }
    let scan = scan_surfaces(cells.get(&place.after)?, &config.align.surface);
    let guess = poses[place.after] * camera_from_velodyne;
    let (guess, rival) = shifted(&map, &scan, &guess, &settings.search);
    if rival > settings.search.largest_rival {
        return None;
    }
    let Alignment { map_from_velodyne, information, overlap, .. } = align(&map, &scan, &guess, &config.align);
    if overlap < settings.least_overlap {
        return None;
    }
    let velodyne_from_camera = camera_from_velodyne.inverse();
    let tangent = adjoint(&velodyne_from_camera);
    Some(Revisit {
        before: place.before,
        after: place.after,
        before_from_after: poses[place.before].inverse() * map_from_velodyne * velodyne_from_camera,
        information: tangent.transpose() * information * tangent,
    })
}

/// The poses that the motions alone lead to, from the first one on.
fn composed(motions: &[Motion]) -> Vec<Pose> {
    let mut poses = vec![Pose::identity()];
    let mut pose = Pose::identity();
    for motion in motions {
        pose *= motion.before_from_after;
        poses.push(pose);
    }
    poses
}

/// What takes the later pass to the earlier one, map frame.
fn correction(revisit: &Revisit, poses: &[Pose]) -> Pose {
    poses[revisit.before] * revisit.before_from_after * poses[revisit.after].inverse()
}

/// The revisits that enough of their neighbours on both passes agree with:
/// what both passes drifted apart changes slowly, false matches lie anywhere.
fn agreeing(revisits: &[Revisit], poses: &[Pose], driven: &[f64], config: &RevisitConfig) -> Vec<Revisit> {
    let corrections: Vec<Pose> = revisits.iter().map(|r| correction(r, poses)).collect();
    let near = |a: &Revisit, b: &Revisit| {
        (driven[a.after] - driven[b.after]).abs() <= config.agree_within_m
            && (driven[a.before] - driven[b.before]).abs() <= config.agree_within_m
    };
    let agrees = |a: usize, b: usize| {
        let here: Point3<f64> = poses[revisits[a].after].translation.vector.into();
        near(&revisits[a], &revisits[b])
            && (corrections[a] * here - corrections[b] * here).norm() <= config.agree_m
            && corrections[a].rotation.angle_to(&corrections[b].rotation) <= config.agree_rad
    };
    (0..revisits.len())
        .filter(|&a| {
            // Ascending by the later pass: neighbours stand beside each other.
            let way =
                |b: &usize| (driven[revisits[a].after] - driven[revisits[*b].after]).abs() <= config.agree_within_m;
            let others = (0..a).rev().take_while(way).chain((a + 1..revisits.len()).take_while(way));
            others.filter(|&b| agrees(a, b)).count() >= config.fewest_agreeing
        })
        .map(|a| revisits[a])
        .collect()
}

/// Root mean square distance of both passes at revisits, metres.
pub(super) fn apart_m(revisits: &[Revisit], poses: &[Pose]) -> f64 {
    let apart =
        |r: &Revisit| (poses[r.before] * r.before_from_after).translation.vector - poses[r.after].translation.vector;
    let sum: f64 = revisits.iter().map(|r| apart(r).norm_squared()).sum();
    if revisits.is_empty() { 0.0 } else { (sum / revisits.len() as f64).sqrt() }
}

/// Whether a revisit is as near to refined poses as its accuracy says.
pub(super) fn fits(revisit: &Revisit, poses: &[Pose], config: &RefineConfig) -> bool {
    squared_sigmas(revisit, poses, &config.graph) <= config.revisits.largest_sigmas.powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix6;

    /// A round of 200 m and another on the next lane, then away.
    fn drive() -> Vec<Pose> {
        let round = |i: usize, radius: f64| {
            let a = i as f64 / 40.0 * std::f64::consts::TAU;
            Pose::new(
                nalgebra::Vector3::new(radius * (1.0 - a.cos()), 0.0, radius * a.sin()),
                nalgebra::Vector3::new(0.0, a, 0.0),
            )
        };
        let away = (0..20).map(|i| Pose::translation(60.0 + f64::from(i) * 5.0, 0.0, 80.0));
        (0..40).map(|i| round(i, 32.0)).chain((0..40).map(|i| round(i, 29.0))).chain(away).collect()
    }

    fn ties(poses: &[Pose], places: &[Place]) -> Vec<Revisit> {
        places
            .iter()
            .map(|p| Revisit {
                before: p.before,
                after: p.after,
                before_from_after: poses[p.before].inverse() * poses[p.after],
                information: Matrix6::identity(),
            })
            .collect()
    }

    #[test]
    fn the_second_round_is_seen_again_and_the_rest_is_not() {
        let poses = drive();
        let config = RevisitConfig::default();
        let found = places(&poses, &driven_m(&poses), &config);
        assert!((18..=26).contains(&found.len()), "{}", found.len());
        assert!(found.iter().all(|p| (38..80).contains(&p.after) && p.before + 30 < p.after));
        let high: Vec<Pose> =
            poses.iter().enumerate().map(|(i, p)| Pose::translation(0.0, i as f64 / 5.0, 0.0) * p).collect();
        assert!(places(&high, &driven_m(&high), &config).is_empty(), "a road over a road is another");
    }

    #[test]
    fn a_place_that_no_neighbour_agrees_with_ties_nothing() {
        let poses = drive();
        let config = RevisitConfig::default();
        let driven = driven_m(&poses);
        let mut found = ties(&poses, &places(&poses, &driven, &config));
        let all = found.len();
        assert_eq!(agreeing(&found, &poses, &driven, &config).len(), all);
        found[7].before_from_after *= Pose::translation(0.5, 0.0, 1.0);
        let kept = agreeing(&found, &poses, &driven, &config);
        assert_eq!(kept.len(), all - 1);
        assert!(kept.iter().all(|r| r.after != found[7].after));
        assert!(agreeing(&found[..1], &poses, &driven, &config).is_empty(), "alone it cannot be checked");
    }
}
