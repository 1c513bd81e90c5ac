//! How probable it is to see a landmark, and to see something that is none.
//!
//! A frame's support for a pose is a log-likelihood ratio against "everything
//! seen is clutter": `ln p_D + ln N(r; 0, S) - ln clutter density` for each
//! match and `ln (1 - p_D)` for each landmark that should have been seen. A
//! match with a gross residual is worth less than none, a missing landmark
//! costs, a feature without a landmark gives nothing. One bus hides many
//! landmarks at once, so what all that is missing costs together has a limit.

use common::map::{LaneKind, PoleKind, SignKind};
use serde::{Deserialize, Serialize};

use super::odds::OddsConfig;
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
    /// As above for tree trunks, where vegetation is told: most stand before
    /// hedges and other trees. Along generated streets one in ten is found; with
    /// 0.3 what is taken for a trunk, frame after frame, kept wrong poses.
    pub trunk: f64,
    /// As above for traffic signs.
    pub traffic_sign: f64,
    /// As above for traffic lights.
    pub traffic_light: f64,
    /// As above for solid lane lines.
    pub solid_lane: f64,
    /// As above for dashed lane lines.
    pub dashed_lane: f64,
    /// As above for kerbs of roads without paint: along KITTI 00 they are found as
    /// lines are, but not every network has learnt them.
    pub kerb: f64,
    /// Share of the frames in which something stands before the camera that
    /// hides any number of landmarks at once: a bus, a row of parked vans.
    pub blocked: f64,
    /// Distance at which detection of high poles and of signs has fallen to
    /// 37 %, metres. It falls as a Gaussian: what is large in the image is
    /// found, what is small soon is not.
    pub range_m: f64,
    /// As above for what is low: delineators and sign posts.
    pub low_range_m: f64,
    /// A line of sight no further from the roads than this is open, metres:
    /// houses stand behind the pavement.
    pub open_m: f64,
    /// Beyond that, distance over which the chance to see falls to 37 %, metres.
    pub fade_m: f64,
    /// Share of a frame's features that are taken as false.
    pub clutter_share: f64,
    /// Spread of the directions of false poles, radians: masts lean little,
    /// branches more.
    pub pole_spread_rad: f64,
    /// Where the far ends of false lane lines lie, as a share of the image
    /// width: all lines on the road run to the vanishing point.
    pub lane_spread_of_width: f64,
    /// Height of the band of the image in which false signs lie, as a share of
    /// its height: what is taken for one hangs where signs hang.
    pub sign_band_of_height: f64,
    /// Mean distance of false ends of marks of one kind (near or far) along a
    /// lane line, metres: a shadow or a patch per dash.
    pub mark_clutter_m: f64,
    /// By how much more the ends of marks must speak for one shift along the
    /// line than for any other, nats: marks are all alike.
    pub mark_lead: f64,
    /// What probabilities of regions say.
    pub odds: OddsConfig,
}

impl Default for DetectionConfig {
    fn default() -> Self {
        Self {
            lamp_post: 0.85,
            sign_post: 0.75,
            delineator: 0.7,
            trunk: 0.1,
            traffic_sign: 0.8,
            traffic_light: 0.7,
            solid_lane: 0.7,
            dashed_lane: 0.7,
            kerb: 0.4,
            blocked: 0.01,
            range_m: 50.0,
            low_range_m: 32.0,
            open_m: 8.0,
            fade_m: 10.0,
            clutter_share: 0.6,
            pole_spread_rad: 0.15,
            lane_spread_of_width: 0.1,
            sign_band_of_height: 0.5,
            mark_clutter_m: 6.0,
            mark_lead: 3.0,
            odds: OddsConfig::default(),
        }
    }
}

impl DetectionConfig {
    #[inline]
    fn at(&self, near: f64, range_m: f64, depth_m: f64, sight_m: f64) -> f64 {
        let blocked = (sight_m - self.open_m).max(0.0) / self.fade_m;
        let far = depth_m / range_m;
        (near * (-far * far - blocked).exp()).clamp(0.01, 0.99)
    }

