//! Far from where it is expected: on the roads that it can have reached.

use super::gaps::{after, told};
use super::*;

#[test]
fn who_was_not_seen_for_long_is_found_on_the_roads_in_reach() {
    let world = World::new(Recipe { pole_spacing_m: 22.0, ..Recipe::default() });
    // Moved on as before it would be 240 m ahead, and no fix comes.
    let (dark, late_s) = (60..100, 20.0);
    let log = told(&world, &[(1..60, 0.0), (101..world.truth.len(), late_s)]);
    let mut config = Config::default();
    let said = after(dark.clone(), late_s, &world, &log, &config);
    let found = said.iter().position(|(_, status)| *status == Status::Ok).unwrap();
    assert!(found < 60, "after {found} frames");
    assert!(said[..found].iter().all(|(_, status)| *status == Status::Lost), "{said:?}");
    assert!(said[found..].iter().all(|(off_m, _)| *off_m < 0.5), "{said:?}");
    // Nothing else finds it.
    config.sweep.after_m = 1e5;
    let said = after(dark, late_s, &world, &log, &config);
    assert!(said.iter().all(|(off_m, status)| *off_m > 10.0 && *status != Status::Ok), "{said:?}");
}

#[test]
fn who_followed_a_gyroscope_that_was_off_is_found_again() {
    let world = World::new(Recipe { speed_m_s: 6.0, length_m: 150.0, ..Recipe::default() });
    let lies = 60..80;
    let turns = |frame: usize, shown: Odometry| {
        let more_rad_s = if lies.contains(&frame) { 1.5 } else { 0.0 };
        Odometry { yaw_rate_rad_s: shown.yaw_rate_rad_s + more_rad_s, ..shown }
    };
    let hidden = lies.start - 10..lies.end + 10;
    let is_hidden = |frame: usize| hidden.contains(&frame);
    let mishap = Mishap { has_wheels: true, wheels: &turns, is_hidden: &is_hidden, ..NONE };
    let back = |after_m: f64| {
        let mut config = Config::default();
        config.sweep.after_m = after_m;
        let run = run_with(&config, &world, &GpsConfig::default(), 1, &mishap);
        assert_eq!(run.lies(), 0);
        run.ok_from(hidden.end).filter(|back| run.errors_m[*back..].iter().all(|error_m| *error_m < 0.5))
    };
    let (swept, unswept) = (back(Config::default().sweep.after_m), back(1e5));
    assert!(swept.is_some_and(|back| back < hidden.end + 20), "{swept:?}");
    assert!(unswept.is_none_or(|back| back > hidden.end + 20), "{unswept:?}");
}

#[test]
fn who_drives_against_the_survey_is_found_from_a_fix_without_a_heading() {
    for is_against in [false, true] {
        let mut world = World::new(street());
        if is_against {
            world.map.roads.iter_mut().for_each(|road| road.path_map.reverse());
        }
        let mut map = LocalMap::whole(world.map.clone());
        let mut tracker = Tracker::new(&mut map, &world.camera, IMAGE, &Config::default());
        let off = Tangent::new(1.0, 0.0, -1.5, 0.0, 0.0, 0.0);
        let fix = GpsFix::from_pose(&retract(&world.truth[0], &off), &GpsConfig::default());
        let fix = GpsFix { heading: None, ..fix };
        for frame in 0..20 {
            let (time_s, features) = (time_s(frame), &world.features(frame));
            let gps = (frame == 0).then_some(&fix);
            let input = FrameInput { time_s, features, gps, odometry: None };
            let found = local(&world.truth[frame], &tracker.step(&input).unwrap().unwrap().map_from_camera);
            assert!(frame < 10 || found.fixed_rows::<3>(0).norm() < 0.5, "{is_against}, frame {frame}: {found}");
        }
    }
}
