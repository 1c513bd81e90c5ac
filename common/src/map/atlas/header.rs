//! The first bytes of an atlas.

use super::super::grid::Grid;
use super::super::{MAX_NOTE_BYTES, note_fault};
use super::entry::{ENTRY_BYTES, Entry, take};
use super::{AtlasSummary, Counts};
use crate::{Error, Result};

/// The first three bytes of every atlas.
pub(super) const MAGIC: [u8; 3] = *b"CSA";

/// Version of the format that this program reads and writes.
pub(super) const VERSION: u8 = 1;

/// Bytes of the header.
pub(super) const HEADER_BYTES: usize = 4 + 8 + 4 + 1 + 1 + MAX_NOTE_BYTES + ENTRY_BYTES + 4;

/// Most levels of nodes: enough for 2^32 tiles with two children to a node.
const MAX_LEVELS: u8 = 32;

/// What the header says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Header {
    /// Length of the file, bytes.
    pub length: u64,
    /// The grid of all coordinates.
    pub grid: Grid,
    /// Levels of nodes: 0 where the root is a tile.
    pub levels: u8,
    /// What the frame is, for people.
    pub frame_note: String,
    /// The root; all zero in an empty atlas.
    pub root: Entry,
}

impl Header {
    /// Its bytes.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let note = self.frame_note.as_bytes();
        if let Some(fault) = note_fault(&self.frame_note) {
            let what = format!("{fault}; shorten or correct it (at most {MAX_NOTE_BYTES} bytes)");
            return Err(Error::AtlasUnencodable { what });
        }
        let mut bytes = Vec::with_capacity(HEADER_BYTES);
        bytes.extend_from_slice(&MAGIC);
        bytes.push(VERSION);
        bytes.extend_from_slice(&self.length.to_le_bytes());
        bytes.extend_from_slice(&(self.grid.quantum_um() as u32).to_le_bytes());
        bytes.extend_from_slice(&[self.levels, note.len() as u8]);
        bytes.extend_from_slice(note);
        bytes.resize(bytes.len() + MAX_NOTE_BYTES - note.len(), 0);
        self.root.write(&mut bytes);
        bytes.extend_from_slice(&crc32c::crc32c(&bytes).to_le_bytes());
        Ok(bytes)
    }

    /// From the first bytes of a file of `file_bytes`; `bytes` are
    /// [`HEADER_BYTES`], or all of a shorter file.
    pub fn from_bytes(bytes: &[u8], file_bytes: u64) -> Result<Self> {
        let least = HEADER_BYTES as u64;
        let too_short = || Error::AtlasLength { expected: least, found: file_bytes };
        // What is cut off inside the magic is a short atlas, not another file.
        if bytes.is_empty() || !MAGIC.iter().zip(bytes).all(|(a, b)| a == b) {
            return Err(Error::NotAnAtlas);
        }
        let mut rest = bytes.get(MAGIC.len()..).ok_or_else(too_short)?;
        let [version] = take(&mut rest).ok_or_else(too_short)?;
        if version != VERSION {
            return Err(Error::AtlasVersion { found: version, supported: VERSION });
        }
        let length = u64::from_le_bytes(take(&mut rest).ok_or_else(too_short)?);
        if length != file_bytes || bytes.len() < HEADER_BYTES {
            return Err(Error::AtlasLength { expected: length.max(least), found: file_bytes });
        }
        let (covered, stored) = bytes.split_last_chunk().ok_or_else(too_short)?;
        let (expected, found) = (u32::from_le_bytes(*stored), crc32c::crc32c(covered));
        if expected != found {
            return Err(Error::AtlasChecksum { part: "header", at: 0, expected, found });
        }
        Self::fields(length, rest).ok_or_else(too_short)?
    }

    /// The fields after the length; none where they end too early.
    fn fields(length: u64, mut rest: &[u8]) -> Option<Result<Self>> {
        let quantum_um = u64::from(u32::from_le_bytes(take(&mut rest)?));
        let [levels, note_bytes] = take(&mut rest)?;
        let note: [u8; MAX_NOTE_BYTES] = take(&mut rest)?;
        let root = Entry::read(&mut rest)?;
        let malformed = |what: String| Some(Err(Error::AtlasMalformed { part: "header", at: 0, what }));
        let Some(grid) = Grid::from_um(quantum_um) else {
            return malformed(format!("has a quantum of {quantum_um} micrometres"));
        };
        let Some((note, padding)) = note.split_at_checked(usize::from(note_bytes)) else {
            return malformed(format!("has a frame note of {note_bytes} bytes"));
        };
        let frame_note = match std::str::from_utf8(note) {
            Ok(note) if note_fault(note).is_none() && padding.iter().all(|&byte| byte == 0) => note.to_owned(),
            _ => return malformed("has a frame note that is no text".into()),
        };
        let is_empty = root.counts.tiles == 0;
        let is_blank = root == Entry::default() && levels == 0;
        if (is_empty && !is_blank) || levels > MAX_LEVELS {
            return malformed(format!("has {levels} levels over {} tiles", root.counts.tiles));
        }
        let ends_inside = root.offset >= HEADER_BYTES as u64 && root.end().is_some_and(|end| end <= length);
        if !(is_empty || ends_inside && root.contains(&root)) {
            return malformed("points outside the file, or has a box without an inside".into());
        }
        Some(Ok(Self { length, grid, levels, frame_note, root }))
    }

    /// The same for people.
    pub fn summary(&self) -> AtlasSummary {
        let counts = self.root.counts;
        AtlasSummary {
            version: VERSION,
            bytes: self.length,
            quantum_m: self.grid.quantum_m(),
            frame_note: self.frame_note.clone(),
            levels: self.levels,
            bounds: (counts != Counts::default()).then(|| self.root.bounds(self.grid)),
            counts,
        }
    }
}
