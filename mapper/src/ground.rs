//! The ground under and beside the driven path, from the stitched scans.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Point2, Point3, Vector2};
use serde::{Deserialize, Serialize};

use crate::grid::{Grid, whole};
use crate::path::{Path, PathIndex};

/// How the ground is told from what stands on it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GroundConfig {
    /// Edge of a cell of the height map, metres: as small as the gaps between
    /// the rings of a stitched cloud allow.
    pub cell_m: f64,
    /// Points in a height bin that make it more than a stray echo.
    pub fewest_points: u32,
    /// Largest step between neighbouring cells of ground, metres: a kerb
    /// (0.15 m) on a slope of 15 %.
    pub largest_step_m: f64,
    /// Points nearer than this to the height map are ground, metres.
    pub thickness_m: f64,
    /// Least share of the driven path under which ground must be seen at the
    /// vehicle's usual height, in the best window of a drive. Real drives show
    /// it under more than half; under a tenth the axes of scans and poses do
    /// not belong together.
    pub least_under_path: f64,
    /// Least and largest height of the camera above the ground, metres, from
    /// that of a small robot to that of a truck: what lies elsewhere under the
    /// path is no ground.
    pub camera_height_m: [f64; 2],
}

impl Default for GroundConfig {
    fn default() -> Self {
        Self {
            cell_m: 1.0,
            fewest_points: 4,
            largest_step_m: 0.3,
            thickness_m: 0.15,
            least_under_path: 0.1,
            camera_height_m: [0.2, 4.0],
        }
    }
}

/// Height bins below and above the camera.
const LOWEST_M: f64 = -6.0;
const HIGHEST_M: f64 = 3.0;
const BIN_M: f64 = 0.05;
const BINS: usize = ((HIGHEST_M - LOWEST_M) / BIN_M) as usize;

/// The slope of the road is told from the ground so far to all sides, metres: a lane.
const SLOPE_BASE_M: f64 = 3.0;

/// A height map of the ground. Heights are along -y of the map.
#[derive(Debug, Clone)]
pub struct Ground {
    grid: Grid,
    /// Height of each cell; NaN where the ground was not reached.
    height_m: Vec<f64>,
    /// Whether ground was seen in the cell, not only continued into it.
    seen: Vec<bool>,
    under_path: f64,
    shown: f64,
}

/// A height with a total order, for the queue.
struct Step(f64);

impl PartialEq for Step {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Step {}

impl PartialOrd for Step {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Step {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

/// The heights of points, by cell of a grid and by bin around the height of the
/// camera there.
pub struct Heights {
    grid: Grid,
    /// Height of the camera over each cell.
    camera: Vec<f64>,
    /// Points of each bin of each cell.
    counts: Vec<u16>,
    /// Sums of their heights above the lowest bin, metres.
    sums: Vec<f32>,
}

impl Heights {
    /// No heights yet, beside a path.
    pub fn new(path: &Path, path_index: &PathIndex, grid: Grid) -> Self {
        let camera = (0..grid.len())
            .map(|i| grid.centre(i))
            .map(|p| path_index.place(path, &p).unwrap_or_else(|| path.place(&p)))
            .map(|place| -path.at(place.station_m).0.y)
            .collect();
        let count = grid.len() * BINS;
        Self { grid, camera, counts: vec![0; count], sums: vec![0.0; count] }
    }

    /// Adds points, map frame, metres.
    pub fn add(&mut self, points_map: impl Iterator<Item = Point3<f64>>) {
        for p in points_map {
            let Some(cell) = self.grid.index(&Point2::new(p.x, p.z)) else { continue };
            let relative = -p.y - self.camera[cell] - LOWEST_M;
            let bin = relative / BIN_M;
            if bin >= 0.0 && bin < BINS as f64 {
                let k = cell * BINS + whole(bin);
                // What can no longer be counted would shift the mean.
                if let Some(count) = self.counts[k].checked_add(1) {
                    self.counts[k] = count;
                    self.sums[k] += relative as f32;
                }
            }
        }
    }

