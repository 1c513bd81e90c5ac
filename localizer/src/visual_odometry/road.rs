//! How far the vehicle went, from the road before it as seen from above in two
//! images.
//!
//! Where the rotation and the direction of the motion are known, the view of
//! the road moves by the way that was driven, and by nothing else; so it is the
//! shift at which the two views correlate best. Asphalt, joints, paint and
//! shadows all count, and no point has to be told from another.

use std::ops::Range;

use common::geometry::PinholeCamera;
use image::GrayImage;
use nalgebra::{Rotation3, Vector3};

use super::config::RoadConfig;

/// Variance of a view that is noise of the camera, grey levels squared.
const NOISE: f64 = 4.0;
/// Largest deviation that counts, standard deviations: paint is no more than
/// asphalt.
const MOST_DEVIATION: f64 = 3.0;

/// The road from above, rows from far to near; zero where it is not seen.
pub(super) struct View {
    columns: usize,
    rows: usize,
    data: Vec<f32>,
    /// The column in which the way ahead lies, of each row.
    middles: Vec<usize>,
    /// Mean of how far to the right of the camera what is seen is, metres.
    middle_m: f64,
}

/// How the road lies before the camera.
#[derive(Debug, Clone, Copy)]
pub(super) struct Road {
    /// Of the camera over it, metres.
    pub height_m: f64,
    /// By how much its distance below the optical axis shrinks per metre ahead.
    pub rise: f64,
    /// Curvature of the way ahead, 1/m, positive to the right.
    pub bend_per_m: f64,
    /// The same upwards, 1/m: positive in a sag, negative on a crest.
    pub sag_per_m: f64,
    /// By how much its distance below the optical axis grows per metre to the right.
    pub fall: f64,
}

impl Road {
    /// How far below the optical axis it lies so far ahead and to the right, metres.
    fn below_m(&self, ahead_m: f64, right_m: f64) -> f64 {
        self.height_m - self.rise * ahead_m - 0.5 * self.sag_per_m * ahead_m * ahead_m + self.fall * right_m
    }

    /// How far to the right the way lies so far ahead, metres.
    pub fn middle_m(&self, ahead_m: f64) -> f64 {
        0.5 * self.bend_per_m * ahead_m * ahead_m
    }
}

/// A shift and how sure it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shift {
    /// Towards the camera, metres.
    pub forward_m: f64,
    /// Correlation there.
    pub correlation: f64,
    /// By how much that is more than at any other shift.
    pub lead: f64,
    /// What the far and the near half of the view say alone, where both do.
    pub halves: Option<[Half; 2]>,
    /// The shifts of the left and of the right side alone, metres, where both tell.
    pub sides_m: Option<[f64; 2]>,
    /// How far to the right of the camera the middle of the view is, metres.
    pub middle_m: f64,
}

impl Shift {
    /// How far forward, as what something is a share of: at least a pixel.
    pub fn way_m(&self, config: &RoadConfig) -> f64 {
        self.forward_m.abs().max(config.pixel_m).copysign(self.forward_m)
    }
}

/// One half of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Half {
    /// Its middle, metres ahead of the camera.
    pub ahead_m: f64,
    /// Its shift towards the camera, metres.
    pub forward_m: f64,
}

/// The sides of the way ahead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Both,
    Left,
    Right,
}

