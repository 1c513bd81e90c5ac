//! Traffic lights: dark boxes that hang before a post.

use std::f64::consts::{FRAC_PI_4, PI, TAU};

use common::map::SignKind;
use nalgebra::{Point3, Vector2};

use super::FoundSign;
use super::config::{LightConfig, SignConfig};
use super::outline::bare;
use super::rows::{Axis, Row};

/// A hit beside a post.
#[derive(Clone, Copy)]
struct Beside {
    /// Off the axis in the plane (x, z), metres.
    off: Vector2<f64>,
    /// Height along -y of the map, metres.
    height: f64,
    above_ground_m: f64,
    range_m: f64,
    /// Direction of view in the plane (x, z), of unit length.
    view: Vector2<f64>,
    reflectance: f32,
    scan: u16,
}

/// The traffic lights among the rows of a post: at most one to each of two sides.
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
    let mut found = Vec::new();
    for _ in 0..2 {
        let Some(direction) = densest(&beside) else { break };
        let (of_box, rest): (Vec<Beside>, Vec<Beside>) =
            beside.iter().copied().partition(|h| h.off.angle(&direction) <= FRAC_PI_4);
        found.extend(light(&of_box, direction, &axis, lights));
        beside = rest;
    }
    found
}

fn hits_beside<'a>(row: &'a Row, axis: &'a Axis, config: &'a LightConfig) -> impl Iterator<Item = Beside> + 'a {
    row.hits.iter().filter_map(move |(p, reflectance)| {
        let off = nalgebra::Point2::new(p.x, p.z) - axis.at(-p.y);
        (off.norm() > axis.radius_m + config.off_post_m).then(|| Beside {
            off,
            height: -p.y,
            above_ground_m: row.above_ground_m,
            range_m: row.range_m,
            view: row.view,
            reflectance: *reflectance,
            scan: row.scan,
        })
    })
}

/// Number of directions that are tried: 7.5 degrees apart.
const DIRECTIONS: usize = 48;

/// The direction from the axis about which most hits lie.
fn densest(hits: &[Beside]) -> Option<Vector2<f64>> {
    (0..DIRECTIONS)
        .map(|i| {
            let angle = i as f64 / DIRECTIONS as f64 * TAU - PI;
            let direction = Vector2::new(angle.cos(), angle.sin());
            // Hits count by their distance: those beside the axis lie in many
            // directions, and between two boxes there are corners of both.
            let sum: f64 = hits
                .iter()
                .filter(|h| h.off.angle(&direction) <= 0.5 * FRAC_PI_4)
                .map(|h| h.off.dot(&direction) * h.range_m.powi(2))
                .sum();
            (sum, direction)
        })
        .filter(|(sum, _)| *sum > 0.0)
        .reduce(|a, b| if b.0 > a.0 { b } else { a })
        .map(|(_, direction)| direction)
}

fn light(hits: &[Beside], direction: Vector2<f64>, axis: &Axis, config: &LightConfig) -> Option<FoundSign> {
    if hits.len() < config.fewest_hits {
        return None;
    }
    let mut scans: Vec<u16> = hits.iter().map(|h| h.scan).collect();
    scans.sort_unstable();
    scans.dedup();
    let dark = hits.iter().filter(|h| h.reflectance <= config.darkest).count() as f64 / hits.len() as f64;
    let across = Vector2::new(-direction.y, direction.x);
    let (left, right) = spread(hits.iter().map(|h| h.off.dot(&across)))?;
    let (low, high) = spread(hits.iter().map(|h| h.height))?;
    let (lowest, _) = spread(hits.iter().map(|h| h.above_ground_m))?;
    let (width_m, height_m) = (right - left, high - low);
    let is_light = scans.len() >= config.fewest_scans
        && dark >= config.least_dark_share
        && lowest >= config.lowest_m
        && (config.width_m[0]..=config.width_m[1]).contains(&width_m)
        && (config.height_m[0]..=config.height_m[1]).contains(&height_m);
    let middle = f64::midpoint(low, high);
    // What is seen of a box is the side towards the lidar, half its depth before
    // its middle.
    let mut along: Vec<f64> =
        hits.iter().map(|h| h.off.dot(&direction) + 0.5 * config.depth_m * h.view.dot(&direction)).collect();
    along.sort_by(f64::total_cmp);
    let before_m = along[along.len() / 2];
    let place = axis.at(middle).coords + direction * before_m + across * f64::midpoint(left, right);
    is_light.then(|| FoundSign {
        kind: SignKind::TrafficLight,
        centroid: Point3::new(place.x, -middle, place.y),
        size_m: Vector2::new(width_m, height_m).push(config.depth_m).norm(),
        points: hits.len(),
        scans: scans.len(),
        facing: Some(direction),
        sigma_m: None,
    })
}

/// The values that all but one in fifty lie between.
fn spread(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let cut = values.len() / 50;
    Some((*values.get(cut)?, *values.get(values.len().checked_sub(1 + cut)?)?))
}
