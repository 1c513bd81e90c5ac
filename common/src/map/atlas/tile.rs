//! A tile: some roads of the atlas with their landmarks, as a map file, and
//! the numbers that these roads have in the atlas.

use super::super::varint::Unsigned;
use super::super::wire::{DECODE_LIMIT, List};
use super::super::{EncodeOptions, SemanticMap};
use super::Counts;
use crate::{Error, Result};

/// Roads that lie near each other, with their landmarks.
#[derive(Debug, Clone, PartialEq)]
pub struct Tile {
    /// The roads and their landmarks, in the frame of the atlas.
    pub map: SemanticMap,
    /// The number of each road of `map` in the atlas, ascending. A map that
    /// was cut into tiles has its roads in the order of these numbers.
    pub road_numbers: Vec<u32>,
}

impl Tile {
    /// What is in it; none where that is more than 32 bits can count.
    pub(super) fn counts(&self) -> Option<Counts> {
        let map = &self.map;
        Some(Counts {
            tiles: 1,
            roads: u32::try_from(map.roads.len()).ok()?,
            poles: u32::try_from(map.poles.len()).ok()?,
            signs: u32::try_from(map.signs.len()).ok()?,
            lanes: u32::try_from(map.lanes.len()).ok()?,
        })
    }

    /// Its bytes: the numbers, then the map file.
    pub(super) fn encode(&self, options: EncodeOptions) -> Result<Vec<u8>> {
        let mut next = 0;
        let gaps = self.road_numbers.iter().map(|&number| {
            let gap = u64::from(number).wrapping_sub(next);
            next = u64::from(number) + 1;
            Unsigned(gap)
        });
        let gaps = List(gaps.collect());
        let mut bytes = bincode::encode_to_vec(gaps, bincode::config::standard())
            .map_err(|e| Error::AtlasUnencodable { what: format!("the numbers of the roads of a tile: {e}") })?;
        bytes.extend_from_slice(&self.map.encode(&options)?);
        Ok(bytes)
    }

    /// From its bytes; what is wrong with them as the end of a sentence.
    pub(super) fn decode(bytes: &[u8]) -> std::result::Result<Self, String> {
        let config = bincode::config::standard().with_limit::<DECODE_LIMIT>();
        let (gaps, used) = bincode::decode_from_slice::<List<Unsigned>, _>(bytes, config)
            .map_err(|e| format!("has no list of road numbers ({e})"))?;
        let mut next = 0_u64;
        let mut road_numbers = Vec::with_capacity(gaps.0.len());
        for Unsigned(gap) in gaps.0 {
            let number = u32::try_from(next + gap).map_err(|_| "has a road number over 32 bits".to_owned())?;
            next = u64::from(number) + 1;
            road_numbers.push(number);
        }
        let map = SemanticMap::decode(bytes.get(used..).unwrap_or(&[])).map_err(|e| format!("holds no map ({e})"))?;
        if map.roads.len() != road_numbers.len() {
            return Err(format!("has {} roads and {} road numbers", map.roads.len(), road_numbers.len()));
        }
        Ok(Self { map, road_numbers })
    }
}