impl View {
    /// The road in an image whose camera is turned against axes in which the
    /// road lies as told.
    pub fn new(
        image: &GrayImage,
        camera: &PinholeCamera,
        camera_from_level: &Rotation3<f64>,
        road: &Road,
        config: &RoadConfig,
    ) -> Self {
        let [near_m, far_m] = config.ahead_m;
        let aside_m = 0.5 * road.bend_per_m.abs() * far_m * far_m;
        let half_m = (config.half_width_m + aside_m).min(2.0 * config.half_width_m);
        let count = |length_m: f64| (length_m / config.pixel_m).ceil().max(1.0) as usize;
        let (columns, rows) = (count(2.0 * half_m), count(far_m - near_m));
        let mut seen = vec![f32::NAN; columns * rows];
        let mut middles = Vec::with_capacity(rows);
        let (mut right_m, mut count_seen) = (0.0, 0.0);
        for (y, row) in seen.chunks_exact_mut(columns).enumerate() {
            let z_m = far_m - y as f64 * config.pixel_m;
            let middle_m = road.middle_m(z_m);
            middles.push((((middle_m + half_m) / config.pixel_m).max(0.0) as usize).min(columns));
            for (x, grey) in row.iter_mut().enumerate() {
                let x_m = x as f64 * config.pixel_m - half_m;
                if (x_m - middle_m).abs() <= config.half_width_m {
                    let point = camera_from_level * Vector3::new(x_m, road.below_m(z_m, x_m), z_m);
                    let u_px = camera.fx_px * point.x / point.z + camera.cx_px;
                    let v_px = camera.fy_px * point.y / point.z + camera.cy_px;
                    let Some(value) = sample(image, u_px as f32, v_px as f32) else { continue };
                    *grey = value;
                    right_m += x_m;
                    count_seen += 1.0;
                }
            }
        }
        Self {
            columns,
            rows,
            data: normalised(&seen, columns, count(config.around_m)),
            middles,
            middle_m: right_m / f64::max(count_seen, 1.0),
        }
    }

    /// The shift from this view to that of the image after, from `least_m` to
    /// `most_m`, back where it is negative; `aside` to the right for each metre
    /// forward.
    pub fn shift_to(
        &self,
        after: &Self,
        aside: f64,
        [least_m, most_m]: [f64; 2],
        config: &RoadConfig,
    ) -> Option<Shift> {
        // Half of the view has to be in both.
        let half = self.rows.cast_signed() / 2;
        let [least, most] = [least_m, most_m].map(|way_m| ((way_m / config.pixel_m) as isize).clamp(-half, half));
        let seen = self.data.iter().filter(|grey| **grey != 0.0).count() as f64;
        let score = |rows| {
            let (correlation, shared) = self.correlation(after, rows, aside, self.shared_rows(rows), Side::Both);
            if f64::from(shared) < config.least_shared * seen { 0.0 } else { correlation }
        };
        let scores: Vec<f64> = (least..=most).map(score).collect();
        let best = (0..scores.len()).max_by(|&a, &b| scores[a].total_cmp(&scores[b]))?;
        let peak = (config.peak_m / config.pixel_m) as usize;
        let others = scores.iter().enumerate().filter(|(i, _)| i.abs_diff(best) > peak);
        let second = others.map(|(_, score)| *score).fold(0.0, f64::max);
        let (correlation, rows) = (scores[best], least + best.cast_signed());
        Some(Shift {
            forward_m: (rows as f64 + vertex(&scores, best)) * config.pixel_m,
            correlation,
            lead: correlation - second,
            halves: self.halves_to(after, aside, rows, config),
            sides_m: self.sides_to(after, aside, rows, config),
            middle_m: self.middle_m,
        })
    }

    /// The shifts of the far and of the near half, close to that of both.
    fn halves_to(&self, after: &Self, aside: f64, rows: isize, config: &RoadConfig) -> Option<[Half; 2]> {
        let half = |is_near: bool| {
            let part = |rows| {
                let Range { start, end } = self.shared_rows(rows);
                let middle = usize::midpoint(start, end);
                if is_near { middle..end } else { start..middle }
            };
            let score = |rows| self.correlation(after, rows, aside, part(rows), Side::Both).0;
            let (rows, shift) = self.peak_near(rows, score, config)?;
            // A row of the other view, and half the way back from it.
            let middle = 0.5 * ((part(rows).start + part(rows).end) as f64 - rows as f64);
            Some(Half { ahead_m: config.ahead_m[1] - middle * config.pixel_m, forward_m: shift * config.pixel_m })
        };
        Some([half(false)?, half(true)?])
    }

