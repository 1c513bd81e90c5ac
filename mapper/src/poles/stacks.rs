//! Columns of a fine grid with the points in them, slice by slice, and the
//! isolated vertical stacks among them.

mod filling;

use std::ops::Range;

use nalgebra::Point2;
use rayon::prelude::*;

pub use self::filling::Filling;
use super::PoleConfig;
use crate::by_cell::ByCell;
use crate::cloud::CloudPoint;
use crate::grid::Grid;

/// Slices per column: the bits of a word.
const SLICES: usize = 64;

/// The standing points, sorted by column of the ground plane.
pub struct Stacks {
    grid: Grid,
    /// Slice of each point, by column.
    slices: ByCell<u8>,
    lowest_m: f64,
    slice_m: f64,
}

/// An isolated vertical stack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stack {
    /// Centre of its column, map (x, z), metres.
    pub centre: Point2<f64>,
    /// Lower end, metres above ground.
    pub low_m: f64,
    /// Upper end, metres above ground.
    pub high_m: f64,
    /// Free and occupied slices less hindered ones: the evidence, in slices.
    pub score: f64,
    /// Its points lie within this of its centre, metres.
    pub reach_m: f64,
    /// Height above which nothing belongs to it, metres above ground.
    pub end_m: f64,
    /// Whether it stands close before something, from which it stands out.
    pub is_before: bool,
    /// Whether it is looked for under a retro-reflective plate.
    pub is_under_sheet: bool,
    /// Slices that are occupied and free around.
    free: u64,
}

impl Stack {
    /// The stack under a reflector whose upper edge is at a height above
    /// ground, whatever stands behind it.
    pub fn under_reflector(centre: Point2<f64>, upper_edge_m: f64, config: &PoleConfig) -> Self {
        let high_m = upper_edge_m + config.reflector_below_top_m;
        let count = ((high_m - config.lowest_m) / config.slice_m).ceil();
        Self::from_ground(centre, count, high_m, config)
    }

    /// The stack under a retro-reflective plate, whatever stands close behind
    /// it: from the ground up to the lower edge, heights above ground. None
    /// where the plate is nearer to the ground than a post is long.
    pub fn under_sheet(centre: Point2<f64>, low_edge_m: f64, high_edge_m: f64, config: &PoleConfig) -> Option<Self> {
        let count = ((low_edge_m - config.lowest_m) / config.slice_m).floor();
        (count * config.slice_m >= config.least_before_m).then(|| Self {
            end_m: high_edge_m,
            is_before: true,
            is_under_sheet: true,
            ..Self::from_ground(centre, count, low_edge_m, config)
        })
    }

    /// So many slices from the ground up to a height above it, all taken for free.
    fn from_ground(centre: Point2<f64>, count: f64, high_m: f64, config: &PoleConfig) -> Self {
        let count = count.clamp(1.0, SLICES as f64 - 1.0) as u32;
        Self {
            centre,
            low_m: config.lowest_m,
            high_m,
            score: f64::from(count),
            reach_m: config.reflector_reach_m,
            end_m: high_m,
            is_before: false,
            is_under_sheet: false,
            free: (1 << count) - 1,
        }
    }

    /// Whether the slice at a height above ground is part of the stack with
    /// nothing around it.
    pub fn is_free(&self, above_ground_m: f64, config: &PoleConfig) -> bool {
        let slice = (above_ground_m - config.lowest_m) / config.slice_m;
        slice >= 0.0 && slice < SLICES as f64 && self.free & (1 << slice as u32) != 0
    }
}

/// What a slice adds to the evidence of a stack.
const FREE: f64 = 1.0;
const HINDERED: f64 = -0.7;
const EMPTY: f64 = -0.35;

/// Cells side by side in a row, as steps in x from the first to the last, and
/// in z: their points stand side by side in memory.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Span {
    first: isize,
    last: isize,
    z: isize,
}

/// The same cells row by row. Cells of a row must follow on each other.
fn spans(cells: &[(isize, isize)]) -> Vec<Span> {
    cells
        .chunk_by(|a, b| a.1 == b.1 && a.0 + 1 == b.0)
        .filter_map(|row| Some(Span { first: row.first()?.0, last: row.last()?.0, z: row.first()?.1 }))
        .collect()
}

/// Cells of a disc or a ring around a cell, as steps in x and z.
fn around(inner_m: f64, outer_m: f64, cell_m: f64) -> Vec<(isize, isize)> {
    let reach = (outer_m / cell_m).ceil() as isize;
    (-reach..=reach)
        .flat_map(|dz| (-reach..=reach).map(move |dx| (dx, dz)))
        .filter(|(dx, dz)| {
            let r = ((dx * dx + dz * dz) as f64).sqrt() * cell_m;
            r >= inner_m && r <= outer_m
        })
        .collect()
}

/// Parts in which the ring around a column is looked at.
const RING_PARTS: usize = 6;

