//! The axis of a pole through the points of a stack.

use nalgebra::{Point3, Vector2};

use super::axis::{Axis, Hit, SHELL_SPREAD, Shared, above, radius_across, ransac, refine, slim};
use super::fences::{Spot, may_be_of_fence, rail};
use super::flat::is_plate;
use super::hedges::Around;
use super::walls::stands_on_wall;
use super::{FittedPole, Plumb, PoleConfig, Stack, looks_like_pole};
use crate::cloud::{Cloud, CloudPoint};
use crate::lidar::{LidarConfig, SheetingConfig, View, Viewpoint};
use crate::sheeting::Glance;

/// Fewest points that tell that something is there: one or two are strays.
const FEWEST_BESIDE: u32 = 3;

/// Share of the slices of a pole in which something reaches from it outwards:
/// points just beside it, seen by more than a quarter of the scans that saw the pole there.
/// Whoever walks by is there in one scan, and behind a gap it is a background.
fn attached_share(spots: &[Spot], axis: &Axis, radius_m: f64, (low_m, high_m): (f64, f64), config: &PoleConfig) -> f64 {
    let (from_m, to_m) = (radius_m + config.gap_from_m, radius_m + config.gap_to_m);
    let slice = |above_ground_m: f64| ((above_ground_m - low_m) / config.slice_m) as usize;
    let count = slice(high_m) + 1;
    let mut core = vec![(0_u32, 0_u64); count];
    let mut beside = vec![(0_u32, 0_u64); count];
    for spot in spots.iter().filter(|s| s.above_ground_m >= low_m && s.above_ground_m <= high_m) {
        let off = (spot.at_map - axis.at(spot.height_m)).norm();
        if off < to_m {
            let of = if off < from_m { &mut core } else { &mut beside };
            let cell = &mut of[slice(spot.above_ground_m)];
            cell.0 += 1;
            cell.1 |= 1 << (spot.scan % 64);
        }
    }
    let is_attached = |(core, beside): &(&(u32, u64), &(u32, u64))| {
        beside.0 >= FEWEST_BESIDE
            && f64::from(beside.0) > config.largest_clutter * f64::from(core.0)
            && 4 * beside.1.count_ones() > core.1.count_ones()
    };
    core.iter().zip(&beside).filter(is_attached).count() as f64 / count as f64
}

/// What fits are wanted for: of what is not wanted no more is found out than
/// tells that.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wanted {
    /// Poles.
    Poles,
    /// Poles, and what may stand in a fence: it may carry its rail on to poles.
    PolesAndFences,
}

impl Wanted {
    /// Whether what was fitted to a stack may be wanted, however it leans.
    fn may_be(self, pole: &FittedPole, stack: &Stack, config: &PoleConfig) -> bool {
        looks_like_pole(pole, stack, config) || (self == Self::PolesAndFences && may_be_of_fence(pole, config))
    }
}

