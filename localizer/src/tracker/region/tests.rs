use common::geometry::{Pose, retract};

use super::*;
use crate::testing::{IMAGE, Recipe, World};

const MOST: f64 = 25.0;
const CONTRADICTION: f64 = 8.0;

/// A fix so far to the right of where the region begins, and what it says.
fn fix(right_m: f64) -> (GpsFix, Rough) {
    let position_map = Point3::new(right_m, 0.0, 0.0);
    let fix =
        GpsFix { position_map, horizontal_sigma_m: 1.5, heading: Some((0.0, 0.03)), is_course: false, age_s: 0.0 };
    let map_from_camera = retract(&Pose::identity(), &(Tangent::x() * right_m));
    (fix, Rough { map_from_camera, sigmas: Vector6::new(1.5, 0.2, 1.5, 0.03, 0.03, 0.03) })
}

fn told(region: &mut Region, right_m: f64, times: usize, config: &Config) {
    let (fix, rough) = fix(right_m);
    (0..times).for_each(|_| region.take(&fix, &rough, None, config));
}

/// A region that begins with a fix that tells no heading, and that headed the other way.
fn headed_either_way(config: &Config) -> (Region, [Rough; 2]) {
    let (fix, along) = fix(0.0);
    let against = Rough { map_from_camera: retract(&along.map_from_camera, &turn(PI)), ..along };
    let mut region = Region::default();
    region.take(&GpsFix { heading: None, ..fix }, &along, Some(&against), config);
    (region, [along, against])
}

fn turn(yaw_rad: f64) -> Tangent {
    Tangent::new(0.0, 0.0, 0.0, 0.0, yaw_rad, 0.0)
}

#[test]
fn who_tells_no_heading_may_drive_either_way_until_one_is_trusted() {
    let config = Config::default();
    let (mut region, roughs) = headed_either_way(&config);
    let [along, against] = roughs.map(|rough| unknown_speed(&rough, &config));
    let costs = |region: &Region| [&along, &against].map(|state| region.against(state, &config.gps, MOST));
    assert!(region.searched_turned(&config.gps).is_some());
    assert!(costs(&region).iter().all(|cost| *cost < 0.1), "{:?}", costs(&region));
    region.trust(&against, CONTRADICTION);
    assert!(region.searched_turned(&config.gps).is_none() && costs(&region)[1] < 0.1, "{:?}", costs(&region));
}

#[test]
fn a_fix_that_tells_the_heading_decides_which_way_the_road_is_driven() {
    let config = Config::default();
    for (yaw_rad, is_turned) in [(3.0, true), (0.1, false)] {
        let (mut region, [along, _]) = headed_either_way(&config);
        let (fix, told) = fix(0.5);
        // Beside no road one without a heading tells none.
        let mut astray = told;
        astray.sigmas[4] = PI / 2.0;
        region.take(&GpsFix { heading: None, ..fix }, &astray, None, &config);
        assert!(region.searched_turned(&config.gps).is_some());
        let told = Rough { map_from_camera: retract(&told.map_from_camera, &turn(yaw_rad)), ..told };
        region.take(&fix, &told, None, &config);
        let kept = region.searched(&config.gps).unwrap();
        let off_rad = local(&along.map_from_camera, &kept.map_from_camera)[4].abs();
        assert!((off_rad > 2.5) == is_turned && region.searched_turned(&config.gps).is_none(), "{off_rad}");
    }
}

/// Who went 20 m with a heading known to 0.2 rad is aside by that.
#[test]
fn what_a_fix_says_of_the_side_is_not_said_again_by_its_heading() {
    let (_, known) = fix(0.0);
    let mut place = unknown_speed(&known, &Config::default());
    let (side_m, heading_rad, way_m) = (1.0, 0.2, 20.0);
    place.covariance[(4, 4)] = heading_rad * heading_rad;
    place.covariance[(0, 0)] = side_m * side_m + (way_m * heading_rad) * (way_m * heading_rad);
    for at in [(0, 4), (4, 0)] {
        place.covariance[at] = way_m * heading_rad * heading_rad;
    }
    let (_, mut rough) = fix(3.0);
    rough.map_from_camera = retract(&rough.map_from_camera, &Tangent::new(0.0, 0.0, 0.0, 0.0, 0.15, 0.0));
    take_in(&mut place, &rough);
    let off = local(&known.map_from_camera, &place.map_from_camera);
    assert!((off[0] - 3.0).abs() < 0.4 && (off[4] - 0.15).abs() < 0.03, "{off}");
}

#[test]
fn what_was_lost_for_long_is_still_as_high_and_as_level_as_the_road() {
    let world = World::new(Recipe::default());
    let (map, roads) = world.local_map();
    let (config, truth) = (Config::default(), world.truth[100]);
    let off = Tangent::new(1.0, 2.5, 4.0, 0.2, 0.0, -0.15);
    // Stands 0.3 m higher than the survey's camera, and nods and leans against it.
    let (higher_m, rest_rad) = (0.3, [0.04, -0.03]);
    let rough = |sigma_m: f64, sigma_rad: f64| {
        let sigmas = Vector6::new(sigma_m, sigma_m, sigma_m, sigma_rad, sigma_rad, sigma_rad);
        let known = Rough { map_from_camera: retract(&truth, &off), sigmas };
        let state = State { higher_m, rest_rad, ..unknown_speed(&known, &config) };
        rough_of(&state, &map, &roads, &config)
    };
    let lost = rough(3.0, 0.2);
    let off = local(&truth, &lost.map_from_camera);
    assert!((off[1] + higher_m).abs() < 0.1, "{off}");
    assert!((off[3] - rest_rad[0]).abs() < 0.02 && (off[5] - rest_rad[1]).abs() < 0.01, "{off}");
    let start = &config.start;
    let [height_m, pitch_rad, roll_rad] = [1, 3, 5].map(|component| lost.sigmas[component]);
    assert!(height_m <= start.height_sigma_m && pitch_rad.max(roll_rad) <= start.tilt_sigma_rad);
    assert!(lost.sigmas[2] >= 3.0 - 1e-9, "{}", lost.sigmas);
    // Who knows that better keeps it.
    let known = local(&truth, &rough(0.05, 0.005).map_from_camera);
    assert!((known[1] - 2.5).abs() < 0.3 && (known[3] - 0.2).abs() < 0.02, "{known}");
}

