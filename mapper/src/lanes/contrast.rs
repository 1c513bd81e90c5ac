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

/// By how many standard deviations the reflectance of a point of a scan
/// exceeds that of its beam on both sides; 0 where it does not by more than
/// the least noise, or where the beam was interrupted; none beyond the range or above the road. Points are
/// expected in the order of the beams, as KITTI stores them; in another order
/// every point counts as interrupted.
pub fn contrast(scan: &LidarScan, i: usize, config: &ContrastConfig) -> Option<f32> {
    let p = &scan.points[i];
    let range = p.coords.norm();
    if range > config.farthest_m || p.z > range * config.highest_rad.sin() {
        return None;
    }
    let over = |side: &Side| scan.reflectance[i] - side.median;
    // Most points are asphalt, no brighter than either side: one is enough.
    let Some(left) = side(scan, i, -1, config).filter(|s| over(s) > config.least_noise) else {
        return Some(0.0);
    };
    let Some(right) = side(scan, i, 1, config).filter(|s| over(s) > config.least_noise) else {
        return Some(0.0);
    };
    let noise = left.spread.min(right.spread).max(config.least_noise);
    Some(over(&left).min(over(&right)) / noise)
}

struct Side {
    median: f32,
    spread: f32,
}

fn side(scan: &LidarScan, i: usize, step: isize, config: &ContrastConfig) -> Option<Side> {
    let at = |k: isize| {
        let j = usize::try_from(i as isize + step * k).ok()?;
        scan.points.get(j).map(|p| (j, (p - scan.points[i]).norm()))
    };
    let spacing = at(1).map(|(_, d)| d)?;
    if spacing > config.beside_from_m {
        return None;
    }
    // The azimuth step is constant: indices stand for distances.
    let per_metre = 1.0 / spacing.max(1e-3);
    let first = config.beside_from_m * per_metre;
    let last = config.beside_to_m * per_metre;
    let mut values = [0.0_f32; SAMPLES];
    let mut n = 0;
    for s in 0..SAMPLES {
        let share = s as f64 / (SAMPLES - 1) as f64;
        let k = (first + (last - first) * share).round() as isize;
        if let Some((j, d)) = at(k)
            && d >= 0.7 * config.beside_from_m
            && d <= 1.5 * config.beside_to_m
        {
            values[n] = scan.reflectance[j];
            n += 1;
        }
    }
    if n < SAMPLES / 2 {
        return None;
    }
    let values = &mut values[..n];
    values.sort_by(f32::total_cmp);
    let median = values[n / 2];
    // Median absolute deviation of half a dozen values: the inner half's width.
    let spread = (values[n - 1 - n / 4] - values[n / 4]) * 0.74;
    Some(Side { median, spread })
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
        let scan = beam(0.0, 0.15);
        for (i, p) in scan.points.iter().enumerate() {
            let c = contrast(&scan, i, &ContrastConfig::default()).unwrap();
            if p.y > 0.0 && p.y < 0.15 {
                assert!(c > 5.0);
            } else {
                assert!(c < 3.0, "{} {c}", p.y);
            }
        }
    }

    #[test]
    fn a_bright_verge_is_no_line() {
        let scan = beam(0.0, 9.0);
        let of = |i| contrast(&scan, i, &ContrastConfig::default());
        assert!((0..scan.points.len()).filter_map(of).all(|c| c < 3.0));
    }
}