    /// The same of the left and of the right side, metres.
    fn sides_to(&self, after: &Self, aside: f64, rows: isize, config: &RoadConfig) -> Option<[f64; 2]> {
        let side = |side: Side| {
            let score = |rows| self.correlation(after, rows, aside, self.shared_rows(rows), side).0;
            self.peak_near(rows, score, config).map(|(_, shift)| shift * config.pixel_m)
        };
        Some([side(Side::Left)?, side(Side::Right)?])
    }

    /// Where near a shift of so many rows a score is best, in whole rows and between
    /// them; none where that is no peak.
    fn peak_near(&self, rows: isize, score: impl Fn(isize) -> f64, config: &RoadConfig) -> Option<(isize, f64)> {
        let (peak, most) = ((config.peak_m / config.pixel_m) as isize, self.rows.cast_signed() / 2);
        let shifts = (rows - peak).max(-most)..=(rows + peak).min(most);
        let scores: Vec<f64> = shifts.clone().map(score).collect();
        let best = (0..scores.len()).max_by(|&a, &b| scores[a].total_cmp(&scores[b]))?;
        let is_peak = best > 0 && best + 1 < scores.len() && scores[best] >= config.least_correlation;
        let rows = shifts.start() + best.cast_signed();
        is_peak.then(|| (rows, rows as f64 + vertex(&scores, best)))
    }

    /// The rows of the other view in which there is what this one shows so many
    /// rows farther off.
    fn shared_rows(&self, rows: isize) -> Range<usize> {
        let (nearer, farther) = (rows.max(0).unsigned_abs(), rows.min(0).unsigned_abs());
        nearer.min(self.rows)..self.rows.saturating_sub(farther)
    }

    /// The correlation where what is in a row of this view is so many rows
    /// nearer in the other, of the same size, and how many pixels are in both;
    /// in some of the rows that they share, rows of the other, and on one side of
    /// the way there.
    fn correlation(&self, after: &Self, rows: isize, aside: f64, of_after: Range<usize>, side: Side) -> (f64, u32) {
        let columns = (aside * rows as f64).round() as isize;
        let (mut product, mut square, mut square_after, mut shared_pixels) = (0.0, 0.0, 0.0, 0);
        let shared = self.columns.saturating_sub(columns.unsigned_abs());
        if shared == 0 {
            return (0.0, 0);
        }
        let (from, from_after) = (columns.max(0) as usize, (-columns).max(0) as usize);
        for y in of_after {
            let middle = after.middles[y].saturating_sub(from_after).min(shared);
            let part = match side {
                Side::Both => 0..shared,
                Side::Left => 0..middle,
                Side::Right => middle..shared,
            };
            let row = &self.data[y.saturating_add_signed(-rows) * self.columns..][from..][part.clone()];
            let row_after = &after.data[y * self.columns..][from_after..][part];
            let (mut sum, mut sum_square, mut sum_square_after, mut count) = (0.0_f32, 0.0_f32, 0.0_f32, 0);
            for (&a, &b) in row.iter().zip(row_after) {
                // What is not seen in one of them is zero there.
                let both = u8::from(a != 0.0 && b != 0.0);
                sum += a * b;
                sum_square += f32::from(both) * a * a;
                sum_square_after += f32::from(both) * b * b;
                count += u32::from(both);
            }
            product += f64::from(sum);
            square += f64::from(sum_square);
            square_after += f64::from(sum_square_after);
            shared_pixels += count;
        }
        (product / (square * square_after).sqrt().max(1.0), shared_pixels)
    }
}

/// Where between its neighbours the best score has its vertex, -0.5 to 0.5; at
/// the ends of the scores, on it.
fn vertex(scores: &[f64], best: usize) -> f64 {
    let neighbours = best.checked_sub(1).and_then(|i| scores.get(i)).zip(scores.get(best + 1));
    let Some((before, after)) = neighbours else { return 0.0 };
    let bow = before - 2.0 * scores[best] + after;
    if bow < 0.0 { (0.5 * (before - after) / bow).clamp(-0.5, 0.5) } else { 0.0 }
}