/// Fits a pole to a stack; none where no axis describes its points, and where
/// these show that it is not wanted.
pub fn fit_pole<'a>(
    cloud: &Cloud,
    points: impl Iterator<Item = &'a CloudPoint>,
    stack: &Stack,
    plumb: &Plumb,
    wanted: Wanted,
    config: &PoleConfig,
    lidar: &LidarConfig,
) -> Option<FittedPole> {
    let mut near: Vec<CloudPoint> = Vec::new();
    // Not collected: iterators of many short pieces are fast from within only.
    points.for_each(|p| near.push(*p));
    let at = |p: &CloudPoint| Vector2::new(p.position.x, p.position.z);
    let in_run: Vec<Hit> = near
        .iter()
        .filter(|p| (at(p) - stack.centre.coords).norm_squared() < stack.reach_m.powi(2))
        .filter(|p| (stack.low_m..=stack.high_m).contains(&f64::from(p.height_m)))
        .filter(|p| stack.is_free(f64::from(p.height_m), config))
        .map(|p| Hit::new(p, cloud))
        .collect();
    if in_run.len() < config.fewest_points / 2 {
        return None;
    }
    let inlier_m = config.inlier_m.min(stack.reach_m);
    let refined = |hits: &[Hit], start: Axis| refine(hits, start, plumb, Shared::ByScan, config);
    let axis = refined(&in_run, ransac(&in_run, inlier_m, plumb, config)?);
    let is_beside = |p: &CloudPoint, axis: &Axis, reach_m: f64| {
        (at(p) - axis.at(-p.position.y)).norm_squared() < (reach_m + ROUNDING_M).powi(2)
    };
    let middle = in_run.iter().map(|h| h.height_m).sum::<f64>() / in_run.len() as f64;
    // Follows the axis up and down as far as points go on without a gap.
    let along = |axis: &Axis, reach_m: f64| {
        let mut on: Vec<Hit> = near
            .iter()
            // The surface lies before the axis by no more than this.
            .filter(|p| f64::from(p.height_m) <= stack.end_m && is_beside(p, axis, reach_m + axis.before_m))
            .map(|p| Hit::new(p, cloud))
            .filter(|h| axis.residual(h).norm() < reach_m)
            .collect();
        on.sort_by(|a, b| a.height_m.total_cmp(&b.height_m));
        let joined = |w: &[Hit]| w[1].height_m - w[0].height_m < config.longest_gap_m;
        let run = on.chunk_by(|a, b| joined(&[*a, *b])).find(|c| c.last().is_some_and(|h| h.height_m >= middle))?;
        let free: Vec<Hit> = run.iter().copied().filter(|h| stack.is_free(h.above_ground_m, config)).collect();
        (free.len() >= config.fewest_points).then(|| (run.to_vec(), Free::new(free, config)))
    };
    let (mut run, mut free) = along(&axis, inlier_m)?;
    if wanted == Wanted::Poles && !free.may_be_pole(config) {
        return None;
    }
    let mut axis = refined(&free.hits, axis);
    // Plates are wide, too, but no stems.
    let is_cut_off = inlier_m >= config.inlier_m
        && radius_across(&free.hits, &axis, config) > config.cut_off_share * inlier_m
        && reflectance(&run, config, &lidar.sheeting) < config.sheeting_reflectance;
    if let Some(wider) = is_cut_off.then(|| along(&axis, config.thickest_m)).flatten() {
        (run, free) = wider;
        axis = refined(&free.hits, axis);
    }
    let post = slim(&free.hits, &axis, config);
    let axis = refined(&post, axis);
    let post = slim(&free.hits, &axis, config);
    let axis = refined(&post, axis);
    let mut pole = describe(cloud, &Seen { run: &run, free: &free, post: &post }, &axis, config, lidar)?;
    // So far as if nothing were attached and all stood in hedges: whatever is makes it less of
    // a pole.
    if !wanted.may_be(&pole, stack, config) {
        return None;
    }
    let reach_m = pole.radius_m + config.gap_to_m.max(config.gap_from_m + config.rail_m);
    let around: Vec<Spot> = near.iter().filter(|p| is_beside(p, &axis, reach_m)).map(Spot::new).collect();
    let ends_m = (run.first()?.above_ground_m, run.last()?.above_ground_m);
    pole.attached_share = attached_share(&around, &axis, pole.radius_m, ends_m, config);
    let seen = Around { points: &near, axis: &axis, radius_m: pole.radius_m, ends_m };
    pole.hedge_share = seen.hedge_share(config);
    // Who is in none is asked no further.
    if pole.is_in_hedge(config) {
        pole.stands_out = seen.stands_out(config);
    }
    // Plates of signs are flat, too, but higher up.
    let wall_top_m = stack.low_m.max(config.sheet_m[0]);
    pole.stands_on_wall = stands_on_wall(&around, &axis, wall_top_m, config);
    if !wanted.may_be(&pole, stack, config) {
        return None;
    }
    if may_be_of_fence(&pole, config) {
        pole.rail = rail(&around, &axis, pole.radius_m, ends_m, config);
    }
    let mut axis = refine(&post, axis, plumb, Shared::ByLaser, config);
    if pole.shows_plates_alone {
        axis = axis.on_surface(&post);
        pole.radius_m = config.trees.low_post_radius_m;
    }
    pole.put_along(&axis);
    Some(pole)
}

