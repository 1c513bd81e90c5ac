use common::geometry::local;
use nalgebra::Vector3;

use super::*;

/// A drive around a bend, and the survey of it with misaligned axes.
fn drive(e: &UnitQuaternion<f64>) -> (Vec<Pose>, Vec<Pose>) {
    let mut pose = Pose::identity();
    let mut truth = Vec::new();
    for i in 0..40 {
        truth.push(pose);
        let bend = if i > 15 { 0.04 } else { 0.0 };
        pose = retract(&pose, &Tangent::new(0.0, 0.02, 6.5, 0.001, bend, 0.0));
    }
    let survey = truth.iter().map(|p| Pose::from_parts(p.translation, p.rotation * e.inverse())).collect();
    (truth, survey)
}

fn exact_motions(truth: &[Pose]) -> Vec<Motion> {
    truth
        .windows(2)
        .map(|w| Motion { before_from_after: w[0].inverse() * w[1], information: Matrix6::identity() * 1e8 })
        .collect()
}

#[test]
fn a_constant_misalignment_is_found_and_taken_out() {
    let e = UnitQuaternion::from_scaled_axis(Vector3::new(0.003, -0.006, 0.002));
    let (truth, survey) = drive(&e);
    let motions = exact_motions(&truth);
    let refined = refine_poses(&survey, &motions, &[], &GraphConfig::default());
    assert!(refined.survey_from_camera.angle_to(&e) < 5e-4);
    for (a, b) in refined.map_from_camera.iter().zip(&truth) {
        assert!((a.translation.vector - b.translation.vector).norm() < 0.02);
        assert!(a.rotation.angle_to(&b.rotation) < 5e-4);
    }
}

#[test]
fn where_the_survey_is_short_the_scans_keep_their_scale() {
    let (truth, _) = drive(&UnitQuaternion::identity());
    let motions = exact_motions(&truth);
    let short: Vec<Pose> =
        truth.iter().map(|p| Pose::from_parts((p.translation.vector * 0.97).into(), p.rotation)).collect();
    let refined = refine_poses(&short, &motions, &[], &GraphConfig::default());
    let step = (refined.map_from_camera[10].inverse() * refined.map_from_camera[11]).translation.vector.norm();
    assert!((step - 6.5).abs() < 0.01, "{step}");
    assert!(refined.survey_sigma_m > 0.5, "{}", refined.survey_sigma_m);
    let exact = refine_poses(&truth, &motions, &[], &GraphConfig::default());
    assert!((exact.survey_sigma_m - GraphConfig::default().survey_sigma_m).abs() < 1e-12);
}

/// A drive that stands for some frames, and its survey, which is half a metre
/// off there along an axis of the map.
fn with_a_stop(frames: usize, axis: usize) -> (Vec<Pose>, Vec<Pose>) {
    let (moving, _) = drive(&UnitQuaternion::identity());
    let truth = [&moving[..12], &vec![moving[12]; frames], &moving[13..]].concat();
    let mut survey = truth.clone();
    for pose in &mut survey[12..12 + frames] {
        pose.translation.vector[axis] += 0.5;
    }
    (truth, survey)
}

#[test]
fn what_the_survey_says_of_a_stop_counts_once_however_long_it_is() {
    let farthest_m = |frames: usize| {
        let (truth, survey) = with_a_stop(frames, 0);
        let found = refine_poses(&survey, &exact_motions(&truth), &[], &GraphConfig::default()).map_from_camera;
        let off_m = |(a, b): (&Pose, &Pose)| (a.translation.vector - b.translation.vector).norm();
        found.iter().zip(&truth).map(off_m).fold(0.0, f64::max)
    };
    let once_m = farthest_m(1);
    for frames in [60, 240] {
        assert!(farthest_m(frames) < 3.0 * once_m, "{frames}: {} {once_m}", farthest_m(frames));
    }
}

#[test]
fn a_stop_does_not_tell_how_accurate_the_survey_is() {
    let sigma_m = |frames: usize| {
        let (truth, survey) = with_a_stop(frames, 2);
        refine_poses(&survey, &exact_motions(&truth), &[], &GraphConfig::default()).survey_sigma_m
    };
    assert!((sigma_m(240) - sigma_m(1)).abs() < 1e-6, "{} {}", sigma_m(240), sigma_m(1));
}

/// A survey without satellites for its first frames: it goes on as it went, a
/// seventh too fast and without the bend.
fn without_satellites(truth: &[Pose], frames: usize) -> Vec<Pose> {
    let mut survey = truth.to_vec();
    for i in (0..frames).rev() {
        let step = truth[i].inverse() * truth[i + 1];
        let wrong = Pose::translation(0.0, 0.0, step.translation.vector.norm() * 8.0 / 7.0);
        survey[i] = survey[i + 1] * wrong.inverse();
    }
    survey
}

#[test]
fn where_the_survey_had_no_satellites_the_scans_decide() {
    let mut pose = Pose::identity();
    let mut truth = Vec::new();
    for _ in 0..40 {
        truth.push(pose);
        pose = retract(&pose, &Tangent::new(0.0, 0.0, 0.8, 0.0, 0.004, 0.0));
    }
    // As weak as a street without much that stands across it.
    let mut motions = exact_motions(&truth);
    for motion in &mut motions {
        motion.information = Matrix6::from_diagonal(&Tangent::new(1e6, 1e6, 4e4, 1e8, 1e8, 1e8));
    }
    for frames in [9, 18] {
        let survey = without_satellites(&truth, frames);
        let refined = refine_poses(&survey, &motions, &[], &GraphConfig::default());
        let doubted = refined.survey_doubts.iter().filter(|doubt| **doubt > 3.0).count();
        assert!(doubted.abs_diff(frames) <= 2, "{doubted} of {frames}");
        let found = refined.map_from_camera[0].inverse() * refined.map_from_camera[frames];
        let off = local(&(truth[0].inverse() * truth[frames]), &found);
        let driven_m = 0.8 * frames as f64;
        assert!(off.fixed_rows::<3>(0).norm() < 0.02 * driven_m, "{frames}: {off}");
        assert!(off.fixed_rows::<3>(3).norm() < 0.1 * 0.004 * frames as f64, "{frames}: {off}");
    }
}

