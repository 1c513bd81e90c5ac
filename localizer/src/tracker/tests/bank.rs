//! What speaks for a hypothesis, and what against it.

use super::*;
use crate::associate::robust::Question;
use crate::solver::Prior;

#[test]
fn where_two_may_be_right_their_mean_is_said_with_their_spread() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let best = followed(&world, &mut map).bank.remove(0);
    let mut other = best.clone();
    other.state.map_from_camera = retract(&best.state.map_from_camera, &(Tangent::x() * 2.0));
    let own = best.state.pose_covariance();
    let mean = |other: &Hypothesis| {
        let both: Vec<_> = [&best, other].into_iter().cloned().collect();
        let (pose, covariance) = mean::mean_of(&both, 3.0).unwrap();
        (local(&best.state.map_from_camera, &pose)[0], covariance[(0, 0)] - own[(0, 0)])
    };
    let (off_m, more_m2) = mean(&other);
    assert!((off_m - 1.0).abs() < 1e-6 && (more_m2 - 1.0).abs() < 1e-6, "{off_m} m, {more_m2} m2");
    other.log_weight -= 60.0;
    let (off_m, more_m2) = mean(&other);
    assert!(off_m.abs() < 1e-6 && more_m2.abs() < 1e-6, "{off_m} m, {more_m2} m2");
}

#[test]
fn of_two_that_come_to_tell_the_same_the_less_probable_is_not_forgotten() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = followed(&world, &mut map);
    let best = tracker.bank.remove(0);
    let config = Config::default();
    let own_m2 = best.state.pose_covariance()[(2, 2)];
    // Where a pose and its variance get to by one 0.3 m farther along, less probable by so
    // many nats, that was tracked beside it for so long.
    let mut merged = |behind: f64, apart_frames: usize| {
        let mut other = best.clone();
        (other.apart_frames, other.log_weight) = (apart_frames, best.log_weight - behind);
        other.state.map_from_camera = retract(&best.state.map_from_camera, &(Tangent::z() * 0.3));
        tracker.bank = vec![best.clone(), other];
        tracker.prune();
        assert_eq!(tracker.bank.len(), 1);
        let state = &tracker.bank[0].state;
        let forward_m = local(&best.state.map_from_camera, &state.map_from_camera)[2];
        (forward_m, state.pose_covariance()[(2, 2)] - own_m2)
    };
    let (forward_m, more_m2) = merged(0.0, best.apart_frames);
    assert!((forward_m - 0.15).abs() < 1e-6 && (more_m2 - 0.15 * 0.15).abs() < 1e-6, "{forward_m} m, {more_m2} m2");
    let (less_m, _) = merged(config.bank.doubt, best.apart_frames);
    assert!(less_m > 0.03 && less_m < 0.1, "{less_m} m");
    // What was just split off it knows nothing of its own.
    let (young_m, _) = merged(0.0, config.health.verify_frames - 1);
    assert!(young_m.abs() < 1e-9, "{young_m} m");
}

#[test]
fn a_frame_that_fits_all_as_well_leaves_what_was_known_of_them() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let best = followed(&world, &mut map).bank.remove(0);
    let bank = BankConfig::default();
    // The lead of one hypothesis over another in 20 frames that say so much for each.
    let lead = |evidence: f64, other_evidence: f64| {
        let (mut best, mut other) = (best.clone(), best.clone());
        (best.past_weight, other.past_weight, other.handicap) = (0.0, -6.0, 5.0);
        for _ in 0..20 {
            (best.evidence, other.evidence) = (evidence, other_evidence);
            let told = bank.told([evidence, other_evidence].into_iter());
            let of_best = best.spoken();
            best.carry(of_best, told, &bank);
            other.carry(of_best, told, &bank);
        }
        (best.past_weight - other.past_weight, other.handicap)
    };
    let (kept, handicap) = lead(7.0, 7.0);
    assert!((kept - 6.0).abs() < 1e-9 && (handicap - 5.0).abs() < 1e-9, "{kept} {handicap}");
    // What tells them apart counts for about five frames, whatever was before.
    let (won, handicap) = lead(6.0, 8.0);
    let lasting = 2.0 * bank.memory / (1.0 - bank.memory);
    assert!((won + lasting).abs() < 0.2 && handicap < 2.0, "{won} {handicap}");
}

