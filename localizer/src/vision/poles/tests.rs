use nalgebra::Point2;

use super::*;
use crate::vision::synthetic::{HEIGHT, WIDTH, bar, draw, empty};

fn poles(maps: &ProbabilityMaps) -> Vec<LineFeature> {
    extract(maps, &PoleConfig::default())
}

/// The largest distance of a feature's ends from the line through two points.
fn off(feature: &LineFeature, a: (f64, f64), b: (f64, f64)) -> f64 {
    let line = common::geometry::ImageLine::through(&Point2::new(a.0, a.1), &Point2::new(b.0, b.1)).unwrap();
    let distance = |p| line.signed_distance_px(p).abs();
    distance(&feature.upper_px).max(distance(&feature.lower_px))
}

#[test]
fn the_centre_line_of_a_slanted_bar_is_found_within_a_tenth_of_a_pixel() {
    for (top, bottom, width) in [
        ((120.3, 20.0), (128.9, 200.0), 6.0),
        ((250.0, 30.4), (230.0, 190.2), 3.0),
        ((61.7, 50.0), (61.7, 120.0), 11.5),
    ] {
        let mut maps = empty();
        draw(&mut maps, Class::Pole, bar(top, bottom, width));
        let [pole] = poles(&maps)[..] else { panic!("{top:?}") };
        assert!(off(&pole, top, bottom) < 0.1, "{pole:?}");
        assert!((pole.upper_px.y - top.1).abs() < 0.6 && (pole.lower_px.y - bottom.1).abs() < 0.6, "{pole:?}");
        assert!((pole.width_px - width).abs() < 0.5, "{pole:?}");
        assert!(!pole.upper_is_cut && !pole.lower_is_cut);
    }
}

#[test]
fn touching_poles_are_split() {
    // Side by side with a rim between them, and leaning against each other.
    for (a, b) in [
        (((100.0, 30.0), (100.0, 200.0)), ((109.0, 60.0), (109.0, 220.0))),
        (((150.0, 20.0), (165.0, 200.0)), ((180.0, 20.0), (165.0, 200.0))),
    ] {
        let mut maps = empty();
        draw(&mut maps, Class::Pole, bar(a.0, a.1, 6.0));
        draw(&mut maps, Class::Pole, bar(b.0, b.1, 6.0));
        draw(
            &mut maps,
            Class::Pole,
            |u, v| if (97.0..112.0).contains(&u) && (60.0..200.0).contains(&v) { 0.2 } else { 0.0 },
        );
        let found = poles(&maps);
        for (from, to) in [a, b] {
            assert!(found.iter().any(|pole| off(pole, from, to) < 0.8 && pole.length_px() > 100.0), "{found:?}");
        }
    }
}

#[test]
fn blobs_arcs_and_leaning_bars_are_no_poles() {
    let blob = |u: f64, v: f64| (20.0 - (u - 60.0).hypot(v - 60.0)).clamp(0.0, 1.0);
    let arc = |u: f64, v: f64| (3.0 - ((u - 200.0).hypot(v - 120.0) - 70.0).abs()).clamp(0.0, 1.0);
    for shape in [
        &blob as &dyn Fn(f64, f64) -> f64,
        &bar((50.0, 30.0), (150.0, 200.0), 5.0),
        &bar((20.0, 50.0), (200.0, 52.0), 5.0),
    ] {
        let mut maps = empty();
        draw(&mut maps, Class::Pole, shape);
        assert!(poles(&maps).is_empty(), "{:?}", poles(&maps));
    }
    // An arc is upright at its two sides only, and there it is bent.
    let mut maps = empty();
    draw(&mut maps, Class::Pole, arc);
    assert!(poles(&maps).iter().all(|pole| pole.length_px() < 60.0));
}

#[test]
fn a_lamp_arm_does_not_bend_its_pole() {
    let mut maps = empty();
    draw(&mut maps, Class::Pole, bar((200.0, 40.0), (200.0, 220.0), 5.0));
    draw(&mut maps, Class::Pole, bar((200.0, 42.0), (235.0, 36.0), 4.0));
    let [pole] = poles(&maps)[..] else { panic!() };
    assert!(off(&pole, (200.0, 40.0), (200.0, 220.0)) < 0.15, "{pole:?}");
}

#[test]
fn a_sign_hides_a_piece_and_the_pole_stays_one() {
    let mut maps = empty();
    draw(&mut maps, Class::Pole, bar((200.0, 20.0), (204.0, 60.0), 5.0));
    draw(&mut maps, Class::Pole, bar((209.0, 110.0), (213.0, 150.0), 5.0));
    draw(&mut maps, Class::Sign, |u, v| (26.0 - (u - 206.0).hypot(v - 85.0)).clamp(0.0, 1.0));
    let [pole] = poles(&maps)[..] else { panic!("{:?}", poles(&maps)) };
    assert!(off(&pole, (200.0, 20.0), (213.0, 150.0)) < 0.1 && pole.length_px() > 128.0, "{pole:?}");
}

#[test]
fn ends_at_the_border_or_at_a_sign_are_cut() {
    let (width, height) = (WIDTH as f64, HEIGHT as f64);
    for (top, bottom, upper, lower) in [
        ((100.0, -20.0), (100.0, 120.0), true, false),
        ((100.0, 100.0), (100.0, height + 20.0), false, true),
        ((width - 10.0, 60.0), (width + 10.0, 200.0), false, true),
        ((200.0, 100.0), (200.0, 200.0), true, false),
    ] {
        let mut maps = empty();
        draw(&mut maps, Class::Pole, bar(top, bottom, 6.0));
        draw(&mut maps, Class::Sign, |u, v| (12.0 - (u - 200.0).hypot(v - 88.0)).clamp(0.0, 1.0));
        let [pole] = poles(&maps)[..] else { panic!("{top:?}") };
        assert_eq!((pole.upper_is_cut, pole.lower_is_cut), (upper, lower), "{pole:?}");
    }
}

#[test]
fn an_end_that_fades_is_cut() {
    let mut maps = empty();
    let pole = bar((100.0, 40.0), (100.0, 200.0), 6.0);
    draw(&mut maps, Class::Pole, |u, v| pole(u, v) * (1.0 - (v - 120.0) / 80.0).clamp(0.0, 1.0));
    let [pole] = poles(&maps)[..] else { panic!() };
    assert!(pole.lower_is_cut && !pole.upper_is_cut, "{pole:?}");
}

#[test]
fn poles_come_from_left_to_right_and_the_same_every_time() {
    let mut maps = empty();
    for u in [300.0, 50.0, 180.0] {
        draw(&mut maps, Class::Pole, bar((u, 20.0), (u + 5.0, 180.0), 5.0));
    }
    let found = poles(&maps);
    assert!(found.len() == 3 && found.windows(2).all(|pair| pair[0].upper_px.x < pair[1].upper_px.x));
    assert_eq!(found, poles(&maps));
}
