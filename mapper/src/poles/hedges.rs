//! Posts in hedges. A hedge touches a post in every slice, as a wall does a pipe, but it
//! is thick where a wall is thin, and lets most beams through where a post ends them.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::axis::Axis;
use super::fences::Spot;
use super::{FittedPole, PoleConfig};
use crate::cloud::CloudPoint;
use crate::quantile::quantile;

/// How posts in hedges are told from walls, leaves and trees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HedgeConfig {
    /// Share of the space around a pole, `crown_radii_m` from it but at its own heights, from
    /// which on it is filled by a hedge: these fill 0.2 to 0.4 of it, and walls, their corners
    /// and vehicles 0.05 to 0.15.
    pub least_share: f64,
    /// A post has so many times as many hits per area, seen from above, as the hedge around it,
    /// in three of four slices: trunks that branch out and edges of walls do in fewer.
    pub stands_out: f64,
    /// Least share of the beams towards it that it ends: it stands in front.
    pub least_visibility: f64,
    /// Largest radius of such a post, metres: masts of lamps are 90 to 180 mm across and are
    /// measured to 1 cm, and stems in hedges that are thicker are trees.
    pub thickest_m: f64,
    /// What fills the space over it by less than this share of what its hedge fills beside it
    /// is the top of the hedge and no crown: crowns are fuller than what grows around stems.
    pub least_crown: f64,
}

impl Default for HedgeConfig {
    fn default() -> Self {
        Self { least_share: 0.18, stands_out: 5.0, least_visibility: 0.8, thickest_m: 0.1, least_crown: 0.5 }
    }
}

impl FittedPole {
    /// Whether a hedge is around it.
    pub(super) fn is_in_hedge(&self, config: &PoleConfig) -> bool {
        self.hedge_share >= config.hedges.least_share
    }

    /// Whether it is a post, or as narrow as one, in a hedge, and no part of it.
    pub(super) fn stands_out_of_hedge(&self, config: &PoleConfig) -> bool {
        self.is_in_hedge(config)
            && self.stands_out >= config.hedges.stands_out
            && self.visibility >= config.hedges.least_visibility
            && self.radius_m <= config.hedges.thickest_m
    }
}

/// What is around an axis.
pub(super) struct Around<'a> {
    pub points: &'a [CloudPoint],
    pub axis: &'a Axis,
    /// Radius of the pole, metres.
    pub radius_m: f64,
    /// Heights of the ends of what is seen of it, metres above ground.
    pub ends_m: (f64, f64),
}

impl Around<'_> {
    /// The points beside the pole: how far off its axis each is, map (x, z), and its height
    /// above ground, metres.
    fn beside(&self) -> impl Iterator<Item = (Vector2<f64>, f64)> {
        self.points
            .iter()
            .map(Spot::new)
            .map(|spot| (spot.at_map - self.axis.at(spot.height_m), spot.above_ground_m))
            .filter(|(_, above_ground_m)| (self.ends_m.0..=self.ends_m.1).contains(above_ground_m))
    }

    /// Share of the cells that are filled where it would have a crown, but at its own heights,
    /// up to those of hedges: cells as large as the slices of columns.
    pub fn hedge_share(&self, config: &PoleConfig) -> f64 {
        let [near_m, far_m] = config.crown_radii_m;
        let (cell_m, slice_m) = (config.column_m, config.slice_m);
        let cell = |m: f64, edge_m: f64| (m / edge_m).floor() as i64;
        let low = cell(self.ends_m.0.max(FROM_M), slice_m);
        let high = cell(self.ends_m.1.min(config.hedge_top_m), slice_m);
        let mut filled: Vec<(i64, i64, i64)> = self
            .beside()
            .filter(|(off, _)| (near_m.powi(2)..far_m.powi(2)).contains(&off.norm_squared()))
            .map(|(off, above_ground_m)| (cell(off.x, cell_m), cell(off.y, cell_m), cell(above_ground_m, slice_m)))
            .filter(|(_, _, slice)| (low..=high).contains(slice))
            .collect();
        filled.sort_unstable();
        filled.dedup();
        let cells = std::f64::consts::PI * (far_m.powi(2) - near_m.powi(2)) / cell_m.powi(2);
        filled.len() as f64 / (cells * (high - low + 1).max(1) as f64)
    }

    /// How many times as many hits per area are on it as around it, seen from above, in three of
    /// four slices.
    pub fn stands_out(&self, config: &PoleConfig) -> f64 {
        let own_m = self.radius_m + config.gap_from_m / 2.0;
        let (from_m, to_m) = (self.radius_m + config.gap_from_m, config.ring_outer_m);
        let slice = |above_ground_m: f64| ((above_ground_m - self.ends_m.0) / config.slice_m) as usize;
        let mut hits = vec![(0.0, 0.0); slice(self.ends_m.1) + 1];
        for (off, above_ground_m) in self.beside() {
            let (own, around) = &mut hits[slice(above_ground_m)];
            let off_m = off.norm();
            if off_m < own_m {
                *own += 1.0;
            } else if (from_m..to_m).contains(&off_m) {
                *around += 1.0;
            }
        }
        let areas = (to_m.powi(2) - from_m.powi(2)) / own_m.powi(2);
        // One more around it, as none may be.
        let times = |(own, around): &(f64, f64)| own / (around + 1.0) * areas;
        let mut times: Vec<f64> = hits.iter().filter(|(own, around)| own + around >= FEWEST).map(times).collect();
        quantile(&mut times, 0.25).unwrap_or(0.0)
    }
}

