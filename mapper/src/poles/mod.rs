//! Pole-like objects: found as isolated vertical stacks, fitted as axes.

mod config;
mod fit;
mod stacks;

use common::map::PoleKind;
use nalgebra::Point2;
use rayon::prelude::*;

pub use config::PoleConfig;
pub use fit::{FittedPole, fit_pole};
pub use stacks::{Stack, Stacks};

use crate::cloud::{Cloud, CloudPoint};
use crate::lidar::LidarConfig;
use crate::signs::clusters;

/// The poles of a stitched cloud with their kinds.
pub fn find_poles(cloud: &Cloud, config: &PoleConfig, lidar: &LidarConfig) -> Vec<(PoleKind, FittedPole)> {
    let stacks = Stacks::new(&cloud.points, cloud.ground.grid(), config);
    // Reflectors last: what stands free is known by then.
    let places: Vec<Stack> = stacks.find(config).into_iter().chain(under_reflectors(cloud, config)).collect();
    let fitted: Vec<FittedPole> = places
        .par_iter()
        .filter_map(|stack| fit_pole(cloud, cloud.near(&stack.centre), stack, config, lidar))
        .filter(|pole| is_pole(pole, config))
        .collect();
    let mut kept: Vec<(PoleKind, FittedPole)> = Vec::new();
    for pole in fitted {
        // Two stacks of one pole, above and below a sign, fit the same axis.
        let known = kept.iter().any(|(_, k)| {
            let off = Point2::new(k.foot.x - pole.foot.x, k.foot.z - pole.foot.z);
            off.coords.norm() < config.ring_inner_m
        });
        let kind = kind_of(&pole, &stacks, config);
        if !known && (kind != PoleKind::Trunk || config.keep_trunks) {
            kept.push((kind, pole));
        }
    }
    kept
}

/// Places under small reflectors at the height of those of delineators.
fn under_reflectors(cloud: &Cloud, config: &PoleConfig) -> Vec<Stack> {
    let [low_m, high_m] = config.reflector_m;
    let bright: Vec<&CloudPoint> = cloud
        .points
        .iter()
        .filter(|p| p.reflectance >= config.least_reflectance)
        .filter(|p| (low_m..=high_m).contains(&f64::from(p.height_m)))
        .collect();
    clusters(&bright, config.core_radius_m)
        .iter()
        .filter_map(|cluster| {
            let (mut low, mut high) = (cluster[0].position, cluster[0].position);
            let mut upper_edge_m = f64::NEG_INFINITY;
            for p in cluster {
                (low, high) = (low.inf(&p.position), high.sup(&p.position));
                upper_edge_m = upper_edge_m.max(f64::from(p.height_m));
            }
            let extent_m = (high.x - low.x).max(high.z - low.z);
            let centre = Point2::new(f64::midpoint(low.x, high.x), f64::midpoint(low.z, high.z));
            (extent_m <= config.widest_reflector_m && cluster.len() >= config.fewest_points / 2)
                .then(|| Stack::under_reflector(centre, upper_edge_m, config))
        })
        .collect()
}

fn is_pole(pole: &FittedPole, config: &PoleConfig) -> bool {
    let free_share = pole.free_m / (pole.top_height_m - pole.foot_height_m);
    let least_share =
        if pole.radius_m <= config.post_radius_m { config.least_free_share } else { config.least_free_share_thick };
    let least_free_m = if pole.foot_height_m > 0.0 { config.least_free_hanging_m } else { config.least_free_m };
    // Whatever carries retro-reflective sheeting was put up for the traffic.
    let is_equipment = pole.reflectance >= config.sheeting_reflectance;
    let is_short = pole.top_height_m <= config.short_top_m;
    pole.tilt_rad() <= config.largest_tilt_rad
        && (is_equipment || !is_short || pole.attached_share <= config.largest_attached_share)
        && (is_equipment || !is_short || pole.radius_m <= config.thickest_short_m)
        && pole.spread_m <= config.largest_spread_m
        && pole.radius_m <= config.thickest_m
        && pole.scans >= config.fewest_scans
        && pole.foot_height_m <= config.highest_foot_m
        && pole.visibility >= config.least_visibility
        && pole.top_height_m >= config.lowest_top_m
        && pole.free_m >= least_free_m
        && free_share >= least_share
}

