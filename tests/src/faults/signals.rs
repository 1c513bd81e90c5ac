//! Faults of what comes with the images: map, calibration, GPS, clock.

use std::f64::consts::TAU;
use std::ops::Range;

use common::geometry::{Pose, PoseParameters};
use common::map::{Road, RoadId};
use localizer::gps::{GpsFix, simulate};
use localizer::odometry::Odometry;
use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;

use crate::map_score::moved;
use crate::trial::Trial;

/// Turns the map to the right about the true position in the middle of the
/// drive.
pub(super) fn turn_map(trial: &mut Trial, angle_rad: f64) {
    let middle = trial.frames.get(trial.frames.len() / 2).and_then(|seen| trial.truth.get(seen.frame));
    let Some(centre) = middle.map(|pose| pose.translation) else { return };
    let down = Vector3::y_axis();
    let turn = Pose::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&down, angle_rad));
    trial.map = moved(&trial.map, &(centre * turn * centre.inverse()));
}

/// Moves all that stands or hangs beside the road along the way that was driven, on or
/// back by a way in `range_m`.
pub(super) fn shift_objects(trial: &mut Trial, range_m: Range<f64>, random: &mut Pcg64) {
    let at = |pose: &Pose| Point3::from(pose.translation.vector);
    let truth = &trial.truth;
    let ways_m = ways_m(truth);
    let Some(&whole_m) = ways_m.last() else { return };
    let mut shift = |point: &Point3<f64>| -> Pose {
        let apart = |pose: &Pose| (at(pose) - point).xz().norm_squared();
        let near = (0..truth.len()).min_by(|&a, &b| apart(&truth[a]).total_cmp(&apart(&truth[b]))).unwrap_or(0);
        let by_m = random.random_range(range_m.clone());
        let is_on = ways_m[near] < by_m || (ways_m[near] + by_m <= whole_m && random.random());
        let target_m = if is_on { ways_m[near] + by_m } else { ways_m[near] - by_m };
        let there = ways_m.partition_point(|way_m| *way_m < target_m).min(truth.len() - 1);
        truth[there] * truth[near].inverse()
    };
    for pole in &mut trial.map.poles {
        let moved = shift(&pole.foot_map);
        (pole.foot_map, pole.top_map) = (moved * pole.foot_map, moved * pole.top_map);
    }
    for sign in &mut trial.map.signs {
        sign.centroid_map = shift(&sign.centroid_map) * sign.centroid_map;
    }
}

/// Keeps the roads of the map, with what stands along them, of which the middle is passed
/// first at a share of the way that `is_kept`.
pub(super) fn keep_roads(trial: &mut Trial, is_kept: impl Fn(f64) -> bool) {
    let truth = &trial.truth;
    let ways_m = ways_m(truth);
    let whole_m = ways_m.last().copied().unwrap_or(0.0).max(f64::MIN_POSITIVE);
    let is_road_kept = |road: &Road| {
        let Some(middle) = road.path_map.get(road.path_map.len() / 2) else { return false };
        let apart_m2 = |&i: &usize| (Point3::from(truth[i].translation.vector) - middle).xz().norm_squared();
        let near = (0..truth.len()).min_by(|a, b| apart_m2(a).total_cmp(&apart_m2(b)));
        near.is_some_and(|near| is_kept(ways_m[near] / whole_m))
    };
    let kept: Vec<bool> = trial.map.roads.iter().map(is_road_kept).collect();
    let mut count = 0..;
    let renamed: Vec<Option<RoadId>> =
        kept.iter().map(|kept| kept.then(|| count.next().map(RoadId)).flatten()).collect();
    let rename = |road: &mut RoadId| {
        let new = renamed.get(road.0 as usize).copied().flatten();
        *road = new.unwrap_or(*road);
        new.is_some()
    };
    let map = &mut trial.map;
    let mut kept = kept.into_iter();
    map.roads.retain(|_| kept.next().unwrap_or(false));
    map.poles.retain_mut(|pole| rename(&mut pole.road));
    map.signs.retain_mut(|sign| rename(&mut sign.road));
    map.lanes.retain_mut(|lane| rename(&mut lane.road));
}

/// The way up to each of these poses, metres.
fn ways_m(truth: &[Pose]) -> Vec<f64> {
    let mut way_m = 0.0;
    let mut before: Option<&Pose> = None;
    let ways_m = truth.iter().map(|pose| {
        way_m +=
            before.replace(pose).map_or(0.0, |before| (pose.translation.vector - before.translation.vector).norm());
        way_m
    });
    ways_m.collect()
}

/// Puts the real camera `by_m` from where the calibration has it (metres, its
/// own axes), which is to put the calibrated one as far the other way.
pub(super) fn move_camera(trial: &mut Trial, by_m: Vector3<f64>) {
    trial.camera.from_reference_m += by_m;
}

/// Makes both focal lengths of the calibration wrong by a factor.
pub(super) fn scale_focal_lengths(trial: &mut Trial, factor: f64) {
    trial.camera.fx_px *= factor;
    trial.camera.fy_px *= factor;
}

