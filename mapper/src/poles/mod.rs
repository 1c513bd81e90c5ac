//! Pole-like objects: found as isolated vertical stacks, fitted as axes.

mod axis;
mod config;
mod fences;
mod fit;
mod fitted;
mod flat;
mod hedges;
mod kinds;
mod normal;
mod plumb;
mod reflectors;
mod roofs;
mod stacks;
#[cfg(test)]
mod tests;
mod walls;

use common::map::PoleKind;
use nalgebra::{Point2, Point3, Vector2};
use rayon::prelude::*;

pub use config::PoleConfig;
pub use fit::{Wanted, fit_pole};
pub use fitted::FittedPole;
pub use hedges::HedgeConfig;
pub use kinds::TreeConfig;
pub use plumb::Plumb;
pub use roofs::ShelterConfig;
pub use stacks::{Filling, Stack, Stacks};
pub use walls::WallConfig;

pub use crate::looks::LookConfig;

use crate::cloud::Cloud;
use crate::lidar::LidarConfig;
use crate::looks::{Stands, standing};
use fences::{ends_fence, in_fences};
use kinds::{Kinds, has_crown};
use reflectors::{under_reflectors, under_sheets};
use roofs::without_pillars;

/// The poles of a stitched cloud with their kinds.
pub fn find_poles(cloud: &Cloud, config: &PoleConfig, lidar: &LidarConfig) -> Vec<(PoleKind, FittedPole)> {
    let config = &of_leaning_map(cloud.ground.tilt_rad(&cloud.path), config);
    let stacks = Stacks::new(&cloud.points, cloud.ground.grid(), config);
    // What stands free first, reflectors last: what stands free is known by then.
    let places: Vec<Stack> = stacks
        .find(config)
        .into_iter()
        .chain(stacks.find_before(config))
        .chain(under_reflectors(cloud, config, &lidar.sheeting))
        .chain(under_sheets(cloud, config, &lidar.sheeting))
        .collect();
    let fit = |plumb: &Plumb, wanted: Wanted| -> Vec<(FittedPole, bool)> {
        places
            .par_iter()
            .filter_map(|stack| {
                let pole = fit_pole(cloud, cloud.near(&stack.centre), stack, plumb, wanted, config, lidar)?;
                let is_pole = is_pole(&pole, stack, config) && !is_of_what_is_behind(&pole, stack, &stacks, config);
                Some((pole, is_pole))
            })
            .collect()
    };
    // How all of them stand tells how a short one does. Leaves bend what stands in a hedge.
    let first = fit(&Plumb::of_map(config), Wanted::Poles);
    let slopes: Vec<_> = first
        .iter()
        .filter(|(pole, is_pole)| *is_pole && !pole.is_in_hedge(config))
        .map(|(p, _)| (p.slope_of_hits, p.slope_covariance))
        .collect();
    let plumb = Plumb::of_poles(&slopes, config);
    let fitted = fit(&plumb, Wanted::PolesAndFences);
    // What is no pole itself may still carry the rail that goes on to others.
    let fenced = in_fences(&fitted.iter().map(|(pole, _)| pole).collect::<Vec<_>>(), config);
    let poles: Vec<FittedPole> = fitted
        .into_iter()
        .zip(fenced)
        .filter_map(|((pole, is_pole), fenced)| (is_pole && !fenced).then_some(pole))
        .collect();
    let kinds = Kinds::of(&poles, &plumb, &stacks, config);
    let kinds: Vec<PoleKind> = poles.iter().map(|pole| kinds.of_pole(pole)).collect();
    let mut kept: Vec<(PoleKind, FittedPole)> = Vec::new();
    for (kind, pole) in kinds.into_iter().zip(poles) {
        // Two stacks of one pole, above and below a sign, fit the same axis.
        let known = kept.iter().any(|(_, k)| {
            let off = Point2::new(k.foot.x - pole.foot.x, k.foot.z - pole.foot.z);
            off.coords.norm() < config.ring_inner_m
        });
        if !known && (kind != PoleKind::Trunk || config.keep_trunks) && !ends_fence(cloud, &pole, config) {
            kept.push((kind, pole));
        }
    }
    // Pillars are told by the others of their roof, so all are asked together.
    let kept = without_pillars(kept, config);
    standing(kept, cloud, &config.looks, lidar)
}

impl Stands for (PoleKind, FittedPole) {
    fn middle(&self) -> Point2<f64> {
        let middle = nalgebra::center(&self.1.foot, &self.1.top);
        Point2::new(middle.x, middle.z)
    }

    fn radius_m(&self) -> f64 {
        self.1.radius_m
    }

    fn beside_m(&self, at: &Point3<f64>, view: Vector2<f64>) -> Option<f64> {
        let pole = &self.1;
        let length_m = pole.foot.y - pole.top.y;
        let up_m = pole.foot.y - at.y;
        if length_m <= 0.0 || up_m < pole.foot_height_m.max(0.2 * length_m) || up_m > length_m {
            return None;
        }
        Some((Point2::new(at.x, at.z) - pole.at_height_of(at)).perp(&view).abs())
    }
}

/// The settings for a map whose level leans so far from the road. Streets climb by half
/// of what a pole may lean; beyond that it is the first camera, whose axes are the map's,
/// that looks up or down, and poles lean in the map by as much.
fn of_leaning_map(tilt_rad: f64, config: &PoleConfig) -> PoleConfig {
    let leaning_rad = if tilt_rad > config.largest_tilt_rad / 2.0 { tilt_rad } else { 0.0 };
    PoleConfig { largest_tilt_rad: config.largest_tilt_rad + leaning_rad, ..config.clone() }
}

