//! Pillars of roofs: what carries a roof stands at the corners of a rectangle.
//!
//! The lidar hardly looks up, so the roof of a filling station or a carport is
//! seldom seen, and its pillars look like masts.

use common::map::PoleKind;
use nalgebra::Vector2;

use super::{FittedPole, PoleConfig};

/// The poles but those that carry a roof: thick ones that stand with three like ones at
/// the corners of a rectangle, or with two that are as thick as they are, as the fourth may
/// be hidden by what stands under the roof; and thin ones as high as each other that do so
/// closer together, of stalls and of shelters at bus stops.
pub(super) fn without_pillars(poles: Vec<(PoleKind, FittedPole)>, config: &PoleConfig) -> Vec<(PoleKind, FittedPole)> {
    let is_mast = |(kind, pole): &(PoleKind, FittedPole)| {
        *kind != PoleKind::Trunk && pole.radius_m >= config.pillar_radius_m && pole.top_height_m > config.short_top_m
    };
    let is_thin = |(kind, pole): &(PoleKind, FittedPole)| {
        *kind != PoleKind::Trunk
            && !pole.has_sheeting(config)
            && (config.short_top_m..=config.shelter_top_m).contains(&pole.top_height_m)
    };
    let as_thick = |a: &FittedPole, b: &FittedPole| (a.radius_m - b.radius_m).abs() <= config.pillars_alike_m;
    let as_high = |a: &FittedPole, b: &FittedPole| (a.top_height_m - b.top_height_m).abs() <= config.shelters_alike_m;
    let (apart_m, shelter_m) = (config.pillars_apart_m, config.shelter_posts_apart_m);
    let roofs: [(&dyn Fn(&(PoleKind, FittedPole)) -> bool, Roof<'_>); 3] = [
        (&is_mast, Roof { fewest: 4, apart_m, are_alike: &|_, _| true }),
        (&is_mast, Roof { fewest: 3, apart_m, are_alike: &as_thick }),
        (&is_thin, Roof { fewest: 3, apart_m: shelter_m, are_alike: &as_high }),
    ];
    let mut is_pillar = vec![false; poles.len()];
    for (may_be, roof) in roofs {
        let could: Vec<usize> = (0..poles.len()).filter(|i| !is_pillar[*i] && may_be(&poles[*i])).collect();
        for i in at_corners(&poles, &could, &roof, config) {
            is_pillar[i] = true;
        }
    }
    poles.into_iter().zip(is_pillar).filter(|(_, pillar)| !pillar).map(|(pole, _)| pole).collect()
}

/// What carries a roof.
struct Roof<'a> {
    /// Corners of its rectangle at which a pole is, at least.
    fewest: usize,
    /// Least and largest side of the rectangle, metres.
    apart_m: [f64; 2],
    /// Whether two may carry the same roof.
    are_alike: &'a dyn Fn(&FittedPole, &FittedPole) -> bool,
}

/// Those of some poles that carry a roof together.
fn at_corners(poles: &[(PoleKind, FittedPole)], could: &[usize], roof: &Roof<'_>, config: &PoleConfig) -> Vec<usize> {
    let at = |i: usize| Vector2::new(poles[i].1.foot.x, poles[i].1.foot.z);
    let [nearest_m, farthest_m] = roof.apart_m;
    let apart = |off: &Vector2<f64>| (nearest_m..=farthest_m).contains(&off.norm());
    let alike = |i: usize, k: usize| (roof.are_alike)(&poles[i].1, &poles[k].1);
    let mut found = Vec::new();
    for &a in could {
        for &b in could {
            let first = at(b) - at(a);
            if !apart(&first) || !alike(a, b) {
                continue;
            }
            for &c in could {
                let second = at(c) - at(a);
                let is_square = first.dot(&second).abs() < config.pillars_off_m * first.norm().max(second.norm());
                if c == b || !apart(&second) || !is_square || !alike(a, c) {
                    continue;
                }
                let fourth = at(a) + first + second;
                let fourth = could.iter().find(|d| (at(**d) - fourth).norm() < config.pillars_off_m && alike(a, **d));
                if fourth.is_some() || roof.fewest == 3 {
                    found.extend([a, b, c]);
                    found.extend(fourth);
                }
            }
        }
    }
    found
}