impl Stacks {
    /// Bins the points that stand on the ground.
    pub fn new(points: &[CloudPoint], within: &Grid, config: &PoleConfig) -> Self {
        let high = Point2::new(
            within.origin.x + within.cell_m * within.width as f64,
            within.origin.y + within.cell_m * within.height as f64,
        );
        let grid = Grid::covering(within.origin, high, config.column_m);
        let place = |p: &CloudPoint| {
            let slice = (f64::from(p.height_m) - config.lowest_m) / config.slice_m;
            // NaN heights fail both comparisons.
            (slice >= 0.0 && slice < SLICES as f64)
                .then(|| grid.index(&Point2::new(p.position.x, p.position.z)))
                .flatten()
                .map(|column| (Some(column), slice as u8))
        };
        let slices = ByCell::new(&grid, points.iter().filter_map(place));
        Self { grid, slices, lowest_m: config.lowest_m, slice_m: config.slice_m }
    }

    /// Slices of the points in some columns side by side.
    fn columns(&self, indices: Range<usize>) -> &[u8] {
        self.slices.of_cells(indices)
    }

    fn column(&self, index: usize) -> &[u8] {
        self.columns(index..index + 1)
    }

    /// The columns around a cell, row by row.
    fn around(&self, (x, z): (usize, usize), spans: &[Span]) -> impl Iterator<Item = Range<usize>> {
        spans.iter().filter_map(move |span| {
            let row = z.checked_add_signed(span.z).filter(|row| *row < self.grid.height)?;
            let first = x.saturating_add_signed(span.first);
            let end = x.checked_add_signed(span.last).map_or(0, |last| (last + 1).min(self.grid.width));
            (first < end).then(|| row * self.grid.width + first..row * self.grid.width + end)
        })
    }

    /// Points per slice in the cells around a cell.
    fn count(&self, cell: (usize, usize), spans: &[Span]) -> [u32; SLICES] {
        let mut counts = [0_u32; SLICES];
        self.count_in(cell, spans, &mut counts);
        counts
    }

    /// Adds the points per slice in the cells around a cell.
    fn count_in(&self, cell: (usize, usize), spans: &[Span], counts: &mut [u32; SLICES]) {
        for columns in self.around(cell, spans) {
            for s in self.columns(columns) {
                counts[usize::from(*s)] += 1;
            }
        }
    }

    /// Slices with a point in one of the cells around a cell.
    fn filled(&self, cell: (usize, usize), spans: &[Span]) -> u64 {
        self.around(cell, spans).fold(0, |filled, columns| filled | self.filled_in(columns))
    }

    fn filled_in(&self, columns: Range<usize>) -> u64 {
        self.columns(columns).iter().fold(0, |filled, slice| filled | 1_u64 << *slice)
    }

    /// The isolated stacks, best first, none within the ring of a better one
    /// at the same height.
    pub fn find(&self, config: &PoleConfig) -> Vec<Stack> {
        let core = spans(&around(0.0, config.core_radius_m, self.grid.cell_m));
        let ring = around(config.ring_inner_m, config.ring_outer_m, self.grid.cell_m);
        let parts: Vec<Vec<Span>> = ring.chunks(ring.len().div_ceil(RING_PARTS).max(1)).map(spans).collect();
        self.best(config.ring_outer_m, |i| self.stack_at(i, &core, &parts, config))
    }

    /// The stacks that stand out from a hedge or a wall close behind them or
    /// around them: at least so many times fuller than every place beside them,
    /// slice after slice. A hedge is as full there as here, and so is a wall.
    pub fn find_before(&self, config: &PoleConfig) -> Vec<Stack> {
        let core = around(0.0, self.grid.cell_m, self.grid.cell_m);
        let off = (config.beside_m / self.grid.cell_m).round() as isize;
        let aslant = (config.beside_m / self.grid.cell_m / std::f64::consts::SQRT_2).ceil() as isize;
        let beside: Vec<Vec<Span>> = [
            (off, 0),
            (-off, 0),
            (0, off),
            (0, -off),
            (aslant, aslant),
            (aslant, -aslant),
            (-aslant, aslant),
            (-aslant, -aslant),
        ]
        .iter()
        .map(|(x, z)| spans(&core.iter().map(|(dx, dz)| (x + dx, z + dz)).collect::<Vec<_>>()))
        .collect();
        let core = spans(&core);
        self.best(config.beside_m, |i| self.before_at(i, &core, &beside, config))
    }

    /// The stacks of all columns, best first, none within `apart_m` of a
    /// better one at the same height.
    fn best(&self, apart_m: f64, at: impl Fn(usize) -> Option<Stack> + Sync) -> Vec<Stack> {
        let mut found: Vec<(usize, Stack)> = (0..self.grid.len())
            .into_par_iter()
            .filter(|i| !self.column(*i).is_empty())
            .filter_map(|i| Some((i, at(i)?)))
            .collect();
        found.sort_by(|a, b| b.1.score.total_cmp(&a.1.score).then(a.0.cmp(&b.0)));
        let mut kept: Vec<Stack> = Vec::new();
        for (_, stack) in found {
            let apart = kept.iter().all(|k| {
                (k.centre - stack.centre).norm() > apart_m || stack.low_m > k.high_m || k.low_m > stack.high_m
            });
            if apart {
                kept.push(stack);
            }
        }
        kept
    }