    /// The lowest height in a cell that so many points support.
    fn lowest(&self, cell: usize, fewest: u32) -> Option<f64> {
        let bins = cell * BINS..(cell + 1) * BINS;
        let height = lowest_supported(&self.counts[bins.clone()], &self.sums[bins], fewest)?;
        Some(height + LOWEST_M + self.camera[cell])
    }
}

impl Ground {
    /// Grows the ground from the driven path outwards over cells whose lowest
    /// well-supported height steps little from their neighbour's.
    pub fn grow(heights: Heights, path: &Path, config: &GroundConfig) -> Self {
        let grid = &heights.grid;
        let candidate: Vec<Option<f64>> =
            (0..grid.len()).map(|cell| heights.lowest(cell, config.fewest_points)).collect();

        let mut height_m = vec![f64::NAN; grid.len()];
        let mut seen = vec![false; grid.len()];
        let mut queue = BinaryHeap::new();
        let Seeds { level, under_path, shown } = seeds(grid, path, &heights.camera, &candidate, config);
        for (cell, h) in level {
            queue.push(Reverse((Step(0.0), cell, Step(h))));
        }
        while let Some(Reverse((_, cell, Step(from)))) = queue.pop() {
            if !height_m[cell].is_nan() {
                continue;
            }
            let step = candidate[cell].map(|h| (h, (h - from).abs()));
            match step {
                Some((h, off)) if off <= config.largest_step_m => {
                    height_m[cell] = h;
                    seen[cell] = true;
                }
                // Hidden or empty: the ground goes on at the height it came with.
                _ => height_m[cell] = from,
            }
            for next in grid.neighbours(cell).filter(|n| height_m[*n].is_nan()) {
                let cost = candidate[next].map_or(f64::INFINITY, |h| (h - height_m[cell]).abs());
                let cost = if cost <= config.largest_step_m { cost } else { 1e3 };
                queue.push(Reverse((Step(cost), next, Step(height_m[cell]))));
            }
        }
        level_hidden(grid, &mut height_m, &seen);
        Self { grid: heights.grid, height_m, seen, under_path, shown }
    }

    /// Height of the ground (along -y of the map, metres) at map (x, z),
    /// bilinear between cell centres; none outside the grid.
    pub fn height_m(&self, p: &Point2<f64>) -> Option<f64> {
        self.cell_and_height_m(p).and_then(|(_, height_m)| height_m)
    }

    /// Index of the cell that holds map (x, z), and the same height.
    pub fn cell_and_height_m(&self, p: &Point2<f64>) -> Option<(usize, Option<f64>)> {
        let place = self.grid.place(p);
        let (column, row) = self.grid.cell_at(place)?;
        let centred = |w: f64, n: usize| (w - 0.5).max(0.0).min((n - 1) as f64);
        let (u, v) = (centred(place[0], self.grid.width), centred(place[1], self.grid.height));
        let (x, z) = (whole(u), whole(v));
        let (x1, z1) = ((x + 1).min(self.grid.width - 1), (z + 1).min(self.grid.height - 1));
        let (fu, fv) = (u - x as f64, v - z as f64);
        let at = |x: usize, z: usize| self.height_m[z * self.grid.width + x];
        let near = at(x, z) * (1.0 - fu) + at(x1, z) * fu;
        let far = at(x, z1) * (1.0 - fu) + at(x1, z1) * fu;
        let height = near * (1.0 - fv) + far * fv;
        Some((row * self.grid.width + column, height.is_finite().then_some(height)))
    }

    /// Share of the driven path under which anything was seen.
    pub fn shown(&self) -> f64 {
        self.shown
    }

    /// Whether ground was seen in the cell that holds map (x, z).
    pub fn is_seen(&self, p: &Point2<f64>) -> bool {
        self.grid.index(p).is_some_and(|i| self.seen[i])
    }

    /// Share of the driven path under which ground was seen at the vehicle's
    /// usual height.
    pub fn under_path(&self) -> f64 {
        self.under_path
    }

