//! The nearest place of a path to points anywhere, however long the path is.

use nalgebra::{Point2, center, distance};
use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};

use super::{Path, PathPlace, ROUNDING_M, ground};

/// Edge of the cells whose points look at the same segments, metres: some steps of a vehicle.
const CELL_M: f64 = 8.0;
/// Farthest coordinate of a point that is in a cell, metres: beyond it cells are no longer exact.
const FARTHEST_M: f64 = 1e9;
/// Segments that are passed over together where all of them are too far away.
const GROUP: usize = 64;

/// A cell of the ground plane.
type Cell = (i64, i64);

/// As [`Path::place`], to the bit: for each cell that points lie in, the segments are found that
/// may be the nearest to one of them.
#[derive(Debug)]
pub struct QuickPath<'a> {
    path: &'a Path,
    /// Of each group of segments a place, and how far they reach from there, metres.
    groups: Vec<(Point2<f64>, f64)>,
    /// The segments that may be the nearest, ascending.
    near: FxHashMap<Cell, Vec<u32>>,
}

impl<'a> QuickPath<'a> {
    /// Of a path; nothing is looked at yet.
    pub fn new(path: &'a Path) -> Self {
        let around = |vertices: &[nalgebra::Point3<f64>]| {
            let (first, last) = (ground(&vertices[0]), ground(&vertices[vertices.len() - 1]));
            let middle = center(&first, &last);
            let reach_m = vertices.iter().map(|v| distance(&middle, &ground(v))).fold(0.0, f64::max);
            (middle, reach_m)
        };
        let groups = (0..path.segments.len())
            .step_by(GROUP)
            .map(|first| around(&path.vertices[first..=(first + GROUP).min(path.segments.len())]))
            .collect();
        Self { path, groups, near: FxHashMap::default() }
    }

    /// Makes ready for points (map x, z) that will be asked for.
    pub fn expect(&mut self, points: &[Point2<f64>]) {
        let cells: FxHashSet<Cell> =
            points.iter().filter_map(cell).filter(|cell| !self.near.contains_key(cell)).collect();
        let cells: Vec<Cell> = cells.into_iter().collect();
        let near: Vec<Vec<u32>> = cells.par_iter().map(|cell| self.segments_near(*cell)).collect();
        self.near.extend(cells.into_iter().zip(near));
    }

    /// The place of a point given by its map (x, z).
    pub fn place(&self, p: &Point2<f64>) -> PathPlace {
        match cell(p).and_then(|cell| self.near.get(&cell)) {
            Some(near) => self.path.place_beside(p, near.iter().map(|i| *i as usize)),
            None => self.path.place(p),
        }
    }

    /// The segments that may be the nearest to a point of a cell: what is farther from its centre
    /// than the nearest one by its diagonal is farther from every point of it.
    fn segments_near(&self, (x, z): Cell) -> Vec<u32> {
        let centre = Point2::new((x as f64 + 0.5) * CELL_M, (z as f64 + 0.5) * CELL_M);
        let distance_m = |i: usize| self.path.segments[i].nearest(&centre).1.sqrt();
        let least_m: Vec<f64> =
            self.groups.iter().map(|(middle, reach_m)| distance(middle, &centre) - reach_m).collect();
        let in_group = |group: usize| group * GROUP..((group + 1) * GROUP).min(self.path.segments.len());
        let mut order: Vec<usize> = (0..least_m.len()).collect();
        order.sort_by(|a, b| least_m[*a].total_cmp(&least_m[*b]));
        let mut nearest_m = f64::INFINITY;
        for group in order.iter().copied().take_while(|group| least_m[*group] <= f64::MAX) {
            if least_m[group] > nearest_m {
                break;
            }
            nearest_m = in_group(group).map(distance_m).fold(nearest_m, f64::min);
        }
        let farthest_m = nearest_m + CELL_M * std::f64::consts::SQRT_2 + ROUNDING_M;
        let near = (0..least_m.len()).filter(|group| least_m[*group] <= farthest_m).flat_map(in_group);
        near.filter(|i| distance_m(*i) <= farthest_m).map(|i| i as u32).collect()
    }
}

/// The cell of a point; none of one too far away.
fn cell(p: &Point2<f64>) -> Option<Cell> {
    let is_near = p.x.abs() <= FARTHEST_M && p.y.abs() <= FARTHEST_M;
    is_near.then(|| ((p.x / CELL_M).floor() as i64, (p.y / CELL_M).floor() as i64))
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn the_places_are_those_of_all_segments() {
        // Twice round a block of 60 m, on another lane, and away from it by a kilometre.
        let corner = |i: i32, half_m: f64| match i % 4 {
            0 => (-half_m, -half_m),
            1 => (half_m, -half_m),
            2 => (half_m, half_m),
            _ => (-half_m, half_m),
        };
        let side = |i: i32| {
            let half_m = if i < 4 { 30.0 } else { 33.5 };
            let ((x, z), (to_x, to_z)) = (corner(i, half_m), corner(i + 1, half_m));
            (0..40).map(move |k| {
                let share = f64::from(k) / 40.0;
                Point3::new(x + (to_x - x) * share, 0.0, z + (to_z - z) * share)
            })
        };
        let away = (0..700).map(|k| Point3::new(-33.5 - 1.5 * f64::from(k), 0.1 * f64::from(k), -33.5));
        let centres: Vec<_> = (0..8).flat_map(side).chain(away).collect();
        let path = Path::new(&centres, 0.0);
        let point =
            |i: i32| Point2::new(f64::from(i * 73 % 1999) * 0.7 - 1200.0, f64::from(i * 37 % 997) * 0.3 - 150.0);
        let far = [Point2::new(3e9, 1.0), Point2::new(-2e5, 4e5), Point2::new(0.0, 0.0)];
        let points: Vec<_> = (0..4000).map(point).chain(far).collect();
        let mut quick = QuickPath::new(&path);
        // Those that were not expected are found, too.
        quick.expect(&points[..2000]);
        for p in &points {
            assert_eq!(quick.place(p), path.place(p), "{p}");
        }
        quick.expect(&points);
        assert!(points.iter().all(|p| quick.place(p) == path.place(p)));
        // Most of the path is not looked at.
        let near = quick.near.values().map(Vec::len).max().unwrap();
        assert!(near < path.segments.len() / 4, "{near} of {}", path.segments.len());
    }
}
