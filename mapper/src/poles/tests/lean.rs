//! How far poles lean.

use super::*;

/// Foot and top of a pole that leans over map x and z by so much per metre.
fn leaning(x: f64, z: f64, height_m: f64, lean: f64) -> (Point3<f64>, Point3<f64>) {
    let foot = Point3::new(x, CAMERA_HEIGHT_M, z);
    (foot, foot + nalgebra::Vector3::new(lean * height_m, -height_m, 0.0))
}

/// A street with masts to its left at these places along it, that lean by so much.
fn with_masts(along_m: [f64; 4], lean: f64) -> Street {
    let mut street = Street::new();
    for z in along_m {
        let (foot, top) = leaning(-5.0, z, 5.0, lean);
        street.add_cylinder(foot, top, 0.06);
    }
    street
}

#[test]
fn short_posts_stand_as_the_long_ones_do() {
    // The first camera is rolled by 1.7 degrees, and so is all that stands.
    let mut street = with_masts([12.0, 22.0, 32.0, 42.0], 0.03);
    let (foot, top) = leaning(4.0, 27.0, 0.9, 0.03);
    street.add_cylinder(foot, top, 0.05);
    let poles = found(street);
    assert_eq!(poles.len(), 5);
    let short = poles.iter().find(|(kind, _)| *kind == PoleKind::Delineator).unwrap();
    assert!((short.1.slope.x - 0.03).abs() < 0.007 && short.1.slope.y.abs() < 0.007, "{}", short.1.slope);
}

#[test]
fn one_pole_that_leans_by_eight_degrees_keeps_its_lean() {
    let mut street = with_masts([12.0, 20.0, 36.0, 44.0], 0.0);
    let (foot, top) = leaning(5.0, 28.0, 4.0, 0.14);
    street.add_cylinder(foot, top, 0.06);
    let poles = found(street);
    let leaning = poles.iter().map(|(_, pole)| pole).find(|pole| pole.foot.x > 0.0).unwrap();
    assert!((leaning.slope.x - 0.14).abs() < 0.009, "{}", leaning.slope);
    assert!((leaning.foot - foot).norm() < 0.03);
}

#[test]
fn the_poles_of_a_camera_that_is_rolled_by_twelve_degrees_lean_with_its_road() {
    let found_on = |road_slope: f64| {
        let mut street = Street::shaped(0.1, |x| road_slope * x);
        for z in [16.0, 30.0, 44.0] {
            let (foot, top) = leaning(3.0, z, 4.0, -0.21);
            let up = nalgebra::Vector3::new(0.0, road_slope * 3.0, 0.0);
            street.add_cylinder(foot - up, top - up, 0.06);
        }
        found(street).len()
    };
    assert_eq!(found_on(0.21), 3);
    assert_eq!(found_on(0.0), 0, "on a level road nothing stands like that");
}