/// Far more than distances that are computed in two ways differ by, metres.
const ROUNDING_M: f64 = 1e-6;

/// The hits along an axis with free space around.
struct Free {
    hits: Vec<Hit>,
    /// Scans that they are from.
    scans: usize,
    /// Slices that they lie in, from below.
    slices: Vec<i64>,
}

impl Free {
    fn new(hits: Vec<Hit>, config: &PoleConfig) -> Self {
        let mut scans: Vec<u16> = hits.iter().map(|h| h.scan).collect();
        scans.sort_unstable();
        scans.dedup();
        let mut slices: Vec<i64> = hits.iter().map(|h| (h.above_ground_m / config.slice_m).floor() as i64).collect();
        slices.sort_unstable();
        slices.dedup();
        Self { hits, scans: scans.len(), slices }
    }

    fn length_m(&self, config: &PoleConfig) -> f64 {
        self.slices.len() as f64 * config.slice_m
    }

    /// Whether enough is free of it, seen by enough scans: part of
    /// [`looks_like_pole`], asked before its axis is known well.
    fn may_be_pole(&self, config: &PoleConfig) -> bool {
        self.scans >= config.fewest_scans
            && self.length_m(config) >= config.least_free_m.min(config.least_free_hanging_m)
    }
}

/// The hits on a pole.
struct Seen<'a> {
    /// Those along its axis, from below.
    run: &'a [Hit],
    /// Of these, those with free space around.
    free: &'a Free,
    /// Of these, those on the post itself.
    post: &'a [Hit],
}

/// The largest reflectance that at least three hits have; of what only glints, that
/// of most hits.
fn reflectance(hits: &[Hit], config: &PoleConfig, sheeting: &SheetingConfig) -> f32 {
    let mut bright: Vec<f32> = hits.iter().map(|h| h.reflectance).collect();
    bright.sort_by(|a, b| b.total_cmp(a));
    let Some(&third) = bright.get(2) else { return 0.0 };
    let least = config.sheeting_reflectance;
    if third < least {
        return third;
    }
    let heights = || hits.iter().filter(|h| h.reflectance >= least).map(|h| h.above_ground_m);
    let (low_m, high_m) = (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
    let there: Vec<Glance> =
        hits.iter().filter(|h| (low_m..=high_m).contains(&h.above_ground_m)).map(Hit::glance).collect();
    if sheeting.is_steady(&there, least) { third } else { bright[bright.len() / 2] }
}

/// Describes what is seen of a pole by the axis that fits it best, but for what
/// is attached to it and for how it stands.
fn describe(cloud: &Cloud, seen: &Seen, axis: &Axis, config: &PoleConfig, lidar: &LidarConfig) -> Option<FittedPole> {
    let residuals: f64 = seen.post.iter().map(|h| axis.residual(h).norm_squared()).sum();
    let radius_m = radius_across(seen.post, axis, config);
    let beams = seen.post.iter().map(|h| (config.beam_rad * h.range_m).powi(2)).sum::<f64>();
    let explained = (SHELL_SPREAD * radius_m).powi(2) + beams / seen.post.len() as f64;
    let (lowest, highest) = (seen.run.first()?.height_m, seen.run.last()?.height_m);
    let foot = ground_under(cloud, axis, lowest, config)?;
    let mut foot_height_m = lowest - foot;
    if foot_height_m < config.foot_m {
        foot_height_m = 0.0;
    }
    let middle = axis.at(f64::midpoint(lowest, highest));
    let view = viewpoints(cloud, middle, config, lidar);
    let off_m = |at_map: &Point3<f64>| (Vector2::new(at_map.x, at_map.z) - middle).norm();
    let near = cloud.sensors.iter().filter(|s| off_m(&s.at_map) < config.farthest_m).count();
    let width_m = 2.0 * radius_m;
    let expected: f64 = seen
        .free
        .slices
        .iter()
        .map(|s| foot + (*s as f64 + 0.5) * config.slice_m)
        .map(|height| view.expected(height, config.slice_m, width_m))
        .sum();
    let hit: f64 = seen.free.hits.iter().map(|h| cloud.view_weight[usize::from(h.scan)]).sum();
    // From below, as the run is.
    let bright: Vec<&Hit> = seen.run.iter().filter(|hit| hit.reflectance >= config.least_reflectance).collect();
    let mut pole = FittedPole {
        foot: Point3::new(0.0, -foot, 0.0),
        top: Point3::new(0.0, -highest, 0.0),
        foot_height_m,
        top_height_m: highest - foot,
        radius_m,
        spread_m: (residuals / seen.post.len() as f64 - explained).max(0.0).sqrt(),
        points: seen.free.hits.len(),
        scans: seen.free.scans,
        scans_near: near,
        visibility: hit / expected.max(1.0),
        nearest_hit_m: seen.post.iter().map(|h| h.range_m).fold(f64::INFINITY, f64::min),
        free_m: seen.free.length_m(config),
        top_is_open: highest > view.ceiling() - config.open_top_m,
        attached_share: 0.0,
        hedge_share: f64::INFINITY,
        stands_out: f64::INFINITY,
        stands_on_wall: false,
        rail: None,
        reflectance: reflectance(seen.run, config, &lidar.sheeting),
        bright_share: bright.len() as f64 / seen.run.len() as f64,
        bright_top_m: bright.iter().rev().nth(2).map_or(0.0, |hit| hit.above_ground_m),
        shows_plates_alone: foot_height_m >= config.sheet_m[0] && is_plate(seen.post, axis, radius_m, config),
        slope: axis.slope,
        slope_of_hits: axis.slope_of_hits,
        slope_covariance: axis.slope_covariance,
    };
    pole.put_along(axis);
    Some(pole)
}

fn viewpoints<'a>(cloud: &Cloud, at: Vector2<f64>, config: &PoleConfig, lidar: &'a LidarConfig) -> View<'a> {
    let views = cloud.sensors.iter().map(|sensor| sensor.view_of(&at, lidar));
    let from = views.zip(&cloud.view_weight).map(|(view, weight)| Viewpoint { weight: *weight, ..view });
    View::new(from, config.farthest_m, lidar)
}

