//! Evidence gathered window by window, handed out in the order of the map.

use common::geometry::distance_to_polyline;
use common::map::{LaneLine, Pole, SemanticMap, Sign};
use nalgebra::{Matrix3, Point3};
use rayon::prelude::*;

use super::{
    EvidenceConfig, LineEvidence, LinePoints, MapEvidence, PointCovariances, PointEvidence, of_lane, of_pole, of_sign,
};
use crate::cloud::Cloud;
use crate::config::Config;
use crate::fuse::length_m;

/// What was measured on the landmarks of each window of a drive. A landmark of
/// the map is found in it by its place, however those of the windows were
/// joined.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EvidenceBook {
    poles: Vec<(Point3<f64>, PointEvidence)>,
    signs: Vec<(Point3<f64>, PointEvidence)>,
    lanes: Vec<(LaneLine, LineEvidence)>,
}

/// Largest distance between a landmark of the map and what it was joined from,
/// metres: less than between any two of one kind.
const SAME_M: f64 = 0.3;

impl EvidenceBook {
    /// Measures the landmarks of a window on its cloud, and returns how well
    /// these are known.
    pub fn add(
        &mut self,
        cloud: &Cloud,
        poles: &[Pole],
        signs: &[Sign],
        lanes: &[LaneLine],
        config: &Config,
    ) -> PointCovariances {
        let settings = &config.evidence;
        let points = || MapEvidence {
            poles: poles.par_iter().map(|pole| of_pole(cloud, pole, settings)).collect(),
            signs: signs.par_iter().map(|sign| of_sign(cloud, sign, settings, &config.lidar)).collect(),
            lanes: Vec::new(),
        };
        let lines = || -> Vec<(LaneLine, LineEvidence)> {
            if lanes.is_empty() {
                return Vec::new();
            }
            let paint = LinePoints::of(cloud, config);
            lanes.iter().map(|lane| (lane.clone(), of_lane(&paint, lane, settings))).collect()
        };
        let (known, lines) = rayon::join(points, lines);
        self.poles.extend(poles.iter().map(|pole| pole.foot_map).zip(known.poles.iter().copied()));
        self.signs.extend(signs.iter().map(|sign| sign.centroid_map).zip(known.signs.iter().copied()));
        self.lanes.extend(lines);
        known.covariances()
    }

    /// The evidence of each landmark of a map, in its order. Rounding to the
    /// quantum (metres) of its file adds `quantum^2 / 12` per axis.
    pub fn of_map(&self, map: &SemanticMap, quantum_m: f64, config: &EvidenceConfig) -> MapEvidence {
        let assumed = MapEvidence::assumed(map, config);
        let rounding_m2 = quantum_m * quantum_m / 12.0;
        let point = |book: &[(Point3<f64>, PointEvidence)], at: &Point3<f64>, unknown: &PointEvidence| {
            let own = at_place(book, at, quantum_m, config.floor_m).unwrap_or(*unknown);
            PointEvidence::new(&(own.covariance() + Matrix3::identity() * rounding_m2), own.points, own.scans)
        };
        let line = |lane: &LaneLine, unknown: &LineEvidence| self.line(lane, rounding_m2).unwrap_or(*unknown);
        MapEvidence {
            poles: map.poles.iter().zip(&assumed.poles).map(|(p, u)| point(&self.poles, &p.foot_map, u)).collect(),
            signs: map.signs.iter().zip(&assumed.signs).map(|(s, u)| point(&self.signs, &s.centroid_map, u)).collect(),
            lanes: map.lanes.iter().zip(&assumed.lanes).map(|(l, u)| line(l, u)).collect(),
        }
    }

    /// Evidence of a lane line: that of the lines it was joined from, by the
    /// length of it that lies beside each.
    fn line(&self, lane: &LaneLine, rounding_m2: f64) -> Option<LineEvidence> {
        let samples = samples(lane);
        let mut sum = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (own, evidence) in &self.lanes {
            let beside = samples.iter().filter(|(p, _)| distance_to_polyline(p, &own.points_map) < SAME_M);
            let beside_m: f64 = beside.map(|(_, length_m)| length_m).sum();
            sum.0 += beside_m;
            sum.1 += beside_m * evidence.lateral_sigma_m.powi(2);
            sum.2 += beside_m * evidence.vertical_sigma_m.powi(2);
            // A piece of that line has its share of the points.
            let share = (beside_m / length_m(&own.points_map).max(1e-9)).min(1.0);
            sum.3 += share * evidence.points as f64;
            sum.4 += share * evidence.scans as f64;
        }
        (sum.0 > 0.0).then(|| {
            let sigma_m = |sum_m2: f64| ((sum_m2 / sum.0 + rounding_m2).sqrt() * 1e4).round() / 1e4;
            LineEvidence {
                lateral_sigma_m: sigma_m(sum.1),
                vertical_sigma_m: sigma_m(sum.2),
                points: sum.3.round() as usize,
                scans: sum.4.round() as usize,
            }
        })
    }
}

