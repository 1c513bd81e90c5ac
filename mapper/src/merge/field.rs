//! Small corrections of place and heading along the roads of a map.

use common::map::{RoadId, SemanticMap};
use nalgebra::{Point3, Vector3};

/// Unknowns of a node: shift along x, y, z (metres), turn about y (radians).
pub const UNKNOWNS: usize = 4;

/// The nodes of all maps: where corrections are, and how they follow on each
/// other. A landmark moves with the two nodes next to its place on its road.
#[derive(Debug, Default)]
pub struct Field {
    /// Places of the nodes, map frame, metres.
    pub nodes: Vec<Point3<f64>>,
    /// Neighbours along a road, and their distance in node spacings.
    pub edges: Vec<(usize, usize, f64)>,
    /// The map that each node is of.
    pub source: Vec<usize>,
    /// Per map and road.
    roads: Vec<Vec<RoadNodes>>,
    /// Corrections, [`UNKNOWNS`] per node.
    pub corrections: Vec<f64>,
}

/// The nodes along a road: where they stand on its path.
#[derive(Debug)]
struct RoadNodes {
    path: Vec<Point3<f64>>,
    stations_m: Vec<f64>,
    nodes: Vec<(f64, usize)>,
}

/// A point that moves with at most two nodes.
#[derive(Debug, Clone, Copy)]
pub struct Held {
    /// The point as its map has it, map frame, metres.
    pub point_map: Point3<f64>,
    /// Nodes and their shares, which sum to 1.
    pub by: [(usize, f64); 2],
}

impl Field {
    /// Lays nodes along the roads of maps, `node_m` apart.
    pub fn new<'a>(maps: impl Iterator<Item = &'a SemanticMap>, node_m: f64) -> Self {
        let mut field = Self::default();
        for (source, map) in maps.enumerate() {
            let mut roads: Vec<RoadNodes> = Vec::new();
            for road in &map.roads {
                let before = roads.last().and_then(|r: &RoadNodes| Some((*r.path.last()?, r.nodes.last()?.1)));
                roads.push(field.lay(&road.path_map, before, source, node_m));
            }
            if roads.is_empty() {
                // Landmarks without a road move together.
                roads.push(field.lay(&[Point3::origin()], None, source, node_m));
            }
            field.roads.push(roads);
        }
        field.corrections = vec![0.0; field.nodes.len() * UNKNOWNS];
        field
    }

    fn lay(
        &mut self,
        path: &[Point3<f64>],
        before: Option<(Point3<f64>, usize)>,
        source: usize,
        node_m: f64,
    ) -> RoadNodes {
        let mut stations_m = vec![0.0];
        let mut length_m = 0.0;
        for pair in path.windows(2) {
            length_m += (pair[1] - pair[0]).norm();
            stations_m.push(length_m);
        }
        let path = path.to_vec();
        let mut road = RoadNodes { path, stations_m, nodes: Vec::new() };
        let count = (length_m / node_m).ceil().clamp(0.0, 1e6) as usize;
        for k in 0..=count {
            let station_m = length_m * k as f64 / count.max(1) as f64;
            let point = road.at(station_m);
            // Roads that follow on each other share a node.
            let shared = before.filter(|(end, _)| k == 0 && (end - point).norm() < 1.0).map(|(_, node)| node);
            let node = shared.unwrap_or_else(|| {
                self.nodes.push(point);
                self.source.push(source);
                self.nodes.len() - 1
            });
            if let Some(&(last_m, last)) = road.nodes.last() {
                self.edges.push((last, node, ((station_m - last_m) / node_m).max(1e-3)));
            }
            road.nodes.push((station_m, node));
        }
        road
    }

    /// A landmark of a map at a point of one of its roads.
    pub fn hold(&self, source: usize, road: RoadId, point_map: &Point3<f64>) -> Option<Held> {
        let roads = self.roads.get(source)?;
        let road = roads.get(road.0 as usize).or_else(|| roads.first())?;
        let station_m = road.station_m(point_map);
        let after = road.nodes.partition_point(|n| n.0 < station_m).min(road.nodes.len() - 1);
        let (b_m, b) = *road.nodes.get(after)?;
        let (a_m, a) = *road.nodes.get(after.saturating_sub(1))?;
        let share = if b_m > a_m { ((station_m - a_m) / (b_m - a_m)).clamp(0.0, 1.0) } else { 0.0 };
        Some(Held { point_map: *point_map, by: [(a, 1.0 - share), (b, share)] })
    }

    /// Where a held point lies with the present corrections.
    pub fn place(&self, held: &Held) -> Point3<f64> {
        let mut moved = Vector3::zeros();
        for (node, share) in held.by {
            let Some(&[x, y, z, turn]) = self.corrections.get(node * UNKNOWNS..(node + 1) * UNKNOWNS) else { continue };
            let arm = held.point_map - self.nodes[node];
            moved += Vector3::new(x + turn * arm.z, y, z - turn * arm.x) * share;
        }
        held.point_map + moved
    }

    /// As [`Field::place`], of a point near a landmark's anchor, that moves
    /// with it.
    pub fn place_with(&self, held: &Held, point_map: &Point3<f64>) -> Point3<f64> {
        self.place(&Held { point_map: *point_map, by: held.by })
    }
}

