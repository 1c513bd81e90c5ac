//! How much brighter a point is than its own beam to both of its sides.

use serde::{Deserialize, Serialize};

use crate::scan::LidarScan;

/// How paint is told from asphalt in one scan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ContrastConfig {
    /// Nearest neighbour on the beam that counts as beside a line, metres:
    /// more than the half of a broad line.
    pub beside_from_m: f64,
    /// Farthest neighbour on the beam, metres: less than the distance of two
    /// lines.
    pub beside_to_m: f64,
    /// Least noise of the reflectance, as a share of full scale.
    pub least_noise: f32,
    /// Farthest range, metres: beyond it the beams pass between dashes.
    pub farthest_m: f64,
    /// Highest elevation of a ray to the road, radians.
    pub highest_rad: f64,
}

impl Default for ContrastConfig {
    fn default() -> Self {
        Self { beside_from_m: 0.25, beside_to_m: 0.9, least_noise: 0.025, farthest_m: 35.0, highest_rad: -0.035 }
    }
}

/// Neighbours looked at on each side.
const SAMPLES: usize = 6;
/// Fewest of them that tell what is beside a point.
const FEWEST: usize = SAMPLES / 2;
/// Fewest neighbours below whose median a point can be: half of the fewest.
const FEWEST_DARKER: usize = FEWEST / 2 + 1;

/// The points of a scan beside their beams.
#[derive(Debug, Clone, Copy)]
pub struct Contrasts<'a> {
    scan: &'a LidarScan,
    config: &'a ContrastConfig,
    highest_sin: f64,
}

struct Side {
    median: f32,
    spread: f32,
}

impl<'a> Contrasts<'a> {
    /// Of a scan whose points are in the order of the beams, as KITTI stores
    /// them; in another order every point counts as interrupted.
    pub fn new(scan: &'a LidarScan, config: &'a ContrastConfig) -> Self {
        Self { scan, config, highest_sin: config.highest_rad.sin() }
    }

    /// By how many standard deviations the reflectance of a point at a range
    /// (metres) exceeds that of its beam on both sides; 0 where it does not by more than the least
    /// noise, or where the beam was interrupted; none beyond the range or above
    /// the road.
    pub fn of(&self, i: usize, range_m: f64) -> Option<f32> {
        if range_m > self.config.farthest_m || self.scan.points[i].z > range_m * self.highest_sin {
            return None;
        }
        let over = |side: &Side| self.scan.reflectance[i] - side.median;
        let is_darker = |side: &Side| over(side) > self.config.least_noise;
        // Most points are asphalt, no brighter than either side: one is enough.
        let Some(left) = self.side::<false>(i).filter(is_darker) else { return Some(0.0) };
        let Some(right) = self.side::<true>(i).filter(is_darker) else { return Some(0.0) };
        let noise = left.spread.min(right.spread).max(self.config.least_noise);
        Some(over(&left).min(over(&right)) / noise)
    }

