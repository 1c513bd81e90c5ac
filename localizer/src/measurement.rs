//! What a landmark and a feature say about each other: the observations of the
//! pair, with the standard deviation of each from the feature, the landmark
//! and the calibration.

mod lane;
mod pole;

use nalgebra::{Point3, Vector2};
use serde::{Deserialize, Serialize};

use crate::features::PointFeature;
use crate::prepare::MAX_KNOTS;
use crate::preselect::SignCandidate;
use crate::residual::Observation;
pub use lane::{LaneEnds, LaneVertex, pair_lane, project_lane};
pub use pole::{PoleEnds, PoleImage, Stretch};

/// Standard deviations of the map and of the calibration, and what two things
/// that belong together may differ by.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NoiseConfig {
    /// Axis of a mapped pole, metres: one-sided lidar hits on a 0.2 m mast,
    /// drift between the stitched scans.
    pub pole_sigma_m: f64,
    /// Centroid of a mapped sign, metres.
    pub sign_sigma_m: f64,
    /// Centroid of a sign by its size (share): only part of it was hit.
    pub sign_sigma_of_size: f64,
    /// Lane line across its direction, metres: those of the worlds' maps are 0.012 off
    /// (root mean square), and a polyline may stray by 0.03 from what it stands for.
    pub lane_sigma_m: f64,
    /// Kerb across its direction, metres: along KITTI 00 masks lie 0.02 m to the inner and
    /// up to 0.1 m to the outer side of where a step begins, and stray by 0.02.
    pub kerb_sigma_m: f64,
    /// Foot of a kerb in height, metres: networks may put their line on the face over it.
    pub kerb_height_sigma_m: f64,
    /// Lane line and road in height, metres: the same.
    pub lane_height_sigma_m: f64,
    /// Ends of the marks of dashed lines, metres along the line: beams of the
    /// lidar cross a line some centimetres apart.
    pub mark_sigma_m: f64,
    /// Road under them in height, metres: it is the row of the image that tells how far
    /// away they are, and the vehicle sways.
    pub mark_height_sigma_m: f64,
    /// What all marks of a line are off by together, metres: the height of the
    /// road between the axles, and the times of camera and lidar. On KITTI 04
    /// marks and poles alike lie 0.1 m off the survey, for seconds.
    pub mark_common_m: f64,
    /// Calibration, rectification and exposure time, radians: no feature is
    /// better than this; a pixel of KITTI 04's.
    pub calibration_sigma_rad: f64,
    /// Foot of a mapped pole in height, metres: kerbs and grass hide it from
    /// the lidar. A feature may reach no lower than three of these.
    pub foot_sigma_m: f64,
    /// Ends of low poles in height, metres: the lidar sees the whole of a
    /// delineator, and the top of a sign post.
    pub low_end_sigma_m: f64,
    /// Ends of the masks of poles, pixels: those that are seen lie up to twice
    /// this off, in label images of KITTI 04 and of the worlds.
    pub end_sigma_px: f64,
    /// Share of poles whose foot (top) is seen where the feature ends uncut; with
    /// 0 ends tell nothing.
    pub seen_end: f64,
    /// Least share of the shorter of segment and feature by which the two must
    /// overlap along the line.
    pub min_overlap: f64,
    /// Factor by which the image of a sign and its feature may differ in size.
    pub max_size_ratio: f64,
}

impl NoiseConfig {
    /// What calibration leaves near the middle of an image of this focal length, pixels.
    pub fn calibration_px(&self, focal_px: f64) -> f64 {
        self.calibration_sigma_rad * focal_px
    }

    /// Standard deviations of a line across its direction and in height, metres.
    fn of_line(&self, is_kerb: bool) -> (f64, f64) {
        if is_kerb {
            (self.kerb_sigma_m, self.kerb_height_sigma_m)
        } else {
            (self.lane_sigma_m, self.lane_height_sigma_m)
        }
    }
}

