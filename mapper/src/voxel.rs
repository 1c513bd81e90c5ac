//! Voxel statistics of clouds: count, mean and scatter per cell.

use std::borrow::Borrow;

use nalgebra::{Matrix3, Point3, Vector3};
use rustc_hash::FxHashMap;

/// Index of a voxel: 21 bits per axis, enough for 2 million cells each way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct VoxelKey(u64);

const AXIS_BITS: u32 = 21;
const AXIS_HALF: i32 = 1 << (AXIS_BITS - 1);

impl VoxelKey {
    /// The voxel of edge `1 / inverse_cell` that holds a point.
    pub fn of(point: &Point3<f64>, inverse_cell: f64) -> Self {
        // `f64::floor` is a call on processors that need not know the instruction.
        let axis = |v: f64| {
            let cell = (v * inverse_cell).max(-f64::from(AXIS_HALF)).min(f64::from(AXIS_HALF - 1));
            let whole = cell as i32;
            (whole - i32::from(f64::from(whole) > cell) + AXIS_HALF) as u64
        };
        Self(axis(point.x) << (2 * AXIS_BITS) | axis(point.y) << AXIS_BITS | axis(point.z))
    }
}

/// Count, mean and scatter of points; two can be merged exactly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    /// Number of points.
    pub count: f64,
    /// Their mean, metres.
    pub mean: Point3<f64>,
    /// Sum of the outer products of their deviations from the mean, m^2.
    pub scatter: Matrix3<f64>,
}

impl Moments {
    /// The moments of both sets together (Chan, Golub and Le Veque 1979).
    #[must_use]
    pub fn merged(&self, other: &Self) -> Self {
        let count = self.count + other.count;
        let apart = other.mean - self.mean;
        let share = other.count / count;
        Self {
            count,
            mean: self.mean + apart * share,
            scatter: self.scatter + other.scatter + apart * apart.transpose() * (self.count * share),
        }
    }

    /// The moments of the points turned and then moved.
    #[must_use]
    pub fn transformed(&self, rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Self {
        Self {
            count: self.count,
            mean: rotation * self.mean + translation,
            scatter: rotation * self.scatter * rotation.transpose(),
        }
    }

    /// Standard deviations (m), largest first, and their directions.
    pub fn axes(&self) -> ([f64; 3], [Vector3<f64>; 3]) {
        let eigen = (self.scatter / self.count).symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        (order.map(|i| eigen.eigenvalues[i].max(0.0).sqrt()), order.map(|i| eigen.eigenvectors.column(i).into()))
    }
}

/// The moments of the occupied voxels of a cloud, in the order of their keys,
/// so that the result does not depend on the order of the points' cells.
pub fn voxel_moments(points: impl IntoIterator<Item: Borrow<Point3<f64>>>, cell_m: f64) -> Vec<Moments> {
    let inverse = 1.0 / cell_m;
    let mut places: FxHashMap<VoxelKey, usize> = FxHashMap::default();
    let mut cells: Vec<(VoxelKey, usize)> = Vec::new();
    let mut sums: Vec<Sums> = Vec::new();
    let mut last: Option<(VoxelKey, usize)> = None;
    for p in points {
        let p = p.borrow();
        let key = VoxelKey::of(p, inverse);
        // Neighbours on a beam mostly lie in one voxel.
        let place = match last {
            Some((known, place)) if known == key => place,
            _ => *places.entry(key).or_insert_with(|| {
                cells.push((key, sums.len()));
                sums.push(Sums::from(*p));
                sums.len() - 1
            }),
        };
        last = Some((key, place));
        sums[place].add(p);
    }
    cells.sort_unstable();
    cells.iter().map(|(_, place)| sums[*place].moments()).collect()
}

/// Sums over the points of a voxel, relative to its first.
struct Sums {
    origin: Point3<f64>,
    count: f64,
    sum: Vector3<f64>,
    /// Of the products xx, yy, zz, xy, xz, yz.
    products: [f64; 6],
}

impl From<Point3<f64>> for Sums {
    fn from(origin: Point3<f64>) -> Self {
        Self { origin, count: 0.0, sum: Vector3::zeros(), products: [0.0; 6] }
    }
}

impl Sums {
    fn add(&mut self, p: &Point3<f64>) {
        let d = p - self.origin;
        self.count += 1.0;
        self.sum += d;
        let products = [d.x * d.x, d.y * d.y, d.z * d.z, d.x * d.y, d.x * d.z, d.y * d.z];
        self.products.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
    }

