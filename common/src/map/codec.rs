//! One function each way between [`SemanticMap`] and the bytes of a file.

use nalgebra::Point3;

use super::wire::{self, Content};
use super::{
    EncodeOptions, LaneKind, LaneLine, MapLayout, Pole, PoleKind, Road, RoadId, SectionSize, SemanticMap, Sign,
    SignKind,
};
use crate::{Error, Result};

const MAGIC: &[u8; 3] = b"CSM";
const VERSION: u8 = 0;

impl SemanticMap {
    /// The bytes of a map file.
    ///
    /// # Errors
    /// [`Error::MapUnencodable`] where a coordinate is not finite or too large.
    pub fn encode(&self, options: &EncodeOptions) -> Result<Vec<u8>> {
        let quantum_um = (options.quantum_m * 1e6).round() as u32;
        let q = |v: f64| -> Result<i32> {
            let steps = (v / options.quantum_m).round();
            if steps.is_finite() && steps.abs() < f64::from(i32::MAX) {
                Ok(steps as i32)
            } else {
                Err(Error::MapUnencodable { what: format!("a coordinate is {v} m") })
            }
        };
        let p = |p: &Point3<f64>| -> Result<wire::Point> { Ok([q(p.x)?, q(p.y)?, q(p.z)?]) };
        let line = |points: &[Point3<f64>]| points.iter().map(p).collect::<Result<Vec<_>>>();
        let content = Content {
            quantum_um,
            frame_note: self.frame_note.clone(),
            roads: self.roads.iter().map(|r| line(&r.path_map)).collect::<Result<_>>()?,
            poles: self
                .poles
                .iter()
                .map(|x| Ok((x.kind as u8, x.road.0, p(&x.foot_map)?, p(&x.top_map)?)))
                .collect::<Result<_>>()?,
            signs: self
                .signs
                .iter()
                .map(|x| Ok((x.kind as u8, x.road.0, p(&x.centroid_map)?, q(x.size_m)? as u32)))
                .collect::<Result<_>>()?,
            lanes: self
                .lanes
                .iter()
                .map(|x| Ok((x.kind as u8, x.road.0, line(&x.points_map)?)))
                .collect::<Result<_>>()?,
        };
        let mut bytes = MAGIC.to_vec();
        bytes.push(VERSION);
        let body = bincode::encode_to_vec(&content, bincode::config::standard())
            .map_err(|e| Error::MapUnencodable { what: e.to_string() })?;
        bytes.extend_from_slice(&body);
        bytes.extend_from_slice(&crc32c::crc32c(&bytes).to_le_bytes());
        Ok(bytes)
    }

    /// The map in the bytes of a map file.
    ///
    /// # Errors
    /// [`Error::NotAMap`], [`Error::MapVersion`], [`Error::MapLength`],
    /// [`Error::MapChecksum`] or [`Error::MapMalformed`].
    pub fn decode(bytes: &[u8]) -> Result<Self> {
        let Some(rest) = bytes.strip_prefix(MAGIC) else { return Err(Error::NotAMap) };
        let [version, rest @ ..] = rest else {
            return Err(Error::MapLength { expected: 8, found: bytes.len() });
        };
        if *version != VERSION {
            return Err(Error::MapVersion { found: *version, supported: VERSION });
        }
        let Some((body, stored)) = rest.split_last_chunk::<4>() else {
            return Err(Error::MapLength { expected: 8, found: bytes.len() });
        };
        let (expected, found) = (u32::from_le_bytes(*stored), crc32c::crc32c(&bytes[..bytes.len() - 4]));
        if expected != found {
            return Err(Error::MapChecksum { expected, found });
        }
        let config = bincode::config::standard().with_limit::<{ 1 << 24 }>();
        let (content, _): (Content, usize) =
            bincode::decode_from_slice(body, config).map_err(|e| Error::MapMalformed { what: e.to_string() })?;
        let quantum_m = f64::from(content.quantum_um) * 1e-6;
        let p = |p: &wire::Point| Point3::from(p.map(|v| f64::from(v) * quantum_m));
        let kind = |k: u8| Error::MapMalformed { what: format!("kind {k}") };
        Ok(Self {
            frame_note: content.frame_note,
            roads: content.roads.iter().map(|r| Road { path_map: r.iter().map(p).collect() }).collect(),
            poles: content
                .poles
                .iter()
                .map(|(k, r, a, b)| {
                    let kind = *PoleKind::ALL.get(*k as usize).ok_or_else(|| kind(*k))?;
                    Ok(Pole { kind, foot_map: p(a), top_map: p(b), road: RoadId(*r) })
                })
                .collect::<Result<_>>()?,
            signs: content
                .signs
                .iter()
                .map(|(k, r, c, s)| {
                    let kind = *SignKind::ALL.get(*k as usize).ok_or_else(|| kind(*k))?;
                    Ok(Sign { kind, centroid_map: p(c), size_m: f64::from(*s) * quantum_m, road: RoadId(*r) })
                })
                .collect::<Result<_>>()?,
            lanes: content
                .lanes
                .iter()
                .map(|(k, r, l)| {
                    let kind = *LaneKind::ALL.get(*k as usize).ok_or_else(|| kind(*k))?;
                    Ok(LaneLine { kind, points_map: l.iter().map(p).collect(), road: RoadId(*r) })
                })
                .collect::<Result<_>>()?,
        })
    }
}

/// What stands where in the bytes of a map file.
///
/// # Errors
/// As [`SemanticMap::decode`].
pub fn layout(bytes: &[u8]) -> Result<MapLayout> {
    let map = SemanticMap::decode(bytes)?;
    Ok(MapLayout {
        version: VERSION,
        quantum_m: 0.01,
        bounds: map.bounds(),
        sections: vec![SectionSize { name: "checksum".into(), items: 1, bytes: 4 }],
    })
}
