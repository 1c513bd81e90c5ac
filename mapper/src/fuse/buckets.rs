//! Things by the square of the ground plane that they lie in.

use nalgebra::Point3;
use rustc_hash::FxHashMap;

/// Indices of points by cell of an endless grid over map x and z. What it
/// gives is in the order in which it was put in, cell by cell, so that it is
/// the same on every run.
#[derive(Debug, Clone)]
pub struct Buckets {
    cell_m: f64,
    cells: FxHashMap<(i64, i64), Vec<usize>>,
}

impl Buckets {
    /// An empty grid of cells of this edge length, metres.
    pub fn new(cell_m: f64) -> Self {
        Self { cell_m: cell_m.max(1e-3), cells: FxHashMap::default() }
    }

    /// A grid of points, each under its index.
    pub fn of<'a>(cell_m: f64, points: impl IntoIterator<Item = &'a Point3<f64>>) -> Self {
        let mut buckets = Self::new(cell_m);
        for (index, point) in points.into_iter().enumerate() {
            buckets.add(point, index);
        }
        buckets
    }

    fn cell(&self, x: f64, z: f64) -> (i64, i64) {
        ((x / self.cell_m).floor() as i64, (z / self.cell_m).floor() as i64)
    }

    /// Adds a point (map frame, metres) under an index.
    pub fn add(&mut self, point: &Point3<f64>, index: usize) {
        let cell = self.cell(point.x, point.z);
        self.cells.entry(cell).or_default().push(index);
    }

    /// Everything within `reach_m` of a point seen from above, and some of
    /// what is farther: whole cells.
    pub fn near(&self, point: &Point3<f64>, reach_m: f64) -> impl Iterator<Item = usize> + '_ {
        let (low_x, low_z) = self.cell(point.x - reach_m, point.z - reach_m);
        let (high_x, high_z) = self.cell(point.x + reach_m, point.z + reach_m);
        (low_x..=high_x)
            .flat_map(move |x| (low_z..=high_z).map(move |z| (x, z)))
            .filter_map(|cell| self.cells.get(&cell))
            .flatten()
            .copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_near_is_found_across_the_borders_of_cells() {
        let points: Vec<Point3<f64>> = (-50..50).map(|i| Point3::new(f64::from(i) * 0.3, 9.0, -2.0)).collect();
        let buckets = Buckets::of(1.0, &points);
        for from in &points {
            let near: Vec<usize> = buckets.near(from, 0.7).collect();
            for (index, point) in points.iter().enumerate() {
                assert!((point - from).norm() > 0.7 || near.contains(&index));
            }
            assert!(near.len() < 15);
        }
    }
}
