//! Plates that hide all that is seen of their post: flat, where a stem is round.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, SymmetricEigen, Vector2};

use super::PoleConfig;
use super::axis::Hit;

/// Whether hits across an axis are those of a plate and not of a stem that is as wide:
/// about the middle of its row each hit of a stem lies along the view as a circle has
/// it, with a variance of `(2/3 - (pi/4)^2) r^2`, and on a plate there is noise alone.
/// Rows are asked one by one, for each laser errs in its range, and each scan in its pose.
pub(super) fn is_plate(hits: &[Hit], radius_m: f64, config: &PoleConfig) -> bool {
    let mut rows: BTreeMap<(u16, i32), Vec<Vector2<f64>>> = BTreeMap::new();
    for hit in hits {
        let beam = (hit.elevation_rad / config.beam_step_rad).round() as i32;
        rows.entry((hit.scan, beam)).or_default().push(hit.at);
    }
    let (mut scatter, mut free) = (Matrix2::zeros(), 0);
    for row in rows.values().filter(|row| row.len() >= FEWEST_OF_ROW) {
        let mean = row.iter().sum::<Vector2<f64>>() / row.len() as f64;
        scatter += row.iter().map(|at| (at - mean) * (at - mean).transpose()).sum::<Matrix2<f64>>();
        free += row.len() - 1;
    }
    if radius_m < config.least_plate_m / 2.0 || free < config.fewest_points {
        return false;
    }
    let thickness2_m2 = SymmetricEigen::new(scatter).eigenvalues.min().max(0.0) / free as f64;
    thickness2_m2 - config.hit_noise_m.powi(2) < config.flat_share * ROUND * radius_m.powi(2)
}

/// Fewest hits of a row that tell whether it is bent.
const FEWEST_OF_ROW: usize = 3;

/// Variance along the view of hits that are spread evenly over the width of a cylinder of
/// unit radius: `2/3 - (pi/4)^2`.
const ROUND: f64 = 0.0498;

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of hits of three scans on something so wide, with how far each lies along the
    /// view at its place across it, from -1 to 1.
    fn hits(radius_m: f64, along_m: impl Fn(f64) -> f64) -> Vec<Hit> {
        let hit = |scan: u16, beam: u8, i: u8| {
            let across = (f64::from(i) - 3.0) / 3.2;
            // Any value in -1..1.
            let noise = (37.7 * f64::from(i) + 12.9 * f64::from(beam) + 78.2 * f64::from(scan)).sin();
            let error_m = 0.02 * f64::from(beam % 3) + 0.03 * noise;
            let height = 2.0 + 0.1 * f64::from(beam);
            Hit {
                at: Vector2::new(radius_m * across, 12.0 + along_m(across) + error_m),
                height,
                above_ground: height,
                from_lidar: Vector2::y(),
                scan,
                elevation_rad: 0.0075 * f64::from(beam),
                range: 12.0,
                reflectance: 0.3,
            }
        };
        (0..3).flat_map(|scan| (0..6).flat_map(move |beam| (0..7).map(move |i| hit(scan, beam, i)))).collect()
    }

    #[test]
    fn a_plate_is_flat_from_straight_and_aslant_and_a_stem_is_not() {
        let config = PoleConfig::default();
        for radius_m in [0.18, 0.25, 0.35] {
            assert!(is_plate(&hits(radius_m, |_| 0.0), radius_m, &config), "{radius_m}");
            assert!(is_plate(&hits(radius_m, |across| 0.8 * radius_m * across), radius_m, &config), "{radius_m}");
            let stem = |across: f64| -radius_m * (1.0 - across * across).max(0.0).sqrt();
            assert!(!is_plate(&hits(radius_m, stem), radius_m, &config), "{radius_m}");
        }
        // No plate is as narrow as a post.
        assert!(!is_plate(&hits(0.05, |_| 0.0), 0.05, &config) && !is_plate(&[], 0.25, &config));
    }
}
