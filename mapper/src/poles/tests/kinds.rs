//! What kind a pole that was fitted is said to be.

use nalgebra::{Matrix2, Vector2, Vector3};

use super::decisions::{add_face, slender};
use super::*;
use crate::cloud::Cloud;

/// The kind of a pole in a cloud, among others that stand upright as it does.
fn kind_among(pole: &FittedPole, others: &[FittedPole], cloud: &Cloud) -> PoleKind {
    let config = PoleConfig::default();
    let stacks = Stacks::new(&cloud.points, cloud.ground.grid(), &config);
    let plumb = Plumb { slope: Vector2::zeros(), lean_rad: config.usual_lean_rad };
    let poles: Vec<FittedPole> = others.iter().chain([pole]).cloned().collect();
    Kinds::of(&poles, &plumb, &stacks, &config).of_pole(pole)
}

fn kind(pole: &FittedPole, street: Street) -> PoleKind {
    kind_among(pole, &[], &street.cloud())
}

/// What stands free and is seen as far up as the lidar looks, 3.4 m above ground.
fn stem(radius_m: f64, lean_rad: f64) -> FittedPole {
    FittedPole {
        radius_m,
        slope_of_hits: Vector2::new(lean_rad, 0.0),
        slope_covariance: Matrix2::identity() * 0.005_f64.powi(2),
        top_height_m: 3.4,
        top_is_open: true,
        ..slender().0
    }
}

/// Points in a box around a place 28 m ahead, up to so far from it.
fn add_leaves(street: &mut Street, height_m: f64, half: Vector3<f64>) {
    add_leaves_aside(street, 0.0, height_m, half);
}

/// The same so far to the right.
fn add_leaves_aside(street: &mut Street, aside_m: f64, height_m: f64, half: Vector3<f64>) {
    for k in 0..4000_u32 {
        let spread = |step: u32| 2.0 * f64::from(k * step % 401) / 401.0 - 1.0;
        let off = Vector3::new(aside_m + half.x * spread(7), half.y * spread(131) - height_m, half.z * spread(53));
        street.add(Point3::new(5.0, CAMERA_HEIGHT_M, 28.0) + off, (k % 10) as u16, 0.3, None);
    }
}

#[test]
fn a_bare_stem_that_is_thick_and_leans_is_a_tree_and_a_mast_is_none() {
    let bare = |radius_m: f64, lean_rad: f64| kind(&stem(radius_m, lean_rad), Street::new());
    assert_eq!((bare(0.12, 0.05), bare(0.12, 0.0)), (PoleKind::Trunk, PoleKind::LampPost));
    // A post that was run into, and what is too thick for any.
    assert_eq!((bare(0.04, 0.1), bare(0.2, 0.0)), (PoleKind::LampPost, PoleKind::Trunk));
}

#[test]
fn a_plate_makes_its_post_look_thick_and_no_tree_of_it() {
    let thick = |reflectance: f32| FittedPole { reflectance, top_is_open: false, ..stem(0.15, 0.01) };
    let kind = |reflectance: f32| kind(&thick(reflectance), Street::new());
    assert_eq!((kind(0.99), kind(0.5)), (PoleKind::SignPost, PoleKind::Trunk));
}

#[test]
fn a_sign_before_a_hedge_has_no_crown() {
    let kind = |reflectance: f32| {
        let mut street = Street::new();
        add_leaves(&mut street, 2.55, Vector3::new(0.8, 0.35, 0.8));
        kind(&FittedPole { reflectance, top_height_m: 2.2, top_is_open: false, ..stem(0.15, 0.01) }, street)
    };
    assert_eq!((kind(0.99), kind(0.5)), (PoleKind::SignPost, PoleKind::Trunk));
}

#[test]
fn what_is_as_thick_as_a_mast_and_ends_lower_than_lamps_is_a_tree() {
    let low = |radius_m: f64| FittedPole { top_is_open: false, ..stem(radius_m, 0.0) };
    let kind = |radius_m: f64| kind(&low(radius_m), Street::new());
    assert_eq!((kind(0.16), kind(0.04)), (PoleKind::Trunk, PoleKind::SignPost));
}

#[test]
fn what_may_be_either_is_what_the_others_of_its_place_are() {
    let cloud = Street::new().cloud();
    let doubtful = stem(0.14, 0.02);
    let among = |other: FittedPole| kind_among(&doubtful, &vec![other; 12], &cloud);
    assert_eq!((among(stem(0.14, 0.06)), among(stem(0.05, 0.0))), (PoleKind::Trunk, PoleKind::LampPost));
}

