//! What is said of poles that were fitted.

use std::ops::Range;

use nalgebra::Vector3;

use super::*;

/// The face of a wall or a hedge along the road, that all scans see.
pub(super) fn add_face(street: &mut Street, x: f64, z: Range<f64>, height_m: f64) {
    let steps = |length_m: f64| (length_m / 0.05) as u32;
    for (i, k) in (0..steps(z.end - z.start)).flat_map(|i| (0..steps(height_m)).map(move |k| (i, k))) {
        let p = Point3::new(x, CAMERA_HEIGHT_M - f64::from(k) * 0.05, z.start + f64::from(i) * 0.05);
        street.add(p, ((7 * i + 3 * k) % 10) as u16, 0.3, None);
    }
}

/// A slender pole that stands free, and where it was found.
pub(super) fn slender() -> (FittedPole, Stack) {
    let mut street = Street::new();
    let foot = Point3::new(5.0, CAMERA_HEIGHT_M, 28.0);
    post(&mut street, foot, 3.0, 0.03);
    let pole = found(street).swap_remove(0).1;
    let stack = Stack::under_reflector(Point2::new(foot.x, foot.z), 2.8, &PoleConfig::default());
    (pole, stack)
}

#[test]
fn what_is_narrow_and_reaches_far_along_the_view_is_a_wall_seen_edge_on() {
    let config = PoleConfig::default();
    let (pole, stack) = slender();
    let is_pole =
        |radius_m: f64, spread_m: f64| is_pole(&FittedPole { radius_m, spread_m, ..pole.clone() }, &stack, &config);
    assert!(is_pole(config.thinnest_m, 0.03) && !is_pole(config.thinnest_m, 0.075) && is_pole(0.06, 0.075));
}

#[test]
fn a_trunk_that_goes_on_above_the_field_of_view_does_not_end_below_any_sign() {
    let config = PoleConfig::default();
    let (pole, stack) = slender();
    let is_pole = |top_height_m: f64, radius_m: f64, top_is_open: bool| {
        is_pole(&FittedPole { top_height_m, radius_m, top_is_open, ..pole.clone() }, &stack, &config)
    };
    assert!(is_pole(1.7, 0.17, true) && !is_pole(1.7, 0.17, false) && is_pole(1.7, 0.05, false));
    // From 30 m, the farthest place, the highest beam meets it 2.9 m above ground.
    let is_open = |height_m: f64| {
        let mut street = Street::new();
        post(&mut street, Point3::new(12.0, CAMERA_HEIGHT_M, 28.0), height_m, 0.05);
        found(street).swap_remove(0).1.top_is_open
    };
    assert!(!is_open(2.3) && is_open(2.8));
}

#[test]
fn a_stem_that_is_wider_than_the_reach_of_an_axis_is_as_thick_as_it_is() {
    for radius_m in [0.16, 0.22] {
        let mut street = Street::new();
        post(&mut street, Point3::new(5.0, CAMERA_HEIGHT_M, 28.0), 3.0, radius_m);
        let fitted_m = found(street).swap_remove(0).1.radius_m;
        assert!((fitted_m - radius_m).abs() < 0.1 * radius_m, "{radius_m} {fitted_m}");
    }
}

#[test]
fn a_glimpse_by_two_of_many_scans_makes_no_pole() {
    let config = PoleConfig::default();
    let (pole, stack) = slender();
    let is_pole = |points: usize, scans: usize, scans_near: usize, reflectance: f32| {
        is_pole(&FittedPole { points, scans, scans_near, reflectance, ..pole.clone() }, &stack, &config)
    };
    assert!(!is_pole(12, 2, 12, 0.3));
    // A short drive, a third scan, more hits, sheeting.
    assert!(is_pole(12, 2, 3, 0.3) && is_pole(12, 3, 12, 0.3) && is_pole(40, 2, 12, 0.3) && is_pole(12, 2, 12, 0.99));
}

#[test]
fn what_is_attached_half_its_length_has_to_be_seen_well_even_with_sheeting() {
    let config = PoleConfig::default();
    let (pole, stack) = slender();
    let is_pole = |attached_share: f64, visibility: f64| {
        let signed = FittedPole { reflectance: 0.99, bright_top_m: 2.0, ..pole.clone() };
        is_pole(&FittedPole { visibility, attached_share, ..signed }, &stack, &config)
    };
    assert!(!is_pole(1.0, 0.15) && is_pole(1.0, 0.6) && is_pole(0.2, 0.15));
}

