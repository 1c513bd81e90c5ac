//! The compact semantic map: what it holds, and how it is stored.
//!
//! [`SemanticMap`] is what the rest of the program sees; `wire` is what
//! stands in the file. One function goes each way, [`SemanticMap::encode`] and
//! [`SemanticMap::decode`], and validation stands there alone. `FORMAT.md`
//! beside this crate's manifest describes every byte.

mod ascii;
mod bounds;
mod codec;
mod file;
mod layout;
mod model;
mod wire;

pub use ascii::ascii;
pub use bounds::Bounds;
pub use codec::layout;
pub use file::{read, write};
pub use layout::{MapLayout, SectionSize};
pub use model::{LaneKind, LaneLine, Pole, PoleKind, Road, RoadId, SemanticMap, Sign, SignKind};

/// How a map is stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EncodeOptions {
    /// Step to which all coordinates and sizes are rounded, metres.
    pub quantum_m: f64,
}

impl Default for EncodeOptions {
    fn default() -> Self {
        Self { quantum_m: 0.01 }
    }
}
