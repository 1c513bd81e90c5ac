//! Fences: the rails that go out from their posts, and the rows that these make.

use nalgebra::{Point2, Vector2};

use super::axis::Axis;
use super::{FittedPole, PoleConfig};
use crate::cloud::{Cloud, CloudPoint};

/// Directions in which a rail is looked for: every 10 degrees, as wide as the
/// tolerance across it at the far end of its reach.
const DIRECTIONS: usize = 36;
/// Length of the pieces of which a rail must have all but one, metres.
const PIECE_M: f64 = 0.1;
/// Height of the layers in which a rail is looked for, metres: they overlap by
/// half, as a rail may lie across the border of two.
const LAYER_M: f64 = 0.15;
/// The pieces in one of which a rail begins that goes out from a post.
const AT_POST: u32 = 0b11;
/// Largest cosine between the rails to both sides of a post: fences turn at
/// posts, by less than a right angle mostly.
const ON_THE_OTHER_SIDE: f64 = -0.5;

/// Where a point near a pole is, whatever saw it.
#[derive(Clone, Copy)]
pub(super) struct Spot {
    /// Map (x, z), metres.
    pub at_map: Vector2<f64>,
    /// Along -y of the map, metres.
    pub height_m: f64,
    pub above_ground_m: f64,
    pub scan: u16,
}

impl Spot {
    pub fn new(p: &CloudPoint) -> Self {
        let at_map = Vector2::new(p.position.x, p.position.z);
        Self { at_map, height_m: -p.position.y, above_ground_m: f64::from(p.height_m), scan: p.scan }
    }
}

fn ways() -> impl Iterator<Item = Vector2<f64>> {
    (0..DIRECTIONS).map(|k| {
        let angle = k as f64 * std::f64::consts::TAU / DIRECTIONS as f64;
        Vector2::new(angle.cos(), angle.sin())
    })
}

/// Whether it is as low as a fence, and nothing on it was put up for the traffic.
pub(super) fn may_be_of_fence(pole: &FittedPole, config: &PoleConfig) -> bool {
    pole.is_short(config) && !pole.has_sheeting(config)
}

/// The direction, map (x, z), of one of the rails that go out from a post to
/// both sides: hits in one direction and at one height, from its surface on
/// without a gap, and open above or below. What merely stands behind a post
/// begins farther off.
pub(super) fn rail(
    spots: &[Spot],
    axis: &Axis,
    radius_m: f64,
    (low_m, high_m): (f64, f64),
    config: &PoleConfig,
) -> Option<Vector2<f64>> {
    let pieces = (config.rail_m / PIECE_M).round().max(2.0) as usize;
    let from_m = radius_m + config.gap_from_m;
    let (low_m, high_m) = (low_m.max(config.lowest_rail_m), high_m.min(config.short_top_m) + LAYER_M);
    if high_m <= low_m {
        return None;
    }
    let layers = (2.0 * (high_m - low_m) / LAYER_M) as usize + 1;
    let beside: Vec<(Vector2<f64>, usize)> = spots
        .iter()
        .filter(|h| h.above_ground_m >= low_m && h.above_ground_m <= high_m)
        .map(|h| (h.at_map - axis.at(h.height_m), (2.0 * (h.above_ground_m - low_m) / LAYER_M) as usize))
        .filter(|(off, layer)| (from_m..from_m + config.rail_m).contains(&off.norm()) && *layer < layers)
        .collect();
    let ways: Vec<Vector2<f64>> = ways()
        .filter(|way| {
            let mut filled = vec![0_u32; layers + 1];
            for (off, layer) in &beside {
                let along = off.dot(way) - from_m;
                if off.perp(way).abs() < config.rail_half_width_m && along >= 0.0 {
                    let piece = 1 << ((along / PIECE_M) as u32).min(31);
                    filled[*layer] |= piece;
                    filled[layer + 1] |= piece;
                }
            }
            let of_rail = filled.iter().filter(|f| f.count_ones() as usize + 1 >= pieces).count();
            // Open air goes with it: a hedge fills every height.
            of_rail > 0 && 2 * of_rail <= layers
        })
        .collect();
    // To one side only it may be a branch, a bicycle or the edge of a car.
    ways.iter().find(|way| ways.iter().any(|other| way.dot(other) < ON_THE_OTHER_SIDE)).copied()
}

