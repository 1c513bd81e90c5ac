//! Retro-reflective sheeting, told from white walls and from glints on glass.
//!
//! Sheeting sends light back to where it comes from, whatever side that is: the
//! lidar saturates on it from one place as from the next. A white wall is bright
//! throughout and saturates it hardly anywhere, and a pane does so from the few
//! places that it mirrors straight back to.

use nalgebra::Vector2;
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};

/// How retro-reflective sheeting looks to the lidar.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SheetingConfig {
    /// Reflectance from which on a hit is saturated.
    pub saturated: f32,
    /// Least share of saturated hits among the bright ones: on the fronts of signs
    /// in KITTI 00 and 04 it is 0.5 to 0.85, on white house fronts 0.015.
    pub least_saturated_share: f64,
    /// Farthest hit that is asked, metres: beyond it the lidar reports less of sheeting,
    /// and no white wall is bright.
    pub within_m: f64,
    /// Sheeting is bright from everywhere within this of the middle direction that it
    /// is bright from, radians: it works up to 45 degrees and more off its normal.
    pub cone_rad: f64,
    /// Least share of the scans taken from there that see it bright: a glass door
    /// saturated the lidar in four of the ten that saw it from within 25 degrees.
    pub least_bright_scans: f64,
}

impl Default for SheetingConfig {
    fn default() -> Self {
        Self { saturated: 0.9, least_saturated_share: 0.2, within_m: 30.0, cone_rad: 0.7, least_bright_scans: 0.5 }
    }
}

/// A hit at the place of what is bright.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Glance {
    /// Its scan.
    pub scan: u16,
    /// Direction from the lidar, map (x, z), of unit length.
    pub from_lidar: Vector2<f64>,
    /// Distance from the lidar, metres.
    pub range_m: f64,
    /// Its reflectance.
    pub reflectance: f32,
}

impl SheetingConfig {
    /// Whether the lidar saturates on what is bright, as on the fronts of signs: on
    /// enough of the hits that have at least this reflectance.
    pub(crate) fn saturates(&self, glances: &[Glance], bright: f32) -> bool {
        let of_least = |least: f32| self.near(glances).filter(|glance| glance.reflectance >= least).count() as f64;
        of_least(self.saturated.max(bright)) >= self.least_saturated_share * of_least(bright)
    }

    /// Whether what has hits of at least this reflectance has them from everywhere
    /// before it, and does not glint. Where all are far off, nothing speaks against it.
    pub(crate) fn is_steady(&self, glances: &[Glance], bright: f32) -> bool {
        let brights = self.near(glances).filter(|glance| glance.reflectance >= bright);
        // From opposite sides there is no middle.
        let Some(middle) = brights.map(|glance| glance.from_lidar).sum::<Vector2<f64>>().try_normalize(1e-6) else {
            return true;
        };
        let mut scans: FxHashMap<u16, bool> = FxHashMap::default();
        for glance in self.near(glances).filter(|glance| glance.from_lidar.dot(&middle) >= self.cone_rad.cos()) {
            *scans.entry(glance.scan).or_default() |= glance.reflectance >= bright;
        }
        let seen_bright = scans.values().filter(|is_bright| **is_bright).count();
        seen_bright as f64 >= self.least_bright_scans * scans.len() as f64
    }

    fn near<'a>(&self, glances: &'a [Glance]) -> impl Iterator<Item = &'a Glance> {
        let within_m = self.within_m;
        glances.iter().filter(move |glance| glance.range_m <= within_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three hits from each of twelve places along a road that passes 10 m off.
    fn seen(reflectance: impl Fn(f64, usize) -> f32) -> Vec<Glance> {
        (0..12_u16)
            .flat_map(|scan| (0..3).map(move |hit| (scan, hit)))
            .map(|(scan, hit)| {
                let ray = Vector2::new(10.0, 11.0 - 2.0 * f64::from(scan));
                let off_rad = (ray.y / ray.x).atan();
                Glance {
                    scan,
                    from_lidar: ray.normalize(),
                    range_m: ray.norm(),
                    reflectance: reflectance(off_rad, hit),
                }
            })
            .collect()
    }

    fn is_sheeting(glances: &[Glance]) -> bool {
        let config = SheetingConfig::default();
        config.saturates(glances, 0.7) && config.is_steady(glances, 0.7)
    }

    #[test]
    fn sheeting_is_bright_from_everywhere_before_it_and_need_not_be_from_behind() {
        assert!(is_sheeting(&seen(|_, _| 0.97)));
        assert!(is_sheeting(&seen(|off_rad, _| if off_rad > -0.2 { 0.97 } else { 0.3 })));
        // Some of its hits are dull.
        assert!(is_sheeting(&seen(|_, hit| if hit == 0 { 0.93 } else { 0.75 })));
    }

    #[test]
    fn a_pane_that_glints_is_no_sheeting() {
        let glints = seen(|off_rad, _| if off_rad.abs() < 0.12 { 0.98 } else { 0.1 });
        let config = SheetingConfig::default();
        assert!(config.saturates(&glints, 0.7) && !config.is_steady(&glints, 0.7));
    }

    #[test]
    fn a_white_wall_is_no_sheeting() {
        let wall = seen(|off_rad, hit| if off_rad.abs() < 0.1 && hit == 0 { 0.91 } else { 0.76 });
        let config = SheetingConfig::default();
        assert!(!config.saturates(&wall, 0.7) && config.is_steady(&wall, 0.7));
    }

    #[test]
    fn far_hits_do_not_speak_against_it() {
        let far = |glance: Glance| Glance { range_m: 50.0, ..glance };
        let hits: Vec<Glance> =
            seen(|off_rad, _| if off_rad > 0.0 { 0.75 } else { 0.2 }).into_iter().map(far).collect();
        assert!(is_sheeting(&hits) && is_sheeting(&[]));
    }
}
