//! Pillars of roofs: what carries a roof stands at the corners of a rectangle.
//!
//! The lidar hardly looks up, so the roof of a filling station or a carport is
//! seldom seen, and its pillars look like masts.

use common::map::PoleKind;
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::{FittedPole, PoleConfig};

/// How the thin posts of stalls and of shelters at bus stops are told.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ShelterConfig {
    /// Top of their posts at most, metres above ground: small roofs are low.
    pub top_m: f64,
    /// Least and largest side of the rectangle in which these stand, metres.
    pub posts_apart_m: [f64; 2],
    /// How much their heights differ, metres: they carry one roof, and beams are so far apart.
    pub alike_m: f64,
}

impl Default for ShelterConfig {
    fn default() -> Self {
        Self { top_m: 3.0, posts_apart_m: [1.2, 5.0], alike_m: 0.15 }
    }
}

/// A pole and what it is said to be.
type Told = (PoleKind, FittedPole);

/// What carries a roof.
struct Roof<'a> {
    /// Whether one may be of it.
    may_be: &'a dyn Fn(&Told) -> bool,
    /// Whether two that may be are alike enough.
    are_alike: &'a dyn Fn(&FittedPole, &FittedPole) -> bool,
    /// Least and largest side of its rectangle, metres.
    apart_m: [f64; 2],
    /// Whether one of the four may be hidden.
    may_hide_one: bool,
}

/// The poles but those that carry a roof: thick ones that stand with three like ones at
/// the corners of a rectangle, or with two that are as thick as they are, as the fourth may
/// be hidden by what stands under the roof; and thin ones as high as each other that do so
/// closer together, of stalls and of shelters at bus stops.
pub(super) fn without_pillars(poles: Vec<Told>, config: &PoleConfig) -> Vec<Told> {
    let shelters = &config.shelters;
    let is_mast = |(kind, pole): &Told| {
        *kind != PoleKind::Trunk && pole.radius_m >= config.pillar_radius_m && pole.top_height_m > config.short_top_m
    };
    let is_thin = |(kind, pole): &Told| {
        *kind != PoleKind::Trunk
            && !pole.has_sheeting(config)
            && (config.short_top_m..=shelters.top_m).contains(&pole.top_height_m)
    };
    let as_thick = |a: &FittedPole, b: &FittedPole| (a.radius_m - b.radius_m).abs() <= config.pillars_alike_m;
    let as_high = |a: &FittedPole, b: &FittedPole| (a.top_height_m - b.top_height_m).abs() <= shelters.alike_m;
    let of_masts =
        Roof { may_be: &is_mast, are_alike: &|_, _| true, apart_m: config.pillars_apart_m, may_hide_one: false };
    let one_hidden = Roof { are_alike: &as_thick, may_hide_one: true, ..of_masts };
    let of_thin = Roof { may_be: &is_thin, are_alike: &as_high, apart_m: shelters.posts_apart_m, may_hide_one: true };
    let mut is_pillar = vec![false; poles.len()];
    for roof in [of_masts, one_hidden, of_thin] {
        let could: Vec<usize> = (0..poles.len()).filter(|i| !is_pillar[*i] && (roof.may_be)(&poles[*i])).collect();
        for i in at_corners(&poles, &could, &roof, config) {
            is_pillar[i] = true;
        }
    }
    poles.into_iter().zip(is_pillar).filter(|(_, pillar)| !pillar).map(|(pole, _)| pole).collect()
}

/// Those of some poles that carry a roof together.
fn at_corners(poles: &[Told], could: &[usize], roof: &Roof<'_>, config: &PoleConfig) -> Vec<usize> {
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
                if fourth.is_some() || roof.may_hide_one {
                    found.extend([a, b, c]);
                    found.extend(fourth);
                }
            }
        }
    }
    found
}
