//! Landmarks seen twice become one, with a better position.
//!
//! A [`Sighting`] is a landmark as one pass over a place found it. Sightings of
//! different passes that lie together are one landmark; two of the same pass
//! are not, for that pass told them apart, unless they lie so close that it must
//! have seen one twice. Positions are combined by their
//! information (the inverse of their covariance), which gives the least
//! variance where errors are independent: `x = (sum P_i^-1)^-1 sum P_i^-1 x_i`.
//!
//! Nothing here depends on the order of the sightings or on how passes are
//! numbered: everything is first brought into an order of its own.

mod buckets;
mod cluster;
mod lanes;
mod points;
mod strands;
mod weights;

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

pub use buckets::Buckets;
pub use cluster::{NEVER_DOUBLE_M, Place, cluster};
pub use lanes::{FusedLane, LaneSample, fuse_lanes};
pub use points::{fuse_poles, fuse_signs};
pub(crate) use strands::length_m;

/// When two sightings are one landmark, and how they are combined.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FuseConfig {
    /// Largest distance of the feet of two sightings of one pole, seen from
    /// above, metres: half the spacing of the densest bollards.
    pub pole_within_m: f64,
    /// Largest distance of the centroids of two sightings of one sign, metres:
    /// two plates on one post are farther apart.
    pub sign_within_m: f64,
    /// Poles that one pass saw are two only beyond this distance, metres: no
    /// two stand so close, and a pole can be found twice.
    pub pole_double_m: f64,
    /// The same for signs of one kind, metres.
    pub sign_double_m: f64,
    /// Largest lateral distance of two sightings of one lane line, metres: a
    /// lane is ten times as wide, and double lines are told apart by the pass
    /// that saw both.
    pub lane_within_m: f64,
    /// Largest angle between two sightings of one lane line, radians.
    pub lane_angle_rad: f64,
    /// Largest difference in height of two sightings of one lane line, metres:
    /// a road over another is higher.
    pub lane_height_m: f64,
    /// Distance of the samples by which lane lines are compared, metres.
    pub lane_step_m: f64,
    /// Shortest part of a lane line that another pass adds to it, metres.
    pub shortest_piece_m: f64,
    /// Half length over which a lane line passes from one pass's position to
    /// the mean of several, metres: no step where one of them ends.
    pub blend_m: f64,
    /// Tolerance of a fused lane line's vertices, metres.
    pub tolerance_m: f64,
    /// Standard deviation of a position whose sighting tells none, metres per
    /// axis: what poles, signs and lines are off on generated drives.
    pub default_sigma_m: f64,
    /// Error that all points of a sighting share, metres per axis: pose of the
    /// pass and grid of the file. It is added to every covariance, so that many
    /// points of one pass do not outvote another pass.
    pub floor_sigma_m: f64,
}

impl Default for FuseConfig {
    fn default() -> Self {
        Self {
            pole_within_m: 0.5,
            sign_within_m: 0.4,
            pole_double_m: 0.2,
            sign_double_m: 0.15,
            lane_within_m: 0.3,
            lane_angle_rad: 0.15,
            lane_height_m: 1.0,
            lane_step_m: 1.0,
            shortest_piece_m: 2.0,
            blend_m: 4.0,
            tolerance_m: 0.03,
            default_sigma_m: 0.05,
            floor_sigma_m: 0.03,
        }
    }
}

/// A landmark as one pass over a place found it.
#[derive(Debug, Clone, PartialEq)]
pub struct Sighting<T> {
    /// The landmark.
    pub landmark: T,
    /// The pass that found it: any numbers, the same for the same pass.
    pub pass: u32,
    /// Covariance of its position (foot of a pole, centroid of a sign, any
    /// vertex of a lane line), map frame, square metres; none where it is not
    /// known.
    pub covariance_map_m2: Option<Matrix3<f64>>,
}

/// What one pass found, with its covariances (square metres) as far as there
/// are any.
pub fn sightings<T>(
    landmarks: Vec<T>,
    pass: u32,
    covariances_map_m2: &[Matrix3<f64>],
) -> impl Iterator<Item = Sighting<T>> {
    let covariances = covariances_map_m2.iter().copied().map(Some).chain(std::iter::repeat(None));
    let sighting = move |(landmark, covariance_map_m2)| Sighting { landmark, pass, covariance_map_m2 };
    landmarks.into_iter().zip(covariances).map(sighting)
}

/// A landmark out of one or more sightings.
#[derive(Debug, Clone, PartialEq)]
pub struct Fused<T> {
    /// The landmark; its road is that of its first sighting.
    pub landmark: T,
    /// Covariance of its position, map frame, square metres.
    pub covariance_map_m2: Matrix3<f64>,
    /// Its sightings, as indices into the list that was fused; the first is
    /// the one with the most certain position.
    pub sightings: Vec<usize>,
}