/// Moves hypotheses that were told so much on by a frame, in place of all that are tracked.
fn predict_of(tracker: &mut Tracker<'_>, was_ever_ok: bool, told: impl Iterator<Item = Hypothesis>) {
    tracker.verdict = tracker.verdict.map(|verdict| Verdict { was_ever_ok, ..verdict });
    tracker.bank = told.collect();
    tracker.predict(0.1, &Believed::default());
}

#[test]
fn what_a_frame_says_of_a_third_tells_two_hypotheses_not_apart() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = followed(&world, &mut map);
    let best = tracker.bank.remove(0);
    // Of three it fits two as well, and the third not at all.
    let mut predict = |was_ever_ok: bool, count: usize| {
        let told = [(0.0, 7.0), (-6.0, 7.0), (-6.0, -3.0)].into_iter().take(count).map(|(past_weight, evidence)| {
            let mut one = best.clone();
            (one.past_weight, one.evidence, one.handicap) = (past_weight, evidence, 5.0);
            one
        });
        predict_of(&mut tracker, was_ever_ok, told);
        let lead = |other: &Hypothesis| (tracker.bank[0].past_weight - other.past_weight, other.handicap);
        tracker.bank.iter().map(lead).collect::<Vec<_>>()
    };
    let [first, second, third] = predict(true, 3)[..] else { panic!("not three") };
    assert!((second.0 - 6.0).abs() < 1e-9, "{second:?}");
    assert!((first.1 - 5.0).abs() < 1e-9 && (second.1 - 5.0).abs() < 1e-9, "{first:?} {second:?}");
    assert!(third.0 > 7.0 && third.1 < 5.0, "{third:?}");
    // One alone has no other that it would have to be told from.
    assert!(predict(true, 1)[0].1 < 5.0);
    // Before anything was trusted, what one frame said fades.
    let [first, second, _] = predict(false, 3)[..] else { panic!("not three") };
    assert!(second.0 < 5.0 && first.1 < 5.0 && second.1 < 5.0, "{first:?} {second:?}");
}

#[test]
fn frames_from_one_place_count_little_once_one_was_trusted() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = followed(&world, &mut map);
    let best = tracker.bank.remove(0);
    // How far another one falls back that a frame speaks against, by the way to it.
    let mut fallen = |way_m: f64, was_ever_ok: bool| {
        let told = [7.0, 2.0].map(|evidence| {
            let mut one = best.clone();
            (one.past_weight, one.evidence, one.way_m) = (0.0, evidence, way_m);
            one
        });
        predict_of(&mut tracker, was_ever_ok, told.into_iter());
        tracker.bank[0].past_weight - tracker.bank[1].past_weight
    };
    let whole = 5.0 * BankConfig::default().memory;
    assert!((fallen(0.5, true) - whole).abs() < 1e-9 && (fallen(2.0, true) - whole).abs() < 1e-9);
    assert!((fallen(0.25, true) - 0.5 * whole).abs() < 1e-9);
    assert!((fallen(0.0, true) - 0.2 * whole).abs() < 1e-9);
    assert!((fallen(0.0, false) - whole).abs() < 1e-9, "nothing is known that would have to stay");
}

#[test]
fn who_was_just_trusted_is_not_lost() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let bank = BankConfig::default();
    let fresh = Tracker::new(&mut map, &world.camera, IMAGE, &Config::default());
    assert!((fresh.newcomer_cost() - bank.newcomer_cost).abs() < 1e-9);
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = followed(&world, &mut map);
    assert!((tracker.newcomer_cost() - bank.jump_cost).abs() < 1e-9);
    let mut time_s = tracker.last_time_s.unwrap();
    let nothing = Features::default();
    let mut costs = Vec::new();
    for _ in 0..100 {
        time_s += 0.1;
        tracker.step(&FrameInput { time_s, features: &nothing, gps: None, odometry: None }).unwrap();
        costs.push(tracker.newcomer_cost());
    }
    // Once what was believed is too uncertain to be followed.
    let last = costs.last().unwrap();
    assert!(costs.is_sorted_by(|a, b| a >= b) && *last < bank.newcomer_cost + 1.0, "{last}");
}

#[test]
fn beside_a_place_found_again_another_need_not_be_a_jump() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = followed(&world, &mut map);
    let bank = BankConfig::default();
    let trusted = tracker.verdict.unwrap();
    assert!(trusted.was_ok && trusted.was_ever_ok);
    let mut cost = |was_ok: bool, was_ever_ok: bool| {
        tracker.verdict = Some(Verdict { was_ok, was_ever_ok, ..trusted });
        tracker.rival_cost()
    };
    assert!((cost(true, true) - bank.jump_cost).abs() < 1e-9);
    assert!((cost(false, true) - bank.newcomer_cost).abs() < 1e-9);
    // At the start all that may be right is searched at once.
    assert!((cost(false, false) - bank.jump_cost).abs() < 1e-9);
}

