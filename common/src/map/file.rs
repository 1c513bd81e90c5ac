//! Map files on disk.

use std::path::Path;

use super::{EncodeOptions, SemanticMap};
use crate::{Error, Result, atomic_file};

/// Reads a map file.
///
/// # Errors
/// [`Error::Io`] where it cannot be read, else [`Error::InFile`] around what
/// [`SemanticMap::decode`] says.
pub fn read(path: impl AsRef<Path>) -> Result<SemanticMap> {
    let bytes = std::fs::read(&path).map_err(Error::io(&path))?;
    SemanticMap::decode(&bytes).map_err(Error::in_file(path))
}

/// Writes a map file and returns its length in bytes.
///
/// # Errors
/// As [`SemanticMap::encode`] and [`atomic_file::write`].
pub fn write(path: impl AsRef<Path>, map: &SemanticMap, options: &EncodeOptions) -> Result<usize> {
    let bytes = map.encode(options)?;
    atomic_file::write(path, &bytes)?;
    Ok(bytes.len())
}
