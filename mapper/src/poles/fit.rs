//! The axis of a pole through the points of a stack.

use std::f64::consts::FRAC_PI_4;

use nalgebra::{Matrix5, Point2, Point3, RowSVector, Vector2, Vector3, Vector5};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{PoleConfig, Stack};
use crate::cloud::{Cloud, CloudPoint};
use crate::lidar::{LidarConfig, View};

/// A pole as fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedPole {
    /// Lower end of the axis, map frame, metres: on the ground, whether the
    /// pole can be seen down to it or not.
    pub foot: Point3<f64>,
    /// Upper end of the axis, map frame, metres.
    pub top: Point3<f64>,
    /// Height above ground from which on it is seen, metres; 0 where that is
    /// near the ground.
    pub foot_height_m: f64,
    /// Height of the upper end above ground, metres.
    pub top_height_m: f64,
    /// Radius of the pole, metres.
    pub radius_m: f64,
    /// Root mean square horizontal distance of the points from a cylinder of
    /// that radius, metres, beyond what the width of the beams explains.
    pub spread_m: f64,
    /// Points on the free part.
    pub points: usize,
    /// Scans that hit it.
    pub scans: usize,
    /// Points on the free part over those expected were nothing in the way.
    pub visibility: f64,
    /// Length of the free part, metres.
    pub free_m: f64,
    /// Whether it ends where the scanners' field of view does.
    pub top_is_open: bool,
    /// Share of its slices in which something reaches from it outwards: rails
    /// of a fence, boards, a hedge that it stands in.
    pub attached_share: f64,
    /// Largest reflectance that at least three of its points have.
    pub reflectance: f32,
}

impl FittedPole {
    /// Angle of the axis from the vertical of the map, radians.
    pub fn tilt_rad(&self) -> f64 {
        (self.top - self.foot).angle(&-Vector3::y())
    }
}

/// An axis over height: `(x, z) = base + slope * height`, and how far the
/// visible surface lies before it, as seen from the lidar.
#[derive(Debug, Clone, Copy)]
struct Axis {
    base: Vector2<f64>,
    slope: Vector2<f64>,
    /// Mean distance of the hits before the axis, metres: `pi / 4` radii.
    before_m: f64,
}

/// A point near a stack: place, height along -y, and direction from the lidar.
#[derive(Clone, Copy)]
struct Hit {
    at: Vector2<f64>,
    height: f64,
    above_ground: f64,
    from_lidar: Vector2<f64>,
    scan: u16,
    range: f64,
    reflectance: f32,
}

impl Hit {
    fn new(p: &CloudPoint, cloud: &Cloud) -> Self {
        let sensor = cloud.sensor_map[usize::from(p.scan)];
        let at = Vector2::new(p.position.x, p.position.z);
        let from_lidar = (at - Vector2::new(sensor.x, sensor.z)).try_normalize(1e-6).unwrap_or_else(Vector2::y);
        Self {
            at,
            height: -p.position.y,
            above_ground: f64::from(p.height_m),
            from_lidar,
            scan: p.scan,
            range: f64::from(p.range_m),
            reflectance: p.reflectance,
        }
    }
}

impl Axis {
    fn at(&self, height: f64) -> Vector2<f64> {
        self.base + self.slope * height
    }
    fn residual(&self, hit: &Hit) -> Vector2<f64> {
        hit.at - (self.at(hit.height) - hit.from_lidar * self.before_m)
    }
}

/// RANSAC trials: a line through two of the points, of which at least half
/// are on the pole, is missed by all with a chance of 0.75^64 = 1e-8.
const TRIALS: usize = 64;
/// Least difference in height of two points that tell a slope, metres.
const SLOPE_BASE_M: f64 = 0.3;

fn ransac(hits: &[Hit], config: &PoleConfig) -> Axis {
    let mut rng = Pcg64Mcg::seed_from_u64(hits.len() as u64);
    let steepest = config.largest_tilt_rad.tan();
    let upright = |h: &Hit, slope: Vector2<f64>| Axis { base: h.at - slope * h.height, slope, before_m: 0.0 };
    let mut best = (f64::NEG_INFINITY, upright(&hits[0], Vector2::zeros()));
    let mut try_axis = |axis: Axis| {
        // MSAC: a truncated square tells a tight line from a loose one.
        let score: f64 =
            hits.iter().map(|h| 1.0 - (axis.residual(h).norm_squared() / config.inlier_m.powi(2)).min(1.0)).sum();
        if score > best.0 {
            best = (score, axis);
        }
    };
    for _ in 0..TRIALS {
        let a = &hits[rng.random_range(0..hits.len())];
        let b = &hits[rng.random_range(0..hits.len())];
        // Short stacks do not tell their tilt: the vertical is a candidate.
        try_axis(upright(a, Vector2::zeros()));
        let rise = a.height - b.height;
        if rise.abs() > SLOPE_BASE_M {
            let slope = (a.at - b.at) / rise;
            if slope.norm() <= steepest {
                try_axis(upright(a, slope));
            }
        }
    }
    best.1
}

