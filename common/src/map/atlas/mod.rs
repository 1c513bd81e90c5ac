//! Many maps in one file, of which a reader loads what is around it.
//!
//! An atlas is a packed Hilbert R-tree (Kamel and Faloutsos, 1993) whose leaves
//! are ordinary map files: the roads of all maps are sorted along a Hilbert
//! curve, neighbours are packed into tiles, and boxes of tiles into nodes, up
//! to one root. Opening reads the header and the root; a query goes down from
//! there. `ATLAS.md` beside this crate's manifest describes every byte.

mod builder;
mod entry;
mod file;
mod header;
mod hilbert;
mod reader;
mod sorter;
#[cfg(test)]
mod tests;
mod tile;

pub use builder::{AtlasBuilder, AtlasOptions};
pub use reader::{Area, Atlas, TilePlace, is_atlas};
pub use tile::Tile;

use super::Bounds;

/// How much there is of what.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Tiles.
    pub tiles: u32,
    /// Roads.
    pub roads: u32,
    /// Poles.
    pub poles: u32,
    /// Signs.
    pub signs: u32,
    /// Lane lines.
    pub lanes: u32,
}

impl Counts {
    /// Both together; none where a number is no longer one of 32 bits.
    pub fn checked_add(self, other: Self) -> Option<Self> {
        Some(Self {
            tiles: self.tiles.checked_add(other.tiles)?,
            roads: self.roads.checked_add(other.roads)?,
            poles: self.poles.checked_add(other.poles)?,
            signs: self.signs.checked_add(other.signs)?,
            lanes: self.lanes.checked_add(other.lanes)?,
        })
    }
}

/// What the header of an atlas says.
#[derive(Debug, Clone, PartialEq)]
pub struct AtlasSummary {
    /// Version of the format.
    pub version: u8,
    /// Length of the file, bytes.
    pub bytes: u64,
    /// Step of all coordinates, metres.
    pub quantum_m: f64,
    /// What the frame is, for people.
    pub frame_note: String,
    /// Levels of nodes over the tiles.
    pub levels: u8,
    /// The box around everything; none for an empty atlas.
    pub bounds: Option<Bounds>,
    /// What is in it.
    pub counts: Counts,
}
