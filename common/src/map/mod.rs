//! The compact semantic map: what it holds, and how it is stored.
//!
//! [`SemanticMap`] is what the rest of the program sees; `wire` is what
//! stands in the file. One function goes each way, [`SemanticMap::encode`] and
//! [`SemanticMap::decode`], and validation stands there alone. `FORMAT.md`
//! beside this crate's manifest describes every byte.

mod ascii;
pub mod atlas;
mod bounds;
mod decode;
mod encode;
mod envelope;
mod file;
mod grid;
mod layout;
mod marks;
mod model;
mod numbering;
mod pole;
#[cfg(test)]
mod tests;
mod varint;
mod wire;

pub use ascii::ascii;
pub use bounds::Bounds;
pub use decode::{decode_with_layout, layout};
pub use file::{read, write};
pub use layout::{MapLayout, SectionSize};
pub use marks::marks_along;
pub use model::{LaneKind, LaneLine, Pole, PoleKind, Road, RoadId, SemanticMap, Sign, SignKind};
pub use numbering::Numbering;

/// How a map is stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EncodeOptions {
    /// Step to which all coordinates and sizes are rounded, metres: from
    /// 0.000001 to 1, in whole micrometres.
    pub quantum_m: f64,
}

impl Default for EncodeOptions {
    /// One centimetre: an error of at most 5 mm per coordinate, an eighth of
    /// what one lidar return is off.
    fn default() -> Self {
        Self { quantum_m: 0.01 }
    }
}

/// Longest [`SemanticMap::frame_note`], bytes.
pub const MAX_NOTE_BYTES: usize = 64;

/// What is wrong with a frame note. It ends up on terminals, so nothing that
/// controls one may be in it.
fn note_fault(note: &str) -> Option<String> {
    if note.len() > MAX_NOTE_BYTES {
        Some(format!("its frame note has {} bytes", note.len()))
    } else if note.chars().any(char::is_control) {
        Some("its frame note contains a control character".into())
    } else {
        None
    }
}
