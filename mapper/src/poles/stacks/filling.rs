//! What fills the space around an axis.

use std::ops::Range;

use nalgebra::{Matrix2, Point2, SymmetricEigen, Vector2};

use super::{SLICES, Span, Stacks, around};

/// What fills a part of the space.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Filling {
    /// Share of its voxels.
    pub share: f64,
    /// How far these lie off the upright plane through the axis that fits them best,
    /// metres, root mean square.
    pub across_m: f64,
    /// How far their middle is from the axis, metres.
    pub aside_m: f64,
}

impl Stacks {
    /// What fills an upright tube: between two radii, metres; heights above ground;
    /// without the columns for which `is_out` holds of their place.
    pub fn filling(
        &self,
        at: &Point2<f64>,
        heights_m: Range<f64>,
        radii_m: Range<f64>,
        is_out: impl Fn(&Point2<f64>) -> bool,
    ) -> Filling {
        let Some(cell) = self.grid.cell(at) else { return Filling::default() };
        let slice = |h: f64| ((h - self.lowest_m) / self.slice_m).clamp(0.0, SLICES as f64) as usize;
        let wanted = slice(heights_m.start)..slice(heights_m.end);
        let mut steps = around(radii_m.start, radii_m.end, self.grid.cell_m);
        let off = |(dx, dz): (isize, isize)| Vector2::new(dx as f64, dz as f64) * self.grid.cell_m;
        steps.retain(|step| !is_out(&(at + off(*step))));
        let (mut count, mut sum, mut squares) = (0.0, Vector2::zeros(), Matrix2::zeros());
        for step in &steps {
            let filled = self.filled(cell, &[Span { first: step.0, last: step.0, z: step.1 }]);
            let voxels = wanted.clone().filter(|s| filled & (1_u64 << s) != 0).count() as f64;
            count += voxels;
            sum += voxels * off(*step);
            squares += voxels * off(*step) * off(*step).transpose();
        }
        if count == 0.0 {
            return Filling::default();
        }
        let across_m2 = SymmetricEigen::new(squares / count).eigenvalues.min();
        Filling {
            share: count / (steps.len() * wanted.len()).max(1) as f64,
            across_m: across_m2.max(0.0).sqrt(),
            aside_m: (sum / count).norm(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::by_cell::ByCell;
    use crate::grid::Grid;

    /// Stacks with these columns (x, z) full from 0 to 2 m.
    fn stacks(columns: &[(f64, f64)]) -> Stacks {
        let grid = Grid::covering(Point2::new(-2.0, -2.0), Point2::new(2.0, 2.0), 0.1);
        let hits = columns.iter().flat_map(|(x, z)| (0..10).map(move |slice| (Point2::new(*x, *z), slice)));
        let slices = ByCell::new(&grid, hits.map(|(at, slice)| (grid.index(&at), slice)));
        Stacks { grid, slices, lowest_m: 0.0, slice_m: 0.2 }
    }

    #[test]
    fn a_plane_through_the_axis_is_flat_and_one_beside_it_is_not() {
        let row = |z: f64| (-9..=9).map(|k| (0.05 + 0.1 * f64::from(k), z + 0.05)).collect::<Vec<_>>();
        let filling = |columns: &[(f64, f64)]| {
            stacks(columns).filling(&Point2::new(0.05, 0.05), 0.0..2.0, 0.6..1.0, |at| at.x > 1.5)
        };
        let (through, beside) = (filling(&row(0.0)), filling(&row(0.6)));
        assert!(through.across_m < 1e-9 && through.share > 0.03, "{through:?}");
        assert!(beside.across_m > 0.4, "{beside:?}");
        assert_eq!(filling(&[]), Filling::default());
        // All of a ring, and none of what is left out.
        let all: Vec<(f64, f64)> =
            (0..400).map(|k| (0.1 * f64::from(k % 20) - 0.95, 0.1 * f64::from(k / 20) - 0.95)).collect();
        let full = stacks(&all).filling(&Point2::new(0.05, 0.05), 0.0..2.0, 0.0..0.5, |_| false);
        assert!((full.share - 1.0).abs() < 1e-9, "{full:?}");
        let none = stacks(&all).filling(&Point2::new(0.05, 0.05), 0.0..2.0, 0.0..0.5, |_| true);
        assert_eq!(none, Filling::default());
    }
}
