//! Poles in the image, and what a pole feature says about them.

use common::map::PoleKind;
use nalgebra::{Point2, Point3};

use super::{NoiseConfig, Pairing};
use crate::prepare::PreparedPole;
use crate::preselect::PoleCandidate;
use crate::projection::{ImageSize, NEAR_M, View, fraction_in_space};
use crate::residual::Observation;

/// Density, against that of any other end, of a feature that reaches below the
/// ground at the foot of its pole, or above the top of a low one.
const UNLIKELY: f64 = 0.05;

/// Standard deviations by which an end of a feature lies off that of its pole at
/// most; farther off it is another, hidden or of something beside it.
const SAME_END: f64 = 2.0;

/// A pole in the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoleImage {
    /// Lower end of what is in front of the camera, pixels.
    pub foot_px: Point2<f64>,
    /// Upper end, pixels.
    pub top_px: Point2<f64>,
    foot_map: Point3<f64>,
    top_map: Point3<f64>,
    kind: PoleKind,
    /// Depth of the lower end, metres.
    pub foot_depth_m: f64,
    top_depth_m: f64,
}

/// How exactly the ends of a pole's features are known beforehand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoleEnds {
    foot_sigma_px: f64,
    top_sigma_px: f64,
    /// Its top is where it is mapped.
    is_low: bool,
    /// Share of ends that are seen.
    seen: f64,
}

impl PoleImage {
    /// Eq. 6 and 7: cut at the near plane; none wholly behind it.
    #[inline]
    pub fn new(view: &View, pole: &PoleCandidate) -> Option<Self> {
        let (mut foot_map, mut top_map) = (pole.foot_map, pole.top_map);
        let (mut foot, mut top) = (view.to_camera(&foot_map), view.to_camera(&top_map));
        if foot.z < NEAR_M && top.z < NEAR_M {
            return None;
        }
        // The point a hair before the plane projects; rounding may not.
        let plane_m = NEAR_M * (1.0 + 1e-9);
        if foot.z < NEAR_M {
            let share = (plane_m - foot.z) / (top.z - foot.z);
            foot_map += (top_map - foot_map) * share;
            foot += (top - foot) * share;
        } else if top.z < NEAR_M {
            let share = (plane_m - top.z) / (foot.z - top.z);
            top_map += (foot_map - top_map) * share;
            top += (foot - top) * share;
        }
        Some(Self {
            foot_px: view.pixel(&foot),
            top_px: view.pixel(&top),
            foot_map,
            top_map,
            kind: pole.kind,
            foot_depth_m: foot.z,
            top_depth_m: top.z,
        })
    }

    /// Its length within the rows of the image, pixels.
    pub fn visible_length_px(&self, image: ImageSize) -> f64 {
        let rows = (self.foot_px.y.min(image.height_px) - self.top_px.y.max(0.0)).max(0.0);
        let height = (self.foot_px.y - self.top_px.y).abs().max(1e-9);
        (self.foot_px - self.top_px).norm() * (rows / height).min(1.0)
    }

    /// The middle of it in the map, metres.
    #[inline]
    pub fn middle_map(&self) -> Point3<f64> {
        nalgebra::center(&self.foot_map, &self.top_map)
    }

    /// How exactly the ends of its features are known beforehand. `slack_px` is
    /// the standard deviation of the pose's shift along the pole.
    pub fn ends(&self, noise: &NoiseConfig, focal_px: f64, slack_px: f64) -> PoleEnds {
        let in_image =
            |sigma_m: f64| (sigma_m * focal_px / self.foot_depth_m).hypot(noise.end_sigma_px).hypot(slack_px);
        let foot_m = if self.kind == PoleKind::Delineator { noise.low_end_sigma_m } else { noise.foot_sigma_m };
        let is_low = matches!(self.kind, PoleKind::Delineator | PoleKind::SignPost);
        let top_m = if is_low { noise.low_end_sigma_m } else { noise.foot_sigma_m };
        PoleEnds { foot_sigma_px: in_image(foot_m), top_sigma_px: in_image(top_m), is_low, seen: noise.seen_end }
    }

    /// How much more likely the feature's ends are for this pole than for
    /// something else that runs along the same line (nats).
    ///
    /// A foot is seen, or hidden: then the feature ends above it. A feature
    /// that reaches into the ground is none of this pole. The mapped top of a
    /// lamp post or trunk is where the lidar's rays end, so a feature may reach
    /// higher; that it ends lower happens where the top is hidden. Low poles
    /// end where they are mapped. `rows_px` is the stretch in which ends of
    /// features lie.
    pub fn ends_support(&self, feature: &PreparedPole, ends: &PoleEnds, rows_px: f64) -> f64 {
        let along = |p: &Point2<f64>| feature.down.dot(&(p - feature.upper_px));
        let gaussian = |off_px: f64, sigma_px: f64| {
            let off = off_px / sigma_px;
            (-0.5 * off * off).exp() / (sigma_px * std::f64::consts::TAU.sqrt()) * rows_px
        };
        let hidden = (1.0 - ends.seen).max(UNLIKELY);
        let below_px = feature.length_px - along(&self.foot_px);
        let foot = if feature.lower_is_cut {
            // Cut by something in front: anywhere above the foot.
            if below_px < 2.0 * ends.foot_sigma_px { 1.0 } else { UNLIKELY }
        } else {
            ends.seen * gaussian(below_px, ends.foot_sigma_px) + if below_px < 0.0 { hidden } else { UNLIKELY }
        };
        let short_px = -along(&self.top_px);
        let top = if feature.upper_is_cut {
            // Cut by something in front: anywhere below the top of a low one.
            if ends.is_low && short_px < -2.0 * ends.top_sigma_px { UNLIKELY } else { 1.0 }
        } else if ends.is_low {
            ends.seen * gaussian(short_px, ends.top_sigma_px) + if short_px > 0.0 { hidden } else { UNLIKELY }
        } else if short_px < 2.0 * ends.top_sigma_px {
            1.0
        } else {
            hidden
        };
        foot.ln() + top.ln()
    }

