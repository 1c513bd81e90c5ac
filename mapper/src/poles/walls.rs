//! Walls: what stands between the windows of a front looks free.

use nalgebra::{Matrix2, SymmetricEigen, Vector2};
use serde::{Deserialize, Serialize};

use super::PoleConfig;
use super::axis::Axis;
use super::fences::Spot;

/// How pieces of walls are told from posts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WallConfig {
    /// Largest share of its slices in which something reaches outwards from what is attached
    /// above hedges, or stands close before something and is no slender post: pipes and jambs
    /// are part of their wall in every slice that is seen well.
    pub largest_attached_share: f64,
    /// What was hit from this far off and farther only, metres, and has a wall below it, is a
    /// piece of that between windows; nearer to the road, posts stand in line with the walls of
    /// gardens.
    pub from_m: f64,
    /// How far the hits on a wall lie off its plane, metres, root mean square: noise of
    /// range and lasers. Hedges are three times as rough.
    pub spread_m: f64,
    /// Its plane goes past no farther off the axis than this, metres.
    pub off_m: f64,
    /// It goes on to both sides by at least this, metres: more than any stem is wide.
    pub reach_m: f64,
}

impl Default for WallConfig {
    fn default() -> Self {
        Self { largest_attached_share: 0.25, from_m: 15.0, spread_m: 0.06, off_m: 0.25, reach_m: 0.4 }
    }
}

/// Whether a wall of at most that height goes past an axis: hits above grass that lie in one
/// vertical plane close to it, and go on to both sides. A hedge is rougher, and what hangs on a
/// post ends.
pub(super) fn stands_on_wall(spots: &[Spot], axis: &Axis, top_m: f64, config: &PoleConfig) -> bool {
    let below: Vec<Vector2<f64>> = spots
        .iter()
        .filter(|s| s.above_ground_m >= config.lowest_rail_m && s.above_ground_m < top_m)
        .map(|s| s.at_map - axis.at(s.height_m))
        .collect();
    if below.len() < config.fewest_points {
        return false;
    }
    let count = below.len() as f64;
    let mean = below.iter().sum::<Vector2<f64>>() / count;
    let scatter = below.iter().map(|off| (off - mean) * (off - mean).transpose()).sum::<Matrix2<f64>>() / count;
    let plane = SymmetricEigen::new(scatter);
    let across = plane.eigenvectors.column(plane.eigenvalues.imin()).into_owned();
    let along = |off: &Vector2<f64>| off.perp(&across);
    plane.eigenvalues.min().max(0.0).sqrt() <= config.walls.spread_m
        && mean.dot(&across).abs() <= config.walls.off_m
        && [1.0, -1.0].iter().all(|side| below.iter().any(|off| side * along(off) >= config.walls.reach_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Spots between two heights, so far to the sides, with so much depth.
    fn spots((low_m, high_m): (f64, f64), (from_m, to_m): (f64, f64), depth_m: f64) -> Vec<Spot> {
        (0..40)
            .map(|i| {
                let share = f64::from(i) / 39.0;
                // Any value in -1..1.
                let noise = (2.3 * f64::from(i)).sin();
                let height = low_m + (high_m - low_m) * (0.5 + 0.5 * (12.9 * f64::from(i)).sin());
                let at_map = Vector2::new(3.0 + from_m + (to_m - from_m) * share, 20.0 + depth_m * noise);
                Spot { at_map, height_m: height, above_ground_m: height, scan: 0 }
            })
            .collect()
    }

    #[test]
    fn a_wall_is_thin_and_goes_on_to_both_sides_below_what_looks_free() {
        let on_wall = |spots: &[Spot]| {
            let axis = Axis::new(Vector2::new(3.0, 20.0), Vector2::zeros());
            stands_on_wall(spots, &axis, 1.2, &PoleConfig::default())
        };
        assert!(on_wall(&spots((0.4, 1.2), (-0.6, 0.6), 0.03)));
        // A hedge, a wall that ends there, what hangs on a stem, what stands 0.5 m behind,
        // what is above, and no more than two hits.
        assert!(!on_wall(&spots((0.4, 1.2), (-0.6, 0.6), 0.2)));
        assert!(!on_wall(&spots((0.4, 1.2), (-0.1, 0.6), 0.03)));
        assert!(!on_wall(&spots((0.4, 1.2), (-0.3, 0.3), 0.03)));
        let behind: Vec<Spot> = spots((0.4, 1.2), (-0.6, 0.6), 0.03)
            .into_iter()
            .map(|spot| Spot { at_map: spot.at_map + Vector2::y() * 0.5, ..spot })
            .collect();
        assert!(!on_wall(&behind));
        assert!(!on_wall(&spots((1.3, 2.0), (-0.6, 0.6), 0.03)));
        let wall = spots((0.4, 1.2), (-0.6, 0.6), 0.03);
        assert!(!on_wall(&[wall[0], wall[39]]));
    }
}