#[test]
fn a_plate_over_a_post_is_no_crown_and_what_is_around_it_is() {
    // A plate of 0.6 m, and what is 0.8 m to all sides: branches, or a parasol.
    let (plate, around) = (Vector3::new(0.3, 0.35, 0.0), Vector3::new(0.8, 0.35, 0.8));
    for radius_m in [0.03, 0.075] {
        let low = FittedPole { top_height_m: 2.2, top_is_open: false, ..stem(radius_m, 0.01) };
        let kind = |half: Vector3<f64>| {
            let mut street = Street::new();
            add_leaves(&mut street, 2.55, half);
            kind(&low, street)
        };
        assert_eq!((kind(plate), kind(around)), (PoleKind::SignPost, PoleKind::Trunk), "{radius_m}");
    }
}

#[test]
fn the_lamp_on_a_mast_beside_a_post_is_no_crown_of_the_post() {
    let post = FittedPole { top_height_m: 2.2, top_is_open: false, ..stem(0.03, 0.01) };
    let mut mast = stem(0.08, 0.0);
    mast.foot.x += 0.8;
    mast.top.x += 0.8;
    let mut street = Street::new();
    add_leaves_aside(&mut street, 0.8, 2.9, Vector3::new(0.2, 0.5, 0.2));
    let cloud = street.cloud();
    // Where no mast is, it is branches.
    let kinds = [kind_among(&post, &[mast], &cloud), kind_among(&post, &[], &cloud)];
    assert_eq!(kinds, [PoleKind::SignPost, PoleKind::Trunk]);
}

#[test]
fn a_bollard_beside_a_parked_car_is_no_trunk_and_a_stem_under_a_bush_is() {
    let pole = FittedPole { top_height_m: 0.9, radius_m: 0.05, top_is_open: false, ..slender().0 };
    let mut beside = Street::new();
    for depth in 0..3 {
        add_face(&mut beside, 5.5 + 0.15 * f64::from(depth), 20.0..36.0, 1.6);
    }
    let mut under = Street::new();
    add_leaves(&mut under, 1.6, Vector3::new(0.7, 0.28, 0.7));
    assert_eq!((kind(&pole, beside), kind(&pole, under)), (PoleKind::Delineator, PoleKind::Trunk));
}

#[test]
fn a_delineator_in_a_hedge_is_no_trunk_though_leaves_make_it_wide() {
    let mut street = Street::new();
    for depth in 0..9 {
        add_face(&mut street, 4.4 + 0.15 * f64::from(depth), 20.0..36.0, 1.8);
    }
    let cloud = street.cloud();
    let pole = FittedPole { top_height_m: 1.1, top_is_open: false, ..slender().0 };
    let kind = |radius_m: f64, reflectance: f32| {
        kind_among(&FittedPole { radius_m, reflectance, ..pole.clone() }, &[], &cloud)
    };
    assert_eq!(kind(0.1, 0.99), PoleKind::Delineator);
    // Without a reflector, and thicker than any post.
    assert_eq!((kind(0.1, 0.5), kind(0.15, 0.99)), (PoleKind::Trunk, PoleKind::Trunk));
}

#[test]
fn a_board_over_a_mast_is_no_crown_and_what_is_as_deep_is_one() {
    let kind = |depth_m: f64| {
        let mut street = Street::new();
        // From 0.1 m over the upper end on, 1.2 m to both sides.
        add_leaves(&mut street, 4.2, Vector3::new(1.2, 0.7, depth_m));
        kind(&FittedPole { top_is_open: false, ..stem(0.05, 0.0) }, street)
    };
    assert_ne!(kind(0.04), PoleKind::Trunk);
    assert_eq!(kind(0.8), PoleKind::Trunk);
}

#[test]
fn a_board_between_two_masts_is_a_crown_of_neither() {
    let mast = FittedPole { top_is_open: false, ..stem(0.05, 0.0) };
    let mut second = mast.clone();
    second.foot.x += 1.8;
    second.top.x += 1.8;
    let low = FittedPole { top_height_m: 1.2, ..second.clone() };
    let mut street = Street::new();
    add_leaves_aside(&mut street, 0.9, 4.2, Vector3::new(0.85, 0.7, 0.05));
    let cloud = street.cloud();
    let kinds = [second, low].map(|other| kind_among(&mast, &[other], &cloud));
    assert_eq!(kinds, [PoleKind::SignPost, PoleKind::Trunk]);
}

#[test]
fn the_top_of_a_hedge_is_no_crown() {
    let kind = |hedge_share: f64| {
        let mut street = Street::new();
        add_leaves(&mut street, 2.55, Vector3::new(0.8, 0.35, 0.8));
        kind(&FittedPole { hedge_share, top_height_m: 2.2, top_is_open: false, ..stem(0.04, 0.0) }, street)
    };
    // As full beside it as above it, and much fuller.
    assert_eq!((kind(0.2), kind(0.9)), (PoleKind::Trunk, PoleKind::SignPost));
}
