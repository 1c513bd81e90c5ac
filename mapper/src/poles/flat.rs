//! Plates that hide all that is seen of their post: flat, where a stem is round.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, SymmetricEigen, Vector2};

use super::PoleConfig;
use super::axis::{Axis, Hit};

/// Whether hits around an axis are those of a plate rather than of a stem that is as wide:
/// whether the hits of rows lie nearer to one plane than to circles, each about its own
/// middle, by the logarithm of the odds `n / 2 ln(S_stem / S_plate)` with the sums `S` of
/// their squares. Rows are asked one by one, for each laser errs in its range, and each
/// scan in its pose.
pub(super) fn is_plate(hits: &[Hit], axis: &Axis, radius_m: f64, config: &PoleConfig) -> bool {
    if radius_m < config.least_plate_m / 2.0 {
        return false;
    }
    let mut rows: BTreeMap<(u16, i32), Vec<&Hit>> = BTreeMap::new();
    for hit in hits {
        rows.entry((hit.scan, hit.beam(config))).or_default().push(hit);
    }
    // How far behind the near side of a stem a hit lies along the view.
    let off_stem_m = |hit: &Hit| {
        let off = hit.at_map - axis.at(hit.height_m);
        off.dot(&hit.from_lidar) + (radius_m.powi(2) - off.perp(&hit.from_lidar).powi(2)).max(0.0).sqrt()
    };
    let (mut scatter, mut of_stem, mut free) = (Matrix2::zeros(), 0.0, 0);
    for row in rows.values().filter(|row| row.len() >= FEWEST_OF_ROW) {
        let count = row.len() as f64;
        let mean = row.iter().map(|h| h.at_map).sum::<Vector2<f64>>() / count;
        scatter += row.iter().map(|h| (h.at_map - mean) * (h.at_map - mean).transpose()).sum::<Matrix2<f64>>();
        let mean_m = row.iter().map(|h| off_stem_m(h)).sum::<f64>() / count;
        of_stem += row.iter().map(|h| (off_stem_m(h) - mean_m).powi(2)).sum::<f64>();
        free += row.len() - 1;
    }
    let of_plate = SymmetricEigen::new(scatter).eigenvalues.min().max(f64::MIN_POSITIVE);
    free as f64 / 2.0 * (of_stem / of_plate).ln() >= config.plate_evidence
}

/// Fewest hits of a row that tell whether it is bent.
const FEWEST_OF_ROW: usize = 3;

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
                at_map: Vector2::new(radius_m * across, 12.0 + along_m(across) + error_m),
                height_m: height,
                above_ground_m: height,
                from_lidar: Vector2::y(),
                scan,
                elevation_rad: 0.0075 * f64::from(beam),
                range_m: 12.0,
                reflectance: 0.3,
            }
        };
        (0..3).flat_map(|scan| (0..6).flat_map(move |beam| (0..7).map(move |i| hit(scan, beam, i)))).collect()
    }

    #[test]
    fn a_plate_is_flat_from_straight_and_aslant_and_a_stem_is_not() {
        let is_plate = |radius_m: f64, along_m: &dyn Fn(f64) -> f64| {
            let axis = Axis::new(Vector2::new(0.0, 12.0), Vector2::zeros());
            is_plate(&hits(radius_m, along_m), &axis, radius_m, &PoleConfig::default())
        };
        for radius_m in [0.18, 0.25, 0.35] {
            assert!(
                is_plate(radius_m, &|_| 0.0) && is_plate(radius_m, &|across| 0.8 * radius_m * across),
                "{radius_m}"
            );
            assert!(!is_plate(radius_m, &|across| -radius_m * (1.0 - across * across).max(0.0).sqrt()), "{radius_m}");
        }
        // No plate is as narrow as a post.
        assert!(!is_plate(0.05, &|_| 0.0));
    }
}