/// Radius from the width across the view: the hits on a round pole are spread
/// evenly over its width, whichever side it is seen from.
fn radius_across(hits: &[Hit], axis: &Axis, config: &PoleConfig) -> f64 {
    let mut across: Vec<f64> = hits.iter().map(|h| (h.at - axis.at(h.height)).perp(&h.from_lidar).abs()).collect();
    across.sort_by(f64::total_cmp);
    let half_width = across.get(across.len() * 9 / 10).map_or(0.0, |a| a / 0.9);
    // The noise widens it: 1.3 standard deviations are a nine in ten share too.
    let noise = 1.3 * config.noise_m / 0.9;
    (half_width.powi(2) - noise.powi(2)).max(config.thinnest_m.powi(2)).sqrt()
}

/// Robust least squares for base, slope and the distance of the surface:
/// linear in all five, with priors that hold what short stacks and views from
/// one side leave open.
fn refine(hits: &[Hit], start: Axis, config: &PoleConfig) -> Axis {
    let mut axis = start;
    let middle = hits.iter().map(|h| h.height).sum::<f64>() / hits.len() as f64;
    // Scans with many hits must not outvote the view from the other side.
    let scans = hits.iter().map(|h| usize::from(h.scan) + 1).max().unwrap_or(0);
    let mut per_scan = vec![0.0_f64; scans];
    for h in hits {
        per_scan[usize::from(h.scan)] += 1.0;
    }
    for _ in 0..8 {
        let radius = radius_across(hits, &axis, config);
        let scale = config.noise_m.powi(2) + (SHELL_SPREAD * radius).powi(2);
        let (mut h, mut g) = (Matrix5::zeros(), Vector5::zeros());
        for hit in hits {
            let scaled = axis.residual(hit).norm_squared() / scale;
            let balance = per_scan[usize::from(hit.scan)].sqrt().recip();
            let weight = balance / (1.0 + scaled / 4.0).powi(2);
            let t = hit.height - middle;
            for (k, u) in [(0, hit.from_lidar.x), (1, hit.from_lidar.y)] {
                let mut row = RowSVector::<f64, 5>::zeros();
                row[k] = 1.0;
                row[2 + k] = t;
                row[4] = -u;
                h += row.transpose() * row * weight;
                g += row.transpose() * (hit.at[k] * weight);
            }
        }
        for k in [2, 3] {
            h[(k, k)] += scale / config.usual_tilt_rad.powi(2);
        }
        let prior = scale / config.surface_sigma_m.powi(2);
        h[(4, 4)] += prior;
        g[4] += prior * radius * FRAC_PI_4;
        let Some(solver) = h.cholesky() else { return axis };
        let s = solver.solve(&g);
        let slope = Vector2::new(s[2], s[3]);
        axis = Axis { base: Vector2::new(s[0], s[1]) - slope * middle, slope, before_m: s[4].max(0.0) };
    }
    axis
}

/// Root mean square distance of hits on a cylinder of unit radius, even over
/// its width, from their mean: `sqrt(1/3 + 2/3 - (pi/4)^2)`.
const SHELL_SPREAD: f64 = 0.62;

/// Fewest points that tell that something is there: one or two are strays.
const FEWEST_BESIDE: u32 = 3;

/// Share of the slices of a pole in which something reaches from it outwards:
/// points just beside it, seen by more than a quarter of the scans that saw the pole there.
/// Whoever walks by is there in one scan, and behind a gap it is a background.
fn attached_share(hits: &[Hit], axis: &Axis, radius_m: f64, (low_m, high_m): (f64, f64), config: &PoleConfig) -> f64 {
    let (from_m, to_m) = (radius_m + config.gap_from_m, radius_m + config.gap_to_m);
    let slice = |above_ground: f64| ((above_ground - low_m) / config.slice_m) as usize;
    let count = slice(high_m) + 1;
    let mut core = vec![(0_u32, 0_u64); count];
    let mut beside = vec![(0_u32, 0_u64); count];
    for hit in hits.iter().filter(|h| h.above_ground >= low_m && h.above_ground <= high_m) {
        let off = (hit.at - axis.at(hit.height)).norm();
        if off < to_m {
            let of = if off < from_m { &mut core } else { &mut beside };
            let cell = &mut of[slice(hit.above_ground)];
            cell.0 += 1;
            cell.1 |= 1 << (hit.scan % 64);
        }
    }
    let is_attached = |(core, beside): &(&(u32, u64), &(u32, u64))| {
        beside.0 >= FEWEST_BESIDE
            && f64::from(beside.0) > config.largest_clutter * f64::from(core.0)
            && 4 * beside.1.count_ones() > core.1.count_ones()
    };
    core.iter().zip(&beside).filter(is_attached).count() as f64 / count as f64
}

