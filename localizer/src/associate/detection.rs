//! How probable it is to see a landmark, and to see something that is none.
//!
//! A frame's support for a pose is a log-likelihood ratio against "everything
//! seen is clutter": `ln p_D + ln N(r; 0, S) - ln clutter density` for each
//! match and `ln (1 - p_D)` for each landmark that should have been seen. A
//! match with a gross residual is worth less than none, a missing landmark
//! costs, a feature without a landmark gives nothing.

use common::map::{LaneKind, PoleKind, SignKind};
use serde::{Deserialize, Serialize};

use crate::prepare::Prepared;
use crate::projection::ImageSize;

/// Detection and clutter model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DetectionConfig {
    /// Probability that a near lamp post in the image is found, occlusion by
    /// traffic and trees included.
    pub lamp_post: f64,
    /// As above for sign posts.
    pub sign_post: f64,
    /// As above for delineators and bollards: low, so soon hidden.
    pub delineator: f64,
    /// As above for tree trunks: few networks call them poles.
    pub trunk: f64,
    /// As above for traffic signs.
    pub traffic_sign: f64,
    /// As above for traffic lights.
    pub traffic_light: f64,
    /// As above for solid lane lines.
    pub solid_lane: f64,
    /// As above for dashed lane lines.
    pub dashed_lane: f64,
    /// Distance over which detection falls to 37 %, metres.
    pub range_m: f64,
    /// Spread of the directions of false poles, radians: masts lean little,
    /// branches more.
    pub pole_spread_rad: f64,
    /// Where the far ends of false lane lines lie, as a share of the image
    /// width: all lines on the road run to the vanishing point.
    pub lane_spread_of_width: f64,
}

impl Default for DetectionConfig {
    fn default() -> Self {
        Self {
            lamp_post: 0.6,
            sign_post: 0.5,
            delineator: 0.3,
            trunk: 0.2,
            traffic_sign: 0.5,
            traffic_light: 0.5,
            solid_lane: 0.7,
            dashed_lane: 0.5,
            range_m: 60.0,
            pole_spread_rad: 0.15,
            lane_spread_of_width: 0.1,
        }
    }
}

impl DetectionConfig {
    fn at(&self, near: f64, depth_m: f64) -> f64 {
        (near * (-depth_m / self.range_m).exp()).clamp(0.01, 0.99)
    }

    /// Probability to find a pole at this depth (m).
    pub fn pole(&self, kind: PoleKind, depth_m: f64) -> f64 {
        let near = match kind {
            PoleKind::LampPost => self.lamp_post,
            PoleKind::SignPost => self.sign_post,
            PoleKind::Delineator => self.delineator,
            PoleKind::Trunk => self.trunk,
        };
        self.at(near, depth_m)
    }

    /// Probability to find a sign at this depth (m).
    pub fn sign(&self, kind: SignKind, depth_m: f64) -> f64 {
        let near = match kind {
            SignKind::TrafficSign => self.traffic_sign,
            SignKind::TrafficLight => self.traffic_light,
        };
        self.at(near, depth_m)
    }

    /// Probability to find a lane line in the range in which it is used.
    pub fn lane(&self, kind: LaneKind) -> f64 {
        match kind {
            LaneKind::Solid => self.solid_lane,
            LaneKind::Dashed => self.dashed_lane,
        }
        .clamp(0.01, 0.99)
    }

    /// Densities of false features in the space of two residuals (per px^2).
    /// Every feature counts as possibly false: the more the image is full of,
    /// the less one match says.
    pub fn clutter(&self, features: &Prepared, image: ImageSize) -> Clutter {
        let count = |n: usize| n.max(1) as f64;
        Clutter {
            // Along a pole the second residual spreads with its length.
            pole_per_px: count(features.poles.len()) / image.width_px,
            pole_spread_rad: self.pole_spread_rad,
            lane_per_px2: count(features.lanes.len()) / (image.width_px * image.width_px * self.lane_spread_of_width),
            sign_per_px2: count(features.signs.len()) / (image.width_px * image.height_px),
        }
    }
}

/// Densities of false features in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clutter {
    pole_per_px: f64,
    pole_spread_rad: f64,
    lane_per_px2: f64,
    sign_per_px2: f64,
}

impl Clutter {
    /// Of poles this long in the image, per px^2.
    pub fn poles_per_px2(&self, length_px: f64) -> f64 {
        // Even the shortest pair of ends is free by some pixels.
        self.pole_per_px / (self.pole_spread_rad * length_px).max(4.0)
    }

    /// Of lane lines, per px^2.
    pub fn lanes_per_px2(&self) -> f64 {
        self.lane_per_px2
    }

    /// Of signs, per px^2.
    pub fn signs_per_px2(&self) -> f64 {
        self.sign_per_px2
    }
}
