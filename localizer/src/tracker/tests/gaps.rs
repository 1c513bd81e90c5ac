use std::collections::BTreeMap;
use std::ops::Range;

use super::*;
use crate::odometry::OdometryLog;
use crate::run::{FrameFeatures, FrameResult, Localizer, Method, localize};

#[test]
fn a_gap_of_an_hour_after_the_first_image_takes_no_more_memory_than_any() {
    let world = World::new(street());
    let gap = Mishap { late_s: &|frame| if frame > 0 { 3600.0 } else { 0.0 }, ..NONE };
    let run = run(&world, &GpsConfig::default(), 1, &gap);
    assert!(run.errors_m.iter().all(|error_m| error_m.is_finite()));
    assert_eq!(run.lies(), 0);
}

#[test]
fn a_day_in_which_nobody_saw_it_takes_a_vehicle_no_further_than_some_minutes() {
    let world = World::new(street());
    let is_one = |_: usize, tracker: &mut Tracker<'_>| {
        let said = tracker.said.as_ref();
        assert!(said.is_none_or(|said| nalgebra::Cholesky::new(said.covariance).is_some()), "{said:?}");
    };
    for has_wheels in [false, true] {
        let late_s = |frame: usize| if frame < 60 { 0.0 } else { 86_400.0 };
        let gap = Mishap { late_s: &late_s, before: &is_one, has_wheels, ..NONE };
        let run = run(&world, &GpsConfig::default(), 1, &gap);
        let most_m = run.errors_m.iter().copied().fold(0.0, f64::max);
        assert!(most_m < Config::default().unseen.longest_told_s * Config::default().bank.max_speed_m_s, "{most_m} m");
        assert_eq!(run.lies(), 0);
    }
}

/// Positions and what is said of them behind frames of which no image comes, and which
/// take longer by `late_s` than they do at the speed of the drive.
pub fn after(dark: Range<usize>, late_s: f64, world: &World, log: &OdometryLog, config: &Config) -> Vec<(f64, Status)> {
    let fixes = fixes(0..GpsConfig::default().simulated_fixes, world);
    after_with(&fixes, dark, late_s, world, log, config)
}

/// What a receiver says in these frames.
fn fixes(frames: Range<usize>, world: &World) -> BTreeMap<usize, GpsFix> {
    let said = simulate(&world.truth[frames.clone()], &GpsConfig::default(), 1);
    frames.zip(said).collect()
}

/// The same with these fixes.
fn after_with(
    fixes: &BTreeMap<usize, GpsFix>,
    dark: Range<usize>,
    late_s: f64,
    world: &World,
    log: &OdometryLog,
    config: &Config,
) -> Vec<(f64, Status)> {
    let frames = (0..world.truth.len()).filter(|frame| !dark.contains(frame)).map(|frame| {
        let late_s = if frame < dark.end { 0.0 } else { late_s };
        let features = world.features(frame);
        FrameFeatures { frame, time_s: time_s(frame) + late_s, features, maps_ms: 0.0, features_ms: 0.0 }
    });
    let mut map = LocalMap::whole(world.map.clone());
    let localizer = Localizer::new(Method::Robust, &mut map, &world.camera, IMAGE, config);
    let results = localize(&frames.collect::<Vec<_>>(), fixes, log, localizer).unwrap();
    let of = |result: &FrameResult| {
        let off = local(&world.truth[result.frame], &result.estimate.map_from_camera);
        (off.fixed_rows::<3>(0).norm(), result.estimate.status)
    };
    results.iter().filter(|result| result.frame >= dark.end).map(of).collect()
}

/// What the motion is said to be up to these frames, the times of which are late, seconds.
pub fn told(world: &World, stretches: &[(Range<usize>, f64)]) -> OdometryLog {
    let mut log = OdometryLog::default();
    for (frames, late_s) in stretches {
        for frame in frames.clone() {
            log.push(time_s(frame - 1) + late_s, time_s(frame) + late_s, world.odometry(frame));
        }
    }
    log
}

#[test]
fn who_braked_while_nobody_saw_it_is_found_again() {
    let world = World::new(Recipe { pole_spacing_m: 22.0, length_m: 300.0, ..Recipe::default() });
    let log = told(&world, &[(1..60, 0.0), (101..world.truth.len(), 1.5)]);
    let said = after(60..100, 1.5, &world, &log, &Config::default());
    let found = said.iter().position(|(_, status)| *status == Status::Ok).unwrap();
    assert!(found < 25, "after {found} frames");
    assert!(said[found..].iter().all(|(off_m, _)| *off_m < 0.5), "{said:?}");
}

#[test]
fn one_fix_says_where_who_was_not_seen_for_long_is() {
    let world = World::new(Recipe { pole_spacing_m: 22.0, length_m: 400.0, ..Recipe::default() });
    // Moved on as before it would be 240 m ahead.
    let (dark, late_s) = (60..100, 20.0);
    let log = told(&world, &[(1..60, 0.0), (101..world.truth.len(), late_s)]);
    let mut fixes = fixes(0..GpsConfig::default().simulated_fixes, &world);
    fixes.extend(self::fixes(105..106, &world));
    let said = after_with(&fixes, dark, late_s, &world, &log, &Config::default());
    assert!(said[..5].iter().all(|(_, status)| *status == Status::Lost), "{said:?}");
    let found = said.iter().position(|(_, status)| *status == Status::Ok).unwrap();
    assert!(found < 20, "after {found} frames");
    assert!(said[10..].iter().all(|(off_m, _)| *off_m < 0.5), "{said:?}");
}

#[test]
fn who_stands_when_it_is_told_again_may_have_gone_far_before() {
    let world = World::new(Recipe { length_m: 250.0, ..Recipe::default() });
    let mut log = told(&world, &[(1..61, 0.0)]);
    // Of the gap the end alone is told.
    let stands = Odometry::of_wheels(0.0, 0.0);
    for i in 0..2 {
        let began_s = time_s(100) + 5.0 + 0.5 * f64::from(i);
        log.push(began_s, began_s + 0.5, stands);
    }
    let said = after(60..100, 6.0, &world, &log, &Config::default());
    assert!(said[0].1 == Status::Lost, "{said:?}");
}

#[test]
fn a_log_leads_round_a_corner_that_no_image_shows() {
    let world = World::new(Recipe { corner: (1.3, 15.0), speed_m_s: 7.0, seed: 2, ..street() });
    let log = told(&world, &[(1..world.truth.len(), 0.0)]);
    let mut config = Config::default();
    let stepwise = after(85..135, 0.0, &world, &log, &config);
    assert!(stepwise.iter().all(|(off_m, _)| *off_m < 0.2), "{stepwise:?}");
    assert!(stepwise[..20].iter().all(|(_, status)| *status == Status::Ok), "{stepwise:?}");
    // As one mean speed and one turn the corner is cut.
    config.unseen.step_s = 10.0;
    let at_once = after(85..135, 0.0, &world, &log, &config);
    assert!(at_once[0].0 > 3.0, "{at_once:?}");
}
