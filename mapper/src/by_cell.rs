//! What lies in the cells of a grid.

use std::ops::Range;

use nalgebra::Point2;

use crate::grid::Grid;

/// Some things by the cell of a grid that they lie in, cell by cell; those of a
/// cell in the order in which they were given.
pub(crate) struct ByCell<T> {
    sorted: Vec<T>,
    /// Where each cell begins in `sorted`.
    starts: Vec<u32>,
}

impl<T: Copy + Default> ByCell<T> {
    /// Counting sort of things, each with the cell that it lies in; what lies in
    /// none is left out.
    pub fn new(grid: &Grid, things: impl Iterator<Item = (Option<usize>, T)> + Clone) -> Self {
        let mut starts = vec![0_u32; grid.len() + 1];
        things.clone().filter_map(|(cell, _)| cell).for_each(|cell| starts[cell + 1] += 1);
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut sorted = vec![T::default(); starts.last().map_or(0, |n| *n as usize)];
        for (cell, thing) in things {
            if let Some(cell) = cell {
                sorted[starts[cell] as usize] = thing;
                starts[cell] += 1;
            }
        }
        // Each start has moved on to the next one.
        starts.copy_within(..grid.len(), 1);
        starts[0] = 0;
        Self { sorted, starts }
    }

    /// What lies in cells within so many of the one at map (x, z), row by row;
    /// `grid` is that of [`Self::new`].
    pub fn near<'a>(&'a self, at: &Point2<f64>, cells: usize, grid: &'a Grid) -> impl Iterator<Item = &'a T> {
        let span = move |c: usize, n: usize| c.saturating_sub(cells)..(c + cells + 1).min(n);
        let around = grid.cell(at).map(|(x, z)| (span(x, grid.width), span(z, grid.height)));
        around.into_iter().flat_map(move |(columns, rows)| {
            rows.flat_map(move |z| self.of_cells(z * grid.width + columns.start..z * grid.width + columns.end))
        })
    }

    /// What lies in cells that follow each other, by their indices.
    pub fn of_cells(&self, cells: Range<usize>) -> &[T] {
        &self.sorted[self.starts[cells.start] as usize..self.starts[cells.end] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_near_comes_row_by_row_and_as_it_was_given() {
        let grid = Grid::covering(Point2::origin(), Point2::new(4.0, 3.0), 1.0);
        let things = [(Some(5), 'a'), (Some(0), 'b'), (None, 'c'), (Some(5), 'd'), (Some(11), 'e'), (Some(2), 'f')];
        let by_cell = ByCell::new(&grid, things.into_iter());
        let near = |x: f64, z: f64, cells: usize| by_cell.near(&Point2::new(x, z), cells, &grid).collect::<String>();
        assert_eq!(
            (near(1.5, 1.5, 0), near(1.5, 1.5, 1), near(3.9, 2.9, 9)),
            ("ad".into(), "bfad".into(), "bfade".into())
        );
        assert_eq!((near(0.5, 2.5, 0), near(-0.1, 0.5, 5)), (String::new(), String::new()));
        assert_eq!(by_cell.of_cells(2..6), ['f', 'a', 'd']);
    }
}