#[test]
fn who_is_lost_for_an_hour_goes_no_faster_and_no_further_than_vehicles_do() {
    let world = World::new(Recipe::default());
    let (mut map, _) = world.local_map();
    let (config, truth) = (Config::default(), world.truth[100]);
    let mut tracker = Tracker::new(&mut map, &world.camera, IMAGE, &config);
    let mut state = unknown_speed(&fix(0.0).1, &config);
    (state.map_from_camera, state.velocity[2]) = (truth, 400.0);
    tracker.region.trust(&state, CONTRADICTION);
    // As fast as that was only until its speed is asked for.
    tracker.follow_region(1.0, None, None).unwrap();
    let mut before = tracker.region.searched(&config.gps).unwrap().map_from_camera;
    for _ in 0..3600 {
        tracker.follow_region(1.0, None, None).unwrap();
        let place = tracker.region.searched(&config.gps).unwrap();
        let way_m = local(&before, &place.map_from_camera).fixed_rows::<3>(0).norm();
        assert!(way_m < 2.0 * config.bank.max_speed_m_s, "{way_m} m in a second");
        let sigmas_m = place.pose_covariance().diagonal().map(f64::sqrt);
        assert!(sigmas_m.iter().all(|sigma| *sigma <= 1.01 * config.health.max_lost_sigma_m), "{sigmas_m}");
        before = place.map_from_camera;
    }
}

#[test]
fn more_fixes_of_one_receiver_do_not_tell_more() {
    let (mut region, config) = (Region::default(), Config::default());
    told(&mut region, 0.0, 30, &config);
    let variance_m2 = region.trusted.as_ref().unwrap().covariance[(0, 0)];
    assert!((1.0..2.3).contains(&variance_m2), "{variance_m2}");
}

/// A state so far to the right, known to 0.15 m across.
fn at(right_m: f64, config: &Config) -> State {
    let mut state = unknown_speed(&fix(right_m).1, config);
    state.sharpen(0, 0.1);
    state
}

#[test]
fn where_a_trusted_pose_contradicts_the_one_before_both_may_be_right() {
    let (mut region, config) = (Region::default(), Config::default());
    let against = |region: &Region, state: &State| region.against(state, &config.gps, MOST);
    let (here, there, away) = (at(0.0, &config), at(4.0, &config), at(12.0, &config));
    region.trust(&here, CONTRADICTION);
    assert!((against(&region, &there) - MOST).abs() < 1e-9);
    // A wrong lock does not speak against where it jumped from, however often
    // it is trusted, but against all other places.
    for _ in 0..3 {
        region.trust(&there, CONTRADICTION);
    }
    assert!(against(&region, &here) < 1e-9 && against(&region, &there) < 1e-9);
    assert!((against(&region, &away) - MOST).abs() < 1e-9);
    // Once it is undone, it does not count any more.
    region.trust(&here, CONTRADICTION);
    assert!(against(&region, &here) < 1e-9 && (against(&region, &there) - MOST).abs() < 1e-9);
}

#[test]
fn a_fix_tells_which_of_the_trusted_poses_was_wrong() {
    let (mut region, config) = (Region::default(), Config::default());
    for right_m in [0.0, 20.0] {
        region.trust(&at(right_m, &config), CONTRADICTION);
    }
    let against = |region: &Region| region.against(&at(0.0, &config), &config.gps, MOST);
    // A reflection contradicts both, and tells nothing.
    told(&mut region, 60.0, 1, &config);
    assert!(against(&region) < 1e-9);
    told(&mut region, 20.0, 1, &config);
    assert!((against(&region) - MOST).abs() < 1e-9);
}

#[test]
fn where_fixes_contradict_what_was_trusted_both_may_be_right() {
    let (mut region, config) = (Region::default(), Config::default());
    let (here, there) = (at(0.0, &config), at(20.0, &config));
    region.trust(&here, CONTRADICTION);
    let against = |region: &Region, state: &State| region.against(state, &config.gps, MOST);
    told(&mut region, 20.0, config.gps.believed_after - 1, &config);
    assert!(against(&region, &here) < 1e-9 && (against(&region, &there) - MOST).abs() < 1e-9);
    assert_eq!(region.searched(&config.gps), Some(&here));
    told(&mut region, 20.0, 1, &config);
    assert!(against(&region, &here) < 1e-9 && against(&region, &there) < 1.0);
    let searched = region.searched(&config.gps).unwrap().map_from_camera;
    assert!((searched.translation.x - 20.0).abs() < 1e-6);
    // One that agrees again says that the others were reflections.
    told(&mut region, 0.5, 1, &config);
    assert!((against(&region, &there) - MOST).abs() < 1e-9);
}