/// The evidence at a place: that of the landmark that was found there, or of
/// the several that were joined to the one there. Each of these adds its
/// information, but for the error that they have in common.
fn at_place(
    book: &[(Point3<f64>, PointEvidence)],
    at: &Point3<f64>,
    quantum_m: f64,
    common_m: f64,
) -> Option<PointEvidence> {
    let near = || book.iter().filter(|(place, _)| (place - at).norm() < SAME_M);
    let off = |place: &Point3<f64>| (place - at).norm();
    let (nearest, own) = near().min_by(|a, b| off(&a.0).total_cmp(&off(&b.0)))?;
    if off(nearest) <= quantum_m {
        return Some(*own);
    }
    let common_m2 = Matrix3::identity() * common_m * common_m;
    let mut information = Matrix3::zeros();
    let (mut points, mut scans) = (0, 0);
    for (_, own) in near() {
        information += (own.covariance() - common_m2).try_inverse()?;
        points += own.points;
        scans += own.scans;
    }
    Some(PointEvidence::new(&(information.try_inverse()? + common_m2), points, scans))
}

/// The middles and the lengths (metres) of a line's edges, none longer than a
/// few metres.
fn samples(lane: &LaneLine) -> Vec<(Point3<f64>, f64)> {
    const STEP_M: f64 = 4.0;
    let edge = |ends: &[Point3<f64>]| {
        let (from, along) = (ends[0], ends[1] - ends[0]);
        let length_m = along.norm();
        let steps = (length_m / STEP_M).ceil().max(1.0);
        (0..steps as usize).map(move |i| (from + along * ((i as f64 + 0.5) / steps), length_m / steps))
    };
    lane.points_map.windows(2).flat_map(edge).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::map::{LaneKind, PoleKind, Road, RoadId};
    use nalgebra::Vector3;

    fn pole(x: f64) -> Pole {
        let foot_map = Point3::new(x, 1.6, 9.0);
        Pole { kind: PoleKind::LampPost, foot_map, top_map: foot_map - Vector3::y() * 4.0, road: RoadId(0) }
    }

    fn evidence(sigma_m: f64) -> PointEvidence {
        PointEvidence::new(&(Matrix3::identity() * sigma_m * sigma_m), 20, 3)
    }

    #[test]
    fn the_map_gets_its_evidence_in_its_own_order_and_joined_landmarks_are_surer() {
        let lane = |z: [f64; 2]| LaneLine {
            kind: LaneKind::Solid,
            points_map: z.map(|z| Point3::new(2.0, 1.6, z)).to_vec(),
            road: RoadId(0),
            marks_m: Vec::new(),
        };
        let line = |sigma_m| LineEvidence { lateral_sigma_m: sigma_m, vertical_sigma_m: sigma_m, points: 50, scans: 4 };
        let book = EvidenceBook {
            poles: vec![
                (pole(5.0).foot_map, evidence(0.04)),
                (pole(-5.0).foot_map, evidence(0.02)),
                (pole(5.1).foot_map, evidence(0.04)),
            ],
            signs: Vec::new(),
            lanes: vec![(lane([0.0, 20.0]), line(0.02)), (lane([20.0, 40.0]), line(0.04))],
        };
        let map = SemanticMap {
            roads: vec![Road { path_map: vec![Point3::origin(), Point3::new(0.0, 0.0, 50.0)] }],
            poles: vec![pole(-5.0), pole(5.05), pole(30.0)],
            lanes: vec![lane([0.0, 40.0])],
            ..SemanticMap::default()
        };
        let config = EvidenceConfig::default();
        let config = EvidenceConfig { floor_m: 0.0, ..config };
        let found = book.of_map(&map, 0.0, &config);
        assert!(found.fits(&map));
        let sigma = |i: usize| found.poles[i].sigma_m(&Vector3::x());
        assert!((sigma(0) - 0.02).abs() < 1e-4 && (sigma(1) - 0.04 / 2.0_f64.sqrt()).abs() < 1e-4);
        assert!((sigma(2) - config.unknown_sigma_m).abs() < 1e-4 && found.poles[1].scans == 6);
        assert!((found.lanes[0].lateral_sigma_m - 0.001_f64.sqrt()).abs() < 1e-4, "{:?}", found.lanes);
        // All of both lines.
        assert_eq!((found.lanes[0].points, found.lanes[0].scans), (100, 8));
        // A quarter of the first.
        let part = SemanticMap { lanes: vec![lane([0.0, 5.0])], ..map };
        assert_eq!(book.of_map(&part, 0.0, &config).lanes[0].points, 13);
    }
}
