//! Faults of what the images show.

use common::geometry::PinholeCamera;
use localizer::features::{Features, LineFeature};
use localizer::projection::ImageSize;
use nalgebra::{Point2, Point3, Rotation3, UnitVector3, Vector2, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;

use crate::trial::Trial;

/// Changes what is seen in every frame.
pub(super) fn each(trial: &mut Trial, mut change: impl FnMut(&mut Features)) {
    for frame in &mut trial.frames {
        change(&mut frame.features);
    }
}

/// Adds false features until `share` of those of each class is false (of one
/// in the mean, where that is no whole number): copies of those found, moved
/// to random places. Lane lines are moved sideways only: they lie on the road.
pub(super) fn add_false(seen: &mut Features, share: f64, image: ImageSize, random: &mut Pcg64) {
    let ImageSize { width_px, height_px } = image;
    add_false_lines(&mut seen.poles, share, image, random);
    for _ in 0..wanted(seen.lanes.len(), share, random) {
        let mut copy = seen.lanes[random.random_range(0..seen.lanes.len())].clone();
        let middle_px = 0.5 * (copy.line.upper_px.x + copy.line.lower_px.x);
        let by = Vector2::new(random.random_range(0.0..width_px) - middle_px, 0.0);
        move_line(&mut copy.line, &by);
        copy.points_px.iter_mut().for_each(|point| *point += by);
        seen.lanes.push(copy);
    }
    for _ in 0..wanted(seen.signs.len(), share, random) {
        let mut copy = seen.signs[random.random_range(0..seen.signs.len())];
        copy.centre_px = Point2::new(random.random_range(0.0..width_px), random.random_range(0.0..height_px));
        seen.signs.push(copy);
    }
    seen.trunks.iter_mut().for_each(|trunks| add_false_lines(trunks, share, image, random));
}

/// Adds false poles, or trunks.
fn add_false_lines(lines: &mut Vec<LineFeature>, share: f64, image: ImageSize, random: &mut Pcg64) {
    for _ in 0..wanted(lines.len(), share, random) {
        let mut copy = lines[random.random_range(0..lines.len())];
        let half = (copy.lower_px - copy.upper_px) * 0.5;
        // Wherever it stands, it is seen as a whole, if it fits at all.
        let within = |size_px: f64, half_px: f64, random: &mut Pcg64| {
            let slack_px = (0.5 * size_px - half_px.abs()).max(0.0);
            0.5 * size_px + slack_px * random.random_range(-1.0..1.0)
        };
        let to = Point2::new(within(image.width_px, half.x, random), within(image.height_px, half.y, random));
        let by = to - (copy.upper_px + half);
        move_line(&mut copy, &by);
        lines.push(copy);
    }
}

/// How many are added to `true_ones` for `share` of all to be false.
fn wanted(true_ones: usize, share: f64, random: &mut Pcg64) -> usize {
    let mean = true_ones as f64 * share / (1.0 - share);
    mean.floor() as usize + usize::from(random.random_bool(mean.fract()))
}

fn move_line(line: &mut LineFeature, by: &Vector2<f64>) {
    line.upper_px += by;
    line.lower_px += by;
}

/// Loses each feature with the chance `share`.
pub(super) fn miss(seen: &mut Features, share: f64, random: &mut Pcg64) {
    seen.poles.retain(|_| !random.random_bool(share));
    seen.lanes.retain(|_| !random.random_bool(share));
    seen.signs.retain(|_| !random.random_bool(share));
    seen.trunks.iter_mut().for_each(|trunks| trunks.retain(|_| !random.random_bool(share)));
}

/// Shows nothing for `count` frames, from the one with index `first` on and
/// again every `every`. Returns the frames after these stretches.
pub(super) fn black(trial: &mut Trial, first: usize, count: usize, every: usize) -> Vec<usize> {
    let mut ends = Vec::new();
    for (index, frame) in trial.frames.iter_mut().enumerate().skip(first) {
        match (index - first) % every {
            into if into < count => frame.features = Features::default(),
            into if into == count => ends.push(frame.frame),
            _ => {}
        }
    }
    ends
}

/// Shows for `count` frames what the one before them does, from the one with index
/// `first` (1 at least) on and again every `every`. Returns the frames after these
/// stretches.
pub(super) fn frozen(trial: &mut Trial, first: usize, count: usize, every: usize) -> Vec<usize> {
    let mut ends = Vec::new();
    for index in first..trial.frames.len() {
        match (index - first) % every {
            into if into < count => trial.frames[index].features = trial.frames[index - 1].features.clone(),
            into if into == count => ends.push(trial.frames[index].frame),
            _ => {}
        }
    }
    ends
}

/// Shows no poles and no trunks for `length_m` of the path, from `first_m` on and again
/// every `every_m`. Returns the frames after these stretches.
pub(super) fn no_poles(trial: &mut Trial, first_m: f64, length_m: f64, every_m: f64) -> Vec<usize> {
    let Trial { frames, truth, .. } = trial;
    let mut ends = Vec::new();
    let (mut driven_m, mut before, mut was_bare) = (0.0, None, false);
    for frame in frames {
        let Some(pose) = truth.get(frame.frame) else { continue };
        let at = pose.translation.vector;
        driven_m += before.map_or(0.0, |before: Vector3<f64>| (at - before).norm());
        before = Some(at);
        let is_bare = driven_m >= first_m && (driven_m - first_m) % every_m < length_m;
        if is_bare {
            frame.features.poles.clear();
            frame.features.trunks.iter_mut().for_each(Vec::clear);
        } else if was_bare {
            ends.push(frame.frame);
        }
        was_bare = is_bare;
    }
    ends
}

/// What is seen after the camera was turned by `angle_rad` about `axis` (its
/// own) while nobody told the calibration.
pub(super) fn turn(seen: &mut Features, camera: &PinholeCamera, axis: &UnitVector3<f64>, angle_rad: f64) {
    let turned_from_calibrated = Rotation3::from_axis_angle(axis, -angle_rad);
    // A turn moves nothing nearer or farther: K R K^-1, whatever the depth.
    let moved = |pixel: &mut Point2<f64>| {
        let ray = turned_from_calibrated * camera.ray(pixel);
        // `project` takes a point in the reference camera's frame.
        let point = Point3::from(ray * (1.0 / ray.z) - camera.from_reference_m);
        if let Some(to) = camera.project(&point, 0.0) {
            *pixel = to;
        }
    };
    let turn_line = |line: &mut LineFeature| [&mut line.upper_px, &mut line.lower_px].into_iter().for_each(moved);
    seen.poles.iter_mut().chain(seen.trunks.iter_mut().flatten()).for_each(turn_line);
    for lane in &mut seen.lanes {
        turn_line(&mut lane.line);
        lane.points_px.iter_mut().for_each(moved);
    }
    seen.signs.iter_mut().for_each(|sign| moved(&mut sign.centre_px));
}