/// Height (along -y of the map, metres) of the ground where an axis meets it:
/// of the points close to it, for a kerb may be near, else of the height map.
fn ground_under(cloud: &Cloud, axis: &Axis, lowest: f64, config: &PoleConfig) -> Option<f64> {
    let coarse = cloud.ground.height_m(&above(axis.at(lowest)))?;
    let at = axis.at(coarse);
    let near: Vec<(f64, f64)> = cloud
        .near_ground(&above(at))
        .map(|p| ((Vector2::new(p.position.x, p.position.z) - at).norm(), -p.position.y))
        .collect();
    let around = |radius_m: f64| {
        let mut heights: Vec<f64> = near.iter().filter(|p| p.0 < radius_m).map(|p| p.1).collect();
        heights.sort_by(f64::total_cmp);
        lowest_layer_m(&heights, config.ground_layer_m, config.fewest_points)
    };
    Some(config.foot_radii_m.iter().find_map(|radius_m| around(*radius_m)).unwrap_or(coarse))
}

/// The median height of the ground around a place, from heights (metres,
/// ascending) of all hits near it: of the lowest layer that holds a fair share of them.
fn lowest_layer_m(heights: &[f64], thickness_m: f64, fewest: usize) -> Option<f64> {
    let most = (0..heights.len()).map(|i| layer(heights, i, thickness_m).len()).max()?;
    if most < fewest {
        return None;
    }
    // Grass and the foot of a hedge make layers, too, but above it.
    let lowest = (0..heights.len()).map(|i| layer(heights, i, thickness_m)).find(|l| 2 * l.len() >= most)?;
    lowest.get(lowest.len() / 2).copied()
}

fn layer(heights: &[f64], from: usize, thickness_m: f64) -> &[f64] {
    let end = heights.partition_point(|h| *h < heights[from] + thickness_m);
    heights.get(from..end).unwrap_or(&[])
}
