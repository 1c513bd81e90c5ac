//! A dense grid over the ground plane, map x and z.

use nalgebra::Point2;

/// The whole part of a number; 0 of a negative one, 2^32 - 1 of a larger one. To
/// 32 bits a cast is one instruction, to 64 unsigned ones a dozen.
pub(crate) fn whole(v: f64) -> usize {
    v as u32 as usize
}

/// Geometry of a dense grid: cells of `cell_m`, row after row along x.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Corner with the least x and z, metres.
    pub origin: Point2<f64>,
    /// Edge of a cell, metres.
    pub cell_m: f64,
    /// Cells along x.
    pub width: usize,
    /// Cells along z.
    pub height: usize,
}

impl Grid {
    /// A grid that covers the rectangle from `low` to `high` (map x, z).
    pub fn covering(low: Point2<f64>, high: Point2<f64>, cell_m: f64) -> Self {
        let cells = |a: f64, b: f64| ((b - a) / cell_m).ceil().max(1.0) as usize;
        Self { origin: low, cell_m, width: cells(low.x, high.x), height: cells(low.y, high.y) }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.width * self.height
    }

    /// Whether the grid has no cell.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Place of a point from the origin, in cells.
    pub fn place(&self, p: &Point2<f64>) -> [f64; 2] {
        [(p.x - self.origin.x) / self.cell_m, (p.y - self.origin.y) / self.cell_m]
    }

    /// Column and row of the cell that holds a point; none outside.
    pub fn cell(&self, p: &Point2<f64>) -> Option<(usize, usize)> {
        self.cell_at(self.place(p))
    }

    /// The same of a place in cells.
    pub fn cell_at(&self, [x, z]: [f64; 2]) -> Option<(usize, usize)> {
        (x >= 0.0 && z >= 0.0 && x < self.width as f64 && z < self.height as f64).then_some((whole(x), whole(z)))
    }

    /// Index of the cell that holds a point; none outside.
    pub fn index(&self, p: &Point2<f64>) -> Option<usize> {
        self.cell(p).map(|(x, z)| z * self.width + x)
    }

    /// Centre of a cell, map (x, z).
    pub fn centre(&self, index: usize) -> Point2<f64> {
        let (x, z) = (index % self.width, index / self.width);
        Point2::new(self.origin.x + (x as f64 + 0.5) * self.cell_m, self.origin.y + (z as f64 + 0.5) * self.cell_m)
    }

    /// Indices of the (up to four) cells that share an edge with a cell.
    pub fn neighbours(&self, index: usize) -> impl Iterator<Item = usize> + use<> {
        let (x, z, width, height) = (index % self.width, index / self.width, self.width, self.height);
        [
            (x > 0).then(|| index - 1),
            (x + 1 < width).then_some(index + 1),
            (z > 0).then(|| index - width),
            (z + 1 < height).then_some(index + width),
        ]
        .into_iter()
        .flatten()
    }
}
