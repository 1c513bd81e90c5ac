//! Covariances of a source's points as bytes, small and without rounding.

use common::map::SemanticMap;
use nalgebra::Matrix3;

use crate::evidence::PointCovariances;

/// Square metres of one step: evidence is rounded to it.
const STEP_M2: f64 = 1e-8;
/// The entries of a symmetric matrix.
const ENTRIES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
/// Bytes of an entry.
const BYTES: usize = size_of::<i32>();

/// Six numbers for each pole and then for each sign, the lowest byte first.
pub fn to_bytes(known: &PointCovariances) -> Vec<u8> {
    let entries = known.poles.iter().chain(&known.signs).flat_map(|c| ENTRIES.map(|entry| c[entry]));
    // 21 square metres are the most that a number holds: then it is not known.
    entries.flat_map(|m2| ((m2 / STEP_M2).round() as i32).to_le_bytes()).collect()
}

/// The covariances of the landmarks of this map; none where the bytes are of
/// another number of landmarks.
pub fn from_bytes(bytes: &[u8], map: &SemanticMap) -> Option<PointCovariances> {
    let (poles, signs) = (map.poles.len(), map.signs.len());
    let matrix = |bytes: &[u8]| {
        let mut covariance = Matrix3::zeros();
        for ((i, j), number) in ENTRIES.into_iter().zip(bytes.chunks_exact(BYTES)) {
            let steps = number.first_chunk().map_or(0, |number| i32::from_le_bytes(*number));
            covariance[(i, j)] = f64::from(steps) * STEP_M2;
            covariance[(j, i)] = covariance[(i, j)];
        }
        covariance
    };
    let length = ENTRIES.len() * BYTES;
    let mut matrices = bytes.chunks_exact(length).map(matrix);
    let known = PointCovariances { poles: matrices.by_ref().take(poles).collect(), signs: matrices.collect() };
    (bytes.len() == (poles + signs) * length).then_some(known)
}

#[cfg(test)]
mod tests {
    use common::map::{Pole, PoleKind, RoadId};
    use nalgebra::Point3;

    use super::*;
    use crate::evidence::PointEvidence;

    #[test]
    fn covariances_come_back_as_they_were() {
        let covariance = Matrix3::new(4e-4, 1.23e-5, -7e-6, 1.23e-5, 0.02, 3e-8, -7e-6, 3e-8, 1e-4);
        let covariance = PointEvidence::new(&covariance, 9, 2).covariance();
        let known = PointCovariances { poles: vec![covariance; 2], signs: Vec::new() };
        let foot_map = Point3::new(1.0, 2.0, 3.0);
        let pole = Pole { kind: PoleKind::Trunk, foot_map, top_map: foot_map, road: RoadId(0) };
        let map = SemanticMap { poles: vec![pole; 2], ..SemanticMap::default() };
        let bytes = to_bytes(&known);
        let back = from_bytes(&bytes, &map).unwrap();
        assert!((back.poles[1] - covariance).norm() < 1e-12 && back.poles.len() == 2 && back.signs.is_empty());
        assert_eq!(to_bytes(&back), bytes);
        assert_eq!(from_bytes(&bytes, &SemanticMap::default()), None);
        assert_eq!(from_bytes(&bytes[1..], &map), None);
    }
}