    fn before_at(&self, index: usize, core: &[Span], beside: &[Vec<Span>], config: &PoleConfig) -> Option<Stack> {
        let cell = (index % self.grid.width, index / self.grid.width);
        let least = config.least_before_m / config.slice_m;
        // Its own column first: most columns of a hedge are told by that.
        let fewest = config.stands_out_by;
        let full = |counts: &[u32; SLICES]| counts.iter().filter(|n| **n >= fewest).count() as f64 >= least;
        if (self.column(index).len() as f64) < least * f64::from(fewest) / 2.0 {
            return None;
        }
        let inside = self.count(cell, core);
        if !full(&inside) {
            return None;
        }
        let mut fullest = [0_u32; SLICES];
        for steps in beside {
            for (most, n) in fullest.iter_mut().zip(self.count(cell, steps)) {
                *most = (*most).max(n);
            }
        }
        let (mut filled, mut hindered) = (0_u64, 0_u64);
        for s in 0..SLICES {
            let bit = 1 << s;
            let needed = config.stands_out * f64::from(fullest[s]) + f64::from(fewest);
            filled |= if inside[s] > 0 { bit } else { 0 };
            hindered |= if f64::from(inside[s]) < needed { bit } else { 0 };
        }
        let found = self.stack_of(index, filled, hindered, least, config.before_reach_m)?;
        Some(Stack { end_m: found.high_m, is_before: true, ..found })
    }

    fn stack_at(&self, index: usize, core: &[Span], ring: &[Vec<Span>], config: &PoleConfig) -> Option<Stack> {
        let cell = (index % self.grid.width, index / self.grid.width);
        let least = config.least_free_m / config.slice_m;
        let filled = self.filled(cell, core);
        // Whatever hinders it makes it no better.
        if f64::from(filled.count_ones()) < least || best_run(filled, 0).0 < least {
            return None;
        }
        let inside = self.count(cell, core);
        let mut outside = [0_u32; SLICES];
        let mut hindered = 0_u64;
        // Most columns are amid a hedge or a wall, as a part of the ring tells.
        for part in ring {
            self.count_in(cell, part, &mut outside);
            // Slices that are not filled are hindered by nothing.
            let is_hindered = |s: &usize| f64::from(outside[*s]) > config.largest_clutter * f64::from(inside[*s]);
            hindered = slices_of(filled).filter(is_hindered).fold(0, |bits, s| bits | 1 << s);
            if f64::from((filled & !hindered).count_ones()) < least || best_run(filled, hindered).0 < least {
                return None;
            }
        }
        self.stack_of(index, filled, hindered, least, config.ring_inner_m)
    }

    /// The best run of the slices that are filled and not hindered; none that
    /// is worth less than `least` slices.
    fn stack_of(&self, index: usize, filled: u64, hindered: u64, least: f64, reach_m: f64) -> Option<Stack> {
        let (score, low, high) = best_run(filled, hindered);
        let height = |slice: usize| self.lowest_m + slice as f64 * self.slice_m;
        // Ties between neighbours go to the fuller column.
        let fuller = self.column(index).len() as f64 * 1e-6;
        (score >= least).then(|| Stack {
            centre: self.grid.centre(index),
            low_m: height(low),
            high_m: height(high + 1),
            score: score + fuller,
            reach_m,
            end_m: f64::INFINITY,
            is_before: false,
            is_under_sheet: false,
            free: filled & !hindered,
        })
    }
}

/// The slices whose bits are set, from below.
fn slices_of(mut bits: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lowest = (bits != 0).then(|| bits.trailing_zeros() as usize);
        bits &= bits.wrapping_sub(1);
        lowest
    })
}

/// The run of slices with the most evidence: its score, first and last slice.
fn best_run(filled: u64, hindered: u64) -> (f64, usize, usize) {
    let (mut best, mut start, mut sum) = ((0.0, 0, 0), 0, 0.0);
    // No run begins or ends with an empty slice.
    for slice in filled.trailing_zeros() as usize..SLICES - filled.leading_zeros() as usize {
        let bit = 1 << slice;
        let value = match (filled & bit != 0, hindered & bit != 0) {
            (true, false) => FREE,
            (true, true) => HINDERED,
            (false, _) => EMPTY,
        };
        if sum <= 0.0 {
            (sum, start) = (0.0, slice);
        }
        sum += value;
        if sum > best.0 {
            best = (sum, start, slice);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::best_run;

    #[test]
    fn a_run_bridges_a_gap_and_stops_at_the_hedge() {
        // Slices 0-2 are hedge, 3-9 free, 6 missed by the beams.
        let (score, low, high) = best_run(0b11_1011_1111, 0b111);
        assert_eq!((low, high), (3, 9));
        assert!((score - (6.0 - 0.35)).abs() < 1e-9);
    }
}
