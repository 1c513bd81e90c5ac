//! Traffic lights: dark boxes that hang on a post.

use common::map::SignKind;
use nalgebra::{Point2, Point3, Vector2};

use super::FoundSign;
use super::config::{LightConfig, SignConfig};
use super::outline::bare;
use super::rows::{Axis, Row};

/// A hit beside a post.
#[derive(Clone, Copy)]
struct Beside {
    /// The middle of the box that it is on the near side of, off the axis in the
    /// plane (x, z), metres.
    middle: Vector2<f64>,
    /// Height along -y of the map, metres.
    height: f64,
    above_ground_m: f64,
    is_dark: bool,
    scan: u16,
}

/// The traffic lights among the rows of a post: at most two, one for those who
/// drive and a lower one for those who walk.
pub fn lights_on(rows: &[Row], axis: &Axis, config: &SignConfig) -> Vec<FoundSign> {
    let axis = bare(axis, rows, &config.outline);
    let lights = &config.lights;
    let mut beside: Vec<Beside> = rows
        .iter()
        .filter(|r| r.above_ground_m >= lights.lowest_m)
        // What reaches farther is no box.
        .filter(|r| r.span_m.0.abs().max(r.span_m.1.abs()) <= lights.reach_m && r.range_m <= lights.farthest_m)
        .flat_map(|r| hits_beside(r, &axis, lights))
        .collect();
    beside.sort_by(|a, b| a.height.total_cmp(&b.height).then(a.scan.cmp(&b.scan)));
    let level = &beside[heights_of(&beside, |i| beside[i].is_dark, lights.least_dark_share, lights)];
    let dark: Vec<Beside> = level.iter().copied().filter(|h| h.is_dark).collect();
    let is_upper = uppers(&dark, lights);
    let are_two = is_upper.contains(&true);
    [false, true]
        .into_iter()
        .filter_map(|upper| {
            // Two heads hang on two sides of their post, and one begins before the other ends.
            let is_own = |i: usize| is_upper[i] == upper;
            let of_head = heights_of(&dark, is_own, lights.least_own_share, lights);
            let hits: Vec<Beside> = of_head.filter(|i| is_own(*i)).map(|i| dark[i]).collect();
            let [two_lenses_m, three_lenses_m] = lights.usual_heights_m;
            let usual_m = if are_two && !upper { two_lenses_m } else { three_lenses_m };
            light(&hits, level, &axis, usual_m, lights)
        })
        .collect()
}

fn hits_beside<'a>(row: &'a Row, axis: &'a Axis, config: &'a LightConfig) -> impl Iterator<Item = Beside> + 'a {
    row.hits.iter().filter_map(move |(p, reflectance)| {
        let off = Point2::new(p.x, p.z) - axis.at(-p.y);
        (off.norm() > axis.radius_m + config.off_post_m).then(|| Beside {
            middle: off + row.view * (0.5 * config.depth_m),
            height: -p.y,
            above_ground_m: row.above_ground_m,
            is_dark: *reflectance <= config.darkest,
            scan: row.scan,
        })
    })
}

/// Which of the hits, sorted by height, are those of one box: the run without a
/// gap in which its own ones are most over the share that they must have.
fn heights_of(
    sorted: &[Beside],
    is_own: impl Fn(usize) -> bool,
    least_share: f64,
    config: &LightConfig,
) -> std::ops::Range<usize> {
    let cost = least_share / (1.0 - least_share);
    let (mut best, mut best_sum) = (0..0, 0.0);
    let (mut start, mut sum) = (0, 0.0);
    for (i, hit) in sorted.iter().enumerate() {
        let is_apart = i > 0 && hit.height - sorted[i - 1].height > config.longest_gap_m;
        if sum <= 0.0 || is_apart {
            (start, sum) = (i, 0.0);
        }
        sum += if is_own(i) { 1.0 } else { -cost };
        if sum > best_sum {
            (best, best_sum) = (start..i + 1, sum);
        }
    }
    best
}

