//! Places where posts are looked for because something on them reflects: a hedge or a
//! fence may stand close behind, and shape alone does not tell them from it.

use std::ops::RangeInclusive;

use nalgebra::Point2;

use super::{PoleConfig, Stack};
use crate::cloud::{Cloud, CloudPoint};
use crate::signs::clusters;

/// Places under small reflectors at the height of those of delineators.
pub(super) fn under_reflectors(cloud: &Cloud, config: &PoleConfig) -> Vec<Stack> {
    let [low_m, high_m] = config.reflector_m;
    reflectors(cloud, config.least_reflectance, low_m..=high_m, config)
        .into_iter()
        .filter(|r| r.width_m <= config.widest_reflector_m)
        .map(|r| Stack::under_reflector(r.centre, r.high_m, config))
        .collect()
}

/// Places under retro-reflective plates: signs are mounted in the middle.
pub(super) fn under_sheets(cloud: &Cloud, config: &PoleConfig) -> Vec<Stack> {
    reflectors(cloud, config.sheeting_reflectance, config.sheet_m[0]..=config.sheet_m[1], config)
        .into_iter()
        .filter(|r| r.width_m <= config.widest_sheet_m)
        .filter_map(|r| Stack::under_sheet(r.centre, r.low_m, r.high_m, config))
        .collect()
}

/// Bright points that lie together.
struct Reflector {
    /// Middle, map (x, z), metres.
    centre: Point2<f64>,
    /// Extent along the ground, metres.
    width_m: f64,
    /// Lower edge, metres above ground.
    low_m: f64,
    /// Upper edge, metres above ground.
    high_m: f64,
}

fn reflectors(
    cloud: &Cloud,
    least_reflectance: f32,
    heights_m: RangeInclusive<f64>,
    config: &PoleConfig,
) -> Vec<Reflector> {
    let bright: Vec<&CloudPoint> = cloud
        .points
        .iter()
        .filter(|p| p.reflectance >= least_reflectance && heights_m.contains(&f64::from(p.height_m)))
        .collect();
    clusters(&bright, config.core_radius_m)
        .iter()
        .filter(|cluster| cluster.len() >= config.fewest_points / 2)
        .filter_map(|cluster| {
            let (low_x, high_x) = middle_half(cluster, |p| p.position.x)?;
            let (low_z, high_z) = middle_half(cluster, |p| p.position.z)?;
            let heights_m = cluster.iter().map(|p| f64::from(p.height_m));
            Some(Reflector {
                centre: Point2::new(f64::midpoint(low_x, high_x), f64::midpoint(low_z, high_z)),
                width_m: 2.0 * (high_x - low_x).hypot(high_z - low_z),
                low_m: heights_m.clone().fold(f64::INFINITY, f64::min),
                high_m: heights_m.fold(f64::NEG_INFINITY, f64::max),
            })
        })
        .collect()
}

/// Between which values the middle half of the points lie, on a plate over half of
/// its width: a reflector dazzles, and some of its echoes come from beside it.
fn middle_half(points: &[&CloudPoint], value: impl Fn(&CloudPoint) -> f64) -> Option<(f64, f64)> {
    let mut values: Vec<f64> = points.iter().map(|p| value(p)).collect();
    values.sort_by(f64::total_cmp);
    let off = values.len() / 4;
    Some((*values.get(off)?, *values.get(values.len() - 1 - off)?))
}
