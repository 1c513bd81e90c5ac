//! The axis of a pole: robust least squares over the hits of many scans.

use std::f64::consts::FRAC_PI_4;

use nalgebra::{Matrix2, Matrix5, Point2, Vector2, Vector5};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rustc_hash::FxHashMap;

use super::normal::Sums;
use super::{Plumb, PoleConfig};
use crate::cloud::{Cloud, CloudPoint};
use crate::sheeting::Glance;

/// A point near a stack: place, height along -y, and direction from the lidar.
#[derive(Clone, Copy)]
pub(super) struct Hit {
    /// Map (x, z), metres.
    pub at_map: Vector2<f64>,
    /// Along -y of the map, metres.
    pub height_m: f64,
    pub above_ground_m: f64,
    pub from_lidar: Vector2<f64>,
    pub scan: u16,
    /// Elevation of the ray from the lidar, radians.
    pub elevation_rad: f64,
    pub range_m: f64,
    pub reflectance: f32,
}

impl Hit {
    pub fn new(p: &CloudPoint, cloud: &Cloud) -> Self {
        let sensor = cloud.sensors[usize::from(p.scan)].at_map;
        let at_map = Vector2::new(p.position.x, p.position.z);
        let ray = at_map - Vector2::new(sensor.x, sensor.z);
        let Glance { scan, from_lidar, range_m, reflectance } = cloud.glance(p);
        Self {
            at_map,
            height_m: -p.position.y,
            above_ground_m: f64::from(p.height_m),
            from_lidar,
            scan,
            elevation_rad: (sensor.y - p.position.y).atan2(ray.norm()),
            range_m,
            reflectance,
        }
    }

    /// As seen from the lidar.
    pub fn glance(&self) -> Glance {
        Glance { scan: self.scan, from_lidar: self.from_lidar, range_m: self.range_m, reflectance: self.reflectance }
    }

    /// Which beam of the lidar it is of.
    pub fn beam(&self, config: &PoleConfig) -> i32 {
        (self.elevation_rad / config.beam_step_rad).round() as i32
    }
}

/// An axis over height: `(x, z) = base + slope * height`, and how far the
/// visible surface lies before it, as seen from the lidar.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    pub base: Vector2<f64>,
    pub slope: Vector2<f64>,
    /// Mean distance of the hits before the axis, metres: `pi / 4` radii.
    pub before_m: f64,
    /// The slope that the hits alone tell, whatever else is known.
    pub slope_of_hits: Vector2<f64>,
    /// Its covariance, rad^2.
    pub slope_covariance: Matrix2<f64>,
}

impl Axis {
    /// The axis that has this base and slope whatever hits tell of it.
    pub fn new(base: Vector2<f64>, slope: Vector2<f64>) -> Self {
        Self { base, slope, before_m: 0.0, slope_of_hits: slope, slope_covariance: Matrix2::identity() }
    }

    #[inline]
    pub fn at(&self, height: f64) -> Vector2<f64> {
        self.base + self.slope * height
    }

    #[inline]
    pub fn residual(&self, hit: &Hit) -> Vector2<f64> {
        hit.at_map - (self.at(hit.height_m) - hit.from_lidar * self.before_m)
    }

    /// The axis in the surface that some hits are on, as it lies from where they were seen.
    pub fn on_surface(self, hits: &[Hit]) -> Self {
        let view = hits.iter().map(|h| h.from_lidar).sum::<Vector2<f64>>() / hits.len().max(1) as f64;
        Self { base: self.base - view * self.before_m, before_m: 0.0, ..self }
    }

    /// Distance of a hit from the axis across the view, metres.
    #[inline]
    pub fn across_m(&self, hit: &Hit) -> f64 {
        (hit.at_map - self.at(hit.height_m)).perp(&hit.from_lidar).abs()
    }
}

/// RANSAC trials: a line through two of the points, of which at least half
/// are on the pole, is missed by all with a chance of 0.75^64 = 1e-8.
const TRIALS: usize = 64;
/// Hits after which it is asked whether a line may still be the best.
const PART: usize = 16;
/// Least difference in height of two points that tell a slope, metres.
const SLOPE_BASE_M: f64 = 0.3;

