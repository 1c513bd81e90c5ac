//! What is not called ok.

use super::*;
use crate::associate::separation::SeparationConfig;

#[test]
fn an_older_image_than_the_last_is_not_called_ok_as_a_new_one_is() {
    // At this speed it is off by 0.6 m, and by no more than other tests let pass.
    let world = World::new(Recipe { speed_m_s: 3.0, ..street() });
    let is_old = |frame: usize| frame >= 30 && frame.is_multiple_of(5);
    let mishap = Mishap { shows: &|frame| frame - 2 * usize::from(is_old(frame)), ..NONE };
    let called_ok = |config: &Config, old: bool| {
        let run = run_with(config, &world, &GpsConfig::default(), 1, &mishap);
        (30..run.statuses.len()).filter(|&frame| is_old(frame) == old && run.statuses[frame] == Status::Ok).count()
    };
    let (config, mut blind) = (Config::default(), Config::default());
    blind.health.max_contradiction_sigmas = f64::INFINITY;
    let (old, old_to_the_blind) = (called_ok(&config, true), called_ok(&blind, true));
    assert!(old_to_the_blind > 0 && 2 * old <= old_to_the_blind, "{old} {old_to_the_blind}");
    assert!(called_ok(&config, false) > 50, "{}", called_ok(&config, false));
}

#[test]
fn an_image_that_comes_again_says_nothing_and_takes_no_trust() {
    let world = World::new(street());
    let is_old = |frame: usize| frame >= 30 && frame.is_multiple_of(5);
    let mishap = Mishap { shows: &|frame| frame - usize::from(is_old(frame)), ..NONE };
    let [run, whole] = [&mishap, &NONE].map(|mishap| run(&world, &GpsConfig::default(), 1, mishap));
    let mut ok = [0, 0];
    for frame in 30..run.statuses.len() {
        let off = local(&world.truth[frame], &run.poses[frame]).fixed_rows::<3>(0).norm();
        assert!(off < 0.4, "{frame}: {off} m");
        if is_old(frame) {
            assert_eq!(run.statuses[frame], Status::Degraded, "{frame}");
        } else {
            ok[0] += usize::from(run.statuses[frame] == Status::Ok);
            ok[1] += usize::from(whole.statuses[frame] == Status::Ok);
        }
    }
    assert!(5 * ok[0] >= 4 * ok[1], "{ok:?}");
}

#[test]
fn a_camera_that_shows_the_same_from_then_on_gets_lost() {
    let world = World::new(street());
    let mishap = Mishap { shows: &|frame| frame.min(40), ..NONE };
    let run = run(&world, &GpsConfig::default(), 1, &mishap);
    assert_eq!(run.statuses[40], Status::Ok);
    assert!(run.statuses[41..].iter().all(|status| *status != Status::Ok));
    let lost = run.statuses.iter().rposition(|status| *status != Status::Lost).unwrap();
    assert!(lost < 75, "{lost} of {}", run.statuses.len());
}

#[test]
fn who_knows_how_far_it_went_is_not_lost_where_there_is_nothing_to_see() {
    let world = World::new(street());
    let dark = 50..75;
    let in_the_dark = |has_wheels: bool, is_black: bool| {
        let is_dark = |frame: usize| dark.contains(&frame);
        let [is_black, is_hidden] = [is_black, !is_black].map(|this| move |frame: usize| this && is_dark(frame));
        let mishap = Mishap { is_black: &is_black, is_hidden: &is_hidden, has_wheels, ..NONE };
        let run = run(&world, &GpsConfig::default(), 1, &mishap);
        assert_eq!(run.lies(), 0);
        run.statuses[dark.clone()].to_vec()
    };
    let lost = |statuses: &[Status]| statuses.iter().filter(|status| **status == Status::Lost).count();
    assert_eq!(lost(&in_the_dark(true, true)), 0);
    // Without wheels, and where much should be seen that is not.
    for statuses in [in_the_dark(false, true), in_the_dark(true, false)] {
        assert!(statuses.iter().all(|status| *status != Status::Ok));
        assert!(lost(&statuses) >= 8, "{}", lost(&statuses));
    }
}

