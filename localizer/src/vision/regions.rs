//! Regions of pixels that probably show one class: region growing (section
//! IV.B) with hysteresis, on runs of pixels instead of single ones.

use super::Plane;

/// Neighbouring pixels of one row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// The row.
    pub y: usize,
    /// The first column.
    pub start: usize,
    /// The column after the last one.
    pub end: usize,
}

/// Pixels that touch each other, at corners too.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Region {
    /// Its pixels: by row, then by column.
    pub runs: Vec<Run>,
    /// Number of its pixels.
    pub area: usize,
    /// Sum of their values, in 1/255.
    pub mass: u64,
    /// The largest of their values, in 1/255.
    pub peak: u8,
}

impl Region {
    /// Its first column, first row, last column, last row.
    pub fn bounds(&self) -> (usize, usize, usize, usize) {
        let left = self.runs.iter().map(|run| run.start).min().unwrap_or(0);
        let right = self.runs.iter().map(|run| run.end).max().unwrap_or(1) - 1;
        let rows = self.runs.first().zip(self.runs.last()).map_or((0, 0), |(a, b)| (a.y, b.y));
        (left, rows.0, right, rows.1)
    }

    /// Mean probability of its pixels.
    pub fn probability(&self) -> f64 {
        self.mass as f64 / (255.0 * self.area.max(1) as f64)
    }
}

/// Which pixels make a region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Growth {
    /// Its pixels have at least this probability.
    pub threshold: f64,
    /// One of its pixels has at least this one.
    pub seed: f64,
    /// It has at least this many pixels.
    pub min_area_px: usize,
}

/// The regions of a plane, in the order of their first pixels.
pub fn grow(plane: &Plane, growth: &Growth) -> Vec<Region> {
    let threshold = level(growth.threshold);
    let runs = runs(plane, threshold);
    let roots = connect(&runs);
    // A root is the first run of its region, so regions open in order.
    let mut region_of_root = vec![usize::MAX; runs.len()];
    let mut regions: Vec<Region> = Vec::new();
    for (run, &root) in runs.iter().zip(&roots) {
        if region_of_root[root] == usize::MAX {
            region_of_root[root] = regions.len();
            regions.push(Region { runs: Vec::new(), area: 0, mass: 0, peak: 0 });
        }
        let region = &mut regions[region_of_root[root]];
        let values = &plane.row(run.y)[run.start..run.end];
        region.runs.push(*run);
        region.area += values.len();
        region.mass += values.iter().map(|&v| u64::from(v)).sum::<u64>();
        region.peak = region.peak.max(values.iter().copied().max().unwrap_or(0));
    }
    let seed = level(growth.seed);
    regions.retain(|region| region.peak >= seed && region.area >= growth.min_area_px);
    regions
}

/// A probability as the smallest byte that reaches it; zero reaches nothing.
pub(super) fn level(probability: f64) -> u8 {
    ((probability * 255.0).ceil() as u8).max(1)
}

/// The runs of a plane, by row, then by column.
pub(super) fn runs(plane: &Plane, threshold: u8) -> Vec<Run> {
    const BLOCK: usize = 32;
    let mut runs = Vec::new();
    for y in 0..plane.height() {
        let row = plane.row(y);
        let mut x = 0;
        while x < row.len() {
            // Most of an image shows no pole and no lane: pass it in blocks.
            if let Some(block) = row.get(x..x + BLOCK)
                && block.iter().fold(0, |largest, &v| largest.max(v)) < threshold
            {
                x += BLOCK;
                continue;
            }
            if row[x] < threshold {
                x += 1;
                continue;
            }
            let start = x;
            while x < row.len() && row[x] >= threshold {
                x += 1;
            }
            runs.push(Run { y, start, end: x });
        }
    }
    runs
}