fn is_pole(pole: &FittedPole, stack: &Stack, config: &PoleConfig) -> bool {
    pole.tilt_rad() <= config.largest_tilt_rad && looks_like_pole(pole, stack, config)
}

/// Whether something is a pole but for its tilt.
fn looks_like_pole(pole: &FittedPole, stack: &Stack, config: &PoleConfig) -> bool {
    let free_share = pole.free_m / (pole.top_height_m - pole.foot_height_m);
    let least_free_m = if pole.foot_height_m > 0.0 { config.least_free_hanging_m } else { config.least_free_m };
    let is_equipment = is_equipment(pole, config);
    let carries_plate = is_equipment || pole.shows_plates_alone;
    let least_share = if carries_plate {
        config.least_free_share_sign
    } else if pole.radius_m <= config.post_radius_m {
        config.least_free_share
    } else {
        config.least_free_share_thick
    };
    let is_short = pole.is_short(config);
    // What stands amid something is hidden by it, unless it is a part of it.
    let is_amid = stack.is_before || pole.attached_share > config.largest_attached_share;
    let least_visibility_amid = config.least_visibility_before.max(config.least_visibility);
    let highest_foot_m = if carries_plate { config.highest_foot_sign_m } else { config.highest_foot_m };
    (is_equipment || pole.attached_share <= largest_attached_share(pole, stack, config))
        && (is_equipment || !is_short || pole.radius_m <= config.thickest_short_m)
        && pole.spread_m <= largest_spread_m(pole, config)
        && pole.radius_m <= largest_radius_m(pole, stack, config)
        && pole.scans >= config.fewest_scans
        && (pole.reflectance >= config.least_reflectance || !is_glimpse(pole, config))
        && pole.nearest_hit_m <= config.hit_within_m
        && (is_equipment || !pole.stands_on_wall || pole.nearest_hit_m < config.walls.from_m)
        && pole.foot_height_m <= highest_foot_m
        && pole.visibility >= if is_amid { least_visibility_amid } else { config.least_visibility }
        && pole.top_height_m >= config.lowest_top_m
        && pole.free_m >= least_free_m
        && free_share >= least_share
}

/// How thick a pole may be. Below a plate one is sought where something else stands as well:
/// it is measured with what is beside it, and in a hedge that is leaves on all sides.
fn largest_radius_m(pole: &FittedPole, stack: &Stack, config: &PoleConfig) -> f64 {
    match (stack.is_under_sheet, pole.is_in_hedge(config)) {
        (false, _) => config.thickest_m,
        (true, false) => config.slender_m,
        (true, true) => config.post_radius_m,
    }
}

/// Whether the sheeting on it says that it was put up for the traffic: it is at the
/// height of signs, or that of a delineator. Tail lamps of parked cars reflect as those
/// do, but they are on round corners, of which one side is seen, and on little of their
/// height.
fn is_equipment(pole: &FittedPole, config: &PoleConfig) -> bool {
    let may_be_in_hedge = pole.radius_m <= config.slender_short_m
        || pole.is_in_hedge(config)
        || pole.visibility >= config.least_visibility_in_hedge && pole.bright_share >= config.least_bright_share;
    let is_delineator = pole.is_short(config)
        && pole.radius_m <= config.thickest_equipped_m
        && (pole.attached_share <= config.walls.largest_attached_share || may_be_in_hedge);
    pole.has_sheeting(config) && (is_delineator || pole.bright_top_m >= config.sheet_m[0])
}

/// In what share of its slices something may reach from it outwards. Boards and
/// crowns are above the free part of a pole, and a hedge is below it; what is
/// attached higher than hedges are, or is thicker than a post and stands close
/// before something, is a pipe, a jamb or a corner of a wall.
fn largest_attached_share(pole: &FittedPole, stack: &Stack, config: &PoleConfig) -> f64 {
    let is_short = pole.is_short(config);
    if !is_short && pole.stands_out_of_hedge(config) {
        return 1.0;
    }
    let is_of_wall =
        if stack.is_before { is_short || pole.radius_m > config.slender_m } else { stack.low_m >= config.hedge_top_m };
    if is_of_wall {
        config.walls.largest_attached_share
    } else if is_short || stack.is_before || stack.low_m < config.largest_bush_m {
        config.largest_attached_share
    } else {
        1.0
    }
}

/// How far its points may lie from its surface: those of a wall that is seen
/// edge-on are as narrow as a post, and reach along the view.
fn largest_spread_m(pole: &FittedPole, config: &PoleConfig) -> f64 {
    if pole.radius_m < 1.1 * config.thinnest_m { config.largest_spread_thin_m } else { config.largest_spread_m }
}

/// Whether only few hits of two scans tell of it, though many were near: what
/// is seen through a gap between others looks free to both sides.
fn is_glimpse(pole: &FittedPole, config: &PoleConfig) -> bool {
    pole.scans <= config.glimpse_scans
        && pole.points < config.glimpse_points
        && (pole.scans as f64) < config.glimpse_share * pole.scans_near as f64
}

/// Whether what stands out before a hedge or a wall is a part of it: it is low,
/// and what is behind it goes on above it.
fn is_of_what_is_behind(pole: &FittedPole, stack: &Stack, stacks: &Stacks, config: &PoleConfig) -> bool {
    stack.is_before
        && !is_equipped_post(pole, config)
        && pole.top_height_m <= config.hedge_top_m
        && has_crown(pole, &[], stacks, config)
}

/// Whether it is a post with sheeting on it.
fn is_equipped_post(pole: &FittedPole, config: &PoleConfig) -> bool {
    pole.has_sheeting(config) && pole.radius_m <= config.post_radius_m
}