#[test]
fn what_was_known_before_a_landmark_came_into_view_bears_witness_for_it() {
    let recipe = Recipe { length_m: 600.0, pole_spacing_m: 40.0, lanes_m: &[-1.7], ..Recipe::default() };
    let world = World::new(recipe);
    let ok_frames = |anchor_s: f64| {
        let mut config = Config::default();
        config.separation.anchor_s = anchor_s;
        let wheels = Mishap { has_wheels: true, ..NONE };
        let run = run_with(&config, &world, &GpsConfig::default(), 0, &wheels);
        assert_eq!(run.lies(), 0);
        run.statuses.iter().filter(|status| **status == Status::Ok).count()
    };
    let (with, without) = (ok_frames(SeparationConfig::default().anchor_s), ok_frames(3600.0));
    assert!(with > without + 50, "{with} and {without} of {}", world.truth.len());
}

#[test]
fn who_knows_how_far_it_went_is_ok_in_the_dark_for_as_long_as_that_is_known_well() {
    let world = World::new(street());
    let from = 50;
    let mishap = Mishap { is_black: &|frame| frame >= from, has_wheels: true, ..NONE };
    let run = run(&world, &GpsConfig::default(), 1, &mishap);
    // Then it says so, and does not come back to it.
    let end = from + run.statuses[from..].iter().take_while(|status| **status == Status::Ok).count();
    assert!(end > from && end < run.statuses.len(), "{end}");
    assert!(run.statuses[end..].iter().all(|status| *status != Status::Ok));
    assert_eq!(run.lies(), 0);
}

#[test]
fn what_is_found_after_a_long_dark_is_not_trusted_for_what_was_before() {
    let world = World::new(street());
    let dark = 50..75;
    let mishap = Mishap { is_black: &|frame| dark.contains(&frame), ..NONE };
    let run = run(&world, &GpsConfig::default(), 1, &mishap);
    let back = run.ok_from(dark.end).unwrap();
    let led_frames = Config::default().health.led_frames;
    assert!((dark.end + led_frames - 1..dark.end + 20).contains(&back), "{back}");
    assert_eq!(run.lies(), 0);
}

#[test]
fn what_has_not_led_for_some_frames_is_not_called_ok() {
    let first_ok = |led_frames: usize| {
        let health = HealthConfig { led_frames, ..HealthConfig::default() };
        run_with(&Config { health, ..Config::default() }, &World::new(street()), &GpsConfig::default(), 3, &NONE)
            .ok_from(0)
    };
    let (soon, late) = (first_ok(0).unwrap(), first_ok(20).unwrap());
    // The first frame is the first that it leads.
    assert!(soon < 19 && late >= 19, "{soon} {late}");
}

#[test]
fn the_first_ok_asks_for_matches_that_agree_better() {
    let world = World::new(street());
    let of = |max_mean_square_anew: f64, max_mean_square: f64| {
        let health = HealthConfig { max_mean_square, max_mean_square_anew, ..HealthConfig::default() };
        run_with(&Config { health, ..Config::default() }, &world, &GpsConfig::default(), 3, &NONE)
    };
    let oks = |run: &Run| run.statuses.iter().filter(|status| **status == Status::Ok).count();
    let usual = of(1e9, 1e9);
    assert!(oks(&usual) > 0);
    // However good what follows: nothing is ok before the first is.
    assert_eq!(oks(&of(0.0, 1e9)), 0);
    // Once it was ok, it is asked no more.
    let first = usual.ok_from(0).unwrap();
    let strict = of(0.2, 1e9);
    let late = strict.ok_from(0).unwrap();
    assert!(late > first, "{late} {first}");
    assert!(usual.statuses[late..] == strict.statuses[late..]);
}

#[test]
fn ok_takes_as_many_good_frames_in_a_row() {
    let world = World::new(Recipe { missed: 0.7, pole_spacing_m: 15.0, ..street() });
    let is_ok = |well_frames: usize| {
        let (well_frames_anew, well_frames_again) = (well_frames, well_frames);
        // Three of ten that should be seen are: no matter here.
        let (least_foreseen, least_foreseen_anew, least_foreseen_again) = (0.0, 0.0, 0.0);
        let health = HealthConfig {
            well_frames,
            well_frames_anew,
            well_frames_again,
            least_foreseen_again,
            least_foreseen_anew,
            least_foreseen,
            ..HealthConfig::default()
        };
        let config = Config { health, ..Config::default() };
        let run = run_with(&config, &world, &GpsConfig::default(), 3, &NONE);
        run.statuses.iter().map(|status| *status == Status::Ok).collect::<Vec<_>>()
    };
    let (alone, of_three) = (is_ok(1), is_ok(3));
    let gaps = alone.windows(2).filter(|pair| pair[0] && !pair[1]).count();
    assert!(gaps > 2, "{gaps}");
    for frame in 2..alone.len() {
        assert_eq!(of_three[frame], alone[frame - 2..=frame].iter().all(|ok| *ok), "frame {frame}");
    }
}