/// Whether a low pole is the last post of a fence: two rails, one above the
/// other, go towards it from one side and end at it or at a gap, and it is as
/// high as they are; or the upper one goes out from its top.
pub(super) fn ends_fence(cloud: &Cloud, pole: &FittedPole, config: &PoleConfig) -> bool {
    if !may_be_of_fence(pole, config) {
        return false;
    }
    let (low_m, high_m) = (config.lowest_rail_m, pole.top_height_m + config.fence_height_m);
    let from_m = pole.radius_m + config.gap_from_m;
    let reach_m = config.fence_gap_m + config.rail_m;
    let layers = (2.0 * (high_m - low_m).max(0.0) / LAYER_M) as usize + 1;
    let rise_m = (pole.foot.y - pole.top.y).max(PIECE_M);
    let at = Point2::new(pole.foot.x, pole.foot.z);
    let cells = (reach_m / cloud.ground.grid().cell_m).ceil() as usize;
    let mut beside: Vec<(u16, usize, Vector2<f64>)> = cloud
        .within_cells(&at, cells)
        .filter(|p| (low_m..high_m).contains(&f64::from(p.height_m)))
        .map(|p| {
            let axis = pole.foot + (pole.top - pole.foot) * ((pole.foot.y - p.position.y) / rise_m);
            let layer = (2.0 * (f64::from(p.height_m) - low_m) / LAYER_M) as usize;
            (p.scan, layer, Vector2::new(p.position.x - axis.x, p.position.z - axis.z))
        })
        .filter(|(_, layer, off)| (from_m..from_m + reach_m).contains(&off.norm()) && *layer < layers)
        .collect();
    beside.sort_by_key(|hit| hit.0);
    ways().any(|way| {
        let seen_by = |of_scan: &[(u16, usize, Vector2<f64>)]| {
            let mut seen = vec![0_u32; layers + 1];
            for (_, layer, off) in of_scan {
                let along = off.dot(&way) - from_m;
                // The way is known to half the angle between two.
                let half_m = config.rail_half_width_m + along * (std::f64::consts::PI / DIRECTIONS as f64);
                if along >= 0.0 && off.perp(&way).abs() < half_m {
                    let piece = 1 << ((along / PIECE_M) as u32).min(31);
                    seen[*layer] |= piece;
                    seen[layer + 1] |= piece;
                }
            }
            seen
        };
        let (once, twice) = witnessed(beside.chunk_by(|a, b| a.0 == b.0).map(seen_by), layers + 1, pole.scans, config);
        rails_above_each_other(&once, &twice, config) >= 2
            || carries_top_rail(&once, &twice, (pole.top_height_m - low_m).max(0.0), config)
    })
}

/// The pieces of each layer that one scan and that two have seen, from those of each scan. What
/// passes by is seen once at each place, its side as rows with gaps between them. Of few beams
/// no two need meet the same pieces: where two scans, and a quarter of those of the post, saw half
/// of a rail each, they saw all of it.
fn witnessed(
    scans: impl Iterator<Item = Vec<u32>>,
    layers: usize,
    scans_of_post: usize,
    config: &PoleConfig,
) -> (Vec<u32>, Vec<u32>) {
    let (mut once, mut twice, mut halves) = (vec![0_u32; layers], vec![0_u32; layers], vec![0_u32; layers]);
    for scan in scans {
        for (((once, twice), halves), seen) in once.iter_mut().zip(&mut twice).zip(&mut halves).zip(scan) {
            *twice |= *once & seen;
            *once |= seen;
            *halves += u32::from(2.0 * PIECE_M * f64::from(seen.count_ones()) >= config.rail_m);
        }
    }
    for ((once, twice), halves) in once.iter().zip(&mut twice).zip(halves) {
        if halves >= 2 && 4 * halves as usize >= scans_of_post {
            *twice = *once;
        }
    }
    (once, twice)
}

/// The rails among the layers of one way, from below: runs of layers with a
/// whole rail that two scans have seen, with one between them that none has.
fn rails_above_each_other(once: &[u32], twice: &[u32], config: &PoleConfig) -> usize {
    let pieces = (config.rail_m / PIECE_M).round().max(2.0) as u32;
    let (mut rails, mut is_open) = (0, true);
    for (once, twice) in once.iter().zip(twice) {
        // A run of so many: each step leaves those that go on for one more.
        let is_rail = (1..pieces).fold(*twice, |run, _| run & (run >> 1)) != 0;
        if is_rail && is_open {
            (rails, is_open) = (rails + 1, false);
        }
        is_open |= once.count_ones() <= 1;
    }
    rails
}

