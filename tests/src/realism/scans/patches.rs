//! Cubic metres above the ground: flat and upright (walls), or scattered
//! (leaves).

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

/// Edge of a cell, metres.
const CELL_M: f64 = 1.0;
/// Lower than this above the ground nothing is looked at, metres: kerbs.
const LOWEST_M: f64 = 0.3;
/// Farther than this there are too few points for a plane, metres.
const FARTHEST_M: f64 = 30.0;
/// Least points for a plane.
const FEWEST: usize = 15;
/// A wall spreads less than this across, metres (standard deviation).
const WALL_M: f64 = 0.08;
/// And more than this along both other directions, metres.
const WIDE_M: f64 = 0.15;
/// Leaves spread more than this in all directions, metres.
const LEAVES_M: f64 = 0.12;
/// Largest upward part of an upright plane's normal.
const UPRIGHT: f64 = 0.2;

/// What a cell holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Patch {
    /// A flat upright surface: spread across it, metres (standard deviation).
    Wall(f64),
    /// Points without a surface.
    Leaves,
    /// Neither.
    Other,
}

/// The cells of a scan.
pub struct Patches {
    cells: BTreeMap<(i32, i32, i32), Patch>,
}

impl Patches {
    /// Fits a plane in each cell with enough points; `height_m` is above the
    /// ground.
    pub fn new(points: &[Point3<f64>], height_m: &[f64]) -> Self {
        let mut members: BTreeMap<(i32, i32, i32), Vec<Vector3<f64>>> = BTreeMap::new();
        for (p, _) in points.iter().zip(height_m).filter(|(p, h)| **h > LOWEST_M && p.coords.norm() < FARTHEST_M) {
            members.entry(cell(p)).or_default().push(p.coords);
        }
        let fitted = members.into_iter().filter(|(_, points)| points.len() >= FEWEST);
        Self { cells: fitted.map(|(cell, points)| (cell, patch(&points))).collect() }
    }

    /// What the cell of a point holds.
    pub fn of(&self, p: &Point3<f64>) -> Option<Patch> {
        self.cells.get(&cell(p)).copied()
    }

    /// All cells that hold something.
    pub fn all(&self) -> impl Iterator<Item = Patch> {
        self.cells.values().copied()
    }
}

fn cell(p: &Point3<f64>) -> (i32, i32, i32) {
    let at = |v: f64| (v / CELL_M).floor() as i32;
    (at(p.x), at(p.y), at(p.z))
}

fn patch(points: &[Vector3<f64>]) -> Patch {
    let count = points.len() as f64;
    let mean = points.iter().sum::<Vector3<f64>>() / count;
    let scatter = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum::<Matrix3<f64>>() / count;
    let eigen = SymmetricEigen::new(scatter);
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let spread_m = order.map(|i| eigen.eigenvalues[i].max(0.0).sqrt());
    let upward = eigen.eigenvectors[(2, order[0])].abs();
    if spread_m[0] < WALL_M && spread_m[1] > WIDE_M && upward < UPRIGHT {
        Patch::Wall(spread_m[0])
    } else if spread_m[0] > LEAVES_M {
        Patch::Leaves
    } else {
        Patch::Other
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_is_flat_and_leaves_are_not() {
        let wall =
            |i: i32| Point3::new(5.5 + 0.01 * f64::from(i % 3 - 1), 0.13 * f64::from(i % 7), 0.16 * f64::from(i / 7));
        let bush = |i: i32| Point3::new(5.0 + 0.2 * f64::from(i % 5), 0.13 * f64::from(i % 7), 0.16 * f64::from(i / 7));
        let of = |shape: &dyn Fn(i32) -> Point3<f64>| {
            let points: Vec<_> = (0..42).map(shape).collect();
            Patches::new(&points, &[1.0; 42]).of(&points[0])
        };
        assert!(matches!(of(&wall), Some(Patch::Wall(across_m)) if (across_m - 0.008).abs() < 0.002));
        assert_eq!(of(&bush), Some(Patch::Leaves));
    }
}