#[test]
fn what_leads_is_ahead_of_all_others_however_they_stand() {
    let world = World::new(street());
    let (mut map, config) = (LocalMap::whole(world.map.clone()), Config::default());
    let fixes = simulate(&world.truth[..2], &config.gps, 1);
    let mut tracker = Tracker::new(&mut map, &world.camera, IMAGE, &config);
    for frame in 0..20 {
        let features = world.features(frame);
        let input = FrameInput { time_s: time_s(frame), features: &features, gps: fixes.get(frame), odometry: None };
        tracker.step(&input).unwrap();
    }
    tracker.bank.truncate(1);
    assert!(tracker.lead().is_infinite());
    for behind in [30.0, 2.0, 7.0] {
        let mut other = tracker.bank[0].clone();
        other.log_weight -= behind;
        tracker.bank.push(other);
    }
    assert!((tracker.lead() - 2.0).abs() < 1e-9, "{}", tracker.lead());
    // An image that comes again confirms nothing.
    tracker.bank.truncate(1);
    let followed_s = tracker.unfollowed_s;
    let features = world.features(19);
    for frame in 20..24 {
        let input = FrameInput { time_s: time_s(frame), features: &features, gps: None, odometry: None };
        tracker.step(&input).unwrap();
    }
    assert!(followed_s < 1e-9 && tracker.unfollowed_s > 0.35, "{followed_s} {}", tracker.unfollowed_s);
}

/// Streets of the same road and lines: where the posts are others, what fits by chance
/// holds a pose somewhere along the road.
#[test]
fn the_map_of_another_street_is_seldom_believed() {
    let recipe = |seed: u64| Recipe { seed, length_m: 300.0, curvature: 0.0, ..Recipe::default() };
    let ok_frames = |of_map: u64, least_foreseen: Option<f64>| {
        let mut world = World::new(recipe(1));
        world.map = World::new(recipe(of_map)).map;
        let mut config = Config::default();
        if let Some(least) = least_foreseen {
            let health = &mut config.health;
            (health.least_foreseen, health.least_foreseen_anew, health.least_foreseen_again) = (least, least, least);
        }
        let run = run_with(&config, &world, &GpsConfig::default(), 1, &Mishap { has_wheels: true, ..NONE });
        run.statuses.iter().filter(|status| **status == Status::Ok).count()
    };
    let of_others = |least: Option<f64>| (2..8).map(|seed| ok_frames(seed, least)).sum::<usize>();
    let (believed, else_believed) = (of_others(None), of_others(Some(0.0)));
    assert!(else_believed > 60 && 4 * believed < else_believed, "{believed} of {else_believed}");
    assert_eq!(ok_frames(1, None), ok_frames(1, Some(0.0)));
}

/// A motorway: its lines alone, which nothing tells apart along the way, and no post.
#[test]
fn a_map_that_promises_nothing_but_lines_is_missed_nothing_of() {
    let mut world = World::new(street());
    (world.map.poles, world.map.signs) = (Vec::new(), Vec::new());
    let config = Config::default();
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = Tracker::new(&mut map, &world.camera, IMAGE, &config);
    let fixes = simulate(&world.truth[..2], &GpsConfig::default(), 1);
    for frame in 0..60 {
        let (time_s, features) = (time_s(frame), world.features(frame));
        let input =
            FrameInput { time_s, features: &features, gps: fixes.get(frame), odometry: world.odometry(frame).into() };
        tracker.step(&input).unwrap();
        let foreseen = &tracker.bank[0].foreseen;
        let (share, agreement) = (foreseen.share(), foreseen.agreement(config.health.enough_known));
        assert!(share >= config.health.least_foreseen_again, "{frame}: {share}");
        assert!(agreement >= config.health.least_foreseen_anew, "{frame}: {agreement}");
    }
}
