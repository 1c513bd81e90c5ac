mod decisions;
mod kinds;
mod lean;

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

/// Poles found where a post has rails in line with it, from a distance on, that
/// so many scans see.
fn post_by_rails(from_m: f64, rails_m: &[f64], scans: u16) -> usize {
    let mut street = Street::new();
    post(&mut street, Point3::new(6.0, CAMERA_HEIGHT_M, 20.0), 1.1, 0.04);
    for scan in 0..scans {
        for (i, up) in (0..60).flat_map(|i| rails_m.iter().map(move |up| (i, *up))) {
            let z = 20.0 + from_m + f64::from(i) * 0.025;
            street.add(Point3::new(6.0, CAMERA_HEIGHT_M - up, z), scan, 0.3, None);
        }
    }
    found(street).len()
}

#[test]
fn fits_that_end_early_are_of_what_is_no_pole_and_the_others_are_whole() {
    let mut street = Street::new();
    street.add_wall(-6.9, 10.0..40.0, 3.0);
    let foot = |x: f64, z: f64| Point3::new(x, CAMERA_HEIGHT_M, z);
    post(&mut street, foot(-6.0, 25.0), 2.5, 0.05);
    post(&mut street, foot(5.0, 33.0), 3.0, 0.05);
    // A post too low to be a pole, and a fence.
    post(&mut street, foot(5.0, 40.0), 0.5, 0.05);
    for k in 0..3 {
        post(&mut street, foot(6.0, 20.0 + 2.0 * f64::from(k)), 1.1, 0.04);
    }
    for (scan, (i, up)) in
        (0..10_u16).flat_map(|scan| (0..200).flat_map(|i| [(i, 0.55), (i, 1.0)]).map(move |at| (scan, at)))
    {
        street.add(foot(6.0, 19.5 + f64::from(i) * 0.025) - nalgebra::Vector3::new(0.0, up, 0.0), scan, 0.3, None);
    }
    let (cloud, config, lidar) = (street.cloud(), PoleConfig::default(), LidarConfig::default());
    let stacks = Stacks::new(&cloud.points, cloud.ground.grid(), &config);
    let fit = |stack: &Stack, wanted: Wanted| {
        fit_pole(&cloud, cloud.near(&stack.centre), stack, &Plumb::of_map(&config), wanted, &config, &lidar)
    };
    let (mut whole, mut ended) = (0, 0);
    for stack in stacks.find(&config).iter().chain(&stacks.find_before(&config)) {
        let (pole, any) = (fit(stack, Wanted::Poles), fit(stack, Wanted::PolesAndFences));
        if pole.is_some() {
            assert_eq!(pole, any, "what is wanted else changes nothing of it");
            whole += 1;
        } else if let Some(any) = any {
            assert!(!is_pole(&any, stack, &config), "{any:?}");
            ended += 1;
        }
    }
    assert!(whole >= 2 && ended >= 1, "{whole} {ended}");
}

