//! Where the marks of a dashed line begin and end, from the brightness of the
//! image along it. The masks of lane networks bridge the gaps between marks;
//! brightness does not, and tells where along its road the camera is.

use nalgebra::Point2;

use super::fit::straight_line;
use crate::features::MarkEdge;
use crate::vision::Plane;
use crate::vision::config::{Ground, MarkConfig};

/// Step of the profile along the line, metres on the ground: the ends of
/// marks are known to a few of these.
const STEP_M: f64 = 0.1;
/// Offsets across the line at which its brightness is read, metres: a painted
/// width, and what the mask's centre may be off.
const ON_M: [f64; 9] = [-0.2, -0.15, -0.1, -0.05, 0.0, 0.05, 0.1, 0.15, 0.2];
/// Offsets at which that of the bare road beside it is read, metres.
const BESIDE_M: [f64; 6] = [-0.55, -0.45, -0.35, 0.35, 0.45, 0.55];

/// The ends of the marks along a lane line, from near to far. `points_px` are
/// its centre points from far to near, at most one per row. Masks end where
/// little of a line is left to see, so it is followed straight on.
pub fn edges(image: &Plane, points_px: &[Point2<f64>], ground: &Ground, config: &MarkConfig) -> Vec<MarkEdge> {
    // Beyond, a row is longer on the ground than half of what is compared.
    let far_m = (0.5 * config.compare_m * ground.focal_px * ground.camera_height_m).sqrt();
    let points_px = prolonged(points_px, image, ground.row_px(far_m), config.direction_px);
    let (Some(far), Some(near)) = (points_px.first(), points_px.last()) else { return Vec::new() };
    let (near_m, far_m) = (ground.distance_m(near.y), ground.distance_m(far.y).min(far_m));
    let line = Line { points_px: &points_px, ground };
    let count = ((far_m - near_m) / STEP_M).max(0.0) as u32;
    let places: Vec<Point2<f64>> = (0..count).filter_map(|i| line.at(near_m + f64::from(i) * STEP_M)).collect();
    let contrasts: Vec<f64> = places.iter().map(|at_px| contrast(image, at_px, ground)).collect();
    let edge = |border: Border| {
        // Sample k lies in the middle of its step; a border is before its sample.
        let z_m = near_m + (border.sample - 0.5) * STEP_M;
        let (at_px, ahead_px) = line.at(z_m).zip(line.at(z_m + STEP_M))?;
        let px_per_m = (ahead_px - at_px).norm() / STEP_M;
        let sigma_px = config.sigma_px.hypot(config.sigma_m * px_per_m);
        Some(MarkEdge { at_px, is_near: border.rises, sigma_px })
    };
    borders(&contrasts, config).into_iter().filter_map(edge).collect()
}

/// Where a profile rises to paint, or falls from it.
struct Border {
    /// The sample that it lies before, with a part.
    sample: f64,
    rises: bool,
}

/// The borders of the marks in a profile of contrasts, [`STEP_M`] apart.
fn borders(contrasts: &[f64], config: &MarkConfig) -> Vec<Border> {
    let half = (config.compare_m / STEP_M).round().max(1.0) as usize;
    let steps = steps(contrasts, half);
    let least = config.least_contrast.max(config.least_share * range(contrasts));
    let mut borders = Vec::new();
    for i in half..(contrasts.len() + 1).saturating_sub(half) {
        let Some(step) = steps.get(i).copied() else { continue };
        let around = steps.get(i - half..(i + half + 1).min(steps.len())).unwrap_or(&[]);
        let is_peak = around.iter().enumerate().all(|(k, other)| {
            // Of equals the first.
            other.abs() < step.abs() || (other.abs() <= step.abs() && k >= half)
        });
        let sides = [mean(&contrasts[i - half..i]), mean(&contrasts[i..i + half])];
        let (dark, bright) = (sides[0].min(sides[1]), sides[0].max(sides[1]));
        if !is_peak || step.abs() < least || dark > config.darkest_share * bright {
            continue;
        }
        let beside = |k: usize| steps.get(k).map_or(0.0, |step| step.abs());
        // The vertex of the parabola through the peak and both neighbours.
        let (before, after) = (beside(i - 1), beside(i + 1));
        let bend = before - 2.0 * step.abs() + after;
        let shift = if bend < -1e-9 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
        borders.push(Border { sample: i as f64 + shift, rises: step > 0.0 });
    }
    borders
}

/// The points of a line from far to near with a point ahead, in the row
/// `far_px`, and one at the border of the image, each on the straight line
/// through its last `direction_px` there.
fn prolonged(points_px: &[Point2<f64>], image: &Plane, far_px: f64, direction_px: f64) -> Vec<Point2<f64>> {
    let (Some(far), Some(near)) = (points_px.first(), points_px.last()) else { return Vec::new() };
    let (right_px, bottom_px) = (image.width() as f64 - 1.0, image.height() as f64 - 1.0);
    let beyond = |end: &Point2<f64>, row_px: f64| {
        let part: Vec<Point2<f64>> = points_px.iter().filter(|p| (*p - end).norm() <= direction_px).copied().collect();
        let line = straight_line(&part).filter(|line| line.direction.y > 1e-3)?;
        let slope = line.direction.x / line.direction.y;
        // Where it leaves the image at its side.
        let inside = |row_px: f64| (0.0..=right_px).contains(&(end.x + slope * (row_px - end.y)));
        let side_px = if slope < 0.0 { 0.0 } else { right_px };
        let row_px = if inside(row_px) { row_px } else { end.y + (side_px - end.x) / slope };
        Some(Point2::new(end.x + slope * (row_px - end.y), row_px))
    };
    let ahead = beyond(far, far_px).filter(|p| p.y < far.y);
    let back = beyond(near, bottom_px).filter(|p| p.y > near.y);
    ahead.into_iter().chain(points_px.iter().copied()).chain(back).collect()
}

