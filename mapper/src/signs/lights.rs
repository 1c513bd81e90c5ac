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

/// The traffic lights among the rows of a post: at most two, one above the other.
pub fn lights_on(rows: &[Row], axis: &Axis, config: &SignConfig) -> Vec<FoundSign> {
    let axis = bare(axis, rows, &config.outline);
    let lights = &config.lights;
    let beside: Vec<Beside> = rows
        .iter()
        .filter(|r| r.above_ground_m >= lights.lowest_m)
        // What reaches farther is no box.
        .filter(|r| r.span_m.0.abs().max(r.span_m.1.abs()) <= lights.reach_m && r.range_m <= lights.farthest_m)
        .flat_map(|r| hits_beside(r, &axis, lights))
        .collect();
    let mut dark: Vec<Beside> = beside.iter().copied().filter(|h| h.is_dark).collect();
    dark.sort_by(|a, b| a.height.total_cmp(&b.height).then(a.scan.cmp(&b.scan)));
    let (lower, upper) = dark.split_at(parting(&dark, lights));
    [lower, upper].into_iter().filter_map(|hits| light(hits, &beside, &axis, lights)).collect()
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

fn mean(hits: &[Beside]) -> Vector2<f64> {
    hits.iter().map(|h| h.middle).sum::<Vector2<f64>>() / hits.len().max(1) as f64
}

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

fn light(hits: &[Beside], all: &[Beside], axis: &Axis, config: &LightConfig) -> Option<FoundSign> {
    if hits.len() < config.fewest_hits {
        return None;
    }
    let mut scans: Vec<u16> = hits.iter().map(|h| h.scan).collect();
    scans.sort_unstable();
    scans.dedup();
    let (low, high) = spread(hits.iter().map(|h| h.height))?;
    let (lowest, _) = spread(hits.iter().map(|h| h.above_ground_m))?;
    let (left, right) = spread(hits.iter().map(|h| h.middle.x))?;
    let (near, far) = spread(hits.iter().map(|h| h.middle.y))?;
    let (width_m, height_m) = ((right - left).max(far - near), high - low);
    let level = all.iter().filter(|h| h.height >= low && h.height <= high);
    let dark = hits.len() as f64 / level.count().max(1) as f64;
    let is_light = scans.len() >= config.fewest_scans
        && dark >= config.least_dark_share
        && lowest >= config.lowest_m
        && (config.width_m[0]..=config.width_m[1]).contains(&width_m)
        && (config.height_m[0]..=config.height_m[1]).contains(&height_m);
    let height = f64::midpoint(low, high);
    let off = mean(hits);
    let place = axis.at(height).coords + off;
    is_light.then(|| FoundSign {
        kind: SignKind::TrafficLight,
        centroid: Point3::new(place.x, -height, place.y),
        size_m: width_m.hypot(height_m),
        points: hits.len(),
        scans: scans.len(),
        facing: off.try_normalize(config.off_post_m),
        sigma_m: None,
    })
}

/// The values that all but one in twenty lie between.
fn spread(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let cut = values.len() / 40;
    Some((*values.get(cut)?, *values.get(values.len().checked_sub(1 + cut)?)?))
}