/// The best of some lines through two hits, or upright through one; none
/// without hits.
pub(super) fn ransac(hits: &[Hit], inlier_m: f64, plumb: &Plumb, config: &PoleConfig) -> Option<Axis> {
    let mut rng = Pcg64Mcg::seed_from_u64(hits.len() as u64);
    let steepest = config.largest_tilt_rad.tan();
    let through = |h: &Hit, slope: Vector2<f64>| Axis::new(h.at_map - slope * h.height_m, slope);
    let mut best = (f64::NEG_INFINITY, through(hits.first()?, plumb.slope));
    let mut try_axis = |axis: Axis| {
        // MSAC: a truncated square tells a tight line from a loose one.
        let (mut score, mut left) = (0.0, hits.len() as f64);
        for part in hits.chunks(PART) {
            for h in part {
                score += 1.0 - (axis.residual(h).norm_squared() / inlier_m.powi(2)).min(1.0);
            }
            left -= part.len() as f64;
            // Most lines miss so many that the rest cannot make up for it.
            if score + left <= best.0 {
                return;
            }
        }
        best = (score, axis);
    };
    for _ in 0..TRIALS {
        let a = &hits[rng.random_range(0..hits.len())];
        let b = &hits[rng.random_range(0..hits.len())];
        // Short stacks do not tell their tilt: the plumb line is a candidate.
        try_axis(through(a, plumb.slope));
        let rise = a.height_m - b.height_m;
        if rise.abs() > SLOPE_BASE_M {
            let slope = (a.at_map - b.at_map) / rise;
            if slope.norm() <= steepest {
                try_axis(through(a, slope));
            }
        }
    }
    Some(best.1)
}

/// Radius from the width across the view: the hits on a round pole are spread
/// evenly over its width, whichever side it is seen from.
pub(super) fn radius_across(hits: &[Hit], axis: &Axis, config: &PoleConfig) -> f64 {
    let mut across: Vec<f64> = hits.iter().map(|h| axis.across_m(h)).collect();
    let widest = across.len() * 9 / 10;
    let half_width =
        if across.is_empty() { 0.0 } else { *across.select_nth_unstable_by(widest, f64::total_cmp).1 / 0.9 };
    // The noise widens it: 1.3 standard deviations are a nine in ten share too.
    let noise = 1.3 * config.noise_m / 0.9;
    (half_width.powi(2) - noise.powi(2)).max(config.thinnest_m.powi(2)).sqrt()
}

/// Root mean square distance of hits on a cylinder of unit radius, even over
/// its width, from their mean: `sqrt(1/3 + 2/3 - (pi/4)^2)`.
pub(super) const SHELL_SPREAD: f64 = 0.62;

/// Which hits of a laser share its error of range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shared {
    /// Those of one scan: the next one says something new. Tells best where the
    /// surface is.
    ByScan,
    /// All, as a laser errs alike in all scans. Tells best how little they know
    /// of a lean along the view.
    ByLaser,
}

/// What the hits of one scan add up to along one coordinate.
#[derive(Clone, Copy)]
struct OfScan {
    weight: f64,
    row: Vector5<f64>,
    value: f64,
}