    /// How far the road along a path leans from the level of the map on the whole, radians:
    /// the slope of the mean plane of the places where ground was seen on all sides.
    pub fn tilt_rad(&self, path: &Path) -> f64 {
        let slope_at = |p: &Point2<f64>| {
            let across = [Vector2::x(), Vector2::y()].map(|side| {
                let [before, behind] = [p - side * SLOPE_BASE_M, p + side * SLOPE_BASE_M];
                let rise_m = self.height_m(&behind)? - self.height_m(&before)?;
                (self.is_seen(&before) && self.is_seen(&behind)).then_some(rise_m / (2.0 * SLOPE_BASE_M))
            });
            Some(Vector2::new(across[0]?, across[1]?))
        };
        let vertices = path.vertices().iter().filter_map(|v| slope_at(&Point2::new(v.x, v.z)));
        let (sum, count) = vertices.fold((Vector2::zeros(), 0.0), |(sum, count), slope| (sum + slope, count + 1.0));
        if count > 0.0 { (sum / count).norm().atan() } else { 0.0 }
    }

    /// The grid of the height map.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }
}

/// Sweeps that carry heights across what a parked car or a hedge hides: ten
/// cells need about their square.
const SWEEPS: usize = 60;

/// Lets the cells where no ground was seen pass smoothly between those where
/// it was: each becomes the mean of its neighbours.
fn level_hidden(grid: &Grid, height_m: &mut [f64], seen: &[bool]) {
    let hidden: Vec<usize> = (0..grid.len()).filter(|i| !seen[*i] && height_m[*i].is_finite()).collect();
    for _ in 0..SWEEPS {
        for &cell in &hidden {
            let (mut sum, mut count) = (0.0, 0.0);
            for next in grid.neighbours(cell).filter(|n| height_m[*n].is_finite()) {
                sum += height_m[next];
                count += 1.0;
            }
            if count > 0.0 {
                height_m[cell] = sum / count;
            }
        }
    }
}

/// Mean height over the lowest window of three bins that holds enough points,
/// relative to the lowest bin, metres.
fn lowest_supported(counts: &[u16], sums: &[f32], fewest: u32) -> Option<f64> {
    (0..counts.len().saturating_sub(2)).find_map(|b| {
        let n: u32 = counts[b..b + 3].iter().map(|c| u32::from(*c)).sum();
        let sum: f32 = sums[b..b + 3].iter().sum();
        (n >= fewest && counts[b] > 0).then(|| f64::from(sum) / f64::from(n))
    })
}

/// The ground under the path.
#[derive(Default)]
struct Seeds {
    /// Cells at the camera's usual height above the ground, with the ground's.
    level: Vec<(usize, f64)>,
    /// Their share of all cells under the path.
    under_path: f64,
    /// The share of those in which anything was seen.
    shown: f64,
}

/// Where the ground begins to grow.
fn seeds(grid: &Grid, path: &Path, camera_height: &[f64], candidate: &[Option<f64>], config: &GroundConfig) -> Seeds {
    let length_m = path.end_station_m() - path.start_station_m();
    let steps = (length_m / grid.cell_m).ceil().max(1.0) as usize;
    let cell_at = |step: usize| {
        let station_m = path.start_station_m() + length_m * step as f64 / steps as f64;
        let (point, _) = path.at(station_m);
        grid.index(&Point2::new(point.x, point.z))
    };
    let mut cells: Vec<usize> = (0..=steps).filter_map(cell_at).collect();
    cells.sort_unstable();
    cells.dedup();
    let [least_m, most_m] = config.camera_height_m;
    let share = |count: usize| count as f64 / cells.len() as f64;
    let shown = share(cells.iter().filter(|cell| candidate[**cell].is_some()).count());
    let mut under: Vec<(usize, f64)> = cells
        .iter()
        .filter_map(|&cell| Some((cell, candidate[cell]? - camera_height[cell])))
        .filter(|(_, h)| (least_m..=most_m).contains(&-h))
        .collect();
    under.sort_by(|a, b| a.1.total_cmp(&b.1));
    let Some(&(_, usual)) = under.get(under.len() / 2) else { return Seeds { shown, ..Seeds::default() } };
    let level: Vec<(usize, f64)> = under
        .into_iter()
        .filter(|(_, h)| (h - usual).abs() < 0.3)
        .map(|(cell, h)| (cell, h + camera_height[cell]))
        .collect();
    let under_path = share(level.len());
    Seeds { level, under_path, shown }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{CloudConfig, Corridor};

    /// A road that climbs 8 % with a kerb of 0.15 m at x = 4, a wall of 3 m at
    /// x = 8, and a car's flank at x = -3.
    fn ground() -> Ground {
        let centres: Vec<_> = (0..60).map(|i| Point3::new(0.0, -0.08 * f64::from(i), f64::from(i))).collect();
        let mut points = Vec::new();
        for z in 0..600 {
            let z = f64::from(z) * 0.1;
            let road = 1.65 - 0.08 * z;
            for x in -60..=79 {
                let x = f64::from(x) * 0.1;
                let hidden = (-4.5..-3.0).contains(&x) && (20.0..24.0).contains(&z);
                if !hidden {
                    points.push(Point3::new(x, if x > 4.0 { road - 0.15 } else { road }, z));
                }
            }
            for k in 0..30 {
                points.push(Point3::new(8.0, road - f64::from(k) * 0.1, z));
            }
            if (20.0..24.0).contains(&z) {
                for k in 8..15 {
                    points.push(Point3::new(-3.5, road - f64::from(k) * 0.1, z));
                }
            }
        }
        let corridor = Corridor::new(&centres, &CloudConfig::default(), 1.0);
        let Corridor { path, path_index, grid, .. } = corridor;
        let mut heights = Heights::new(&path, &path_index, grid);
        heights.add(points.into_iter());
        Ground::grow(heights, &path, &GroundConfig::default())
    }

    #[test]
    fn more_points_than_can_be_counted_do_not_raise_the_ground() {
        let centres: Vec<_> = (0..10).map(|i| Point3::new(0.0, 0.0, f64::from(i))).collect();
        let Corridor { path, path_index, grid, .. } = Corridor::new(&centres, &CloudConfig::default(), 1.0);
        let mut heights = Heights::new(&path, &path_index, grid);
        heights.add(std::iter::repeat_n(Point3::new(0.5, 1.65, 4.5), 100_000));
        let cell = heights.grid.index(&Point2::new(0.5, 4.5)).unwrap();
        let lowest_m = heights.lowest(cell, 4).unwrap();
        assert!((lowest_m + 1.65).abs() < 0.02, "{lowest_m}");
    }

    #[test]
    fn a_road_leans_as_it_climbs() {
        let centres: Vec<_> = (0..60).map(|i| Point3::new(0.0, -0.08 * f64::from(i), f64::from(i))).collect();
        let path = Path::new(&centres, 10.0);
        assert!((ground().tilt_rad(&path) - 0.08_f64.atan()).abs() < 0.01, "{}", ground().tilt_rad(&path));
    }

    #[test]
    fn the_ground_follows_slopes_and_kerbs_and_goes_on_under_what_stands_on_it() {
        let ground = ground();
        let off = |x: f64, z: f64, above: f64| ground.height_m(&Point2::new(x, z)).unwrap() - (0.08 * z - 1.65 + above);
        assert!(off(1.0, 30.0, 0.0).abs() < 0.05);
        assert!(off(6.0, 30.0, 0.15).abs() < 0.05);
        assert!(off(-3.5, 22.0, 0.0).abs() < 0.15, "{}", off(-3.5, 22.0, 0.0));
        assert!(off(8.6, 30.0, 0.15).abs() < 0.3, "{}", off(8.6, 30.0, 0.15));
        assert!(ground.is_seen(&Point2::new(1.0, 30.0)) && !ground.is_seen(&Point2::new(12.0, 30.0)));
        assert!(ground.height_m(&Point2::new(500.0, 0.0)).is_none());
    }
}
