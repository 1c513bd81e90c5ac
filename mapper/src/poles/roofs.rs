//! Pillars of roofs: what carries a roof stands at the corners of a rectangle.
//!
//! The lidar hardly looks up, so the roof of a filling station or a carport is
//! seldom seen, and its pillars look like masts.

use common::map::PoleKind;
use nalgebra::Vector2;

use super::{FittedPole, PoleConfig};

/// The poles but those that stand with three like ones at the corners of a
/// rectangle, or with two that are as thick as they are: the fourth may be
/// hidden by what stands under the roof.
pub(super) fn without_pillars(poles: Vec<(PoleKind, FittedPole)>, config: &PoleConfig) -> Vec<(PoleKind, FittedPole)> {
    let mut is_pillar = vec![false; poles.len()];
    for fewest in [4, 3] {
        let could: Vec<usize> = (0..poles.len())
            .filter(|i| !is_pillar[*i] && poles[*i].0 != PoleKind::Trunk)
            .filter(|i| poles[*i].1.radius_m >= config.pillar_radius_m && poles[*i].1.top_height_m > config.short_top_m)
            .collect();
        for i in at_corners(&poles, &could, fewest, config) {
            is_pillar[i] = true;
        }
    }
    poles.into_iter().zip(is_pillar).filter(|(_, pillar)| !pillar).map(|(pole, _)| pole).collect()
}

/// Those of some poles that stand at the corners of a rectangle of which so many
/// are taken.
fn at_corners(poles: &[(PoleKind, FittedPole)], could: &[usize], fewest: usize, config: &PoleConfig) -> Vec<usize> {
    let at = |i: usize| Vector2::new(poles[i].1.foot.x, poles[i].1.foot.z);
    let [nearest_m, farthest_m] = config.pillars_apart_m;
    let apart = |off: &Vector2<f64>| (nearest_m..=farthest_m).contains(&off.norm());
    let alike = |i: usize, k: usize| (poles[i].1.radius_m - poles[k].1.radius_m).abs() <= config.pillars_alike_m;
    let mut found = Vec::new();
    for &a in could {
        for &b in could {
            let first = at(b) - at(a);
            if !apart(&first) {
                continue;
            }
            for &c in could {
                let second = at(c) - at(a);
                let is_square = first.dot(&second).abs() < config.pillars_off_m * first.norm().max(second.norm());
                if c == b || !apart(&second) || !is_square {
                    continue;
                }
                let fourth = at(a) + first + second;
                let fourth = could.iter().find(|d| (at(**d) - fourth).norm() < config.pillars_off_m);
                if fourth.is_some() || (fewest == 3 && alike(a, b) && alike(a, c)) {
                    found.extend([a, b, c]);
                    found.extend(fourth);
                }
            }
        }
    }
    found
}