#[test]
fn a_reflector_on_what_is_attached_makes_a_delineator_of_what_is_slender_or_bright_or_seen_well() {
    let config = PoleConfig::default();
    let (pole, stack) = slender();
    let short = FittedPole { reflectance: 0.99, bright_top_m: 0.9, free_m: 0.8, top_is_open: false, ..pole };
    let is_pole = |attached_share: f64, radius_m: f64, visibility: f64, bright_share: f64, top_height_m: f64| {
        let changed = FittedPole { top_height_m, radius_m, visibility, attached_share, bright_share, ..short.clone() };
        is_pole(&changed, &stack, &config)
    };
    // In a hedge: slender, and as wide as the reflector dazzles.
    assert!(is_pole(1.0, 0.04, 0.4, 0.1, 1.0) && is_pole(1.0, 0.08, 0.8, 0.25, 1.0));
    // Tail lamps: small, or seen from one side, or on a corner that goes on above.
    assert!(!is_pole(1.0, 0.08, 0.8, 0.08, 1.0) && !is_pole(1.0, 0.08, 0.4, 0.25, 1.0));
    assert!(!is_pole(1.0, 0.04, 0.8, 0.25, 1.9) && !is_pole(0.2, 0.13, 0.8, 0.25, 1.0));
    // A post that stands free.
    assert!(is_pole(0.2, 0.08, 0.4, 0.1, 1.0));
}

#[test]
fn a_tree_that_forks_low_is_a_pole_and_what_hardly_shows_free_is_none() {
    let config = PoleConfig::default();
    let (pole, stack) = slender();
    let is_pole = |radius_m: f64, free_m: f64| {
        is_pole(&FittedPole { radius_m, free_m, top_height_m: 2.4, ..pole.clone() }, &stack, &config)
    };
    // Its branches fill the upper half; a banner beside a door.
    assert!(is_pole(0.28, 1.2) && !is_pole(0.28, 0.85) && is_pole(0.04, 0.85));
}

#[test]
fn pipes_and_jambs_are_of_their_wall_and_a_mast_in_a_hedge_is_a_pole() {
    let config = PoleConfig::default();
    let (pole, stack) = slender();
    let is_pole = |low_m: f64, is_before: bool, radius_m: f64, attached_share: f64| {
        let mut stack = stack;
        (stack.low_m, stack.is_before) = (low_m, is_before);
        let pole = FittedPole { radius_m, attached_share, visibility: 1.0, ..pole.clone() };
        is_pole(&pole, &stack, &config)
    };
    // Attached higher than hedges are, as high as they are, and hardly.
    assert!(!is_pole(2.4, false, 0.05, 0.4) && is_pole(1.6, false, 0.05, 0.6) && is_pole(2.4, false, 0.05, 0.1));
    // Close before a wall: thick, and slender.
    assert!(!is_pole(0.2, true, 0.1, 0.4) && is_pole(0.2, true, 0.04, 0.4));
    // Free near the ground, and attached above.
    assert!(!is_pole(0.2, false, 0.05, 0.6) && is_pole(0.2, false, 0.05, 0.4));
}

#[test]
fn a_stem_that_ends_below_the_top_of_hedges_is_of_the_one_behind_it() {
    let config = PoleConfig::default();
    let (pole, stack) = slender();
    let mut street = Street::new();
    for depth in 0..4 {
        add_face(&mut street, 5.3 + 0.15 * f64::from(depth), 20.0..36.0, 3.2);
    }
    let cloud = street.cloud();
    let stacks = Stacks::new(&cloud.points, cloud.ground.grid(), &config);
    let is_of_hedge = |top_height_m: f64, is_before: bool, reflectance: f32| {
        let mut stack = stack;
        stack.is_before = is_before;
        let pole = FittedPole { top_height_m, reflectance, ..pole.clone() };
        is_of_what_is_behind(&pole, &stack, &stacks, &config)
    };
    assert!(is_of_hedge(1.9, true, 0.3));
    // A post that rises above, one that stands free, one with sheeting.
    assert!(!is_of_hedge(2.5, true, 0.3) && !is_of_hedge(1.9, false, 0.3) && !is_of_hedge(1.9, true, 0.99));
}