/// Adds a simulated fix each second after the start.
pub(super) fn fix_each_second(trial: &mut Trial, seed: u64) {
    let Some(first_s) = trial.frames.first().map(|seen| seen.time_s) else { return };
    let mut due_s = first_s + 1.0;
    let mut at = Vec::new();
    for seen in trial.frames.iter().filter(|seen| trial.truth.len() > seen.frame) {
        if seen.time_s >= due_s {
            at.push(seen.frame);
            due_s = first_s + (seen.time_s - first_s).floor() + 1.0;
        }
    }
    let poses: Vec<Pose> = at.iter().map(|&frame| trial.truth[frame]).collect();
    // Not the deviates that the start was drawn with.
    let fixes = simulate(&poses, &trial.config.gps, !seed);
    trial.fixes.extend(at.into_iter().zip(fixes));
}

/// Moves every which fix (the first of them from the start on) by so many
/// metres into a random direction; it claims what it claimed before.
pub(super) fn add_outliers(trial: &mut Trial, every: usize, off_m: f64, random: &mut Pcg64) {
    for fix in trial.fixes.values_mut().skip(every - 1).step_by(every) {
        let direction_rad = random.random_range(0.0..TAU);
        fix.position_map += Vector3::new(direction_rad.sin(), 0.0, direction_rad.cos()) * off_m;
    }
}

/// Gives these frames a fix that is so far off into a random direction and
/// turned as much to one side, and claims half of that as its standard
/// deviations.
pub(super) fn kidnap(trial: &mut Trial, frames: &[usize], off_m: f64, turn_rad: f64, random: &mut Pcg64) {
    for &frame in frames {
        let Some(pose) = trial.truth.get(frame) else { continue };
        let direction_rad = random.random_range(0.0..TAU);
        let turn_rad = if random.random_bool(0.5) { turn_rad } else { -turn_rad };
        let off = Vector3::new(direction_rad.sin(), 0.0, direction_rad.cos()) * off_m;
        let fix = GpsFix {
            position_map: (pose.translation.vector + off).into(),
            horizontal_sigma_m: 0.5 * off_m,
            heading: Some((PoseParameters::from_pose(pose).yaw_rad + turn_rad, 0.5 * turn_rad.abs())),
            is_course: false,
            age_s: 0.0,
        };
        trial.fixes.insert(frame, fix);
    }
}

/// Changes what wheels and gyroscope, or the images, say of the motion in so many
/// frames, from one on and again after so many.
pub(super) fn change_motion(
    trial: &mut Trial,
    first: usize,
    length: usize,
    every: usize,
    change: impl Fn(Odometry) -> Odometry,
) {
    let time_s = |index: usize| trial.frames.get(index).map_or(f64::INFINITY, |seen| seen.time_s);
    // From the frame before the first of them to the last.
    let befores = (first.saturating_sub(1)..trial.frames.len()).step_by(every);
    let stretches: Vec<[f64; 2]> = befores.map(|before| [time_s(before), time_s(before + length)]).collect();
    trial.odometry = trial.odometry.changed(|ended_s, mean| {
        let is_hit = stretches.iter().any(|[begin_s, end_s]| *begin_s < ended_s && ended_s <= *end_s);
        if is_hit { change(mean) } else { mean }
    });
}

/// Drops `count` frames, from the one with index `first` on and again every `every`.
/// Returns the frames after these stretches.
pub(super) fn drop_stretches(trial: &mut Trial, first: usize, count: usize, every: usize) -> Vec<usize> {
    let (mut index, mut ends) = (0, Vec::new());
    trial.frames.retain(|seen| {
        let into = (index >= first).then(|| (index - first) % every);
        index += 1;
        if into == Some(count) {
            ends.push(seen.frame);
        }
        into.is_none_or(|into| into >= count)
    });
    ends
}

/// Keeps the frames with these indices.
pub(super) fn keep(trial: &mut Trial, mut is_kept: impl FnMut(usize) -> bool) {
    let mut indices = 0..;
    trial.frames.retain(|_| indices.next().is_some_and(&mut is_kept));
}

/// Delivers every which frame twice, at the same time.
pub(super) fn double_every(trial: &mut Trial, every: usize) {
    let frames = std::mem::take(&mut trial.frames);
    for (index, frame) in frames.into_iter().enumerate() {
        if index % every == every - 1 {
            trial.frames.push(frame.clone());
        }
        trial.frames.push(frame);
    }
}

/// Delivers what every which frame showed again, as the next frame.
pub(super) fn hold_every(trial: &mut Trial, every: usize) {
    for index in (every..trial.frames.len()).step_by(every) {
        trial.frames[index].features = trial.frames[index - 1].features.clone();
    }
}

/// Makes the times of the frames early and late in turns.
pub(super) fn jitter(trial: &mut Trial, off_s: f64) {
    for (index, frame) in trial.frames.iter_mut().enumerate() {
        frame.time_s += if index % 2 == 0 { -off_s } else { off_s };
    }
}
