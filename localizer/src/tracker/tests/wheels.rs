use std::collections::BTreeMap;

use super::*;
use crate::odometry::OdometryLog;
use crate::run::{FrameFeatures, FrameResult, Localizer, Method, localize};

#[test]
fn wheels_that_lock_or_spin_and_numbers_that_no_vehicle_drives_are_not_believed() {
    let world = World::new(street());
    let nonsense = |frame: usize, Odometry { speed_m_s, yaw_rate_rad_s }: Odometry| match frame {
        30..40 => Odometry { speed_m_s: Some(0.0), yaw_rate_rad_s },
        50..60 => Odometry { speed_m_s: speed_m_s.map(|m_s| 2.0 * m_s), yaw_rate_rad_s },
        70 => Odometry { speed_m_s, yaw_rate_rad_s: 14.0 },
        74..78 => Odometry { speed_m_s, yaw_rate_rad_s: -1.5 },
        80 => Odometry { speed_m_s: Some(1e200), yaw_rate_rad_s: -1e200 },
        _ => Odometry { speed_m_s, yaw_rate_rad_s },
    };
    let run = run(&world, &GpsConfig::default(), 1, &Mishap { has_wheels: true, wheels: &nonsense, ..NONE });
    let started = run.ok_from(0).unwrap();
    assert_eq!(run.lies(), 0);
    assert!(run.rms_m(started) < 0.15, "{}", run.rms_m(started));
    let ok = run.statuses[started..].iter().filter(|status| **status == Status::Ok).count();
    assert!(10 * ok > 9 * (run.statuses.len() - started), "{ok}");
}

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

#[test]
fn a_log_leads_round_a_corner_that_no_image_shows() {
    let world = World::new(Recipe { corner: (1.3, 15.0), speed_m_s: 7.0, seed: 2, ..street() });
    let (gps, config) = (GpsConfig::default(), Config::default());
    let fixes: BTreeMap<usize, GpsFix> =
        simulate(&world.truth[..gps.simulated_fixes], &gps, 1).into_iter().enumerate().collect();
    let mut log = OdometryLog::default();
    for frame in 1..world.truth.len() {
        log.push(time_s(frame - 1), time_s(frame), world.odometry(frame));
    }
    let is_dark = |frame: &usize| (85..135).contains(frame);
    let frames: Vec<FrameFeatures> = (0..world.truth.len())
        .filter(|frame| !is_dark(frame))
        .map(|frame| {
            let features = world.features(frame);
            FrameFeatures { frame, time_s: time_s(frame), features, maps_ms: 0.0, features_ms: 0.0 }
        })
        .collect();
    let off_m = |told_step_s: f64| -> Vec<(f64, Status)> {
        let mut config = config.clone();
        config.unseen.told_step_s = told_step_s;
        let mut map = LocalMap::whole(world.map.clone());
        let localizer = Localizer::new(Method::Robust, &mut map, &world.camera, IMAGE, &config);
        let results = localize(&frames, &fixes, &log, localizer).unwrap();
        let of = |result: &FrameResult| {
            let off = local(&world.truth[result.frame], &result.estimate.map_from_camera);
            (off.fixed_rows::<3>(0).norm(), result.estimate.status)
        };
        results.iter().filter(|result| result.frame >= 135).map(of).collect()
    };
    let stepwise = off_m(config.unseen.told_step_s);
    assert!(stepwise.iter().all(|(off_m, _)| *off_m < 0.2), "{stepwise:?}");
    assert!(stepwise[..20].iter().all(|(_, status)| *status == Status::Ok), "{stepwise:?}");
    // As one mean speed and one turn the corner is cut.
    let at_once = off_m(10.0);
    assert!(at_once[0].0 > 3.0, "{at_once:?}");
}