/// The grey value between four pixels; none outside the image.
fn sample(image: &GrayImage, u_px: f32, v_px: f32) -> Option<f32> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    // NaN is outside, too.
    if !(u_px >= 0.0 && v_px >= 0.0 && u_px < (width - 1) as f32 && v_px < (height - 1) as f32) {
        return None;
    }
    let (u, v) = (u_px as usize, v_px as usize);
    let (right, down) = (u_px - u as f32, v_px - v as f32);
    let upper = image.as_raw().get(v * width + u..)?;
    let lower = upper.get(width..)?;
    let between = |row: &[u8]| Some(f32::from(*row.first()?) * (1.0 - right) + f32::from(*row.get(1)?) * right);
    Some(between(upper)? * (1.0 - down) + between(lower)? * down)
}

/// Each pixel less the mean of those around it, over their spread; zero where
/// nothing is seen.
fn normalised(seen: &[f32], columns: usize, around: usize) -> Vec<f32> {
    let rows = seen.len() / columns;
    let stride = columns + 1;
    // Sums of count, value and square over all that is above and to the left.
    let mut sums = vec![[0.0_f64; 3]; stride * (rows + 1)];
    for y in 0..rows {
        let mut row = [0.0; 3];
        for x in 0..columns {
            let value = f64::from(seen[y * columns + x]);
            let terms = if value.is_nan() { [0.0; 3] } else { [1.0, value, value * value] };
            for k in 0..3 {
                row[k] += terms[k];
                sums[(y + 1) * stride + x + 1][k] = sums[y * stride + x + 1][k] + row[k];
            }
        }
    }
    let mut out = vec![0.0; seen.len()];
    for (i, out) in out.iter_mut().enumerate().filter(|(i, _)| !seen[*i].is_nan()) {
        let (x, y) = (i % columns, i / columns);
        let (left, right) = (x.saturating_sub(around), (x + around + 1).min(columns));
        let (top, bottom) = (y.saturating_sub(around), (y + around + 1).min(rows));
        let [count, sum, squares]: [f64; 3] = std::array::from_fn(|k| {
            sums[bottom * stride + right][k] - sums[top * stride + right][k] - sums[bottom * stride + left][k]
                + sums[top * stride + left][k]
        });
        let mean = sum / count;
        let spread = ((squares / count - mean * mean).max(0.0) + NOISE).sqrt();
        *out = ((f64::from(seen[i]) - mean) / spread).clamp(-MOST_DEVIATION, MOST_DEVIATION) as f32;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> PinholeCamera {
        PinholeCamera { fx_px: 200.0, fy_px: 200.0, cx_px: 150.0, cy_px: 20.0, from_reference_m: Vector3::zeros() }
    }

    fn view(image: &GrayImage, config: &RoadConfig) -> View {
        let road = Road { height_m: 1.65, rise: 0.0, bend_per_m: 0.0, sag_per_m: 0.0, fall: 0.0 };
        View::new(image, &camera(), &Rotation3::identity(), &road, config)
    }

    #[test]
    fn a_view_is_itself_where_nothing_moved_and_nothing_where_nothing_is_shared() {
        let config = RoadConfig::default();
        let image = GrayImage::from_fn(300, 100, |u, v| image::Luma([(u * 37 % 101 + v * 53 % 97) as u8]));
        let seen = view(&image, &config);
        let shift = seen.shift_to(&seen, 0.0, [-1.0, 4.0], &config).unwrap();
        assert!(shift.forward_m.abs() < 1e-6 && (shift.correlation - 1.0).abs() < 1e-3, "{shift:?}");
        assert_eq!(seen.correlation(&seen, 10, 1e3, 10..seen.rows, Side::Both), (0.0, 0));
        assert_eq!(seen.correlation(&seen, 10, -1e3, 10..seen.rows, Side::Both), (0.0, 0));
    }

    #[test]
    fn the_vertex_lies_between_the_neighbours() {
        assert!((vertex(&[0.2, 0.8, 0.6], 1) - 0.25).abs() < 1e-9);
        assert_eq!((vertex(&[0.2, 0.8], 1), vertex(&[0.5, 0.5, 0.5], 1)), (0.0, 0.0));
    }
}
