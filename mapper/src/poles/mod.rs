//! Pole-like objects: found as isolated vertical stacks, fitted as axes.

mod config;
mod fit;
mod stacks;

use common::map::PoleKind;
use nalgebra::Point2;
use rayon::prelude::*;

pub use config::PoleConfig;
pub use fit::{FittedPole, fit_pole};
pub use stacks::{Stack, Stacks};

use crate::cloud::Cloud;
use crate::lidar::LidarConfig;

/// The poles of a stitched cloud with their kinds.
pub fn find_poles(cloud: &Cloud, config: &PoleConfig, lidar: &LidarConfig) -> Vec<(PoleKind, FittedPole)> {
    let stacks = Stacks::new(&cloud.points, cloud.ground.grid(), config);
    let fitted: Vec<FittedPole> = stacks
        .find(config)
        .par_iter()
        .filter_map(|stack| fit_pole(cloud, cloud.near(&stack.centre), stack, config, lidar))
        .filter(|pole| is_pole(pole, config))
        .collect();
    let mut kept: Vec<(PoleKind, FittedPole)> = Vec::new();
    for pole in fitted {
        // Two stacks of one pole, above and below a sign, fit the same axis.
        let known = kept.iter().any(|(_, k)| {
            let off = Point2::new(k.foot.x - pole.foot.x, k.foot.z - pole.foot.z);
            off.coords.norm() < config.ring_inner_m
        });
        let kind = kind_of(&pole, &stacks, config);
        if !known && (kind != PoleKind::Trunk || config.keep_trunks) {
            kept.push((kind, pole));
        }
    }
    kept
}

fn is_pole(pole: &FittedPole, config: &PoleConfig) -> bool {
    let free_share = pole.free_m / (pole.top_height_m - pole.foot_height_m);
    let least_share =
        if pole.radius_m <= config.post_radius_m { config.least_free_share } else { config.least_free_share_thick };
    let least_free_m = if pole.foot_height_m > 0.0 { config.least_free_hanging_m } else { config.least_free_m };
    pole.tilt_rad() <= config.largest_tilt_rad
        && pole.spread_m <= config.largest_spread_m
        && pole.radius_m <= config.thickest_m
        && pole.scans >= config.fewest_scans
        && pole.foot_height_m <= config.highest_foot_m
        && pole.visibility >= config.least_visibility
        && pole.top_height_m >= config.lowest_top_m
        && pole.free_m >= least_free_m
        && free_share >= least_share
}

fn kind_of(pole: &FittedPole, stacks: &Stacks, config: &PoleConfig) -> PoleKind {
    let top = pole.top_height_m;
    let above = top..top + 1.5;
    let crown = stacks.filled_share(&Point2::new(pole.top.x, pole.top.z), above, 1.0);
    if crown >= config.crown_share || pole.radius_m > config.trunk_radius_m {
        PoleKind::Trunk
    } else if top <= config.delineator_top_m {
        PoleKind::Delineator
    } else if top >= config.lamp_top_m || (pole.top_is_open && top >= config.open_lamp_top_m) {
        PoleKind::LampPost
    } else {
        PoleKind::SignPost
    }
}