/// Fits a pole to a stack; none where no axis describes its points.
pub fn fit_pole<'a>(
    cloud: &Cloud,
    near: impl Iterator<Item = &'a CloudPoint>,
    stack: &Stack,
    config: &PoleConfig,
    lidar: &LidarConfig,
) -> Option<FittedPole> {
    let hits: Vec<Hit> = near.map(|p| Hit::new(p, cloud)).collect();
    let in_run: Vec<Hit> = hits
        .iter()
        .copied()
        .filter(|h| stack.is_free(h.above_ground, config))
        .filter(|h| h.above_ground >= stack.low_m && h.above_ground <= stack.high_m)
        .filter(|h| (h.at - stack.centre.coords).norm() < stack.reach_m)
        .collect();
    if in_run.len() < config.fewest_points / 2 {
        return None;
    }
    let axis = refine(&in_run, ransac(&in_run, config), config);
    let inlier_m = config.inlier_m.min(stack.reach_m);
    // Follow the axis up and down as far as points go on without a gap.
    let mut on: Vec<Hit> =
        hits.iter().copied().filter(|h| axis.residual(h).norm() < inlier_m && h.above_ground <= stack.end_m).collect();
    on.sort_by(|a, b| a.height.total_cmp(&b.height));
    let middle = in_run.iter().map(|h| h.height).sum::<f64>() / in_run.len() as f64;
    let joined = |w: &[Hit]| w[1].height - w[0].height < config.longest_gap_m;
    let run = on.chunk_by(|a, b| joined(&[*a, *b])).find(|c| c.last().is_some_and(|h| h.height >= middle))?;
    let free: Vec<Hit> = run.iter().copied().filter(|h| stack.is_free(h.above_ground, config)).collect();
    if free.len() < config.fewest_points {
        return None;
    }
    let axis = refine(&free, axis, config);
    let residuals: f64 = free.iter().map(|h| axis.residual(h).norm_squared()).sum();
    let radius_m = radius_across(&free, &axis, config);
    let beams = free.iter().map(|h| (config.beam_rad * h.range).powi(2)).sum::<f64>();
    let explained = (SHELL_SPREAD * radius_m).powi(2) + beams / free.len() as f64;
    let mut scans: Vec<u16> = free.iter().map(|h| h.scan).collect();
    scans.sort_unstable();
    scans.dedup();
    let mut slices: Vec<i64> = free.iter().map(|h| (h.above_ground / config.slice_m).floor() as i64).collect();
    slices.sort_unstable();
    slices.dedup();

    let mut bright: Vec<f32> = run.iter().map(|h| h.reflectance).collect();
    bright.sort_by(|a, b| b.total_cmp(a));
    let point = |height: f64| {
        let at = axis.at(height);
        Point3::new(at.x, -height, at.y)
    };
    let above_ground = |height: f64| {
        let at = axis.at(height);
        cloud.ground.height_m(&Point2::new(at.x, at.y)).map(|g| height - g)
    };
    let (lowest, highest) = (run.first()?.height, run.last()?.height);
    let mut foot_height_m = above_ground(lowest)?;
    // The foot is on the ground, not where the beams, the grass or a hedge end.
    let foot = lowest - foot_height_m;
    if foot_height_m < config.foot_m {
        foot_height_m = 0.0;
    }
    let mid = axis.at(f64::midpoint(lowest, highest));
    let from = cloud.sensor_map.iter().map(|s| ((Vector2::new(s.x, s.z) - mid).norm(), -s.y));
    let view = View::new(from, config.farthest_m, lidar);
    let ground_m = lowest - above_ground(lowest)?;
    let width_m = 2.0 * radius_m;
    let expected: f64 = slices
        .iter()
        .map(|s| ground_m + (*s as f64 + 0.5) * config.slice_m)
        .map(|height| view.expected(height, config.slice_m, width_m))
        .sum();
    Some(FittedPole {
        foot: point(foot),
        top: point(highest),
        foot_height_m,
        top_height_m: above_ground(highest)?,
        radius_m,
        spread_m: (residuals / free.len() as f64 - explained).max(0.0).sqrt(),
        points: free.len(),
        scans: scans.len(),
        visibility: free.len() as f64 / expected.max(1.0),
        free_m: slices.len() as f64 * config.slice_m,
        top_is_open: highest > view.ceiling() - config.longest_gap_m,
        attached_share: attached_share(
            &hits,
            &axis,
            radius_m,
            (run.first()?.above_ground, run.last()?.above_ground),
            config,
        ),
        reflectance: bright.get(2).copied().unwrap_or(0.0),
    })
}
