//! Which tiles of an atlas are held: those that are asked for, those ahead,
//! and for a while those behind.

use common::map::Numbering;
use common::map::atlas::{Area, Atlas, TilePlace};
use serde::{Deserialize, Serialize};

use super::Held;
use crate::Result;
use crate::road_index::{Cells, RoadIndex};

/// Settings of an atlas in use. They change when a tile is read, and never a
/// pose, but for `max_reach_m`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LocalMapConfig {
    /// Tiles are read this far ahead of what is asked for, metres: 200 m are
    /// four seconds at the highest speed, one tile each frame.
    pub prefetch_m: f64,
    /// A tile is dropped this far behind that, metres, so that one at the edge
    /// is not read again and again.
    pub keep_m: f64,
    /// No road is looked for further away, metres: where the position is not
    /// known better, nothing can be associated, and the work must end somewhere.
    pub max_reach_m: f64,
}

impl Default for LocalMapConfig {
    fn default() -> Self {
        Self { prefetch_m: 200.0, keep_m: 100.0, max_reach_m: 500.0 }
    }
}

/// What was read of an atlas.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Usage {
    /// Bytes, header and index included.
    pub bytes_read: u64,
    /// Tiles; one that was dropped and read again counts twice.
    pub tiles_read: usize,
    /// Most tiles held at a time.
    pub most_held: usize,
}

/// The atlas, and what of it is held.
#[derive(Debug)]
pub(super) struct Surroundings {
    atlas: Atlas,
    config: LocalMapConfig,
    frame: u64,
    /// The last area that was asked for.
    asked: Option<Area>,
    /// All tiles in this area are known.
    known: Option<Area>,
    /// Known tiles that are not held.
    waiting: Vec<TilePlace>,
    /// Where the held tiles are, and the last frame that asked for them.
    places: Vec<(TilePlace, u64)>,
    usage: Usage,
}

/// The area of whole cells.
pub(super) fn area_of(cells: &Cells) -> Area {
    let (min_xz, max_xz) = cells.corners_m();
    Area { min_xz, max_xz }
}

/// Whether the tile at byte `offset` of the atlas is one of `places`.
fn is_held(places: &[(TilePlace, u64)], offset: u64) -> bool {
    places.binary_search_by_key(&offset, |(place, _)| place.offset()).is_ok()
}

impl Surroundings {
    /// An atlas of which nothing is held yet.
    pub fn new(atlas: Atlas, config: LocalMapConfig) -> Self {
        Self {
            atlas,
            config,
            frame: 0,
            asked: None,
            known: None,
            waiting: Vec::new(),
            places: Vec::new(),
            usage: Usage::default(),
        }
    }

    /// How far is looked where `reach_m` is asked for, metres.
    pub fn reach_m(&self, reach_m: f64) -> f64 {
        reach_m.min(self.config.max_reach_m)
    }

    /// What was read so far.
    pub fn usage(&self) -> Usage {
        Usage { bytes_read: self.atlas.bytes_read(), ..self.usage }
    }

    /// The numbers of the landmarks of the whole atlas.
    pub fn numbering(&self) -> Numbering {
        let counts = self.atlas.summary().counts;
        Numbering::new(counts.poles as usize, counts.signs as usize, counts.lanes as usize)
    }

    /// Makes sure that everything in `area` is held.
    pub fn need(&mut self, area: &Area, held: &mut Vec<Held>) -> Result<()> {
        self.asked = Some(*area);
        self.know(area)?;
        while let Some(next) = self.waiting.iter().position(|place| area.touches(&place.bounds)) {
            self.read(next, held)?;
        }
        for (place, used) in &mut self.places {
            if area.touches(&place.bounds) {
                *used = self.frame;
            }
        }
        Ok(())
    }

    /// Drops the tiles that were left behind, and reads the nearest of those
    /// ahead.
    pub fn next_frame(&mut self, held: &mut Vec<Held>) -> Result<()> {
        self.frame += 1;
        let Some(asked) = self.asked else { return Ok(()) };
        let ahead = asked.grown(self.config.prefetch_m);
        let kept = ahead.grown(self.config.keep_m);
        let (last, known) = (self.frame - 1, self.known);
        let waiting = &mut self.waiting;
        self.places.retain(|(place, used)| {
            let stays = *used >= last || kept.touches(&place.bounds);
            if !stays && known.is_some_and(|known| known.touches(&place.bounds)) {
                waiting.push(*place);
            }
            stays
        });
        if held.len() != self.places.len() {
            held.retain(|held| is_held(&self.places, held.tile));
        }
        self.know(&asked.grown(0.5 * self.config.prefetch_m))?;
        let nearest = (0..self.waiting.len())
            .filter(|&i| self.waiting.get(i).is_some_and(|place| ahead.touches(&place.bounds)))
            .min_by(|&a, &b| self.distance_m(a, &asked).total_cmp(&self.distance_m(b, &asked)));
        nearest.map_or(Ok(()), |next| self.read(next, held))
    }

    /// Makes sure that all tiles in `area` are known.
    fn know(&mut self, area: &Area) -> Result<()> {
        if self.known.is_some_and(|known| known.contains(area)) {
            return Ok(());
        }
        let wide = area.grown(self.config.prefetch_m);
        let mut found = self.atlas.tiles_in(&wide)?;
        found.retain(|place| !is_held(&self.places, place.offset()));
        self.waiting = found;
        self.known = Some(wide);
        Ok(())
    }

    /// Reads the tile `waiting[next]`.
    fn read(&mut self, next: usize, held: &mut Vec<Held>) -> Result<()> {
        let Some(place) = self.waiting.get(next).copied() else { return Ok(()) };
        // One that cannot be read goes on waiting: it is not left out in silence.
        let tile = self.atlas.tile(&place)?;
        self.waiting.swap_remove(next);
        let at = self.places.partition_point(|(other, _)| other.offset() < place.offset());
        self.places.insert(at, (place, self.frame));
        let index = RoadIndex::new(&tile.map);
        let (map, road_numbers) = (tile.map, tile.road_numbers);
        held.insert(at, Held { tile: place.offset(), map, index, road_numbers, before: place.before });
        self.usage.tiles_read += 1;
        self.usage.most_held = self.usage.most_held.max(held.len());
        Ok(())
    }

    /// How far a waiting tile is from the middle of an area, metres.
    fn distance_m(&self, waiting: usize, area: &Area) -> f64 {
        let Some(TilePlace { bounds, .. }) = self.waiting.get(waiting) else { return f64::INFINITY };
        let off = |axis: usize, min: f64, max: f64| {
            let middle = 0.5 * (area.min_xz[axis] + area.max_xz[axis]);
            (min - middle).max(middle - max).max(0.0)
        };
        off(0, bounds.min_map.x, bounds.max_map.x).hypot(off(1, bounds.min_map.z, bounds.max_map.z))
    }
}
