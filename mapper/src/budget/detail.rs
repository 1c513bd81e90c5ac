//! How finely a map is written.

use common::map::{LaneLine, Road, SemanticMap, marks_along};
use nalgebra::{Matrix3, Point3};
use serde::Serialize;

use super::Known;
use crate::evidence::{LineEvidence, MapEvidence, PointEvidence};
use crate::lanes::simplify;

/// How finely a map is written.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Detail {
    /// Step of all coordinates, metres.
    pub quantum_m: f64,
    /// By how much lane lines may be simplified, metres.
    pub lane_tolerance_m: f64,
    /// By how much the roads' paths may be simplified, metres.
    pub road_tolerance_m: f64,
    /// Whether dashed lines keep their marks.
    pub marks: bool,
}

impl From<[f64; 3]> for Detail {
    fn from([quantum_m, lane_tolerance_m, road_tolerance_m]: [f64; 3]) -> Self {
        Self { quantum_m, lane_tolerance_m, road_tolerance_m, marks: true }
    }
}

/// The middle of a mark lies no farther off the chord of its line, metres: a
/// mark of 10 m on a curve of 50 m.
const MARK_OFF_M: f64 = 0.25;

impl Detail {
    /// A map as it is.
    pub fn unchanged(quantum_m: f64) -> Self {
        Self { quantum_m, lane_tolerance_m: 0.0, road_tolerance_m: 0.0, marks: true }
    }

    /// The same without marks.
    #[must_use]
    pub fn without_marks(self) -> Self {
        Self { marks: false, ..self }
    }

    /// A map with fewer vertices, and what its landmarks are still known to:
    /// the coarser grid adds `quantum^2 / 12` to each axis, a simplified line
    /// what its lost vertices lie off it.
    pub fn applied(&self, whole: Known<'_>) -> (SemanticMap, MapEvidence) {
        let road = |road: &Road| Road { path_map: thinned(&road.path_map, self.road_tolerance_m) };
        let lane = |lane: &LaneLine| {
            let points_map = thinned(&lane.points_map, self.lane_tolerance_m);
            let marks_m = match (self.marks, points_map.len() == lane.points_map.len()) {
                (false, _) => Vec::new(),
                (true, true) => lane.marks_m.clone(),
                (true, false) => {
                    marks_along(&points_map, &lane.marks_map().collect::<Vec<_>>(), self.lane_tolerance_m + MARK_OFF_M)
                }
            };
            LaneLine { points_map, marks_m, ..*lane }
        };
        let map = SemanticMap {
            roads: whole.map.roads.iter().map(road).collect(),
            lanes: whole.map.lanes.iter().map(lane).collect(),
            ..whole.map.clone()
        };
        let rounding_m2 = ((self.quantum_m.powi(2) - whole.quantum_m.powi(2)) / 12.0).max(0.0);
        let point = |own: &PointEvidence| {
            PointEvidence::new(&(own.covariance() + Matrix3::identity() * rounding_m2), own.points, own.scans)
        };
        let line = |(own, (thin, full)): (&LineEvidence, (&LaneLine, &LaneLine))| {
            let [lateral_m2, vertical_m2] = off_m2(&full.points_map, &thin.points_map);
            LineEvidence {
                lateral_sigma_m: (own.lateral_sigma_m.powi(2) + rounding_m2 + lateral_m2).sqrt(),
                vertical_sigma_m: (own.vertical_sigma_m.powi(2) + rounding_m2 + vertical_m2).sqrt(),
                ..*own
            }
        };
        let lines = map.lanes.iter().zip(&whole.map.lanes);
        let evidence = MapEvidence {
            poles: whole.evidence.poles.iter().map(point).collect(),
            signs: whole.evidence.signs.iter().map(point).collect(),
            lanes: whole.evidence.lanes.iter().zip(lines).map(line).collect(),
        };
        (map, evidence)
    }
}

/// Mean square of how far the vertices of a polyline lie beside a simpler one,
/// square metres: horizontally and in height.
fn off_m2(full: &[Point3<f64>], thin: &[Point3<f64>]) -> [f64; 2] {
    if full.len() == thin.len() {
        return [0.0; 2];
    }
    let mut sum = [0.0; 2];
    for p in full {
        let off = thin.windows(2).map(|ends| {
            let along = ends[1] - ends[0];
            let share = ((p - ends[0]).dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
            p - (ends[0] + along * share)
        });
        if let Some(off) = off.min_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared())) {
            sum = [sum[0] + off.x * off.x + off.z * off.z, sum[1] + off.y * off.y];
        }
    }
    sum.map(|sum| sum / full.len().max(1) as f64)
}

fn thinned(points: &[Point3<f64>], tolerance_m: f64) -> Vec<Point3<f64>> {
    if tolerance_m <= 0.0 {
        return points.to_vec();
    }
    simplify(points, tolerance_m).into_iter().filter_map(|i| points.get(i).copied()).collect()
}
