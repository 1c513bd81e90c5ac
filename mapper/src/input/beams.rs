//! Points in the order of the beams.
//!
//! Lane paint is told by comparing a point with its neighbours on the beam,
//! which KITTI stores one after the other. Other recorders store column by
//! column, and stitched clouds in no order at all.

use common::kitti::ScanPoint;

/// The share of a beam's spacing within which two elevations are one beam's.
const SHARE_OF_STEP: f32 = 0.25;

/// Puts the points of a scan (lidar frame) into the order of the beams and,
/// on each, of the azimuth, unless they are in the order of the beams already.
/// `ring` is the beam of each point, where the file says it; otherwise beams
/// are told by their elevation, `step_rad` being the mean angle between two.
pub fn order(points: &mut [ScanPoint], ring: &[u16], step_rad: f64) {
    let width_rad = step_rad as f32 * SHARE_OF_STEP;
    let elevation = |p: &ScanPoint| p.z_m.atan2(p.x_m.hypot(p.y_m));
    let along = points.windows(2).filter(|w| (elevation(&w[0]) - elevation(&w[1])).abs() < width_rad).count();
    if 2 * along >= points.len() {
        return;
    }
    let mut keyed: Vec<(i32, f32, ScanPoint)> = points
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let beam = match ring.get(i) {
                Some(ring) => i32::from(*ring),
                // From the highest down, as the beams of KITTI.
                None => -(elevation(p) / width_rad).floor() as i32,
            };
            (beam, p.y_m.atan2(p.x_m), *p)
        })
        .collect();
    keyed.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    for (slot, (_, _, p)) in points.iter_mut().zip(keyed) {
        *slot = p;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Beams of a lidar 1.7 m above a plain.
    fn beams() -> Vec<Vec<ScanPoint>> {
        (0..20)
            .map(|beam| {
                let range = 4.0 + 0.7 * beam as f32;
                (0..600)
                    .map(|i| {
                        let azimuth = (i as f32 - 300.0) * 0.01;
                        let (sin, cos) = azimuth.sin_cos();
                        ScanPoint { x_m: range * cos, y_m: range * sin, z_m: -1.7, reflectance: beam as f32 }
                    })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn columns_become_beams_and_beams_stay() {
        let beams = beams();
        let by_beam: Vec<ScanPoint> = beams.iter().flatten().copied().collect();
        let by_column: Vec<ScanPoint> = (0..600).flat_map(|i| beams.iter().map(move |b| b[i])).collect();
        let mut kept = by_beam.clone();
        order(&mut kept, &[], 0.0073);
        assert_eq!(kept, by_beam);
        let rings: Vec<u16> = by_column.iter().map(|p| p.reflectance as u16).collect();
        for rings in [&rings[..], &[]] {
            let mut ordered = by_column.clone();
            order(&mut ordered, rings, 0.0073);
            let same = ordered.windows(2).filter(|w| (w[0].reflectance - w[1].reflectance).abs() < 0.5).count();
            assert!(same >= ordered.len() - 20, "{same} of {}", ordered.len());
        }
    }
}