#[test]
fn what_slides_away_from_the_trusted_pose_pays_for_all_of_the_way() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = followed(&world, &mut map);
    let (best, most) = (tracker.bank[0].clone(), tracker.config.bank.most_astray);
    let mut astray = |right_m: f64| {
        let mut moved = best.clone();
        moved.state.map_from_camera = retract(&best.state.map_from_camera, &(Tangent::x() * right_m));
        tracker.bank.clear();
        tracker.add(moved);
        let added = &tracker.bank[0];
        assert!((added.log_weight + added.astray - best.log_weight - best.astray).abs() < 1e-9);
        added.astray
    };
    let costs: Vec<f64> = [0.0, 0.1, 0.2, 4.0, 40.0].into_iter().map(&mut astray).collect();
    assert!(costs.is_sorted() && costs[0] < 0.1 && costs[1] > costs[0] && costs[2] > 2.0 * costs[1], "{costs:?}");
    assert!((costs[3] - most).abs() < 1e-9 && (costs[4] - most).abs() < 1e-9, "{costs:?}");
}

#[test]
fn a_jump_tells_of_wrong_times_once_the_speed_is_known() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = followed(&world, &mut map);
    let mut best = tracker.bank.remove(0);
    tracker.select(&best.state.map_from_camera, &Reach { position_m: 5.0, angle_rad: 0.1 }).unwrap();
    let prior = Prior::new(best.state.map_from_camera, &best.state.pose_covariance()).unwrap();
    let scene = tracker.sight.scene(&tracker.config);
    let question = Question {
        scene: &scene,
        gate_covariance: &best.state.pose_covariance(),
        prior: &prior,
        config: &tracker.config,
    };
    let rival = tracker.associator.refine(&question, &best.state.map_from_camera).unwrap();
    let tells = |best: &Hypothesis| Hypothesis::beside(best, &rival, 10.0).interval.is_some();
    assert!(tells(&best));
    best.age_frames = 1;
    assert!(!tells(&best));
}

#[test]
fn a_jump_pays_once_for_its_distance() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = followed(&world, &mut map);
    let best = tracker.bank.remove(0);
    tracker.select(&best.state.map_from_camera, &Reach { position_m: 5.0, angle_rad: 0.1 }).unwrap();
    let prior = Prior::new(best.state.map_from_camera, &best.state.pose_covariance()).unwrap();
    let scene = tracker.sight.scene(&tracker.config);
    let gate_covariance = best.state.pose_covariance();
    let question =
        Question { scene: &scene, gate_covariance: &gate_covariance, prior: &prior, config: &tracker.config };
    let beside = retract(&best.state.map_from_camera, &(Tangent::x() * 0.5));
    let mut far = tracker.associator.refine(&question, &beside).unwrap();
    far.prior_cost = 7.0;
    let paid = |jump: &Hypothesis| far.support + far.occam + best.past_weight - jump.log_weight;
    for jump_cost in [1.0, 1e3] {
        let (jumped, rival) = (Hypothesis::jumped(&best, &far, jump_cost), Hypothesis::beside(&best, &far, jump_cost));
        assert!((paid(&jumped) - jumped.handicap).abs() < 1e-9, "{}", paid(&jumped));
        assert!((paid(&rival) - rival.handicap - far.prior_cost).abs() < 1e-9, "{}", paid(&rival));
    }
}

#[test]
fn what_was_hidden_from_the_best_was_hidden_from_those_beside_it() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = followed(&world, &mut map);
    for past_weight in [-30.0, 10.0] {
        tracker.bank.truncate(1);
        let best = &mut tracker.bank[0];
        best.state.map_from_camera = retract(&best.state.map_from_camera, &(Tangent::x() * 2.0));
        (best.past_weight, best.log_weight) = (past_weight, past_weight);
        assert!(tracker.search_if_needed().unwrap());
        let found: Vec<f64> = tracker.bank.iter().filter(|h| h.age_frames == 0).map(|h| h.past_weight).collect();
        assert!(!found.is_empty() && found.iter().all(|past| (past - past_weight.min(0.0)).abs() < 1e-9), "{found:?}");
        tracker.bank.retain(|h| h.age_frames > 0);
    }
}