/// For each run the first run of its region: union-find over runs that touch
/// in neighbouring rows.
fn connect(runs: &[Run]) -> Vec<usize> {
    fn root(parents: &mut [usize], mut i: usize) -> usize {
        while parents[i] != i {
            parents[i] = parents[parents[i]];
            i = parents[i];
        }
        i
    }
    let mut parents: Vec<usize> = (0..runs.len()).collect();
    // `above` walks the runs of the row before; it never has to go back,
    // except by one: that run may touch the next one here, too.
    let mut above = 0;
    for (i, run) in runs.iter().enumerate() {
        while above < i && (runs[above].y + 1 < run.y || (runs[above].y + 1 == run.y && runs[above].end < run.start)) {
            above += 1;
        }
        let touching = runs[above..i].iter().take_while(|other| other.y + 1 == run.y && other.start <= run.end);
        for other in above..above + touching.count() {
            let (a, b) = (root(&mut parents, other), root(&mut parents, i));
            parents[a.max(b)] = a.min(b);
        }
    }
    (0..runs.len()).map(|i| root(&mut parents, i)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(rows: &[&str]) -> Plane {
        let value = |c| match c {
            '#' => 255,
            'o' => 50,
            _ => 0,
        };
        Plane::new(rows[0].len(), rows.iter().flat_map(|row| row.chars().map(value)).collect()).unwrap()
    }

    const GROWTH: Growth = Growth { threshold: 0.1, seed: 0.5, min_area_px: 1 };

    #[test]
    fn arms_that_meet_below_are_one_region() {
        let regions = grow(&plane(&["#..#.#", "#..#..", "####.."]), &GROWTH);
        assert_eq!(regions.len(), 2);
        assert_eq!((regions[0].area, regions[0].bounds()), (8, (0, 0, 3, 2)));
        assert_eq!((regions[1].area, regions[1].bounds()), (1, (5, 0, 5, 0)));
    }

    #[test]
    fn corners_touch() {
        assert_eq!(grow(&plane(&["#..", ".#.", "..#", ".#.", "#.."]), &GROWTH).len(), 1);
        assert_eq!(grow(&plane(&["#...#", ".#.#.", "..#.."]), &GROWTH).len(), 1);
    }

    #[test]
    fn a_region_needs_a_seed_and_an_area() {
        assert_eq!(grow(&plane(&["ooo.oo#"]), &GROWTH).len(), 1);
        assert_eq!(grow(&plane(&["oooooo#"]), &GROWTH)[0].area, 7);
        assert!(grow(&plane(&["oo#"]), &Growth { min_area_px: 4, ..GROWTH }).is_empty());
        assert!(grow(&Plane::zeros(70, 3), &Growth { threshold: 0.0, seed: 0.0, min_area_px: 0 }).is_empty());
    }

    #[test]
    fn regions_are_those_of_a_flood_fill() {
        // A pseudo-random pattern near the percolation threshold, so that
        // regions are as tangled as they get.
        let mut state = 7_u32;
        let data: Vec<u8> = (0..97 * 61)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                if state >> 24 < 100 { 255 } else { 0 }
            })
            .collect();
        let plane = Plane::new(97, data.clone()).unwrap();
        let mut seen = vec![false; data.len()];
        let mut areas = Vec::new();
        for at in 0..data.len() {
            let mut stack = vec![at];
            let mut area = 0;
            while let Some(i) = stack.pop() {
                if data[i] == 0 || std::mem::replace(&mut seen[i], true) {
                    continue;
                }
                area += 1;
                let (x, y) = (i % 97, i / 97);
                for near in y.saturating_sub(1)..(y + 2).min(61) {
                    stack.extend((x.saturating_sub(1)..(x + 2).min(97)).map(|x| near * 97 + x));
                }
            }
            if area > 0 {
                areas.push(area);
            }
        }
        let regions = grow(&plane, &GROWTH);
        assert_eq!(regions.iter().map(|r| r.area).collect::<Vec<_>>(), areas);
    }
}
