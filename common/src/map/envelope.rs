//! What stands around the body of a map file: magic, version and length
//! before it, a checksum after it.

use super::pole::Leans;
use crate::{Error, Result};

/// The first three bytes of every map.
const MAGIC: &[u8; 3] = b"CSM";

/// The newest version that this program reads.
const NEWEST: u8 = 5;

/// What a file holds, as its version says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Form {
    /// The marks of dashed lines.
    pub has_marks: bool,
    /// Kerbs, behind the marks.
    pub has_kerbs: bool,
    /// How the leans of poles are given.
    pub leans: Leans,
}

impl Form {
    fn of_version(version: u8) -> Option<Self> {
        let leans = match version {
            1 | 2 => Leans::Quanta,
            3..=5 => Leans::Thousandths,
            _ => return None,
        };
        let has_kerbs = version == 5;
        Some(Self { has_marks: has_kerbs || version.is_multiple_of(2), has_kerbs, leans })
    }

    /// The version that says so.
    pub fn version(self) -> u8 {
        let first = match self.leans {
            Leans::Quanta => 1,
            Leans::Thousandths => 3,
        };
        first + u8::from(self.has_marks) + u8::from(self.has_kerbs)
    }
}

/// Bytes before the body: magic, version, length of the file.
pub(super) const PREFIX_BYTES: usize = 8;

/// Bytes after the body: CRC-32C of everything before.
pub(super) const CHECKSUM_BYTES: usize = 4;

/// The file of a form around a body.
pub(super) fn seal(form: Form, body: &[u8]) -> Result<Vec<u8>> {
    let length = PREFIX_BYTES + body.len() + CHECKSUM_BYTES;
    let length_field = u32::try_from(length).map_err(|_| Error::MapUnencodable {
        what: format!("it would take {length} bytes, and a map file has at most {}; split the drive", u32::MAX),
    })?;
    let mut bytes = Vec::with_capacity(length);
    bytes.extend_from_slice(MAGIC);
    bytes.push(form.version());
    bytes.extend_from_slice(&length_field.to_le_bytes());
    bytes.extend_from_slice(body);
    bytes.extend_from_slice(&crc32c::crc32c(&bytes).to_le_bytes());
    Ok(bytes)
}

/// The form and the body of a file whose length and checksum are right.
pub(super) fn open(bytes: &[u8]) -> Result<(Form, &[u8])> {
    // What is cut off inside the magic is a short map, not another file.
    let magic_bytes = bytes.len().min(MAGIC.len());
    if bytes.is_empty() || bytes[..magic_bytes] != MAGIC[..magic_bytes] {
        return Err(Error::NotAMap);
    }
    let least = PREFIX_BYTES + CHECKSUM_BYTES;
    let too_short = || Error::MapLength { expected: least, found: bytes.len() };
    let version = *bytes.get(MAGIC.len()).ok_or_else(too_short)?;
    let form = Form::of_version(version).ok_or(Error::MapVersion { found: version, supported: NEWEST })?;
    let length_field: [u8; 4] =
        bytes.get(4..PREFIX_BYTES).and_then(|field| field.try_into().ok()).ok_or_else(too_short)?;
    let expected = u32::from_le_bytes(length_field) as usize;
    if bytes.len() != expected {
        return Err(Error::MapLength { expected, found: bytes.len() });
    }
    let (covered, stored) = bytes.split_last_chunk::<CHECKSUM_BYTES>().ok_or_else(too_short)?;
    let (expected, found) = (u32::from_le_bytes(*stored), crc32c::crc32c(covered));
    if expected != found {
        return Err(Error::MapChecksum { expected, found });
    }
    covered.get(PREFIX_BYTES..).map(|body| (form, body)).ok_or_else(too_short)
}
