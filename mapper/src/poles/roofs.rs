//! Pillars of roofs: what carries a roof stands at the corners of a rectangle.
//!
//! The lidar hardly looks up, so the roof of a filling station or a carport is
//! seldom seen, and its pillars look like masts.

use common::map::PoleKind;
use nalgebra::Vector2;

use super::{FittedPole, PoleConfig};

/// The poles but those that stand with three like ones at the corners of a
/// rectangle.
pub(super) fn without_pillars(poles: Vec<(PoleKind, FittedPole)>, config: &PoleConfig) -> Vec<(PoleKind, FittedPole)> {
    let could: Vec<usize> = (0..poles.len())
        .filter(|i| poles[*i].0 != PoleKind::Trunk)
        .filter(|i| poles[*i].1.radius_m >= config.pillar_radius_m && poles[*i].1.top_height_m > config.short_top_m)
        .collect();
    let at = |i: usize| Vector2::new(poles[i].1.foot.x, poles[i].1.foot.z);
    let [nearest_m, farthest_m] = config.pillars_apart_m;
    let apart = |off: &Vector2<f64>| (nearest_m..=farthest_m).contains(&off.norm());
    let mut is_pillar = vec![false; poles.len()];
    for &a in &could {
        for &b in &could {
            let first = at(b) - at(a);
            if !apart(&first) {
                continue;
            }
            for &c in &could {
                let second = at(c) - at(a);
                let is_square = first.dot(&second).abs() < config.pillars_off_m * first.norm().max(second.norm());
                if c == b || !apart(&second) || !is_square {
                    continue;
                }
                let fourth = at(a) + first + second;
                let Some(&d) = could.iter().find(|d| (at(**d) - fourth).norm() < config.pillars_off_m) else {
                    continue;
                };
                for i in [a, b, c, d] {
                    is_pillar[i] = true;
                }
            }
        }
    }
    poles.into_iter().zip(is_pillar).filter(|(_, pillar)| !pillar).map(|(pole, _)| pole).collect()
}