impl RoadNodes {
    fn at(&self, station_m: f64) -> Point3<f64> {
        let i = self.stations_m.partition_point(|s| *s <= station_m).clamp(1, self.path.len().max(1));
        let (Some(a), Some(from)) = (self.path.get(i - 1), self.stations_m.get(i - 1)) else { return Point3::origin() };
        let (Some(b), Some(to)) = (self.path.get(i), self.stations_m.get(i)) else { return *a };
        a + (b - a) * ((station_m - from) / (to - from).max(1e-9)).clamp(0.0, 1.0)
    }

    fn station_m(&self, point: &Point3<f64>) -> f64 {
        let mut best = (f64::INFINITY, 0.0);
        for (pair, from) in self.path.windows(2).zip(&self.stations_m) {
            let way = pair[1] - pair[0];
            let share = ((point - pair[0]).dot(&way) / way.norm_squared().max(1e-12)).clamp(0.0, 1.0);
            let off = (point - (pair[0] + way * share)).norm_squared();
            if off < best.0 {
                best = (off, from + share * way.norm());
            }
        }
        best.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::map::Road;

    fn map() -> SemanticMap {
        let path = |from: f64, to: f64| Road { path_map: vec![Point3::new(0.0, 0.0, from), Point3::new(0.0, 0.0, to)] };
        SemanticMap { roads: vec![path(0.0, 50.0), path(50.0, 100.0), path(300.0, 310.0)], ..SemanticMap::default() }
    }

    #[test]
    fn roads_that_follow_on_each_other_move_together() {
        let map = map();
        let mut field = Field::new([&map, &map].into_iter(), 25.0);
        assert_eq!(field.nodes.len(), 2 * 7);
        assert_eq!(field.edges.len(), 2 * 5);
        field.corrections[2 * UNKNOWNS] = 1.0;
        let x = |z: f64, road| {
            let held = field.hold(0, RoadId(road), &Point3::new(4.0, 1.0, z)).unwrap();
            field.place(&held).x - 4.0
        };
        assert!((x(50.0, 0) - 1.0).abs() < 1e-12 && (x(50.0, 1) - 1.0).abs() < 1e-12);
        assert!((x(37.5, 0) - 0.5).abs() < 1e-12 && (x(62.5, 1) - 0.5).abs() < 1e-12);
        assert!(x(90.0, 1).abs() < 1e-12 && x(305.0, 2).abs() < 1e-12);
        let other = field.hold(1, RoadId(0), &Point3::new(4.0, 1.0, 50.0)).unwrap();
        assert!((field.place(&other).x - 4.0).abs() < 1e-12);
    }

    #[test]
    fn a_turn_is_about_the_axis_that_points_down() {
        let map = map();
        let mut field = Field::new(std::iter::once(&map), 25.0);
        let turn_rad = 1e-3;
        field.corrections[3] = turn_rad;
        let point = Point3::new(3.0, 1.0, 0.0);
        let held = field.hold(0, RoadId(0), &point).unwrap();
        let turned = nalgebra::Rotation3::from_axis_angle(&Vector3::y_axis(), turn_rad) * point;
        assert!((field.place(&held) - turned).norm() < 1e-5);
    }

    #[test]
    fn a_map_without_roads_moves_as_one() {
        let field = Field::new([&SemanticMap::default()].into_iter(), 25.0);
        assert!(field.hold(0, RoadId(3), &Point3::new(3.0, 1.0, 9.0)).is_some());
    }
}
