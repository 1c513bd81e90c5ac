//! Which roads of a map pass a place, and which landmarks belong to them.
//!
//! A query costs the same on a map of any length: stretches are found through
//! a sorted grid of the survey's path, landmarks through their road.

use common::map::SemanticMap;
use nalgebra::{Point3, Vector3};

/// Side of a grid cell, metres: about the length of a road stretch.
const CELL_M: f64 = 50.0;

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

/// A rectangle of whole grid cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cells {
    low: (i32, i32),
    high: (i32, i32),
}

impl Cells {
    /// The cells that come within `reach_m` of a position, to each side.
    pub fn around(position_map: &Point3<f64>, reach_m: f64) -> Self {
        let reach = Vector3::repeat(reach_m);
        Self { low: cell(&(position_map - reach)), high: cell(&(position_map + reach)) }
    }

    /// Smallest x and z, largest x and z, metres.
    pub fn corners_m(&self) -> ([f64; 2], [f64; 2]) {
        let edge = |index: i32, beyond: f64| (f64::from(index) + beyond) * CELL_M;
        ([edge(self.low.0, 0.0), edge(self.low.1, 0.0)], [edge(self.high.0, 1.0), edge(self.high.1, 1.0)])
    }
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

    /// The stretches that pass through these cells, in no order, some of them
    /// several times.
    pub fn roads_in(&self, cells: &Cells) -> impl Iterator<Item = u32> {
        let (low, high) = (cells.low, cells.high);
        // No column without any road is looked at, however wide the query.
        let ends = self.cells.first().zip(self.cells.last());
        let (first, last) = ends.map_or((0, -1), |(first, last)| (low.0.max(first.0.0), high.0.min(last.0.0)));
        (first..=last).flat_map(move |x| {
            let start = self.cells.partition_point(|&(c, _)| c < (x, low.1));
            let column = self.cells.get(start..).unwrap_or(&[]);
            column.iter().take_while(move |&&(c, _)| c <= (x, high.1)).map(|&(_, road)| road)
        })
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