/// Robust least squares for base, slope and the distance of the surface:
/// linear in all five, with priors that hold what short stacks and views from
/// one side leave open.
///
/// The pose of each scan errs by a few centimetres, and all its hits with it:
/// that common shift is integrated out (Woodbury), so that a scan that saw the
/// lower half and another that saw the upper one make no tilt. Each laser errs
/// in its range by about as much, and again all its hits with it: along the view
/// many hits of one beam say little more than one.
pub(super) fn refine(hits: &[Hit], start: Axis, plumb: &Plumb, shared: Shared, config: &PoleConfig) -> Axis {
    let mut axis = start;
    let middle = hits.iter().map(|h| h.height_m).sum::<f64>() / hits.len() as f64;
    let scans = hits.iter().map(|h| usize::from(h.scan) + 1).max().unwrap_or(0);
    let none = OfScan { weight: 0.0, row: Vector5::zeros(), value: 0.0 };
    let shift = config.pose_noise_m.powi(2);
    let of_beam_m2: Vec<f64> =
        hits_of_beam(hits, shared, config).into_iter().map(|count| count * config.beam_noise_m.powi(2)).collect();
    let value = |h: &Hit| [h.at_map.dot(&h.from_lidar), h.at_map.dot(&Vector2::new(-h.from_lidar.y, h.from_lidar.x))];
    let values: Vec<[f64; 2]> = hits.iter().map(value).collect();
    let mut of_scans = vec![[none; 2]; scans];
    for _ in 0..8 {
        let radius = radius_across(hits, &axis, config);
        let scale = config.hit_noise_m.powi(2) + (SHELL_SPREAD * radius).powi(2);
        let mut sums = Sums::default();
        of_scans.fill([none; 2]);
        for ((hit, of_beam_m2), values) in hits.iter().zip(&of_beam_m2).zip(&values) {
            let scaled = axis.residual(hit).norm_squared() / (scale + shift);
            let robust = (1.0 + scaled / 4.0).powi(2).recip();
            let t = hit.height_m - middle;
            let along = hit.from_lidar;
            let across = Vector2::new(-along.y, along.x);
            let weights = [robust / (scale + of_beam_m2), robust / scale];
            sums.add(&along, t, *values, weights);
            // The poles of a scan are seen in one direction: its shift may be
            // told along the view and across it.
            let rows = [(along, -1.0), (across, 0.0)].into_iter().zip(*values).zip(weights);
            for (sum, (((axis, of_surface), value), weight)) in of_scans[usize::from(hit.scan)].iter_mut().zip(rows) {
                let weighted = axis * weight;
                sum.row += Vector5::new(weighted.x, weighted.y, weighted.x * t, weighted.y * t, of_surface * weight);
                sum.weight += weight;
                sum.value += value * weight;
            }
        }
        let (mut h, mut g) = sums.equations();
        // Most scans see nothing of it.
        for sum in of_scans.iter().flatten().filter(|sum| sum.weight > 0.0) {
            let known = shift / (1.0 + shift * sum.weight);
            h -= sum.row * sum.row.transpose() * known;
            g -= sum.row * (sum.value * known);
        }
        let prior = config.surface_sigma_m.powi(-2);
        h[(4, 4)] += prior;
        g[4] += prior * radius * FRAC_PI_4;
        let (slope_of_hits, slope_covariance) = slope_alone(h, &g);
        let upright = plumb.uprightness(&(slope_of_hits - plumb.slope), &slope_covariance, config);
        for k in [0, 1] {
            h[(2 + k, 2 + k)] += upright;
            g[2 + k] += upright * plumb.slope[k];
        }
        let Some(solver) = h.cholesky() else { return axis };
        let s = solver.solve(&g);
        let slope = Vector2::new(s[2], s[3]);
        let before = axis;
        let base = Vector2::new(s[0], s[1]) - slope * middle;
        axis = Axis { base, slope, before_m: s[4].max(0.0), slope_of_hits, slope_covariance };
        let moved_m = (axis.at(middle) - before.at(middle)).amax().max((axis.before_m - before.before_m).abs());
        if moved_m < SETTLED && (axis.slope - before.slope).amax() < SETTLED {
            break;
        }
    }
    axis
}

/// A refinement has settled where its steps are smaller than this, metres and
/// radians: the map is rounded to a thousand times as much and more.
const SETTLED: f64 = 1e-6;

/// For each hit, how many hits share its error of range, itself included.
fn hits_of_beam(hits: &[Hit], shared: Shared, config: &PoleConfig) -> Vec<f64> {
    let beam = |hit: &Hit| (if shared == Shared::ByScan { hit.scan } else { 0 }, hit.beam(config));
    let beams: Vec<(u16, i32)> = hits.iter().map(beam).collect();
    let mut counts: FxHashMap<(u16, i32), u32> = FxHashMap::default();
    for beam in &beams {
        *counts.entry(*beam).or_default() += 1;
    }
    beams.iter().map(|beam| counts.get(beam).map_or(0.0, |count| f64::from(*count))).collect()
}