/// Hedges are looked for from this height above ground on, metres: below it is grass.
const FROM_M: f64 = 0.5;

/// Fewest hits in a slice that tell how many there are per area.
const FEWEST: f64 = 5.0;

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// Points that stand at `places` (x, z) around an axis, every 5 cm up to 2 m.
    fn points(places: &[Vector2<f64>]) -> Vec<CloudPoint> {
        let heights = (0..40).map(|k| 0.05 * f64::from(k));
        heights
            .flat_map(|height_m| places.iter().map(move |at| (at, height_m)))
            .map(|(at, height_m)| CloudPoint {
                position: Point3::new(at.x, -height_m, at.y),
                height_m: height_m as f32,
                reflectance: 0.3,
                range_m: 8.0,
                contrast: None,
                scan: 0,
            })
            .collect()
    }

    /// How far a hedge fills the space around, and how a post of 4 cm stands out.
    fn of(places: &[Vector2<f64>]) -> (f64, f64) {
        let axis = Axis::new(Vector2::zeros(), Vector2::zeros());
        let around = Around { points: &points(places), axis: &axis, radius_m: 0.04, ends_m: (0.0, 1.99) };
        let config = PoleConfig::default();
        (around.hedge_share(&config), around.stands_out(&config))
    }

    /// Places over an area, in no order.
    fn leaves(count: u32, from: Vector2<f64>, size: Vector2<f64>) -> Vec<Vector2<f64>> {
        let share = |k: u32, step: f64| (f64::from(k) * step).fract();
        (0..count).map(|k| from + Vector2::new(size.x * share(k, 0.754_878), size.y * share(k, 0.569_84))).collect()
    }

    #[test]
    fn a_hedge_fills_the_space_around_and_a_wall_and_its_corner_do_not() {
        let config = HedgeConfig::default();
        let hedge = leaves(150, Vector2::new(-1.2, -0.4), Vector2::new(2.4, 0.8));
        assert!(of(&hedge).0 > config.least_share, "{:?}", of(&hedge));
        let wall = leaves(150, Vector2::new(-1.2, 0.1), Vector2::new(2.4, 0.03));
        let corner: Vec<Vector2<f64>> =
            wall.iter().copied().chain(leaves(75, Vector2::new(0.1, 0.1), Vector2::new(0.03, 1.2))).collect();
        assert!(of(&wall).0 < of(&corner).0 && of(&corner).0 < config.least_share, "{:?} {:?}", of(&wall), of(&corner));
    }

    #[test]
    fn a_post_stands_out_of_leaves_and_leaves_alone_do_not() {
        let hedge = leaves(150, Vector2::new(-1.2, -0.4), Vector2::new(2.4, 0.8));
        let with_post: Vec<Vector2<f64>> =
            hedge.iter().copied().chain(leaves(12, Vector2::new(-0.04, -0.04), Vector2::new(0.08, 0.0))).collect();
        let least = HedgeConfig::default().stands_out;
        assert!(of(&with_post).1 > least && of(&hedge).1 < 0.5 * least, "{:?} {:?}", of(&with_post), of(&hedge));
    }

    #[test]
    fn nothing_around_is_no_hedge() {
        assert_eq!(of(&[]), (0.0, 0.0));
    }
}
