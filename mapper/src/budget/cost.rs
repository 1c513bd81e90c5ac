//! What landmarks cost in the file: bytes as they are really encoded.

use std::collections::BTreeMap;

use common::map::{EncodeOptions, LaneLine, Pole, RoadId, SemanticMap, Sign, layout};
use nalgebra::Point3;

use crate::error::Result;
use crate::evidence::MapEvidence;

/// Landmarks of one kind on one road: they are coded one after the other, so
/// that the cost of one depends on which of the others are kept.
pub type Group = (usize, u32);

/// A map of some landmarks; a landmark is its index among poles, then signs,
/// then lane lines.
pub struct Coder<'a> {
    map: &'a SemanticMap,
    options: EncodeOptions,
}

impl<'a> Coder<'a> {
    /// For the landmarks of a map.
    pub fn new(map: &'a SemanticMap, quantum_m: f64) -> Self {
        Self { map, options: EncodeOptions { quantum_m } }
    }

    /// Number of landmarks.
    pub fn count(&self) -> usize {
        self.map.poles.len() + self.map.signs.len() + self.map.lanes.len()
    }

    /// The group that a landmark belongs to.
    pub fn group(&self, landmark: usize) -> Group {
        match self.get(landmark) {
            Some(Landmark::Pole(pole)) => (pole.kind as usize, pole.road.0),
            Some(Landmark::Sign(sign)) => (SIGNS + sign.kind as usize, sign.road.0),
            Some(Landmark::Lane(lane)) => (LANES + lane.kind as usize, lane.road.0),
            None => (usize::MAX, 0),
        }
    }

    fn get(&self, landmark: usize) -> Option<Landmark<'a>> {
        let (poles, signs) = (self.map.poles.len(), self.map.signs.len());
        if let Some(pole) = self.map.poles.get(landmark) {
            return Some(Landmark::Pole(pole));
        }
        if let Some(sign) = self.map.signs.get(landmark.checked_sub(poles)?) {
            return Some(Landmark::Sign(sign));
        }
        self.map.lanes.get(landmark.checked_sub(poles + signs)?).map(Landmark::Lane)
    }

    /// The map of some landmarks, in this order, all roads in it.
    pub fn map_of(&self, landmarks: &[usize]) -> SemanticMap {
        let mut map = without_landmarks(self.map);
        for landmark in landmarks {
            match self.get(*landmark) {
                Some(Landmark::Pole(pole)) => map.poles.push(*pole),
                Some(Landmark::Sign(sign)) => map.signs.push(*sign),
                Some(Landmark::Lane(lane)) => map.lanes.push(lane.clone()),
                None => {}
            }
        }
        map
    }

    /// Bytes of the file of some landmarks.
    ///
    /// # Errors
    /// As [`SemanticMap::encode`].
    pub fn file_bytes(&self, landmarks: &[usize]) -> Result<usize> {
        Ok(self.map_of(landmarks).encode(&self.options)?.len())
    }

    /// Bytes of the landmarks of one group in their section, encoded on their
    /// road alone.
    ///
    /// # Errors
    /// As [`SemanticMap::encode`].
    pub fn group_bytes(&self, landmarks: &[usize]) -> Result<usize> {
        let mut map = SemanticMap::default();
        for landmark in landmarks {
            match self.get(*landmark) {
                Some(Landmark::Pole(pole)) => map.poles.push(Pole { road: RoadId(0), ..*pole }),
                Some(Landmark::Sign(sign)) => map.signs.push(Sign { road: RoadId(0), ..*sign }),
                Some(Landmark::Lane(lane)) => map.lanes.push(LaneLine { road: RoadId(0), ..lane.clone() }),
                None => {}
            }
        }
        let road = landmarks.first().map_or(0, |landmark| self.group(*landmark).1);
        map.roads.extend(self.map.roads.get(road as usize).cloned());
        let sections = layout(&map.encode(&self.options)?)?.sections;
        // Header, roads and checksum are those of the whole map.
        let landmarks_only = sections.iter().skip(2).take(sections.len().saturating_sub(3));
        Ok(landmarks_only.map(|section| section.bytes).sum())
    }
}

enum Landmark<'a> {
    Pole(&'a Pole),
    Sign(&'a Sign),
    Lane(&'a LaneLine),
}

/// First number of the kinds of signs and of lane lines among all kinds.
const SIGNS: usize = 100;
const LANES: usize = 200;

/// The roads of a map alone.
pub fn without_landmarks(map: &SemanticMap) -> SemanticMap {
    SemanticMap { frame_note: map.frame_note.clone(), roads: map.roads.clone(), ..SemanticMap::default() }
}

/// The evidence in the order of a map as it was decoded: `kept` is the same
/// map before it was encoded, with the evidence in its own order.
pub fn in_order_of(decoded: &SemanticMap, kept: &SemanticMap, evidence: &MapEvidence, quantum_m: f64) -> MapEvidence {
    let grid =
        |p: &Point3<f64>| [p.x, p.y, p.z].map(|metres| (metres * 1e6 / (quantum_m * 1e6).round()).round() as i64);
    // Tops need not lie on the grid.
    let pole = |p: &Pole| (p.kind, p.road, [grid(&p.foot_map).as_slice(), &grid(&p.top_map)[1..2]].concat());
    let sign = |s: &Sign| (s.kind, s.road, grid(&s.centroid_map));
    let lane = |l: &LaneLine| (l.kind, l.road, l.points_map.iter().map(grid).collect::<Vec<_>>());
    MapEvidence {
        poles: matched(decoded.poles.iter().map(pole), kept.poles.iter().map(pole).zip(&evidence.poles)),
        signs: matched(decoded.signs.iter().map(sign), kept.signs.iter().map(sign).zip(&evidence.signs)),
        lanes: matched(decoded.lanes.iter().map(lane), kept.lanes.iter().map(lane).zip(&evidence.lanes)),
    }
}

fn matched<'a, K: Ord, E: Copy + 'a>(
    wanted: impl Iterator<Item = K>,
    kept: impl Iterator<Item = (K, &'a E)>,
) -> Vec<E> {
    // Two landmarks on the same grid points have the same evidence but for
    // what the grid has lost.
    let by_place: BTreeMap<K, E> = kept.map(|(key, evidence)| (key, *evidence)).collect();
    wanted.filter_map(|key| by_place.get(&key).copied()).collect()
}
