//! Traffic lights: dark boxes that hang on a post.

use std::ops::Range;

use common::map::SignKind;
use nalgebra::{Matrix2, Point2, Point3, Vector2};

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
    height_m: f64,
    above_ground_m: f64,
    is_dark: bool,
    scan: u16,
    /// Whether its row is wider than that of a bare post.
    is_of_wide: bool,
    /// What it counts: as much at each height, however many hits are there.
    weight: f64,
}

/// The traffic lights among the rows of a post, from above: one for those who
/// drive, and a lower one for those who walk.
pub fn lights_on(rows: &[Row], axis: &Axis, config: &SignConfig) -> Vec<FoundSign> {
    let post_m = (2.0 * axis.radius_m + config.outline.slack_m).max(config.outline.narrowest_m);
    let axis = bare(axis, rows, &config.outline);
    let lights = &config.lights;
    let mut beside: Vec<Beside> = rows
        .iter()
        .filter(|r| r.above_ground_m >= lights.lowest_m)
        // What reaches farther is no box.
        .filter(|r| r.span_m.0.abs().max(r.span_m.1.abs()) <= lights.reach_m && r.range_m <= lights.farthest_m)
        .flat_map(|r| hits_beside(r, &axis, post_m, lights))
        .collect();
    beside.sort_by(|a, b| a.height_m.total_cmp(&b.height_m).then(a.scan.cmp(&b.scan)));
    lights_beside(&beside, &axis, lights)
}

/// The lights among hits beside a post, sorted by height, from above.
fn lights_beside(beside: &[Beside], axis: &Axis, lights: &LightConfig) -> Vec<FoundSign> {
    let mut found = Vec::new();
    for level in dark_runs(beside, lights).into_iter().rev() {
        let is_below = !found.is_empty();
        found.extend(lights_among(&beside[level], is_below, axis, lights));
    }
    found
}

/// What a hit says for a housing, in dark hits: nothing where as many are dark as must be.
fn dark_gain(hit: &Beside, lights: &LightConfig) -> f64 {
    if hit.is_dark { 1.0 } else { -lights.least_dark_share / (1.0 - lights.least_dark_share) }
}

/// One or two lights among hits of which most are dark, sorted by height.
fn lights_among(level: &[Beside], is_below: bool, axis: &Axis, lights: &LightConfig) -> Vec<FoundSign> {
    let mut dark: Vec<Beside> = level.iter().copied().filter(|h| h.is_dark).collect();
    count_heights_alike(&mut dark);
    let [two_lenses_m, three_lenses_m] = lights.usual_heights_m;
    let Some(of_upper) = evidence_of_upper(&dark, lights) else {
        let usual_m = if is_below { two_lenses_m } else { three_lenses_m };
        return light(&dark, level, axis, usual_m, lights).into_iter().collect();
    };
    [(1.0, three_lenses_m), (-1.0, two_lenses_m)]
        .into_iter()
        .filter_map(|(side, usual_m)| {
            // Two heads hang on two sides of their post, and one begins before the other ends.
            let own = |i: usize| side * of_upper[i];
            let gains: Vec<f64> = (0..dark.len()).map(|i| gain_of_own(own(i), lights.own_share)).collect();
            let of_head = best_run(&dark, &gains, lights)?;
            let hits: Vec<Beside> = of_head.filter(|i| own(*i) > 0.0).map(|i| dark[i]).collect();
            light(&hits, level, axis, usual_m, lights)
        })
        .collect()
}

/// The hits of a row that are not its post's; `post_m` is how wide rows of that are.
fn hits_beside<'a>(
    row: &'a Row,
    axis: &'a Axis,
    post_m: f64,
    config: &'a LightConfig,
) -> impl Iterator<Item = Beside> + 'a {
    row.hits.iter().filter_map(move |(p, reflectance)| {
        let off = Point2::new(p.x, p.z) - axis.at(-p.y);
        (off.norm() > axis.radius_m + config.off_post_m).then(|| Beside {
            middle: off + row.view * (0.5 * config.depth_m),
            height_m: -p.y,
            above_ground_m: row.above_ground_m,
            is_dark: *reflectance <= config.darkest,
            scan: row.scan,
            is_of_wide: row.width_m() > post_m,
            weight: 1.0,
        })
    })
}

/// The runs of hits, sorted by height, that are dark most of all, and then those below
/// and above them, from below.
fn dark_runs(sorted: &[Beside], config: &LightConfig) -> Vec<Range<usize>> {
    let gains: Vec<f64> = sorted.iter().map(|hit| dark_gain(hit, config)).collect();
    let mut found = Vec::new();
    let mut open: Vec<Range<usize>> = std::iter::once(0..sorted.len()).collect();
    while let Some(within) = open.pop() {
        let Some(best) = best_run(&sorted[within.clone()], &gains[within.clone()], config) else { continue };
        let best = within.start + best.start..within.start + best.end;
        if best.len() >= config.fewest_hits {
            open.extend([within.start..best.start, best.end..within.end]);
            found.push(best);
        }
    }
    found.sort_by_key(|run| run.start);
    found
}