#[test]
fn what_was_hit_from_afar_only_is_not_known_to_stand_free() {
    let config = PoleConfig::default();
    let (pole, stack) = slender();
    let is_pole = |nearest_hit_m: f64| is_pole(&FittedPole { nearest_hit_m, ..pole.clone() }, &stack, &config);
    assert!(is_pole(29.0) && !is_pole(31.0));
}

/// Poles found where a stem rises from the top of a wall of 1 m so far beside the road.
fn stem_on_wall(x: f64) -> usize {
    let mut street = Street::new();
    add_face(&mut street, x, 20.0..36.0, 1.0);
    let foot = Point3::new(x, CAMERA_HEIGHT_M - 1.0, 28.0);
    post(&mut street, foot, 1.6, 0.08);
    found(street).len()
}

#[test]
fn what_rises_from_a_far_wall_is_a_piece_of_it_between_windows_and_by_the_road_a_lamp() {
    assert_eq!((stem_on_wall(15.5), stem_on_wall(6.0)), (0, 1));
}

#[test]
fn sheeting_on_a_far_wall_says_that_a_post_is_one() {
    let config = PoleConfig::default();
    let (pole, stack) = slender();
    let is_pole = |stands_on_wall: bool, nearest_hit_m: f64, reflectance: f32| {
        let pole = FittedPole { stands_on_wall, nearest_hit_m, reflectance, bright_top_m: 2.0, ..pole.clone() };
        is_pole(&pole, &stack, &config)
    };
    assert!(!is_pole(true, 20.0, 0.3) && is_pole(true, 20.0, 0.99));
    assert!(is_pole(true, 10.0, 0.3) && is_pole(false, 20.0, 0.3));
}

#[test]
fn below_a_plate_leaves_around_a_post_make_it_wider_and_nothing_else_may() {
    let config = PoleConfig::default();
    let (pole, mut stack) = slender();
    stack.is_under_sheet = true;
    let is_pole = |radius_m: f64, hedge_share: f64| {
        is_pole(&FittedPole { radius_m, hedge_share, ..pole.clone() }, &stack, &config)
    };
    assert!(is_pole(0.05, 0.0) && is_pole(0.1, 0.3));
    assert!(!is_pole(0.1, 0.1) && !is_pole(0.15, 0.3));
}

#[test]
fn what_a_hedge_touches_in_every_slice_is_a_post_where_it_stands_out_of_it() {
    let config = PoleConfig::default();
    let (pole, mut stack) = slender();
    let touched = FittedPole { attached_share: 0.9, radius_m: 0.09, hedge_share: 0.3, stands_out: 9.0, ..pole };
    stack.is_before = true;
    let is_pole = |pole: FittedPole| is_pole(&pole, &stack, &config);
    assert!(is_pole(touched.clone()));
    // Before a wall, of leaves, behind them, as thick as a tree, and one that ends in them.
    assert!(!is_pole(FittedPole { hedge_share: 0.1, ..touched.clone() }));
    assert!(!is_pole(FittedPole { stands_out: 3.0, ..touched.clone() }));
    assert!(!is_pole(FittedPole { visibility: 0.4, ..touched.clone() }));
    assert!(!is_pole(FittedPole { radius_m: 0.11, ..touched.clone() }));
    assert!(!is_pole(FittedPole { top_height_m: 1.5, top_is_open: false, ..touched }));
}

#[test]
fn a_lamp_post_in_a_hedge_is_found_and_its_leaves_are_none() {
    let in_hedge = |has_post: bool| {
        let mut street = Street::new();
        let share = |k: u32, step: f64| (f64::from(k) * step).fract();
        for k in 0..45_000_u32 {
            let off = Vector3::new(share(k, 0.819_173), 2.2 * share(k, 0.671_044), 16.0 * share(k, 0.549_7));
            let at = Point3::new(5.4 + off.x, CAMERA_HEIGHT_M - off.y, 20.0 + off.z);
            street.add(at, (k % 10) as u16, 0.3, None);
        }
        let foot = Point3::new(5.5, CAMERA_HEIGHT_M, 28.0);
        if has_post {
            post(&mut street, foot, 2.4, 0.08);
        }
        (found(street), foot)
    };
    let (poles, foot) = in_hedge(true);
    assert_eq!(poles.len(), 1, "{poles:?}");
    assert!(poles[0].0 != PoleKind::Trunk && (poles[0].1.foot - foot).norm() < 0.06, "{poles:?}");
    assert!(in_hedge(false).0.is_empty());
}
