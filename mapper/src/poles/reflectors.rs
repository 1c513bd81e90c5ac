//! Places where posts are looked for because something on them reflects: a hedge or a
//! fence may stand close behind, and shape alone does not tell them from it.

use std::ops::RangeInclusive;

use nalgebra::Point2;

use super::{PoleConfig, Stack};
use crate::cloud::{Cloud, CloudPoint};
use crate::lidar::SheetingConfig;
use crate::signs::clusters;

/// Places under small reflectors at the height of those of delineators.
pub(super) fn under_reflectors(cloud: &Cloud, config: &PoleConfig, sheeting: &SheetingConfig) -> Vec<Stack> {
    let [low_m, high_m] = config.reflector_m;
    reflectors(cloud, config.least_reflectance, low_m..=high_m, config, sheeting)
        .into_iter()
        .filter(|r| r.width_m <= config.widest_reflector_m)
        .map(|r| Stack::under_reflector(r.centre, r.high_m, config))
        .collect()
}

/// Places under retro-reflective plates: signs are mounted in the middle.
pub(super) fn under_sheets(cloud: &Cloud, config: &PoleConfig, sheeting: &SheetingConfig) -> Vec<Stack> {
    let [low_m, high_m] = config.sheet_m;
    reflectors(cloud, config.sheeting_reflectance, low_m..=high_m, config, sheeting)
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
    sheeting: &SheetingConfig,
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
            let found = Reflector {
                centre: Point2::new(f64::midpoint(low_x, high_x), f64::midpoint(low_z, high_z)),
                width_m: 2.0 * (high_x - low_x).hypot(high_z - low_z),
                low_m: heights_m.clone().fold(f64::INFINITY, f64::min),
                high_m: heights_m.fold(f64::NEG_INFINITY, f64::max),
            };
            let is_there = |p: &CloudPoint| {
                (low_x..=high_x).contains(&p.position.x)
                    && (low_z..=high_z).contains(&p.position.z)
                    && (found.low_m..=found.high_m).contains(&f64::from(p.height_m))
            };
            sheeting.is_steady(&cloud.glances(&found.centre, is_there), least_reflectance).then_some(found)
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

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::testing::{CAMERA_HEIGHT_M, Street};

    /// Places under what is half a metre square on a house front and so bright in each
    /// scan that sees it.
    fn places(reflectance: impl Fn(u16) -> f32) -> usize {
        let mut street = Street::new();
        for scan in 0..10 {
            for (i, k) in (0..6).flat_map(|i| (0..6).map(move |k| (i, k))) {
                let up_m = 1.5 + 0.1 * f64::from(k);
                let place = Point3::new(9.0, CAMERA_HEIGHT_M - up_m, 28.0 + 0.1 * f64::from(i));
                street.add(place, scan, reflectance(scan), None);
            }
        }
        under_sheets(&street.cloud(), &PoleConfig::default(), &SheetingConfig::default()).len()
    }

    #[test]
    fn posts_are_looked_for_under_sheeting_and_not_under_panes_that_glint() {
        assert_eq!(places(|_| 0.98), 1);
        assert_eq!(places(|scan| if scan == 4 { 0.98 } else { 0.1 }), 0);
    }
}