#[test]
fn a_survey_is_not_doubted_for_a_single_step_or_for_its_axes() {
    let e = UnitQuaternion::from_scaled_axis(Vector3::new(0.003, -0.006, 0.002));
    let (truth, mut survey) = drive(&e);
    let mut motions = exact_motions(&truth);
    survey[20].translation.vector.z += 0.5;
    motions[30].before_from_after *= Pose::translation(0.0, 0.0, 0.4);
    let refined = refine_poses(&survey, &motions, &[], &GraphConfig::default());
    assert!(refined.survey_doubts.iter().all(|doubt| *doubt <= 1.0), "{:?}", refined.survey_doubts);
    // Of one or two steps none is outvoted.
    survey[1].translation.vector.z += 0.5;
    for frames in 1..=3 {
        let few = refine_poses(&survey[..frames], &motions[..frames - 1], &[], &GraphConfig::default());
        assert_eq!(few.survey_doubts, vec![1.0; frames]);
    }
}

/// Twice round a block; the survey of the second round has drifted.
fn two_rounds() -> (Vec<Pose>, Vec<Pose>, Vec<Revisit>) {
    let mut pose = Pose::identity();
    let mut truth = Vec::new();
    for _ in 0..80 {
        truth.push(pose);
        pose = retract(&pose, &Tangent::new(0.0, 0.0, 5.0, 0.0, std::f64::consts::TAU / 40.0, 0.0));
    }
    let drift = |i: usize| Vector3::new(1.5, -0.5, 1.0) * (i as f64 / 60.0).min(1.0);
    let survey = truth.iter().enumerate().map(|(i, p)| Translation3::from(drift(i)) * p).collect::<Vec<_>>();
    let revisits = (0..40)
        .step_by(2)
        .map(|i| Revisit {
            before: i,
            after: i + 40,
            before_from_after: truth[i].inverse() * truth[i + 40],
            information: Matrix6::identity() * 1e8,
        })
        .collect();
    (truth, survey, revisits)
}

fn passes_apart_m(poses: &[Pose]) -> f64 {
    (0..40).map(|i| (poses[i].translation.vector - poses[i + 40].translation.vector).norm()).fold(0.0, f64::max)
}

#[test]
fn what_the_survey_drifted_between_two_rounds_is_taken_out() {
    let (truth, survey, revisits) = two_rounds();
    let motions = exact_motions(&truth);
    let config = GraphConfig::default();
    let untied = refine_poses(&survey, &motions, &[], &config).map_from_camera;
    assert!(passes_apart_m(&untied) > 0.5, "{}", passes_apart_m(&untied));
    let tied = refine_poses(&survey, &motions, &revisits, &config).map_from_camera;
    assert!(passes_apart_m(&tied) < 0.05, "{}", passes_apart_m(&tied));
}

#[test]
fn a_false_revisit_does_not_bend_the_drive() {
    let (truth, survey, mut revisits) = two_rounds();
    let motions = exact_motions(&truth);
    let config = GraphConfig::default();
    let wrong = Pose::translation(0.8, 0.0, -1.5);
    revisits[5].before_from_after *= wrong;
    let bent = refine_poses(&survey, &motions, &revisits, &config).map_from_camera;
    assert!(passes_apart_m(&bent) < 0.08, "{}", passes_apart_m(&bent));
    assert!(squared_sigmas(&revisits[5], &bent, &config).sqrt() > 10.0);
}

#[test]
fn conjugate_gradients_solve_what_they_are_given() {
    let (truth, survey, revisits) = two_rounds();
    let mut chain = Chain::zero(truth.len());
    let weight = Matrix6::identity();
    for i in 0..truth.len() - 1 {
        let z = truth[i].inverse() * truth[i + 1];
        chain.add_motion(i, &MotionTerm::new(&survey[i], &survey[i + 1], &z, &(weight * 1e4)));
        chain.add_position(i, &Vector3::new(0.3, 0.1, -0.2), 100.0);
        chain.add_orientation(i, &Vector3::new(0.01, 0.0, 0.02), 100.0);
    }
    chain.add_misalignment(&Vector3::new(0.01, 0.0, 0.0), 10.0);
    let term = |r: &Revisit| {
        MotionTerm::new(&survey[r.before], &survey[r.after], &r.before_from_after, &(Matrix6::identity() * 1e3))
    };
    let terms: Vec<_> = revisits.iter().map(|r| (r, term(r))).collect();
    let step = solve(&chain, &terms).unwrap();
    // What is left of the gradient once the step is taken.
    let mut left = chain.times(&step);
    left.add(1.0, &chain.gradient);
    for (r, t) in &terms {
        let pull = t.weight * (t.before * step.poses[r.before] + step.poses[r.after] + t.residual);
        left.poses[r.before] += t.before.transpose() * pull;
        left.poses[r.after] += pull;
    }
    assert!(left.dot(&left).sqrt() < 1e-3 * chain.gradient.dot(&chain.gradient).sqrt());
}
