//! What stands where in a map file, for people.

use super::Bounds;

/// The sections of a map file, in file order, and what its header says.
#[derive(Debug, Clone, PartialEq)]
pub struct MapLayout {
    /// Version of the format.
    pub version: u8,
    /// Step of all coordinates, metres.
    pub quantum_m: f64,
    /// The box around everything; none for an empty map.
    pub bounds: Option<Bounds>,
    /// Header, roads, poles per kind, signs per kind, lanes per kind, marks of
    /// dashed lines where there are any, checksum.
    pub sections: Vec<SectionSize>,
}

/// How much one section takes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SectionSize {
    /// What it holds.
    pub name: String,
    /// How many landmarks (roads, ..) it holds.
    pub items: usize,
    /// How many bytes it takes.
    pub bytes: usize,
}

impl MapLayout {
    /// Length of the whole file, bytes.
    pub fn total_bytes(&self) -> usize {
        self.sections.iter().map(|section| section.bytes).sum()
    }
}