    fn moments(&self) -> Moments {
        let mean = self.sum / self.count;
        let [xx, yy, zz, xy, xz, yz] = self.products;
        let outer = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        let scatter = outer - mean * mean.transpose() * self.count;
        Moments { count: self.count, mean: self.origin + mean, scatter }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_axes_and_their_deviations_make_the_scatter(
            // From rods and plates of one thickness to blobs, of any size.
            values in prop::array::uniform3(prop_oneof![Just(0.0), Just(1.0), 1e-9_f64..1.0]),
            scale in prop_oneof![Just(1e-12), Just(1.0), Just(1e6)],
            turn in prop::array::uniform3(-3.0_f64..3.0),
        ) {
            let values = values.map(|v| v * scale);
            let rotation = *Rotation3::new(Vector3::from(turn)).matrix();
            let scatter = rotation * Matrix3::from_diagonal(&Vector3::from(values)) * rotation.transpose();
            let (found, axes) = Moments { count: 1.0, mean: Point3::origin(), scatter }.axes();
            let vectors = Matrix3::from_columns(&axes);
            let made = vectors * Matrix3::from_diagonal(&Vector3::from(found.map(|s| s * s))) * vectors.transpose();
            prop_assert!((made - scatter).amax() <= 1e-14 * scale, "{made} {scatter}");
            prop_assert!((vectors.transpose() * vectors - Matrix3::identity()).amax() < 1e-14, "{vectors}");
            prop_assert!(found[0] >= found[1] && found[1] >= found[2], "{found:?}");
        }
    }

    fn cloud() -> Vec<Point3<f64>> {
        (0..200)
            .map(|i| {
                let t = f64::from(i);
                Point3::new((t * 0.37).sin() * 2.0, (t * 0.11).cos(), t * 0.01 - 1.0)
            })
            .collect()
    }

    #[test]
    fn merged_moments_are_the_moments_of_all_points() {
        let points = cloud();
        let merged = voxel_moments(&points, 0.5).iter().copied().reduce(|a, b| a.merged(&b)).unwrap();
        let whole = voxel_moments(&points, 1e4);
        // The grid's origin is a cell corner, so one huge cell may be up to eight.
        let whole = whole.iter().copied().reduce(|a, b| a.merged(&b)).unwrap();
        assert!((merged.mean - whole.mean).norm() < 1e-9);
        assert!((merged.scatter - whole.scatter).norm() < 1e-6);
        assert!((merged.count - 200.0).abs() < 1e-9);
    }

    #[test]
    fn a_voxel_reaches_from_its_corner_to_the_next_and_the_outermost_on_without_end() {
        let key = |v: f64| VoxelKey::of(&Point3::new(v, 0.0, 0.0), 2.0);
        for v in [-3.0, -2.5, -1e-9, -0.0, 0.0, 0.3, 1.0, 7.999] {
            let corner = (v * 2.0_f64).floor() / 2.0;
            assert!(key(v) == key(corner) && key(v) == key(corner + 0.499) && key(v) < key(corner + 0.5), "{v}");
        }
        assert!(key(-1e300) == key(f64::NEG_INFINITY) && key(1e300) == key(f64::INFINITY));
        assert!(key(-1e300) < key(-1e4) && key(1e4) < key(1e300));
    }

    #[test]
    fn the_order_of_points_changes_no_cell() {
        let points = cloud();
        let mut reversed = points.clone();
        reversed.reverse();
        let (a, b) = (voxel_moments(&points, 0.5), voxel_moments(&reversed, 0.5));
        assert_eq!(a.len(), b.len());
        assert!(a.iter().zip(&b).all(|(p, q)| (p.mean - q.mean).norm() < 1e-9));
    }
}