#[test]
fn the_last_post_of_a_fence_is_no_pole_and_one_with_less_beside_it_is() {
    assert_eq!(post_by_rails(0.05, &[0.5, 1.0], 10), 0);
    // Across a gate.
    assert_eq!(post_by_rails(0.9, &[0.5, 1.0], 10), 0);
    // Its lower rail lies in grass; a crash barrier goes out from lower.
    assert_eq!(post_by_rails(0.05, &[1.0], 10), 0);
    assert_eq!(post_by_rails(0.05, &[0.7], 10), 1);
    // Its end is seen by one scan.
    assert_eq!(post_by_rails(0.05, &[1.0], 1), 1);
    // A crash barrier, and the end of a hedge.
    assert_eq!(post_by_rails(0.9, &[0.5], 10), 1);
    assert_eq!(post_by_rails(0.9, &[0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0], 10), 1);
    // Whoever passes by.
    assert_eq!(post_by_rails(0.9, &[0.5, 1.0], 1), 1);
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

/// Poles found where a parked car's tail lamp, or a reflector as high as a delineator's,
/// is on the corner of a car: the rear from z = 25 on, the side along x = 3.5.
fn on_the_corner_of_a_car(is_delineator: bool) -> Vec<(PoleKind, FittedPole)> {
    let mut street = Street::new();
    let at = |x: f64, up_m: f64, z: f64| Point3::new(x, CAMERA_HEIGHT_M - up_m, z);
    for scan in 0..5_u16 {
        for up_m in (0..22).map(|k| 0.25 + 0.05 * f64::from(k)) {
            for i in 0..34 {
                let along_m = 0.05 * f64::from(i);
                // Corners are rounded, by 0.1 m.
                let inset_m = [0.1, 0.013].get(i as usize).copied().unwrap_or(0.0);
                let is_lamp = (0.8..0.88).contains(&up_m) && i < 4;
                street.add(at(3.5 + along_m, up_m, 25.0 + inset_m), scan, if is_lamp { 0.99 } else { 0.15 }, None);
                street.add(at(3.5 + inset_m, up_m, 25.0 + 2.0 * along_m), scan, 0.15, None);
            }
        }
    }
    if is_delineator {
        let foot = Point3::new(3.45, CAMERA_HEIGHT_M, 24.9);
        post(&mut street, foot, 1.0, 0.05);
        reflector(&mut street, foot, 0.75);
    }
    found(street)
}

#[test]
fn the_tail_lamp_of_a_parked_car_is_no_delineator_and_one_beside_it_is() {
    assert!(on_the_corner_of_a_car(false).is_empty());
    let kinds: Vec<PoleKind> = on_the_corner_of_a_car(true).into_iter().map(|pole| pole.0).collect();
    assert_eq!(kinds, [PoleKind::Delineator]);
}

/// Poles found where a retro-reflective plate is 0.22 m before a fence that is as
/// high as its lower edge, on a post or on the fence.
fn sign_before_fence(is_on_post: bool) -> Vec<(PoleKind, FittedPole)> {
    let mut street = Street::new();
    street.add_wall(5.22, 10.0..40.0, 2.2);
    let foot = Point3::new(5.0, CAMERA_HEIGHT_M, 25.0);
    if is_on_post {
        post(&mut street, foot, 2.2, 0.04);
    }
    for (scan, (i, k)) in (0..10_u16).flat_map(|s| (0..13).flat_map(move |i| (0..10).map(move |k| (s, (i, k))))) {
        let off = nalgebra::Vector3::new(-0.05, -2.2 - 0.06 * f64::from(k), 0.05 * f64::from(i) - 0.3);
        street.add(foot + off, scan, 0.99, None);
    }
    found(street)
}

#[test]
fn a_post_close_before_a_fence_is_found_by_the_sign_on_it() {
    let poles = sign_before_fence(true);
    assert_eq!(poles.len(), 1);
    assert_eq!(poles[0].0, PoleKind::SignPost);
    assert!((poles[0].1.foot - Point3::new(5.0, CAMERA_HEIGHT_M, 25.0)).norm() < 0.06, "{:?}", poles[0].1);
    assert!(sign_before_fence(false).is_empty());
}

#[test]
fn a_reflector_that_dazzles_is_as_wide_as_most_of_its_echoes() {
    let mut street = Street::new();
    street.add_wall(5.4, 10.0..40.0, 2.0);
    let foot = Point3::new(5.0, CAMERA_HEIGHT_M, 25.0);
    post(&mut street, foot, 1.0, 0.05);
    reflector(&mut street, foot, 0.75);
    // One in six of the echoes.
    for (scan, side) in (0..4_u16).flat_map(|scan| [(scan, -1.0), (scan, 1.0)]) {
        street.add(foot - nalgebra::Vector3::new(0.05, 0.8, 0.18 * side), scan, 0.99, None);
    }
    let kinds: Vec<PoleKind> = found(street).into_iter().map(|p| p.0).collect();
    assert_eq!(kinds, [PoleKind::Delineator]);
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

#[test]
fn a_post_in_the_way_of_no_rail_stays_in_its_row() {
    let mut street = Street::new();
    for k in 0..5 {
        post(&mut street, Point3::new(4.0, CAMERA_HEIGHT_M, 20.0 + 1.5 * f64::from(k)), 1.0, 0.05);
    }
    assert_eq!(found(street).len(), 5);
}

#[test]
fn what_carries_a_roof_is_no_pole_and_two_masts_are() {
    let mut street = Street::new();
    for (x, z) in [(7.0, 20.0), (10.5, 20.0), (7.0, 26.0), (10.5, 26.0)] {
        post(&mut street, Point3::new(x, CAMERA_HEIGHT_M, z), 3.4, 0.16);
    }
    // One corner of a second roof is hidden.
    for (x, z) in [(-7.0, 20.0), (-10.5, 20.0), (-7.0, 26.0)] {
        post(&mut street, Point3::new(x, CAMERA_HEIGHT_M, z), 3.4, 0.16);
    }
    for z in [36.0, 40.0] {
        post(&mut street, Point3::new(7.0, CAMERA_HEIGHT_M, z), 3.4, 0.16);
    }
    let feet: Vec<f64> = found(street).iter().map(|(_, pole)| pole.foot.z).collect();
    assert_eq!(feet.len(), 2, "{feet:?}");
    assert!(feet.iter().all(|z| *z > 30.0));
}

#[test]
fn thin_posts_as_high_as_each_other_carry_a_low_roof() {
    let left = |heights_m: &[f64]| {
        let mut street = Street::new();
        let corners = [(5.0, 26.0), (6.8, 26.0), (5.0, 28.6), (6.8, 28.6)];
        for ((x, z), height_m) in corners.into_iter().zip(heights_m) {
            post(&mut street, Point3::new(x, CAMERA_HEIGHT_M, z), *height_m, 0.03);
        }
        found(street).len()
    };
    assert_eq!((left(&[2.4; 4]), left(&[2.4; 3])), (0, 0));
    // Two carry no roof, nor do posts of signs, each as high as its plates, and lamps.
    assert_eq!((left(&[2.4; 2]), left(&[2.4, 2.7, 2.2, 2.9]), left(&[3.3; 4])), (2, 4, 4));
}

#[test]
fn a_sign_on_a_post_does_not_bend_its_axis() {
    let mut street = Street::new();
    let foot = Point3::new(5.0, CAMERA_HEIGHT_M, 28.0);
    post(&mut street, foot, 2.8, 0.04);
    // A plate before the post, to one side of it.
    for scan in 0..10_u16 {
        for (i, k) in (0..12).flat_map(|i| (0..12).map(move |k| (i, k))) {
            let off = nalgebra::Vector3::new(-0.1 + 0.05 * f64::from(i), -2.1 - 0.06 * f64::from(k), -0.08);
            street.add(foot + off, scan, 0.99, None);
        }
    }
    let poles = found(street);
    assert_eq!(poles.len(), 1);
    let pole = &poles[0].1;
    assert!(pole.tilt_rad() < 0.01 && (pole.foot - foot).norm() < 0.03, "{pole:?}");
}

#[test]
fn a_foot_on_a_footway_is_not_on_the_road_beside_it() {
    let mut street = Street::new();
    let kerb_m = 0.14;
    // Denser than the road below it, which the street of the tests has everywhere.
    // The footway begins 0.4 m before the post, inside a cell of the height map.
    for (i, k) in (0..60).flat_map(|i| (0..60).map(move |k| (i, k))) {
        let (x, z) = (4.2 + 0.05 * f64::from(i), 26.5 + 0.05 * f64::from(k));
        street.add(Point3::new(x, CAMERA_HEIGHT_M - kerb_m, z), (k % 10) as u16, 0.3, None);
    }
    let foot = Point3::new(4.6, CAMERA_HEIGHT_M - kerb_m, 28.0);
    post(&mut street, foot, 3.0, 0.05);
    let poles = found(street);
    assert_eq!(poles.len(), 1);
    assert!((poles[0].1.foot - foot).norm() < 0.03, "{:?}", poles[0].1.foot);
}

/// Somebody who stood upright beside the road during three scans; whether the
/// others look through where that was.
fn passer_by(is_looked_through: bool) -> Street {
    let mut street = Street::new();
    let foot = Point3::new(5.0, CAMERA_HEIGHT_M, 28.0);
    street.add_passing_cylinder(foot, foot - nalgebra::Vector3::new(0.0, 1.95, 0.0), 0.1, 2..5);
    for scan in (0..2).chain(5..9).filter(|_| is_looked_through) {
        street.add_behind(foot, 1.9, scan);
    }
    street
}

#[test]
fn what_other_scans_look_through_has_moved_and_is_no_pole() {
    assert_eq!(found(passer_by(false)).len(), 1, "nothing says that it moved");
    assert!(found(passer_by(true)).is_empty());
}

#[test]
fn a_pole_that_one_scan_looks_through_stays() {
    let mut street = Street::new();
    let foot = Point3::new(5.0, CAMERA_HEIGHT_M, 28.0);
    street.add_passing_cylinder(foot, foot - nalgebra::Vector3::new(0.0, 1.95, 0.0), 0.1, 0..8);
    street.add_behind(foot, 1.9, 8);
    assert_eq!(found(street).len(), 1);
}