/// A lane line over the ground.
struct Line<'a> {
    points_px: &'a [Point2<f64>],
    ground: &'a Ground,
}

impl Line<'_> {
    /// Its place at a distance ahead, metres; none beyond its ends.
    fn at(&self, depth_m: f64) -> Option<Point2<f64>> {
        let row_px = self.ground.row_px(depth_m);
        let after = self.points_px.partition_point(|p| p.y < row_px);
        let b = self.points_px.get(after.min(self.points_px.len().checked_sub(1)?))?;
        let a = self.points_px.get(after.max(1) - 1)?;
        let share = if b.y - a.y > 1e-9 { (row_px - a.y) / (b.y - a.y) } else { 0.0 };
        // Half a row: the last point stands for its whole row.
        ((-0.5..=1.5).contains(&share)).then(|| Point2::new(a.x + (b.x - a.x) * share, row_px))
    }
}

/// By how much a line is brighter than the road on both sides of it, grey
/// levels: the brightest strip as wide as paint near its middle, which the
/// mask has wrong by some centimetres.
fn contrast(image: &Plane, at_px: &Point2<f64>, ground: &Ground) -> f64 {
    let px_per_m = ground.below_px(at_px.y) / ground.camera_height_m;
    let value = |off_m: f64| brightness(image, at_px.x + off_m * px_per_m, at_px.y);
    let on = ON_M.map(value);
    let brightest = on.windows(3).map(mean).fold(0.0, f64::max);
    brightest - mean(&BESIDE_M.map(value))
}

/// Brightness between the pixels of a row and the next, grey levels; 0
/// outside.
fn brightness(image: &Plane, x: f64, y: f64) -> f64 {
    let (left, top) = (x.floor(), y.floor());
    let (right, down) = (x - left, y - top);
    let at = |dx: f64, dy: f64| f64::from(image.at(left + dx, top + dy));
    let upper = at(0.0, 0.0) * (1.0 - right) + at(1.0, 0.0) * right;
    let lower = at(0.0, 1.0) * (1.0 - right) + at(1.0, 1.0) * right;
    upper * (1.0 - down) + lower * down
}

/// By how much the mean of `half` values from each one on is above that of as
/// many before it; 0 near the ends.
fn steps(values: &[f64], half: usize) -> Vec<f64> {
    let mut steps = vec![0.0; values.len()];
    for i in half..(values.len() + 1).saturating_sub(half) {
        if let Some(step) = steps.get_mut(i) {
            *step = mean(&values[i..i + half]) - mean(&values[i - half..i]);
        }
    }
    steps
}

/// From the tenth to the ninetieth of a hundred values.
fn range(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted.get((share * sorted.len() as f64) as usize).copied().unwrap_or(0.0);
    at(0.9) - at(0.1)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const GROUND: Ground = Ground { horizon_px: 180.0, focal_px: 718.0, camera_height_m: 1.65 };

    /// A line 1.8 m to the left, with marks between these distances (m), as a
    /// camera sees it whose pixels each gather `GATHER` x `GATHER` rays.
    fn view(marks_m: &[[f64; 2]]) -> (Plane, Vec<Point2<f64>>) {
        const GATHER: usize = 8;
        let (width, height) = (1241_usize, 376_usize);
        let mut plane = Plane::zeros(width, height);
        let is_paint = |u: f64, v: f64| {
            let z = GROUND.distance_m(v);
            let x = (u - 600.0) * z / GROUND.focal_px;
            z > 0.0 && (x + 1.8).abs() < 0.06 && marks_m.iter().any(|[from, to]| (*from..*to).contains(&z))
        };
        for y in 181..height {
            for x in 0..width {
                let ray = |i: usize| (i as f64 + 0.5) / GATHER as f64 - 0.5;
                let rays = (0..GATHER * GATHER).map(|i| (ray(i % GATHER), ray(i / GATHER)));
                let hits = rays.filter(|(du, dv)| is_paint(x as f64 + du, y as f64 + dv)).count();
                plane.data_mut()[y * width + x] = (90 + 100 * hits / (GATHER * GATHER)) as u8;
            }
        }
        // It is seen from 9 to 17 m.
        let points_px = (250..310)
            .map(|v| {
                let z = GROUND.distance_m(f64::from(v));
                // The mask is 4 cm off.
                Point2::new(600.0 - 1.76 * GROUND.focal_px / z, f64::from(v))
            })
            .collect();
        (plane, points_px)
    }

    #[test]
    fn marks_end_where_they_are_painted() {
        let (image, points_px) = view(&[[5.0, 9.0], [12.0, 15.0], [18.0, 21.0]]);
        let found = edges(&image, &points_px, &GROUND, &MarkConfig::default());
        let expected = [(9.0, false), (12.0, true), (15.0, false), (18.0, true), (21.0, false)];
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (edge, (z, is_near)) in found.iter().zip(expected) {
            let off_px = edge.at_px.y - GROUND.row_px(z);
            assert!(off_px.abs() < 1.0 && edge.is_near == is_near, "{z}: {off_px}");
        }
    }

    #[test]
    fn a_solid_line_and_a_bare_road_have_no_ends() {
        for marks in [&[[2.0, 60.0]][..], &[]] {
            let (image, points_px) = view(marks);
            assert_eq!(edges(&image, &points_px, &GROUND, &MarkConfig::default()), []);
        }
        let (image, _) = view(&[[5.0, 9.0]]);
        assert_eq!(edges(&image, &[], &GROUND, &MarkConfig::default()), []);
    }
}