/// The run without a gap, of hits sorted by height, that gains most.
fn best_run(sorted: &[Beside], gains: &[f64], config: &LightConfig) -> Option<Range<usize>> {
    let (mut best, mut best_sum) = (None, 0.0);
    let (mut start, mut sum) = (0, 0.0);
    for (i, (hit, gain)) in sorted.iter().zip(gains).enumerate() {
        let is_apart = i > 0 && hit.height_m - sorted[i - 1].height_m > config.longest_gap_m;
        if sum <= 0.0 || is_apart {
            (start, sum) = (i, 0.0);
        }
        sum += gain;
        if sum > best_sum {
            (best, best_sum) = (Some(start..i + 1), sum);
        }
    }
    best
}

/// What a hit says for a box at its height that this share of the hits there are
/// of, against none: `own` is the evidence that it is of that box and not of the
/// other one, the natural logarithm of their odds.
fn gain_of_own(own: f64, share: f64) -> f64 {
    (1.0 - share + share * own.exp()).ln()
}

/// Weighs hits, sorted by height, by how many others are at their height: those
/// who drive by see much more of a lower edge than of what is above it.
fn count_heights_alike(sorted: &mut [Beside]) {
    let heights: Vec<f64> = sorted.iter().map(|h| h.height_m).collect();
    for hit in sorted {
        let from = heights.partition_point(|h| *h < hit.height_m - LEVEL_M);
        let to = heights.partition_point(|h| *h <= hit.height_m + LEVEL_M);
        hit.weight = ((to - from) as f64).recip();
    }
}

/// Hits so near in height are at one, metres: the heights of beams differ by more.
const LEVEL_M: f64 = 0.03;

fn weight(hits: &[Beside]) -> f64 {
    hits.iter().map(|h| h.weight).sum()
}

fn mean(hits: &[Beside]) -> Vector2<f64> {
    hits.iter().map(|h| h.weight * h.middle).sum::<Vector2<f64>>() / weight(hits).max(f64::MIN_POSITIVE)
}

/// The scatter of the middles about their mean, m^2, times the weight of the hits.
fn scatter(hits: &[Beside]) -> Matrix2<f64> {
    let mean = mean(hits);
    hits.iter().map(|h| h.weight * (h.middle - mean) * (h.middle - mean).transpose()).sum()
}

/// Evidence that each of the hits on dark boxes, sorted by height, is of the upper
/// of two and not of the lower one (natural logarithm of the odds); none where
/// there is one box only. Where they overlap in height their sides of the post
/// tell: middles scatter along the faces that are seen more than across them, as
/// much on both (Fisher's discriminant).
fn evidence_of_upper(sorted: &[Beside], config: &LightConfig) -> Option<Vec<f64>> {
    let (below, above) = sorted.split_at(parting(sorted, config)?);
    let noise = Matrix2::identity() * config.middle_sigma_m.powi(2);
    let covariance = (scatter(below) + scatter(above)) / weight(sorted) + noise;
    let (below, above) = (mean(below), mean(above));
    let (toward_upper, border) = (covariance.try_inverse()? * (above - below), (above + below) / 2.0);
    let most = config.most_own_odds.ln();
    Some(sorted.iter().map(|h| toward_upper.dot(&(h.middle - border)).clamp(-most, most)).collect())
}

/// Where hits that are sorted by height part into two boxes on different sides
/// of the post: the split that explains most of their scatter; none where there
/// is one box only.
fn parting(sorted: &[Beside], config: &LightConfig) -> Option<usize> {
    let fewest = config.fewest_hits_of_two;
    let apart = |i: usize| (mean(&sorted[..i]) - mean(&sorted[i..])).norm();
    let explained = |i: usize| weight(&sorted[..i]) * weight(&sorted[i..]) * apart(i).powi(2);
    (fewest..(sorted.len() + 1).saturating_sub(fewest))
        .max_by(|a, b| explained(*a).total_cmp(&explained(*b)))
        .filter(|i| apart(*i) >= config.apart_m)
}

