//! Points by the cell of a grid.

use std::ops::Range;

use nalgebra::Point2;

use crate::grid::Grid;

/// Indices of some points by the cell of a grid that they lie in.
pub(crate) struct ByCell {
    points: Vec<u32>,
    /// Where each cell begins in `points`.
    starts: Vec<u32>,
}

impl ByCell {
    /// Counting sort of points by the cell of a grid that each counts in; what
    /// counts in none is left out.
    pub fn new<P>(points: &[P], grid: &Grid, cell: impl Fn(&P) -> Option<usize>) -> Self {
        let mut starts = vec![0_u32; grid.len() + 1];
        points.iter().filter_map(&cell).for_each(|c| starts[c + 1] += 1);
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut by_cell = vec![0_u32; starts.last().map_or(0, |n| *n as usize)];
        for (i, p) in points.iter().enumerate() {
            if let Some(c) = cell(p) {
                by_cell[starts[c] as usize] = i as u32;
                starts[c] += 1;
            }
        }
        // Each start has moved on to the next one.
        starts.copy_within(..grid.len(), 1);
        starts[0] = 0;
        Self { points: by_cell, starts }
    }

    /// Indices of the points whose cell is within so many of the one at map
    /// (x, z), row by row; `grid` is that of [`Self::new`].
    pub fn near<'a>(&'a self, at: &Point2<f64>, cells: usize, grid: &'a Grid) -> impl Iterator<Item = usize> {
        let span = move |c: usize, n: usize| c.saturating_sub(cells)..(c + cells + 1).min(n);
        let around = grid.cell(at).map(|(x, z)| self.within(span(x, grid.width), span(z, grid.height), grid));
        around.into_iter().flatten()
    }

    /// Indices of the points in columns and rows of the grid, row by row.
    pub fn within<'a>(
        &'a self,
        columns: Range<usize>,
        rows: Range<usize>,
        grid: &'a Grid,
    ) -> impl Iterator<Item = usize> + 'a {
        rows.flat_map(move |z| {
            columns.clone().flat_map(move |x| self.of_cell(z * grid.width + x).iter().map(|i| *i as usize))
        })
    }

    /// Indices of the points in a cell, by its index.
    pub fn of_cell(&self, cell: usize) -> &[u32] {
        &self.points[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }
}
