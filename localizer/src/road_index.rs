//! Where on the map the camera is: road stretches near a position, and the
//! landmarks that belong to them.
//!
//! A query costs the same on a map of any length: stretches are found through
//! a sorted grid of the survey's path, landmarks through their road.

use common::map::SemanticMap;
use nalgebra::{Point3, Vector3};

/// Side of a grid cell, metres: about the length of a road stretch.
const CELL_M: f64 = 50.0;

/// The survey's path near a position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPlace {
    /// The nearest point of the path, map frame, metres: where the survey's
    /// camera was.
    pub point_map: Point3<f64>,
    /// Unit direction in which the survey drove there.
    pub forward_map: Vector3<f64>,
}

/// Landmarks by road, roads by place.
#[derive(Debug, Clone, Default)]
pub struct RoadIndex {
    /// Sorted by cell, then road.
    cells: Vec<((i32, i32), u32)>,
    poles: ByRoad,
    lanes: ByRoad,
    signs: ByRoad,
}

/// Indices grouped by road: those of road `r` are `items[starts[r]..starts[r + 1]]`.
#[derive(Debug, Clone, Default)]
struct ByRoad {
    starts: Vec<usize>,
    items: Vec<usize>,
}

impl ByRoad {
    fn new(roads: usize, road_of: impl Iterator<Item = u32>) -> Self {
        let mut pairs: Vec<(u32, usize)> = road_of.enumerate().map(|(item, road)| (road, item)).collect();
        pairs.sort_unstable();
        let starts = (0..=roads as u32).map(|road| pairs.partition_point(|&(r, _)| r < road)).collect();
        Self { starts, items: pairs.into_iter().map(|(_, item)| item).collect() }
    }

    fn of(&self, road: u32) -> &[usize] {
        let bounds = self.starts.get(road as usize).zip(self.starts.get(road as usize + 1));
        bounds.and_then(|(&start, &end)| self.items.get(start..end)).unwrap_or(&[])
    }
}

fn cell(point: &Point3<f64>) -> (i32, i32) {
    ((point.x / CELL_M).floor() as i32, (point.z / CELL_M).floor() as i32)
}

impl RoadIndex {
    /// Indexes a map.
    pub fn new(map: &SemanticMap) -> Self {
        let mut cells = Vec::new();
        for (road, stretch) in map.roads.iter().enumerate() {
            cells.extend(stretch.path_map.iter().map(|p| (cell(p), road as u32)));
            for ends in stretch.path_map.windows(2) {
                let [a, b] = [ends[0], ends[1]];
                // A long straight edge passes through cells without a vertex.
                let steps = ((b - a).norm() / (0.5 * CELL_M)).ceil() as usize;
                cells.extend((1..steps).map(|i| (cell(&(a + (b - a) * (i as f64 / steps as f64))), road as u32)));
            }
        }
        cells.sort_unstable();
        cells.dedup();
        let roads = map.roads.len();
        Self {
            cells,
            poles: ByRoad::new(roads, map.poles.iter().map(|p| p.road.0)),
            lanes: ByRoad::new(roads, map.lanes.iter().map(|l| l.road.0)),
            signs: ByRoad::new(roads, map.signs.iter().map(|s| s.road.0)),
        }
    }

    /// Fills `roads` with the stretches that pass within about `reach_m` of
    /// the position (whole cells), ascending.
    pub fn roads_near(&self, position_map: &Point3<f64>, reach_m: f64, roads: &mut Vec<u32>) {
        roads.clear();
        let reach = Vector3::repeat(reach_m);
        let (low, high) = (cell(&(position_map - reach)), cell(&(position_map + reach)));
        for x in low.0..=high.0 {
            let start = self.cells.partition_point(|&(c, _)| c < (x, low.1));
            let column = self.cells[start..].iter().take_while(|&&(c, _)| c <= (x, high.1));
            roads.extend(column.map(|&(_, road)| road));
        }
        roads.sort_unstable();
        roads.dedup();
    }

    /// Poles of a road, as indices into the map.
    pub fn poles(&self, road: u32) -> &[usize] {
        self.poles.of(road)
    }

    /// Lane lines of a road, as indices into the map.
    pub fn lanes(&self, road: u32) -> &[usize] {
        self.lanes.of(road)
    }

    /// Signs of a road, as indices into the map.
    pub fn signs(&self, road: u32) -> &[usize] {
        self.signs.of(road)
    }
}

/// The place on the paths of `roads` that is nearest to a position in the
/// horizontal plane; none where no path has two distinct points.
pub fn nearest_path(map: &SemanticMap, roads: &[u32], position_map: &Point3<f64>) -> Option<PathPlace> {
    let mut best: Option<(f64, PathPlace)> = None;
    let stretches = roads.iter().filter_map(|&road| map.roads.get(road as usize));
    for ends in stretches.flat_map(|stretch| stretch.path_map.windows(2)) {
        let along = ends[1] - ends[0];
        let length2 = along.x * along.x + along.z * along.z;
        let Some(forward_map) = along.try_normalize(1e-6).filter(|_| length2 > 1e-12) else { continue };
        let to = position_map - ends[0];
        let fraction = ((to.x * along.x + to.z * along.z) / length2).clamp(0.0, 1.0);
        let point_map = ends[0] + along * fraction;
        let off = position_map - point_map;
        let distance2 = off.x * off.x + off.z * off.z;
        if best.as_ref().is_none_or(|(least, _)| distance2 < *least) {
            best = Some((distance2, PathPlace { point_map, forward_map }));
        }
    }
    best.map(|(_, place)| place)
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::map::{Pole, PoleKind, Road, RoadId};

    fn two_roads() -> SemanticMap {
        let pole = |z: f64, road| Pole {
            kind: PoleKind::LampPost,
            foot_map: Point3::new(5.0, 1.6, z),
            top_map: Point3::new(5.0, -6.0, z),
            road: RoadId(road),
        };
        SemanticMap {
            roads: vec![
                Road { path_map: vec![Point3::new(0.0, 0.0, 0.0), Point3::new(0.0, -2.0, 200.0)] },
                Road { path_map: vec![Point3::new(0.0, -2.0, 200.0), Point3::new(0.0, 0.0, 900.0)] },
            ],
            poles: vec![pole(300.0, 1), pole(10.0, 0), pole(20.0, 0)],
            ..SemanticMap::default()
        }
    }

    #[test]
    fn only_near_roads_are_found_and_their_landmarks() {
        let index = RoadIndex::new(&two_roads());
        let mut roads = vec![7];
        index.roads_near(&Point3::new(3.0, 0.0, 20.0), 40.0, &mut roads);
        assert_eq!(roads, [0]);
        assert_eq!(index.poles(0), [1, 2]);
        // No vertex of road 1 is near here, but its edge is.
        index.roads_near(&Point3::new(3.0, 0.0, 600.0), 40.0, &mut roads);
        assert_eq!(roads, [1]);
        index.roads_near(&Point3::new(5e4, 0.0, 600.0), 40.0, &mut roads);
        assert!(roads.is_empty());
        assert!(index.poles(99).is_empty());
    }

    #[test]
    fn the_path_gives_height_and_direction() {
        let place = nearest_path(&two_roads(), &[0, 1], &Point3::new(4.0, 9.0, 100.0)).unwrap();
        assert!((place.point_map - Point3::new(0.0, -1.0, 100.0)).norm() < 1e-9);
        assert!(place.forward_map.z > 0.99 && place.forward_map.y < 0.0);
        assert!(nearest_path(&two_roads(), &[], &Point3::origin()).is_none());
    }
}
