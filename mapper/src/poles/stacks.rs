//! Columns of a fine grid with their occupied slices as bits, and the
//! isolated vertical stacks among them.

use nalgebra::Point2;

use super::PoleConfig;
use crate::cloud::CloudPoint;
use crate::grid::Grid;

/// Slices per column: the bits of a word.
const SLICES: usize = 64;

/// Occupancy of columns of the ground plane, slice by slice.
pub struct Stacks {
    grid: Grid,
    occupied: Vec<u64>,
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
    /// Slices that are occupied and free around.
    free: u64,
}

impl Stack {
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

impl Stacks {
    /// Bins the points that stand on the ground.
    pub fn new(points: &[CloudPoint], within: &Grid, config: &PoleConfig) -> Self {
        let high = Point2::new(
            within.origin.x + within.cell_m * within.width as f64,
            within.origin.y + within.cell_m * within.height as f64,
        );
        let grid = Grid::covering(within.origin, high, config.column_m);
        let mut occupied = vec![0_u64; grid.len()];
        for p in points {
            let slice = (f64::from(p.height_m) - config.lowest_m) / config.slice_m;
            // NaN heights fail both comparisons.
            if slice >= 0.0
                && slice < SLICES as f64
                && let Some(i) = grid.index(&Point2::new(p.position.x, p.position.z))
            {
                occupied[i] |= 1 << slice as u32;
            }
        }
        Self { grid, occupied, lowest_m: config.lowest_m, slice_m: config.slice_m }
    }

    /// The isolated stacks, best first, none within the ring of a better one
    /// at the same height.
    pub fn find(&self, config: &PoleConfig) -> Vec<Stack> {
        let core = self.offsets(0.0, config.core_radius_m);
        let ring = self.offsets(config.ring_inner_m, config.ring_outer_m);
        let reach = (config.ring_outer_m / self.grid.cell_m).ceil() as usize;
        let least = config.least_free_m / config.slice_m;
        let mut found: Vec<(usize, Stack)> = Vec::new();
        for z in reach..self.grid.height.saturating_sub(reach) {
            for x in reach..self.grid.width.saturating_sub(reach) {
                let centre = z * self.grid.width + x;
                if self.occupied[centre] == 0 {
                    continue;
                }
                let any = |offsets: &[isize]| {
                    offsets.iter().fold(0_u64, |bits, o| bits | self.occupied[(centre as isize + o) as usize])
                };
                let filled = any(&core);
                if f64::from(filled.count_ones()) < least {
                    continue;
                }
                let hindered = any(&ring);
                let (score, low, high) = best_run(filled, hindered);
                if score >= least {
                    let height = |slice: usize| self.lowest_m + slice as f64 * self.slice_m;
                    // Ties between neighbours go to the fuller column.
                    let fuller = f64::from(self.occupied[centre].count_ones()) * 1e-3;
                    found.push((
                        centre,
                        Stack {
                            centre: self.grid.centre(centre),
                            low_m: height(low),
                            high_m: height(high + 1),
                            score: score + fuller,
                            free: filled & !hindered,
                        },
                    ));
                }
            }
        }
        found.sort_by(|a, b| b.1.score.total_cmp(&a.1.score).then(a.0.cmp(&b.0)));
        let mut kept: Vec<Stack> = Vec::new();
        for (_, stack) in found {
            let apart = kept.iter().all(|k| {
                (k.centre - stack.centre).norm() > config.ring_outer_m
                    || stack.low_m > k.high_m
                    || k.low_m > stack.high_m
            });
            if apart {
                kept.push(stack);
            }
        }
        kept
    }

    /// Share of the voxels of an upright cylinder that are occupied; heights
    /// above ground.
    pub fn filled_share(&self, at: &Point2<f64>, heights_m: std::ops::Range<f64>, radius_m: f64) -> f64 {
        let Some((x, z)) = self.grid.cell(at) else { return 0.0 };
        let slice = |h: f64| ((h - self.lowest_m) / self.slice_m).clamp(0.0, SLICES as f64) as u32;
        let (low, high) = (slice(heights_m.start), slice(heights_m.end));
        if high <= low {
            return 0.0;
        }
        let mask = (u64::MAX >> (64 - (high - low))) << low;
        let reach = (radius_m / self.grid.cell_m).ceil() as isize;
        let (mut filled, mut all) = (0_u32, 0_u32);
        for dz in -reach..=reach {
            for dx in -reach..=reach {
                let (cx, cz) = (x as isize + dx, z as isize + dz);
                let inside = cx >= 0 && cz >= 0 && (cx as usize) < self.grid.width && (cz as usize) < self.grid.height;
                if inside && dx * dx + dz * dz <= reach * reach {
                    let i = cz as usize * self.grid.width + cx as usize;
                    filled += (self.occupied[i] & mask).count_ones();
                    all += high - low;
                }
            }
        }
        f64::from(filled) / f64::from(all.max(1))
    }

    fn offsets(&self, inner_m: f64, outer_m: f64) -> Vec<isize> {
        let reach = (outer_m / self.grid.cell_m).ceil() as isize;
        let mut offsets = Vec::new();
        for dz in -reach..=reach {
            for dx in -reach..=reach {
                let r = ((dx * dx + dz * dz) as f64).sqrt() * self.grid.cell_m;
                if r >= inner_m && r <= outer_m {
                    offsets.push(dz * self.grid.width as isize + dx);
                }
            }
        }
        offsets
    }
}

/// The run of slices with the most evidence: its score, first and last slice.
fn best_run(filled: u64, hindered: u64) -> (f64, usize, usize) {
    let (mut best, mut start, mut sum) = ((0.0, 0, 0), 0, 0.0);
    for slice in 0..SLICES {
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
