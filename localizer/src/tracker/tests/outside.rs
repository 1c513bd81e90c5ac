//! Beyond the end of the map, and between two parts of it.

use std::ops::Range;

use super::*;

/// A street of which the map lacks these stretches of 50 m.
fn torn(recipe: Recipe, missing: Range<u32>) -> World {
    let mut world = World::new(recipe);
    let map = &mut world.map;
    let mut number = 0..;
    map.roads.retain(|_| number.next().is_some_and(|number| !missing.contains(&number)));
    let left = |road: &mut common::map::RoadId| {
        let is_left = !missing.contains(&road.0);
        road.0 -= if road.0 >= missing.end { missing.end - missing.start } else { 0 };
        is_left
    };
    map.poles.retain_mut(|pole| left(&mut pole.road));
    map.signs.retain_mut(|sign| left(&mut sign.road));
    map.lanes.retain_mut(|lane| left(&mut lane.road));
    world
}

/// The frame that is so far along the street, metres.
fn frame_at(way_m: f64) -> usize {
    (way_m / (Recipe::default().speed_m_s * time_s(1))) as usize
}

#[test]
fn who_drives_on_where_the_map_ends_is_followed_by_wheels_and_not_drawn_back() {
    let recipe = Recipe { length_m: 300.0, ..Recipe::default() };
    let world = torn(recipe, 2..10);
    for seed in 0..3 {
        let run = run(&world, &GpsConfig::default(), seed, &Mishap { has_wheels: true, ..NONE });
        let (inside, outside) = run.errors_m.split_at(frame_at(100.0));
        assert!(inside[15..].iter().all(|error_m| *error_m < 0.5), "{inside:?}");
        assert!(outside.iter().all(|error_m| *error_m < 0.02 * 200.0), "{outside:?}");
        assert_eq!(run.lies(), 0);
        let far = &run.statuses[frame_at(150.0)..];
        assert!(far.iter().all(|status| *status != Status::Ok), "{far:?}");
    }
}

#[test]
fn who_drives_on_unseen_beyond_the_map_is_lost_and_says_so() {
    let world = torn(Recipe { length_m: 300.0, ..Recipe::default() }, 2..10);
    let run = run(&world, &GpsConfig::default(), 1, &NONE);
    assert_eq!(run.lies(), 0);
    for (status, error_m) in run.statuses.iter().zip(&run.errors_m).skip(frame_at(100.0)) {
        assert!(*error_m < 3.0 || *status == Status::Lost, "{status:?}, {error_m} m");
    }
}

#[test]
fn who_comes_back_into_the_map_is_ok_again() {
    let world = torn(Recipe { length_m: 300.0, ..Recipe::default() }, 2..4);
    let run = run(&world, &GpsConfig::default(), 1, &Mishap { has_wheels: true, ..NONE });
    assert_eq!(run.lies(), 0);
    let back = frame_at(200.0);
    let again = run.ok_from(back).unwrap();
    assert!(again < back + 20, "{again}, {back}");
    assert!(run.errors_m[again..].iter().all(|error_m| *error_m < 0.5), "{:?}", run.errors_m);
}
