//! Uncertainty of lane lines.

use common::map::LaneLine;
use nalgebra::{Point2, Point3, Vector1};

use super::scatter::{Components, Scatter};
use super::{EvidenceConfig, LineEvidence};
use crate::by_cell::ByCell;
use crate::cloud::{Cloud, CloudPoint};
use crate::config::Config;
use crate::grid::Grid;

/// The paint of a cloud, by place.
pub struct LinePoints {
    points: ByCell<(Point3<f64>, u16)>,
    grid: Grid,
}

/// Edge of the cells, metres: a few times the reach of a line.
const CELL_M: f64 = 1.0;

impl LinePoints {
    /// The paint of a cloud: what is brighter than its beam on both sides.
    pub fn of(cloud: &Cloud, config: &Config) -> Self {
        let lanes = &config.lanes;
        let is_paint = |p: &&CloudPoint| {
            p.contrast.is_some_and(|contrast| contrast >= lanes.least_contrast)
                && f64::from(p.height_m.abs()) < lanes.thickness_m
        };
        let points: Vec<(Point3<f64>, u16)> =
            cloud.points.iter().filter(is_paint).map(|p| (p.position, p.scan)).collect();
        let (mut low, mut high) = (Point2::new(0.0, 0.0), Point2::new(0.0, 0.0));
        for (k, (p, _)) in points.iter().enumerate() {
            let at = Point2::new(p.x, p.z);
            (low, high) = if k == 0 { (at, at) } else { (low.inf(&at), high.sup(&at)) };
        }
        let grid = Grid::covering(low, high, CELL_M);
        let points = ByCell::new(&grid, points.iter().map(|p| (grid.index(&Point2::new(p.0.x, p.0.z)), *p)));
        Self { points, grid }
    }

    /// Points near map (x, z).
    fn near(&self, at: &Point2<f64>) -> impl Iterator<Item = &(Point3<f64>, u16)> {
        self.points.near(at, 1, &self.grid)
    }
}

/// How well a lane line is known, from the paint of its cloud, across and in
/// height: how well the line follows the paint of each piece, and how well the
/// scans that painted it agree there. Of kerbs the paint says nothing.
pub fn of_lane(paint: &LinePoints, lane: &LaneLine, config: &EvidenceConfig) -> LineEvidence {
    let sigma_m = config.unknown_sigma_m;
    let unknown = LineEvidence { lateral_sigma_m: sigma_m, vertical_sigma_m: sigma_m, points: 0, scans: 0 };
    if !lane.kind.is_painted() {
        return unknown;
    }
    let (mut lateral, mut vertical) = (Scatter::<1>::default(), Scatter::<1>::default());
    let mut station_m = 0.0;
    for ends in lane.points_map.windows(2) {
        let along = ends[1] - ends[0];
        let length_m = along.x.hypot(along.z);
        if length_m < 1e-6 {
            continue;
        }
        let steps = (length_m / CELL_M).ceil().max(1.0);
        for step in 0..steps as usize {
            let (from, to) = (length_m * step as f64 / steps, length_m * (step + 1) as f64 / steps);
            let middle = ends[0] + along * (f64::midpoint(from, to) / length_m);
            for (p, scan) in paint.near(&Point2::new(middle.x, middle.z)) {
                let d = p - ends[0];
                let at_m = (d.x * along.x + d.z * along.z) / length_m;
                let off_m = (d.x * along.z - d.z * along.x) / length_m;
                if at_m >= from && at_m < to && off_m.abs() < config.reach_m {
                    let piece = ((station_m + at_m) / config.piece_m).floor() as i64;
                    lateral.add(*scan, piece, Vector1::new(off_m));
                    let height_m = -(d.y - along.y * at_m / length_m);
                    vertical.add(*scan, piece, Vector1::new(height_m));
                }
            }
        }
        station_m += length_m;
    }
    if lateral.points() == 0 {
        return unknown;
    }
    let sigma_m = |scatter: &Scatter<1>| (place_m2(scatter, config) + config.floor_m.powi(2)).sqrt();
    LineEvidence {
        lateral_sigma_m: rounded(sigma_m(&lateral)),
        vertical_sigma_m: rounded(sigma_m(&vertical)),
        points: lateral.points(),
        scans: lateral.scans(),
    }
}

fn rounded(metres: f64) -> f64 {
    (metres * 1e4).round() / 1e4
}

/// Variance of the line at a place, square metres: that of the mean of the
/// scans that saw the place, and how far the line lies beside that mean.
fn place_m2(scatter: &Scatter<1>, config: &EvidenceConfig) -> f64 {
    let Components { cell, scan, .. } = scatter.components(config);
    let mut pieces: std::collections::BTreeMap<i64, (f64, f64)> = std::collections::BTreeMap::new();
    for (_, piece, mean) in scatter.cells() {
        let sum = pieces.entry(piece).or_insert((0.0, 0.0));
        *sum = (sum.0 + mean.x, sum.1 + 1.0);
    }
    let variance = |(sum, scans): &(f64, f64)| {
        let mean_m2 = (cell + scan) / scans;
        // The mean lies off the line by its own error, too: what is more is
        // the line's.
        mean_m2 + ((sum / scans).powi(2) - mean_m2).max(0.0)
    };
    pieces.values().map(variance).sum::<f64>() / pieces.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{CAMERA_HEIGHT_M, Street};
    use common::map::{LaneKind, RoadId};

    fn line(x: f64) -> LaneLine {
        let points_map = [5.0, 30.0, 50.0].map(|z| Point3::new(x, CAMERA_HEIGHT_M, z)).to_vec();
        LaneLine { kind: LaneKind::Solid, points_map, road: RoadId(0), marks_m: Vec::new() }
    }

    #[test]
    fn a_line_beside_its_paint_is_known_to_be_off() {
        let mut street = Street::new();
        for i in 0..1500 {
            let z = f64::from(i) * 0.04;
            let wobble = 0.04 * (f64::from(i) * 1.7).sin();
            street.add(Point3::new(1.75 + wobble, CAMERA_HEIGHT_M, z), (i / 150) as u16, 0.5, Some(8.0));
        }
        let config = Config::default();
        let paint = LinePoints::of(&street.cloud(), &config);
        let on = of_lane(&paint, &line(1.75), &config.evidence);
        let off = of_lane(&paint, &line(1.85), &config.evidence);
        assert!(on.lateral_sigma_m < 0.05 && on.points > 900, "{on:?}");
        assert!(off.lateral_sigma_m > 0.08, "{off:?}");
        let none = of_lane(&paint, &line(-4.0), &config.evidence);
        assert_eq!((none.points, none.scans), (0, 0));
    }
}