/// The light whose housing has these hits; `usual_m` is how high it is mostly.
fn light(hits: &[Beside], all: &[Beside], axis: &Axis, usual_m: f64, lights: &LightConfig) -> Option<FoundSign> {
    let mut scans: Vec<u16> = hits.iter().map(|h| h.scan).collect();
    scans.sort_unstable();
    scans.dedup();
    let (low, high) = spread(hits.iter().map(|h| h.height_m))?;
    let (lowest, _) = spread(hits.iter().map(|h| h.above_ground_m))?;
    let (left, right) = spread(hits.iter().map(|h| h.middle.x))?;
    let (near, far) = spread(hits.iter().map(|h| h.middle.y))?;
    let width_m = (right - left).max(far - near);
    let level = all.iter().filter(|h| h.height_m >= low && h.height_m <= high);
    let dark_hits = level.clone().filter(|h| h.is_dark).count() as f64;
    let dark = dark_hits / level.clone().count().max(1) as f64;
    let off = mean(hits);
    // What reaches from a bare post is noise, and what is nearer to its axis than to the
    // box is its own.
    let is_of_box = |h: &&Beside| (h.middle - off).norm_squared() < h.middle.norm_squared();
    let of_box = level.filter(|h| h.is_of_wide || !h.is_dark).filter(is_of_box);
    let evidence: f64 = of_box.map(|h| dark_gain(h, lights)).sum();
    let is_light = evidence >= lights.fewest_hits as f64
        && scans.len() >= lights.fewest_scans
        && dark >= lights.least_dark_share
        && lowest >= lights.lowest_m
        && (lights.width_m[0]..=lights.width_m[1]).contains(&width_m)
        && (lights.seen_m[0]..=lights.seen_m[1]).contains(&(high - low));
    // Upper edges are mostly above what the lidar sees.
    let height_m = usual_m.max(high - low);
    let height = low + 0.5 * height_m;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Hits on a box around this place between two heights, so many per metre of
    /// height: in turn a hand to the left and to the right of its middle.
    fn hits(at: (f64, f64), (low, high): (f64, f64), per_m: f64, is_dark: bool) -> Vec<Beside> {
        let count = ((high - low) * per_m) as u16;
        (0..count)
            .map(|i| {
                let side = [-0.1, -0.03, 0.04, 0.1][usize::from(i % 4)];
                let height = low + (high - low) * (f64::from(i) + 0.5) / f64::from(count);
                let middle = Vector2::new(at.0 + side, at.1 + 0.1 * side);
                Beside {
                    middle,
                    height_m: height,
                    above_ground_m: height,
                    is_dark,
                    scan: i % 7,
                    is_of_wide: true,
                    weight: 1.0,
                }
            })
            .collect()
    }

    fn lights(mut beside: Vec<Beside>) -> Vec<FoundSign> {
        beside.sort_by(|a, b| a.height_m.total_cmp(&b.height_m));
        let axis = Axis::through(&Point3::new(0.0, -2.0, 0.0), 0.05);
        lights_beside(&beside, &axis, &LightConfig::default())
    }

    #[test]
    fn a_head_begins_where_another_one_before_it_hides_most_of_it() {
        let lower = [hits((0.0, -0.18), (2.0, 2.6), 200.0, true), hits((0.0, -0.18), (2.0, 2.05), 4000.0, true)];
        let upper = [hits((0.2, 0.0), (2.35, 2.6), 60.0, true), hits((0.2, 0.0), (2.6, 3.0), 120.0, true)];
        let found = lights([lower, upper].concat().concat());
        let [upper, lower] = &found[..] else { panic!("{found:?}") };
        assert!((-lower.centroid.y - 2.3).abs() < 0.05 && (-upper.centroid.y - 2.8).abs() < 0.07, "{found:?}");
        assert!((upper.centroid.x - 0.2).abs() < 0.03 && (lower.centroid.z + 0.18).abs() < 0.03, "{found:?}");
    }

    #[test]
    fn what_shows_of_the_mast_beside_its_light_is_no_part_of_that() {
        let seen = |other: (f64, f64)| {
            let heights_m = (2.4, 2.8);
            lights([hits((0.0, -0.2), heights_m, 60.0, true), hits(other, heights_m, 20.0, false)].concat()).len()
        };
        // As much at the place of the box would be a part of something else.
        assert_eq!((seen((0.0, 0.02)), seen((0.0, -0.2))), (1, 0));
    }

    #[test]
    fn what_is_dark_below_a_light_hides_no_light() {
        let below = hits((0.1, 0.0), (1.85, 1.9), 2000.0, true);
        let post = hits((0.0, 0.0), (1.9, 2.5), 100.0, false);
        let light = hits((0.0, -0.18), (2.5, 2.9), 100.0, true);
        let found = lights([below, post, light].concat());
        let [light] = &found[..] else { panic!("{found:?}") };
        assert!((-light.centroid.y - 2.95).abs() < 0.05, "{light:?}");
    }

    #[test]
    fn few_hits_are_a_light_where_all_are_dark() {
        let seen = |dark: f64, other: f64| {
            let heights_m = (2.2, 2.4);
            let other = hits((0.2, 0.0), heights_m, other, false);
            lights([hits((0.2, 0.0), heights_m, dark, true), other].concat()).len()
        };
        assert_eq!((seen(60.0, 0.0), seen(30.0, 0.0), seen(60.0, 15.0)), (1, 0, 0));
        // Those of a post are no wider than it.
        let of_post = hits((0.2, 0.0), (2.2, 2.4), 60.0, true).into_iter().map(|h| Beside { is_of_wide: false, ..h });
        assert!(lights(of_post.collect()).is_empty());
    }
}