fn mean(hits: &[Beside]) -> Vector2<f64> {
    hits.iter().map(|h| h.middle).sum::<Vector2<f64>>() / hits.len().max(1) as f64
}

/// Which of the hits on dark boxes, sorted by height, are of the upper of two;
/// none where there is one only. Where they overlap in height their sides of
/// the post tell.
fn uppers(sorted: &[Beside], config: &LightConfig) -> Vec<bool> {
    let parting = parting(sorted, config);
    if parting == 0 {
        return vec![false; sorted.len()];
    }
    let mut is_upper: Vec<bool> = (0..sorted.len()).map(|i| i >= parting).collect();
    for _ in 0..SIDE_ROUNDS {
        let of = |upper: bool| -> Vec<Beside> {
            sorted.iter().zip(&is_upper).filter(|(_, u)| **u == upper).map(|(h, _)| *h).collect()
        };
        let (below, above) = (of(false), of(true));
        if below.len().min(above.len()) < config.fewest_hits {
            return vec![false; sorted.len()];
        }
        let (below, above) = (mean(&below), mean(&above));
        is_upper = sorted.iter().map(|h| (h.middle - above).norm() < (h.middle - below).norm()).collect();
    }
    is_upper
}

/// Rounds in which hits go to the nearer of two boxes (Lloyd 1982).
const SIDE_ROUNDS: usize = 3;

/// Where hits that are sorted by height part into two boxes on different sides
/// of the post: the split that explains most of their scatter; 0 where there is
/// one box only.
fn parting(sorted: &[Beside], config: &LightConfig) -> usize {
    let fewest = config.fewest_hits;
    let apart = |i: usize| (mean(&sorted[..i]) - mean(&sorted[i..])).norm();
    let explained = |i: usize| (i * (sorted.len() - i)) as f64 * apart(i).powi(2);
    (fewest..(sorted.len() + 1).saturating_sub(fewest))
        .max_by(|a, b| explained(*a).total_cmp(&explained(*b)))
        .filter(|i| apart(*i) >= config.apart_m)
        .unwrap_or(0)
}

/// The light whose housing has these hits; `usual_m` is how high it is mostly.
fn light(hits: &[Beside], all: &[Beside], axis: &Axis, usual_m: f64, lights: &LightConfig) -> Option<FoundSign> {
    if hits.len() < lights.fewest_hits {
        return None;
    }
    let mut scans: Vec<u16> = hits.iter().map(|h| h.scan).collect();
    scans.sort_unstable();
    scans.dedup();
    let (low, high) = spread(hits.iter().map(|h| h.height))?;
    let (lowest, _) = spread(hits.iter().map(|h| h.above_ground_m))?;
    let (left, right) = spread(hits.iter().map(|h| h.middle.x))?;
    let (near, far) = spread(hits.iter().map(|h| h.middle.y))?;
    let width_m = (right - left).max(far - near);
    let level = all.iter().filter(|h| h.height >= low && h.height <= high);
    let dark = level.clone().filter(|h| h.is_dark).count() as f64 / level.count().max(1) as f64;
    let is_light = scans.len() >= lights.fewest_scans
        && dark >= lights.least_dark_share
        && lowest >= lights.lowest_m
        && (lights.width_m[0]..=lights.width_m[1]).contains(&width_m)
        && (lights.seen_m[0]..=lights.seen_m[1]).contains(&(high - low));
    // Upper edges are mostly above what the lidar sees.
    let height_m = usual_m.max(high - low);
    let height = low + 0.5 * height_m;
    let off = mean(hits);
    let place = axis.at(height).coords + off;
    is_light.then(|| FoundSign {
        kind: SignKind::TrafficLight,
        centroid: Point3::new(place.x, -height, place.y),
        size_m: width_m.hypot(height_m),
        points: hits.len(),
        scans: scans.len(),
        facing: off.try_normalize(lights.off_post_m),
        sigma_m: None,
    })
}

/// The values that all but one in ten lie between.
fn spread(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let cut = values.len() / 20;
    Some((*values.get(cut)?, *values.get(values.len().checked_sub(1 + cut)?)?))
}