    /// Probability to find a pole at this depth (m), the line of sight to
    /// which leaves the roads by `sight_m`.
    #[inline]
    pub fn pole(&self, kind: PoleKind, depth_m: f64, sight_m: f64) -> f64 {
        let (near, range_m) = match kind {
            PoleKind::LampPost => (self.lamp_post, self.range_m),
            PoleKind::SignPost => (self.sign_post, self.low_range_m),
            PoleKind::Delineator => (self.delineator, self.low_range_m),
            PoleKind::Trunk => (self.trunk, self.range_m),
        };
        self.at(near, range_m, depth_m, sight_m)
    }

    /// Probability to find a sign; arguments as for [`Self::pole`].
    #[inline]
    pub fn sign(&self, kind: SignKind, depth_m: f64, sight_m: f64) -> f64 {
        let near = match kind {
            SignKind::TrafficSign => self.traffic_sign,
            SignKind::TrafficLight => self.traffic_light,
        };
        self.at(near, self.range_m, depth_m, sight_m)
    }

    /// Probability to find a lane line in the range in which it is used.
    #[inline]
    pub fn lane(&self, kind: LaneKind) -> f64 {
        match kind {
            LaneKind::Solid => self.solid_lane,
            LaneKind::Dashed => self.dashed_lane,
            LaneKind::Kerb => self.kerb,
        }
        .clamp(0.01, 0.99)
    }

    /// What it costs that landmarks were not seen, nats: `apart` if each were
    /// missed for its own reason, or at the most that the view is blocked.
    /// `ln ((1 - b) exp(apart) + b)`, with the share `b` of blocked frames.
    #[inline]
    pub fn all_unseen(&self, apart: f64) -> f64 {
        let blocked = self.blocked.clamp(0.0, 1.0);
        if blocked == 0.0 {
            return apart;
        }
        ((1.0 - blocked) * apart.exp() + blocked).ln()
    }

    /// Densities of false features in the space of two residuals (per px^2).
    /// The more the image is full of, the less one match says.
    pub fn clutter(&self, features: &Prepared, image: ImageSize) -> Clutter {
        let count = |n: usize| (n as f64 * self.clutter_share).max(1.0);
        Clutter {
            // Along a pole the second residual spreads with its length.
            pole_per_px: count(features.count_of(PoleKind::LampPost)) / image.width_px,
            trunk_per_px: count(features.count_of(PoleKind::Trunk)) / image.width_px,
            pole_spread_rad: self.pole_spread_rad,
            lane_per_px2: count(features.lanes.len()) / (image.width_px * image.width_px * self.lane_spread_of_width),
            sign_per_px2: count(features.signs.len()) / (image.width_px * image.height_px * self.sign_band_of_height),
        }
    }
}

/// Densities of false features in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clutter {
    pole_per_px: f64,
    trunk_per_px: f64,
    pole_spread_rad: f64,
    lane_per_px2: f64,
    sign_per_px2: f64,
}

impl Clutter {
    /// Of poles of a kind and this long in the image, per px^2.
    pub fn poles_per_px2(&self, kind: PoleKind, length_px: f64) -> f64 {
        let per_px = if kind == PoleKind::Trunk { self.trunk_per_px } else { self.pole_per_px };
        // Even the shortest pair of ends is free by some pixels.
        per_px / (self.pole_spread_rad * length_px).max(4.0)
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_is_unseen_costs_no_more_than_a_blocked_view_and_never_gains(
            apart in -200.0..0.0, more in 0.0..50.0, blocked in 0.0001..1.0,
        ) {
            let detection = DetectionConfig { blocked, ..DetectionConfig::default() };
            let cost = detection.all_unseen(apart);
            prop_assert!(cost >= apart - 1e-9 && cost <= 1e-12);
            prop_assert!(cost >= blocked.ln() - 1e-9);
            prop_assert!(detection.all_unseen(apart - more) <= cost + 1e-12);
            let never = DetectionConfig { blocked: 0.0, ..detection };
            prop_assert!((never.all_unseen(apart) - apart).abs() < 1e-9);
            prop_assert!((never.all_unseen(-1e6) + 1e6).abs() < 1e-9 && detection.all_unseen(-1e6).is_finite());
        }
    }
}