fn kind_of(pole: &FittedPole, stacks: &Stacks, config: &PoleConfig) -> PoleKind {
    let top = pole.top_height_m;
    let above = top..top + 1.5;
    let crown = stacks.filled_share(&Point2::new(pole.top.x, pole.top.z), above, 1.0);
    // People beside it and the hedge behind it are no crown of a post with
    // sheeting on it.
    let is_equipment = pole.reflectance >= config.sheeting_reflectance && pole.radius_m <= config.thickest_short_m;
    if (crown >= config.crown_share && !is_equipment) || pole.radius_m > config.trunk_radius_m {
        PoleKind::Trunk
    } else if top <= config.delineator_top_m {
        PoleKind::Delineator
    } else if top >= config.lamp_top_m || (pole.top_is_open && top >= config.open_lamp_top_m) {
        PoleKind::LampPost
    } else {
        PoleKind::SignPost
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::testing::{CAMERA_HEIGHT_M, Street};

    fn found(street: Street) -> Vec<(PoleKind, FittedPole)> {
        find_poles(&street.cloud(), &PoleConfig::default(), &LidarConfig::default())
    }

    #[test]
    fn a_pole_seen_from_the_road_has_its_axis_and_its_foot_on_the_ground() {
        let mut street = Street::new();
        let foot = Point3::new(5.0, CAMERA_HEIGHT_M, 28.0);
        let top = foot + nalgebra::Vector3::new(0.16, -4.8, 0.08);
        street.add_cylinder(foot, top, 0.08);
        let poles = found(street);
        assert_eq!(poles.len(), 1);
        let (kind, pole) = &poles[0];
        assert_eq!(*kind, PoleKind::LampPost);
        // One-sided hits: the mean of the points is 6 cm nearer to the road.
        assert!((pole.foot - foot).norm() < 0.03, "{:?}", pole.foot);
        assert!((pole.radius_m - 0.08).abs() < 0.03, "{}", pole.radius_m);
        assert!((pole.tilt_rad() - 0.037).abs() < 0.01);
    }

    #[test]
    fn walls_and_their_corners_are_no_poles() {
        let mut street = Street::new();
        street.add_wall(6.0, 10.0..30.0, 3.0);
        assert!(found(street).is_empty());
    }

    #[test]
    fn a_pole_half_a_metre_before_a_wall_is_found() {
        let mut street = Street::new();
        street.add_wall(6.9, 10.0..40.0, 3.0);
        let foot = Point3::new(6.0, CAMERA_HEIGHT_M, 25.0);
        street.add_cylinder(foot, foot - nalgebra::Vector3::new(0.0, 2.5, 0.0), 0.05);
        let poles = found(street);
        assert_eq!(poles.len(), 1);
        assert!((poles[0].1.foot - foot).norm() < 0.04);
    }

    #[test]
    fn a_delineator_is_told_from_a_sign_post() {
        let mut street = Street::new();
        for (z, height) in [(15.0, 1.0), (35.0, 2.2)] {
            let foot = Point3::new(4.0, CAMERA_HEIGHT_M, z);
            street.add_cylinder(foot, foot - nalgebra::Vector3::new(0.0, height, 0.0), 0.05);
        }
        let kinds: Vec<PoleKind> = found(street).into_iter().map(|p| p.0).collect();
        assert!(kinds.contains(&PoleKind::Delineator) && kinds.contains(&PoleKind::SignPost), "{kinds:?}");
    }

    /// Hits on a post and what else stands there, seen from every place.
    fn post(street: &mut Street, foot: Point3<f64>, height_m: f64, radius_m: f64) {
        street.add_cylinder(foot, foot - nalgebra::Vector3::new(0.0, height_m, 0.0), radius_m);
    }

    fn reflector(street: &mut Street, foot: Point3<f64>, height_m: f64) {
        for scan in 0..10_u16 {
            for k in 0..4 {
                let up = height_m + 0.04 * f64::from(k);
                street.add(foot - nalgebra::Vector3::new(0.05, up, 0.0), scan, 0.99, None);
            }
        }
    }

    #[test]
    fn posts_of_fences_and_gates_are_no_poles() {
        let mut street = Street::new();
        for k in 0..6 {
            post(&mut street, Point3::new(6.0, CAMERA_HEIGHT_M, 20.0 + 2.0 * f64::from(k)), 1.1, 0.04);
        }
        for scan in 0..10_u16 {
            for (i, up) in (0..400).flat_map(|i| [0.55, 1.0].map(|up| (i, up))) {
                let z = 20.0 + f64::from(i) * 0.025;
                street.add(Point3::new(6.0, CAMERA_HEIGHT_M - up, z), scan, 0.3, None);
            }
        }
        post(&mut street, Point3::new(-6.0, CAMERA_HEIGHT_M, 25.0), 1.6, 0.18);
        assert!(found(street).is_empty());
    }

    #[test]
    fn a_delineator_before_a_hedge_is_found_by_its_reflector() {
        let mut street = Street::new();
        street.add_wall(5.4, 10.0..40.0, 2.0);
        let foot = Point3::new(5.0, CAMERA_HEIGHT_M, 25.0);
        post(&mut street, foot, 1.0, 0.05);
        reflector(&mut street, foot, 0.75);
        let poles = found(street);
        assert_eq!(poles.len(), 1);
        assert_eq!(poles[0].0, PoleKind::Delineator);
        assert!((poles[0].1.foot - foot).norm() < 0.06, "{:?}", poles[0].1);
    }

    #[test]
    fn the_foot_is_on_the_ground_though_a_hedge_hides_it() {
        let mut street = Street::new();
        let foot = Point3::new(5.0, CAMERA_HEIGHT_M, 28.0);
        let up = |height_m: f64| foot - nalgebra::Vector3::new(0.0, height_m, 0.0);
        street.add_cylinder(up(1.2), up(5.0), 0.06);
        let poles = found(street);
        assert_eq!(poles.len(), 1);
        assert!((poles[0].1.foot - foot).norm() < 0.05, "{:?}", poles[0].1.foot);
        assert!((poles[0].1.foot_height_m - 1.2).abs() < 0.1);
    }
}