/// The slope and its covariance from the normal equations of all five; no
/// knowledge at all where it cannot be told.
fn slope_alone(information: Matrix5<f64>, right: &Vector5<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    // A slope of 1 rad is as good as unknown.
    let whole = (information + Matrix5::from_diagonal(&Vector5::new(0.0, 0.0, 1.0, 1.0, 0.0))).try_inverse();
    whole.map_or_else(
        || (Vector2::zeros(), Matrix2::identity()),
        |c| ((c * right).fixed_rows::<2>(2).into_owned(), c.fixed_view::<2, 2>(2, 2).into_owned()),
    )
}

/// The hits of the slices where it is slimmest: a sign on a post is wider than
/// the post, stands before it and reaches to one side, and would bend its axis.
pub(super) fn slim(hits: &[Hit], axis: &Axis, config: &PoleConfig) -> Vec<Hit> {
    let slice = |h: &Hit| (h.above_ground_m / config.slice_m).floor() as i64;
    let mut sorted: Vec<(i64, f64)> = hits.iter().map(|h| (slice(h), axis.across_m(h))).collect();
    sorted.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let widths: Vec<(i64, f64)> = sorted
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|of_slice| of_slice.len() >= FEWEST_ACROSS)
        .map(|of_slice| of_slice[of_slice.len() * 8 / 10])
        .collect();
    let mut by_width: Vec<f64> = widths.iter().map(|w| w.1).collect();
    by_width.sort_by(f64::total_cmp);
    let Some(post_m) = by_width.get(by_width.len() / 4) else { return hits.to_vec() };
    let widest_m = post_m + config.wider_m;
    let wide: Vec<i64> = widths.iter().filter(|w| w.1 > widest_m).map(|w| w.0).collect();
    let slices_left = widths.len() - wide.len();
    let left: Vec<Hit> = hits.iter().filter(|h| wide.binary_search(&slice(h)).is_err()).copied().collect();
    // The plumb line tells the slope of what is short, better than a rail before it.
    let tells = slices_left >= FEWEST_SLIM && left.len() >= config.fewest_points;
    if tells { left } else { hits.to_vec() }
}

/// Fewest slices that tell where a post is.
const FEWEST_SLIM: usize = 2;

/// Fewest hits that tell how wide a slice is.
const FEWEST_ACROSS: usize = 4;

/// Place of a point above the ground plane.
pub(super) fn above(at: Vector2<f64>) -> Point2<f64> {
    at.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three scans of an upright post 0.8 m high; its highest beam measures too far.
    fn short_post(too_far_m: f64) -> Vec<Hit> {
        let hit = |scan: u16, beam: u8, i: u8| {
            let from_lidar = Vector2::new((0.2 * f64::from(scan)).sin(), (0.2 * f64::from(scan)).cos());
            let across = Vector2::new(-from_lidar.y, from_lidar.x) * (0.012 * (f64::from(i) - 3.5));
            let error_m = if beam == 3 { too_far_m } else { 0.0 };
            let height = 0.2 * (1.0 + f64::from(beam));
            Hit {
                at_map: from_lidar * (error_m - 0.04) + across,
                height_m: height,
                above_ground_m: height,
                from_lidar,
                scan,
                elevation_rad: 0.03 * f64::from(beam),
                range_m: 8.0,
                reflectance: 0.3,
            }
        };
        (0..3).flat_map(|scan| (0..4).flat_map(move |beam| (0..8).map(move |i| hit(scan, beam, i)))).collect()
    }

    #[test]
    fn the_error_of_one_beam_hardly_tilts_a_short_post_however_many_hits_it_has() {
        let upright = Axis::new(Vector2::zeros(), Vector2::zeros());
        let plumb = Plumb { slope: Vector2::zeros(), lean_rad: 0.01 };
        let lean =
            |config: &PoleConfig| refine(&short_post(0.03), upright, &plumb, Shared::ByLaser, config).slope.norm();
        let beams_alike = PoleConfig { beam_noise_m: 0.0, ..PoleConfig::default() };
        let (known, alike) = (lean(&PoleConfig::default()), lean(&beams_alike));
        assert!(known < 0.5 * alike && known < 0.005, "{known} {alike}");
    }
}