/// Whether the upper rail of a fence goes out from the top of its post, `rise_m` over the lowest
/// layer: twice as long a rail as others need, with twice the gaps, that two scans have seen, from
/// the post on, and open below. Its lower rail may lie in grass. Crash barriers are lower than the
/// delineators on them.
fn carries_top_rail(once: &[u32], twice: &[u32], rise_m: f64, config: &PoleConfig) -> bool {
    let pieces = (2.0 * (config.rail_m / PIECE_M).round()).clamp(4.0, 31.0) as u32;
    let of_rail = |seen: &u32| (seen & ((1 << pieces) - 1)).count_ones();
    let begins = |seen: &u32| seen & AT_POST != 0;
    // The post ends in one layer; the rail may be in the one below or above.
    let below = ((2.0 * rise_m / LAYER_M) as usize).saturating_sub(1);
    let mut at_top = twice.iter().skip(below).take(3);
    at_top.any(|seen| begins(seen) && of_rail(seen) + 2 >= pieces)
        && once.iter().take(below).any(|seen| of_rail(seen) <= 1)
}

/// Which of the poles stand in a fence: low ones with a rail, and those in line
/// with a rail that are as high as its post. The ends of a row and the sides of
/// a gap may show no rail of their own.
pub(super) fn in_fences(poles: &[&FittedPole], config: &PoleConfig) -> Vec<bool> {
    let is_low = |p: &FittedPole| may_be_of_fence(p, config);
    let mut rails: Vec<Option<Vector2<f64>>> = poles.iter().map(|p| p.rail.filter(|_| is_low(p))).collect();
    let mut open: Vec<(usize, Vector2<f64>)> = (0..).zip(&rails).filter_map(|(i, r)| Some((i, (*r)?))).collect();
    while let Some((from, way)) = open.pop() {
        for (i, pole) in poles.iter().enumerate() {
            let off = pole.foot - poles[from].foot;
            let off = Vector2::new(off.x, off.z);
            let as_high = (pole.top_height_m - poles[from].top_height_m).abs() < config.fence_height_m;
            let in_line = off.perp(&way).abs() < config.fence_off_line_m && off.norm() < config.fence_span_m;
            if rails[i].is_none() && is_low(pole) && as_high && in_line {
                rails[i] = Some(way);
                open.push((i, way));
            }
        }
    }
    rails.iter().map(Option::is_some).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_scans_that_saw_half_of_a_rail_each_saw_all_of_it() {
        let twice = |scans: &[u32], scans_of_post: usize| {
            witnessed(scans.iter().map(|scan| vec![*scan]), 1, scans_of_post, &PoleConfig::default()).1[0]
        };
        assert_eq!(twice(&[0b1_0101, 0b0_1110], 8), 0b1_1111);
        // Two that pass by what is seen all along, one, and a stray of another.
        assert_eq!(twice(&[0b1_0101, 0b0_1110], 9), 0b0_0100);
        assert_eq!(twice(&[0b1_1111, 0b0_0100], 8), 0b0_0100);
        assert_eq!(twice(&[0b1_1111], 1), 0);
    }

    #[test]
    fn an_upper_rail_goes_out_from_the_top_of_its_post_and_is_open_below() {
        const WHOLE: u32 = 0b11_1111_1111;
        // Ten layers, half of 0.15 m apart: a post that ends in the eighth.
        let carries = |rails: &[(usize, u32)]| {
            let mut seen = vec![0_u32; 11];
            for &(layer, pieces) in rails {
                seen[layer] = pieces;
            }
            carries_top_rail(&seen, &seen, 0.6, &PoleConfig::default())
        };
        assert!(carries(&[(7, WHOLE)]) && carries(&[(8, WHOLE & !0b1_0000)]));
        // A crash barrier below the top of a delineator, what begins beside it, what is short,
        // and a hedge.
        assert!(!carries(&[(4, WHOLE)]) && !carries(&[(7, WHOLE << 3)]) && !carries(&[(7, 0b1_1111)]));
        let hedge: Vec<(usize, u32)> = (0..9).map(|layer| (layer, WHOLE)).collect();
        assert!(!carries(&hedge));
    }
}