    /// The side of the later or of the earlier points of the beam; none where
    /// the beam was interrupted, or where the point is not brighter than that side.
    fn side<const LATER: bool>(&self, i: usize) -> Option<Side> {
        let LidarScan { points, reflectance, .. } = self.scan;
        let config = self.config;
        let room = if LATER { points.len() - 1 - i } else { i };
        if room == 0 {
            return None;
        }
        let beside = |steps: usize| if LATER { i + steps } else { i - steps };
        let apart_m = |j: usize| (points[j] - points[i]).norm();
        let spacing = apart_m(beside(1));
        if spacing > config.beside_from_m {
            return None;
        }
        let share = |s: usize| s as f64 / (SAMPLES - 1) as f64;
        let mut steps = [0; SAMPLES];
        if self.scan.is_uneven {
            let mut at = 1;
            for (s, steps) in steps.iter_mut().enumerate() {
                let from_m = config.beside_from_m + (config.beside_to_m - config.beside_from_m) * share(s);
                while at <= room && apart_m(beside(at)) < from_m {
                    at += 1;
                }
                *steps = at;
            }
        } else {
            // The azimuth step is constant: indices stand for distances.
            let per_metre = 1.0 / spacing.max(1e-3);
            let first = config.beside_from_m * per_metre;
            let last = config.beside_to_m * per_metre;
            for (s, steps) in steps.iter_mut().enumerate() {
                *steps = rounded(first + (last - first) * share(s)) as usize;
            }
        }
        // They go outwards: what lies beyond the scan are the last of them.
        let count = steps.iter().take_while(|steps| **steps <= room).count();
        let mut darker = 0;
        for steps in &steps[..count] {
            darker += usize::from(reflectance[i] - reflectance[beside(*steps)] > config.least_noise);
        }
        // Before any distance is looked at: half of the points of a real road end
        // here.
        if darker < FEWEST_DARKER {
            return None;
        }
        let mut values = [0.0_f32; SAMPLES];
        let mut n = 0;
        for &steps in &steps[..count] {
            let j = beside(steps);
            let d = apart_m(j);
            if d >= 0.7 * config.beside_from_m && d <= 1.5 * config.beside_to_m {
                values[n] = reflectance[j];
                n += 1;
            }
        }
        if n < FEWEST {
            return None;
        }
        let values = &mut values[..n];
        values.sort_by(f32::total_cmp);
        let median = values[n / 2];
        // Median absolute deviation of half a dozen values: the inner half's width.
        let spread = (values[n - 1 - n / 4] - values[n / 4]) * 0.74;
        Some(Side { median, spread })
    }
}

/// The nearest whole number to one from 0 to 2^31, of two the even one.
/// `f64::round` is a call on processors that need not know the instruction, and
/// casts do not go side by side; at 1.5 * 2^52 the last bit of the sum is 1.
pub(super) fn rounded(v: f64) -> u32 {
    (v + 6_755_399_441_055_744.0).to_bits() as u32
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// A straight beam over asphalt with paint from `from` to `to` metres.
    fn beam(from: f64, to: f64) -> LidarScan {
        let points: Vec<Point3<f64>> = (0..300).map(|i| Point3::new(8.0, f64::from(i) * 0.025 - 3.75, -1.7)).collect();
        let reflectance = points
            .iter()
            .enumerate()
            .map(|(i, p)| {
                let grain = 0.01 * ((i * 7 % 5) as f32 - 2.0);
                if p.y > from && p.y < to { 0.55 + grain } else { 0.28 + grain }
            })
            .collect();
        LidarScan { points, reflectance, ..LidarScan::default() }
    }

    #[test]
    fn a_line_stands_out_and_the_asphalt_does_not() {
        let (scan, config) = (beam(0.0, 0.15), ContrastConfig::default());
        let contrasts = Contrasts::new(&scan, &config);
        for (i, p) in scan.points.iter().enumerate() {
            let c = contrasts.of(i, p.coords.norm()).unwrap();
            if p.y > 0.0 && p.y < 0.15 {
                assert!(c > 5.0);
            } else {
                assert!(c < 3.0, "{} {c}", p.y);
            }
        }
    }

    #[test]
    fn a_bright_verge_is_no_line() {
        let (scan, config) = (beam(0.0, 9.0), ContrastConfig::default());
        let contrasts = Contrasts::new(&scan, &config);
        let of = |(i, p): (usize, &Point3<f64>)| contrasts.of(i, p.coords.norm());
        assert!(scan.points.iter().enumerate().filter_map(of).all(|c| c < 3.0));
    }

    #[test]
    fn numbers_are_rounded_to_the_nearest() {
        for v in [0.0, 0.49, 0.499_999_999_999_999_94, 0.5, 0.51, 1.5, 2.5, 900.49, 900.51, 1e6] {
            assert_eq!(rounded(v), v.round_ties_even() as u32, "{v}");
        }
    }
}