    /// The pair with a feature: the ends of the stretch along which both are
    /// seen, against the feature's line. None where they do not overlap or the
    /// feature reaches far below the foot. `slack_px` is how far the pose may
    /// shift either along the line.
    pub fn pair(
        &self,
        feature: &PreparedPole,
        noise: &NoiseConfig,
        focal_px: f64,
        slack_px: f64,
    ) -> Option<[Observation; 2]> {
        let stretch = self.stretch(feature, noise, focal_px, slack_px)?;
        let [start_px, end_px] = stretch.places_px;
        Some([
            self.observe(&stretch, start_px, feature, noise, focal_px),
            self.observe(&stretch, end_px, feature, noise, focal_px),
        ])
    }

    /// Adds to their pairing where the ends of a low pole and of a feature are
    /// seen, if they may be the same; what is high ends where leaves, lamps and
    /// parked cars let it. `slack_px` is how far the pose may shift either along
    /// the line.
    pub fn push_ends(
        &self,
        feature: &PreparedPole,
        noise: &NoiseConfig,
        focal_px: f64,
        slack_px: f64,
        pairing: &mut Pairing,
    ) {
        if noise.seen_end <= 0.0 {
            return;
        }
        let mut push = |point_map: Point3<f64>, pole_px: &Point2<f64>, feature_px: &Point2<f64>, depth_m: f64| {
            let sigma_px = (noise.low_end_sigma_m * focal_px / depth_m).hypot(noise.end_sigma_px);
            if feature.down.dot(&(pole_px - feature_px)).abs() <= SAME_END * sigma_px + slack_px {
                pairing.push_end(Observation::on_line(point_map, feature.down, feature_px, sigma_px));
            }
        };
        let is_delineator = self.kind == PoleKind::Delineator;
        if is_delineator && !feature.lower_is_cut {
            let lower_px = feature.upper_px + feature.down * feature.length_px;
            push(self.foot_map, &self.foot_px, &lower_px, self.foot_depth_m);
        }
        if (is_delineator || self.kind == PoleKind::SignPost) && !feature.upper_is_cut {
            push(self.top_map, &self.top_px, &feature.upper_px, self.top_depth_m);
        }
    }

    /// Where a pair with a feature is compared; none where it is none. See
    /// [`Self::pair`].
    pub fn stretch(
        &self,
        feature: &PreparedPole,
        noise: &NoiseConfig,
        focal_px: f64,
        slack_px: f64,
    ) -> Option<Stretch> {
        let along = |p: &Point2<f64>| feature.down.dot(&(p - feature.upper_px));
        let (top, foot) = (along(&self.top_px), along(&self.foot_px));
        if foot - top < 1.0 {
            return None;
        }
        let foot_slack_px = slack_px + 3.0 * noise.foot_sigma_m * focal_px / self.foot_depth_m;
        if feature.length_px > foot + foot_slack_px {
            return None;
        }
        let (start, end) = (top.max(0.0), foot.min(feature.length_px));
        let shorter_px = feature.length_px.min(foot - top);
        if end - start + slack_px < noise.min_overlap * shorter_px {
            return None;
        }
        // Without overlap within the slack: compare where they come closest.
        let places_px = if end - start < 1.0 {
            let middle = (0.5 * (start + end)).clamp(top, foot);
            [(middle - 0.5).max(top), (middle + 0.5).min(foot)]
        } else {
            [start, end]
        };
        Some(Stretch { places_px, top_px: top, foot_px: foot })
    }

    /// The observation at a place of a stretch, pixels below the feature's upper
    /// end.
    pub fn observe(
        &self,
        stretch: &Stretch,
        place_px: f64,
        feature: &PreparedPole,
        noise: &NoiseConfig,
        focal_px: f64,
    ) -> Observation {
        let fraction = (place_px - stretch.top_px) / (stretch.foot_px - stretch.top_px);
        let share = fraction_in_space(fraction, self.top_depth_m, self.foot_depth_m);
        let point_map = self.top_map + (self.foot_map - self.top_map) * share;
        let depth_m = self.top_depth_m + (self.foot_depth_m - self.top_depth_m) * share;
        let landmark_px = noise.pole_sigma_m * focal_px / depth_m;
        let variance =
            feature.variance_px2(place_px) + landmark_px * landmark_px + noise.calibration_px(focal_px).powi(2);
        Observation {
            point_map,
            normal: feature.line.normal,
            offset_px: feature.line.offset_px,
            sigma_px: variance.sqrt(),
        }
    }
}

/// Where a pole and a feature are compared, pixels below the feature's upper end
/// along it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// The first place and the last.
    pub places_px: [f64; 2],
    /// The pole's top.
    top_px: f64,
    /// The pole's foot.
    foot_px: f64,
}
