//! How well each landmark is known, from the points that it was made of.
//!
//! The map file has no room for it; it stands in the report beside the map,
//! in the order of the landmarks in the file. It is measured on the stitched
//! cloud and not in the fits, so that it judges a landmark however it was
//! found: points of one scan share that scan's pose error, so scans and not
//! points are what is counted as independent.

mod book;
mod config;
mod lanes;
mod poles;
mod scatter;
mod signs;

use common::map::SemanticMap;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

pub use book::EvidenceBook;
pub use config::EvidenceConfig;
pub use lanes::{LinePoints, of_lane};
pub use poles::of_pole;
pub use signs::of_sign;

/// How well the landmarks of a map are known, in the order in which they are
/// decoded from its file.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapEvidence {
    /// Feet of the poles.
    pub poles: Vec<PointEvidence>,
    /// Centroids of the signs.
    pub signs: Vec<PointEvidence>,
    /// Lane lines.
    pub lanes: Vec<LineEvidence>,
}

/// How well a point of the map is known: the foot of a pole, the centroid of a
/// sign.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointEvidence {
    /// Covariance of the point, map axes (x right, y down, z forward), square
    /// metres. It holds against the drive's own trajectory near by: a drift
    /// that moves everything there together is no part of it.
    pub covariance_map_m2: [[f64; 3]; 3],
    /// Points of the cloud that lie on the landmark.
    pub points: usize,
    /// Scans that they are from.
    pub scans: usize,
}

/// Covariances of the points of some landmarks, in their order: what is needed
/// to weigh several sightings of one.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PointCovariances {
    /// Of the feet of poles, map axes, square metres.
    pub poles: Vec<Matrix3<f64>>,
    /// Of the centroids of signs.
    pub signs: Vec<Matrix3<f64>>,
}

/// How well a lane line is known, on average along it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineEvidence {
    /// Standard deviation across the line, metres.
    pub lateral_sigma_m: f64,
    /// Standard deviation in height, metres.
    pub vertical_sigma_m: f64,
    /// Points of paint on it.
    pub points: usize,
    /// Scans that they are from.
    pub scans: usize,
}

impl PointEvidence {
    /// Evidence with this covariance, square metres.
    pub fn new(covariance_map_m2: &Matrix3<f64>, points: usize, scans: usize) -> Self {
        let c = covariance_map_m2;
        // A tenth of a millimetre is finer than anyone can tell: short numbers.
        let rounded = |i: usize, j: usize| (f64::midpoint(c[(i, j)], c[(j, i)]) * 1e8).round() / 1e8;
        Self { covariance_map_m2: [0, 1, 2].map(|i| [0, 1, 2].map(|j| rounded(i, j))), points, scans }
    }

    /// The covariance as a matrix, square metres.
    pub fn covariance(&self) -> Matrix3<f64> {
        let c = &self.covariance_map_m2;
        Matrix3::from_fn(|i, j| c[i][j])
    }

    /// Standard deviation along a direction (unit vector, map frame), metres.
    pub fn sigma_m(&self, direction_map: &Vector3<f64>) -> f64 {
        direction_map.dot(&(self.covariance() * direction_map)).max(0.0).sqrt()
    }
}

impl MapEvidence {
    /// What is assumed of a map that has no report beside it.
    pub fn assumed(map: &SemanticMap, config: &EvidenceConfig) -> Self {
        let point = |sigma: [f64; 3]| {
            let variances = Vector3::from(sigma).map(|s| s * s);
            PointEvidence::new(&Matrix3::from_diagonal(&variances), 0, 0)
        };
        let (along, up) = (config.unknown_sigma_m, config.unknown_vertical_sigma_m);
        let line = LineEvidence { lateral_sigma_m: along, vertical_sigma_m: along, points: 0, scans: 0 };
        Self {
            poles: vec![point([along, up, along]); map.poles.len()],
            signs: vec![point([along, up, along]); map.signs.len()],
            lanes: vec![line; map.lanes.len()],
        }
    }

    /// Those of its poles and signs.
    pub fn covariances(&self) -> PointCovariances {
        let all = |list: &[PointEvidence]| list.iter().map(PointEvidence::covariance).collect();
        PointCovariances { poles: all(&self.poles), signs: all(&self.signs) }
    }

    /// Whether it has one entry for each landmark of a map.
    pub fn fits(&self, map: &SemanticMap) -> bool {
        self.poles.len() == map.poles.len()
            && self.signs.len() == map.signs.len()
            && self.lanes.len() == map.lanes.len()
    }
}
