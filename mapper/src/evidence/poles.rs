//! Uncertainty of the foot of a pole.

use common::map::Pole;
use nalgebra::{Matrix3, Point2, Vector2};

use super::scatter::Scatter;
use super::{EvidenceConfig, PointEvidence};
use crate::cloud::{Cloud, CloudPoint};
use crate::quantile::upper_median;

/// A hit near the axis: how far off it, and from where it was seen.
struct Hit {
    off_m: Vector2<f64>,
    from_lidar: Vector2<f64>,
    height_m: f64,
    scan: u16,
}

/// How well the foot of a pole is known, from the cloud that it was found in.
///
/// The foot is the axis at the height of the ground: the error of the axis
/// where its hits are (their scatter, and the surface that hides it), carried
/// down with that of its slope.
pub fn of_pole(cloud: &Cloud, pole: &Pole, config: &EvidenceConfig) -> PointEvidence {
    let foot = Point2::new(pole.foot_map.x, pole.foot_map.z);
    let ground_m = if cloud.ground.is_seen(&foot) { config.ground_sigma_m } else { config.unseen_ground_sigma_m };
    let hits = hits(cloud, pole, config);
    let mut scatter = Scatter::<2>::default();
    let before_m =
        upper_median(hits.iter().map(|hit| -hit.off_m.dot(&hit.from_lidar)).collect()).clamp(0.0, LARGEST_RADIUS_M);
    for hit in &hits {
        let residual_m = hit.off_m + hit.from_lidar * before_m;
        if residual_m.norm() < config.reach_m {
            scatter.add(hit.scan, (hit.height_m / config.slice_m).floor() as i64, residual_m);
        }
    }
    let height = |cell: i64| (cell as f64 + 0.5) * config.slice_m;
    let count = scatter.cells().count() as f64;
    if count < 1.0 {
        let across = config.unknown_sigma_m.powi(2);
        return evidence(across, Vector2::zeros(), ground_m, config, (0, 0));
    }
    let components = scatter.components(config);
    let middle_m = scatter.cells().map(|(_, cell, _)| height(cell)).sum::<f64>() / count;
    let rise_m2: f64 = scatter.cells().map(|(_, cell, _)| (height(cell) - middle_m).powi(2)).sum();
    // Precision of the slices and of what is known of poles before.
    let slope2 = (rise_m2 / components.cell + config.tilt_sigma_rad.powi(-2)).recip();
    let lever_m = middle_m + pole.foot_map.y;
    // Seen from both sides, what is not known of the surface cancels.
    let views = hits.iter().map(|hit| hit.from_lidar).sum::<Vector2<f64>>() / hits.len().max(1) as f64;
    evidence(
        components.mean + slope2 * lever_m * lever_m,
        views * config.surface_sigma_m,
        ground_m,
        config,
        (scatter.points(), scatter.scans()),
    )
}

/// Largest radius of a pole, metres: what lies farther before the axis is not
/// its surface.
const LARGEST_RADIUS_M: f64 = 0.35;

fn hits(cloud: &Cloud, pole: &Pole, config: &EvidenceConfig) -> Vec<Hit> {
    let (foot, top) = (pole.foot_map, pole.top_map);
    let rise_m = (foot.y - top.y).max(1e-6);
    let hit = |p: &CloudPoint| {
        let share = (foot.y - p.position.y) / rise_m;
        let axis = foot + (top - foot) * share;
        let off_m = Vector2::new(p.position.x - axis.x, p.position.z - axis.z);
        if !(0.0..=1.0).contains(&share) || off_m.norm() > config.reach_m + LARGEST_RADIUS_M {
            return None;
        }
        let sensor = cloud.sensors.get(usize::from(p.scan))?.at_map;
        let from_lidar = Vector2::new(axis.x - sensor.x, axis.z - sensor.z).try_normalize(1e-6)?;
        Some(Hit { off_m, from_lidar, height_m: -p.position.y, scan: p.scan })
    };
    cloud.near(&Point2::new(foot.x, foot.z)).filter_map(hit).collect()
}

fn evidence(
    across_m2: f64,
    surface_m: Vector2<f64>,
    ground_m: f64,
    config: &EvidenceConfig,
    (points, scans): (usize, usize),
) -> PointEvidence {
    let floor_m2 = config.floor_m.powi(2);
    let mut covariance = Matrix3::from_diagonal(&nalgebra::Vector3::new(
        across_m2 + floor_m2,
        ground_m * ground_m + floor_m2,
        across_m2 + floor_m2,
    ));
    covariance[(0, 0)] += surface_m.x * surface_m.x;
    covariance[(2, 2)] += surface_m.y * surface_m.y;
    covariance[(0, 2)] += surface_m.x * surface_m.y;
    covariance[(2, 0)] += surface_m.x * surface_m.y;
    PointEvidence::new(&covariance, points, scans)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{CAMERA_HEIGHT_M, Street};
    use common::map::{PoleKind, RoadId};
    use nalgebra::{Point3, Vector3};

    fn pole(foot: Point3<f64>, height_m: f64) -> Pole {
        let top_map = foot - Vector3::new(0.0, height_m, 0.0);
        Pole { kind: PoleKind::LampPost, foot_map: foot, top_map, road: RoadId(0) }
    }

    #[test]
    fn a_pole_that_was_seen_is_known_better_than_one_that_was_not() {
        let config = EvidenceConfig::default();
        let mut street = Street::new();
        let foot = Point3::new(5.0, CAMERA_HEIGHT_M, 28.0);
        street.add_cylinder(foot, foot - Vector3::new(0.0, 4.0, 0.0), 0.08);
        let cloud = street.cloud();
        let seen = of_pole(&cloud, &pole(foot, 4.0), &config);
        assert!(seen.scans >= 8 && seen.points > 500, "{seen:?}");
        let across = seen.sigma_m(&Vector3::x());
        assert!(across > config.floor_m && across < 0.03, "{across}");
        let other = of_pole(&cloud, &pole(Point3::new(-9.0, CAMERA_HEIGHT_M, 28.0), 4.0), &config);
        assert_eq!((other.points, other.scans), (0, 0));
        assert!(other.sigma_m(&Vector3::x()) > across);
        assert!(seen.covariance().symmetric_eigenvalues().min() > 0.0);
    }

    #[test]
    fn a_foot_far_below_the_hits_is_known_less() {
        let config = EvidenceConfig::default();
        let mut street = Street::new();
        let foot = Point3::new(5.0, CAMERA_HEIGHT_M, 28.0);
        street.add_cylinder(foot - Vector3::new(0.0, 2.6, 0.0), foot - Vector3::new(0.0, 3.0, 0.0), 0.08);
        let evidence = of_pole(&street.cloud(), &pole(foot, 3.0), &config);
        assert!(evidence.sigma_m(&Vector3::x()) > 0.03, "{evidence:?}");
    }
}
