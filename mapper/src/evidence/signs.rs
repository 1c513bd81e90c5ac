//! Uncertainty of the centroid of a sign.

use common::map::Sign;
use nalgebra::{Matrix3, Point2, Vector1, Vector2, Vector3};

use super::scatter::Scatter;
use super::{EvidenceConfig, PointEvidence};
use crate::cloud::{Cloud, CloudPoint};
use crate::lidar::LidarConfig;

/// Reflectance from which on points are of the plate and not of what stands
/// behind it, where there are enough of them.
const BRIGHT: f32 = 0.7;
/// Fewest points to go by.
const FEWEST: usize = 5;

/// How well the centroid of a sign is known, from the cloud that it was found
/// in.
///
/// A plate's centroid is the middle of its outline. Along the view it errs as
/// its scans do; across and in height its edges lie between two beams, or
/// beyond the lidar's field of view.
pub fn of_sign(cloud: &Cloud, sign: &Sign, config: &EvidenceConfig, lidar: &LidarConfig) -> PointEvidence {
    let reach_m = sign.size_m / 2.0 + config.reach_m;
    let at = sign.centroid_map;
    let near: Vec<&CloudPoint> =
        cloud.near(&Point2::new(at.x, at.z)).filter(|p| (p.position - at).norm() < reach_m).collect();
    let bright: Vec<&CloudPoint> = near.iter().copied().filter(|p| p.reflectance >= BRIGHT).collect();
    let points = if bright.len() >= FEWEST { bright } else { near };
    let floor = Matrix3::identity() * config.floor_m.powi(2);
    let view = points
        .iter()
        .filter_map(|p| Some(at - cloud.sensors.get(usize::from(p.scan))?.at_map))
        .map(|d| Vector3::new(d.x, 0.0, d.z))
        .sum::<Vector3<f64>>();
    let Some(deep) = view.try_normalize(1e-6).filter(|_| points.len() >= FEWEST) else {
        let (along, up) = (config.unknown_sigma_m.powi(2), config.unknown_vertical_sigma_m.powi(2));
        let unknown = Matrix3::from_diagonal(&Vector3::new(along, up, along));
        return PointEvidence::new(&(unknown + floor), points.len(), 0);
    };
    let across = Vector3::new(deep.z, 0.0, -deep.x);
    let mut scatter = Scatter::<1>::default();
    for p in &points {
        let row = (p.position.y / config.slice_m).floor() as i64;
        scatter.add(p.scan, row, Vector1::new((p.position - at).dot(&deep)));
    }
    let components = scatter.components(config);
    let scans = scatter.scans() as f64;
    let pose_m2 = components.scan / scans;
    let range_m = points.iter().map(|p| f64::from(p.range_m)).sum::<f64>() / points.len() as f64;
    let extent_m = |axis: &Vector3<f64>| {
        let along = points.iter().map(|p| (p.position - at).dot(axis));
        let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
        high - low
    };
    let (width_m, height_m) = (extent_m(&across), extent_m(&Vector3::y()));
    let edge = |seen_m: f64, other_m: f64, gap_m: f64| {
        // Two edges, each anywhere in the gap beside the outermost beam of all
        // scans: the variance of their middle is `gap^2 / 24`.
        let gap_m = gap_m / scans;
        // The largest extent of a plate is its diagonal: a side is as long as
        // the other one leaves of it, and no longer than that of a square.
        let side_m = (sign.size_m.powi(2) - other_m.powi(2)).max(0.0).sqrt();
        let unseen_m = (side_m.min(sign.size_m * std::f64::consts::FRAC_1_SQRT_2) - seen_m).max(0.0);
        gap_m * gap_m / 24.0 + (config.unseen_share * unseen_m).powi(2)
    };
    let cut_m2 = if is_cut_off(cloud, &points, lidar) { config.cut_off_sigma_m.powi(2) } else { 0.0 };
    let beams_m = config.elevation_sigma_rad * range_m;
    let vertical_m2 =
        pose_m2 + beams_m * beams_m + cut_m2 + edge(height_m, width_m, lidar.elevation_step_rad * range_m);
    let lateral_m2 = pose_m2 + edge(width_m, height_m, lidar.azimuth_step_rad * range_m);
    let covariance = deep * deep.transpose() * components.mean
        + across * across.transpose() * lateral_m2
        + Vector3::y() * Vector3::y().transpose() * vertical_m2
        + floor;
    PointEvidence::new(&covariance, points.len(), scatter.scans())
}

/// Whether no scan of a plate looks beyond its highest point by more than a
/// beam: then nobody knows how far up it goes on. Scans from farther away look
/// higher.
fn is_cut_off(cloud: &Cloud, points: &[&CloudPoint], lidar: &LidarConfig) -> bool {
    let Some(top) = points.iter().map(|p| p.position).min_by(|a, b| a.y.total_cmp(&b.y)) else { return false };
    let looks_beyond = |p: &&CloudPoint| {
        cloud.sensors.get(usize::from(p.scan)).is_some_and(|sensor| {
            let view = sensor.view_of(&Vector2::new(top.x, top.z), lidar);
            view.elevation_rad(-top.y) < lidar.highest_rad - 1.5 * lidar.elevation_step_rad
        })
    };
    !points.iter().any(looks_beyond)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Street;
    use common::map::{RoadId, SignKind};
    use nalgebra::Point3;

    /// A sign below the upper end of the lidar's field of view, or above it.
    fn sign(is_high: bool) -> Sign {
        let centroid_map = Point3::new(4.0, if is_high { -0.8 } else { 0.5 }, 40.0);
        Sign { kind: SignKind::TrafficSign, centroid_map, size_m: 0.85, road: RoadId(0) }
    }

    fn plate(sign: &Sign, lower_half_only: bool) -> PointEvidence {
        let mut street = Street::new();
        for scan in 2..6 {
            for (i, k) in (-6..=6).flat_map(|i| (-6..=6).map(move |k| (i, k))) {
                if k >= 0 || !lower_half_only {
                    let at = sign.centroid_map + Vector3::new(f64::from(i) * 0.05, f64::from(k) * 0.05, 0.0);
                    street.add(at, scan, 0.95, None);
                }
            }
        }
        of_sign(&street.cloud(), sign, &EvidenceConfig::default(), &LidarConfig::default())
    }

    #[test]
    fn a_plate_whose_upper_half_was_not_seen_is_known_less_in_height_only() {
        let config = EvidenceConfig::default();
        let (whole, half) = (plate(&sign(false), false), plate(&sign(false), true));
        let up = Vector3::y();
        assert!(half.sigma_m(&up) > 2.0 * whole.sigma_m(&up), "{whole:?} {half:?}");
        assert!((half.sigma_m(&Vector3::x()) / whole.sigma_m(&Vector3::x()) - 1.0).abs() < 0.1);
        assert_eq!(whole.scans, 4);
        assert!(plate(&sign(true), false).sigma_m(&up) > config.cut_off_sigma_m * 0.99);
        // From far away one looks over it, from near by not.
        let middling = Sign { centroid_map: Point3::new(4.0, -0.2, 40.0), ..sign(false) };
        assert!(plate(&middling, false).sigma_m(&up) < config.cut_off_sigma_m / 2.0);
        let nothing = of_sign(&Street::new().cloud(), &sign(false), &config, &LidarConfig::default());
        assert!(nothing.sigma_m(&up) > config.unknown_vertical_sigma_m * 0.99);
    }
}