impl Default for NoiseConfig {
    fn default() -> Self {
        Self {
            pole_sigma_m: 0.06,
            sign_sigma_m: 0.05,
            sign_sigma_of_size: 0.10,
            lane_sigma_m: 0.02,
            kerb_sigma_m: 0.05,
            kerb_height_sigma_m: 0.03,
            lane_height_sigma_m: 0.02,
            mark_sigma_m: 0.08,
            mark_height_sigma_m: 0.03,
            mark_common_m: 0.1,
            calibration_sigma_rad: 0.001_414,
            foot_sigma_m: 0.4,
            low_end_sigma_m: 0.15,
            end_sigma_px: 3.0,
            seen_end: 0.6,
            min_overlap: 0.3,
            max_size_ratio: 3.0,
        }
    }
}

/// The observations of one pair; at least two. Those of its line or point are
/// believed or doubted together, each end of a pole by itself: it may be hidden.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pairing {
    observations: [Observation; MAX_KNOTS],
    count: usize,
    /// How many of them are ends, the last ones.
    ends: usize,
}

impl Pairing {
    pub(crate) fn empty() -> Self {
        let blank = Observation { point_map: Point3::origin(), normal: Vector2::x(), offset_px: 0.0, sigma_px: 1.0 };
        Self { observations: [blank; MAX_KNOTS], count: 0, ends: 0 }
    }

    pub(crate) fn push(&mut self, observation: Observation) {
        if let Some(slot) = self.observations.get_mut(self.count) {
            *slot = observation;
            self.count += 1;
        }
    }

    /// Adds an end of a pole, after all that is of its line.
    pub(crate) fn push_end(&mut self, observation: Observation) {
        let before = self.count;
        self.push(observation);
        self.ends += self.count - before;
    }

    /// All of them.
    pub fn observations(&self) -> &[Observation] {
        &self.observations[..self.count]
    }

    /// Those of its line or point.
    pub fn line(&self) -> &[Observation] {
        &self.observations[..self.count - self.ends]
    }

    /// Those that are believed or doubted together.
    pub fn groups(&self) -> impl Iterator<Item = &[Observation]> {
        let ends = self.observations()[self.count - self.ends..].chunks(1);
        std::iter::once(self.line()).chain(ends)
    }

    /// The first and the last of its line: what that fixes.
    pub fn extremes(&self) -> (&Observation, &Observation) {
        (&self.observations[0], &self.observations[self.line().len().max(1) - 1])
    }
}

impl From<[Observation; 2]> for Pairing {
    fn from(two: [Observation; 2]) -> Self {
        let mut pairing = Self::empty();
        for observation in two {
            pairing.push(observation);
        }
        pairing
    }
}

/// The pair of a sign and a feature (eq. 8), at the sign's depth (m); none
/// where their sizes do not agree.
pub fn pair_sign(
    sign: &SignCandidate,
    depth_m: f64,
    feature: &PointFeature,
    noise: &NoiseConfig,
    focal_px: f64,
) -> Option<[Observation; 2]> {
    if sign.kind != feature.kind {
        return None;
    }
    let expected_px = sign.size_m * focal_px / depth_m;
    let found_px = feature.extent_px.norm();
    let ratio = (found_px / expected_px.max(1e-9)).max(expected_px / found_px.max(1e-9));
    if ratio > noise.max_size_ratio {
        return None;
    }
    let landmark_px = noise.sign_sigma_m.hypot(noise.sign_sigma_of_size * sign.size_m) * focal_px / depth_m;
    let sigma_px = feature.sigma_px.hypot(landmark_px).hypot(noise.calibration_px(focal_px));
    let on_line = |normal| Observation::on_line(sign.centroid_map, normal, &feature.centre_px, sigma_px);
    Some([on_line(Vector2::x()), on_line(Vector2::y())])
}

#[cfg(test)]
mod tests;
