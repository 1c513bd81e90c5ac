//! The maps that a merged map was made of.
//!
//! A merged map is a function of the *set* of its sources, and the sources of
//! a union of sets are the union of the sources. So it does not matter in
//! which order or in which steps maps are merged. The sources lie beside the
//! merged map: `area.sources` beside `area.csm`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use common::atomic_file;
use common::map::{EncodeOptions, SemanticMap, layout};

use crate::error::{Error, Result};
use crate::report::checksum;

/// The first bytes of a file of sources.
const MAGIC: &[u8; 4] = b"CSMS";
/// Version of that file.
const VERSION: u8 = 1;

/// Map files, each once, in an order of their own.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Sources(BTreeSet<Arc<[u8]>>);

/// One source, read.
#[derive(Debug, Clone)]
pub struct Source {
    /// Checksum of its file, which names it.
    pub crc32c: u32,
    /// Step of its coordinates, metres.
    pub quantum_m: f64,
    /// What it holds.
    pub map: SemanticMap,
}

impl Sources {
    /// Adds the bytes of a map file; false where it was there already.
    ///
    /// # Errors
    /// What [`SemanticMap::decode`] says.
    pub fn add(&mut self, bytes: &[u8]) -> Result<bool, common::Error> {
        SemanticMap::decode(bytes)?;
        Ok(self.0.insert(bytes.into()))
    }

    /// Adds a map.
    ///
    /// # Errors
    /// As [`SemanticMap::encode`].
    pub fn add_map(&mut self, map: &SemanticMap, options: &EncodeOptions) -> Result<bool, common::Error> {
        Ok(self.0.insert(map.encode(options)?.into()))
    }

    /// Adds the sources of a map file: those that lie beside it, else the map
    /// itself. Says how many were there already.
    ///
    /// # Errors
    /// A file that cannot be read or is no map; sources beside it that are not
    /// its own.
    pub fn add_file(&mut self, path: &Path) -> Result<usize> {
        let bytes = std::fs::read(path).map_err(common::Error::io(path))?;
        SemanticMap::decode(&bytes).map_err(common::Error::in_file(path))?;
        let beside = path_beside(path);
        let sources = match std::fs::read(&beside) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => [bytes.into()].into(),
            read => {
                Self::from_bytes(&read.map_err(common::Error::io(&beside))?, &bytes)
                    .map_err(|reason| Error::BadSources { path: beside, map: path.to_path_buf(), reason })?
                    .0
            }
        };
        let before = self.0.len();
        let count = sources.len();
        self.0.extend(sources);
        Ok(before + count - self.0.len())
    }

    /// The maps, in their own order.
    ///
    /// # Errors
    /// None that is not a fault of the program: only maps were added.
    pub fn read(&self) -> Result<Vec<Source>> {
        use rayon::prelude::*;
        let files: Vec<&Arc<[u8]>> = self.0.iter().collect();
        let sources: Result<Vec<Source>, common::Error> = files
            .par_iter()
            .map(|bytes| {
                let quantum_m = layout(bytes)?.quantum_m;
                Ok(Source { crc32c: checksum(bytes), quantum_m, map: SemanticMap::decode(bytes)? })
            })
            .collect();
        Ok(sources?)
    }

    /// The bytes of the only source, if there is but one.
    pub fn only(&self) -> Option<&[u8]> {
        self.0.first().filter(|_| self.0.len() == 1).map(|bytes| &bytes[..])
    }

    /// The bytes of the file of sources of a merged map: magic, version, length
    /// and checksum of the map; the number of sources, the length and the
    /// bytes of each (all numbers of four bytes, the lowest first); CRC-32C of
    /// all before.
    fn to_bytes(&self, map_bytes: &[u8]) -> Vec<u8> {
        let mut bytes = [&MAGIC[..], &[VERSION]].concat();
        // Map files have lengths of four bytes, by their format.
        let number = |bytes: &mut Vec<u8>, value: usize| bytes.extend_from_slice(&(value as u32).to_le_bytes());
        number(&mut bytes, map_bytes.len());
        number(&mut bytes, checksum(map_bytes) as usize);
        number(&mut bytes, self.0.len());
        for source in &self.0 {
            number(&mut bytes, source.len());
            bytes.extend_from_slice(source);
        }
        let crc = crc32c::crc32c(&bytes);
        number(&mut bytes, crc as usize);
        bytes
    }

    /// The sources of this very map; else what is wrong.
    fn from_bytes(bytes: &[u8], map_bytes: &[u8]) -> Result<Self, String> {
        let cut = || "it was cut off".to_owned();
        let rest = bytes.strip_prefix(MAGIC).ok_or("it is no file of sources")?;
        let (&version, _) = rest.split_first().ok_or_else(cut)?;
        if version != VERSION {
            return Err(format!("it has version {version}, and this program reads version {VERSION}"));
        }
        let (covered, crc) = bytes.split_last_chunk::<4>().ok_or_else(cut)?;
        if u32::from_le_bytes(*crc) != crc32c::crc32c(covered) {
            return Err("it is damaged".into());
        }
        let mut rest = covered.get(MAGIC.len() + 1..).ok_or_else(cut)?;
        let number = |rest: &mut &[u8]| -> Result<u32, String> {
            let (value, after) = rest.split_first_chunk::<4>().ok_or_else(cut)?;
            *rest = after;
            Ok(u32::from_le_bytes(*value))
        };
        let of_map = (number(&mut rest)? as usize, number(&mut rest)?);
        if of_map != (map_bytes.len(), checksum(map_bytes)) {
            return Err("it is about another map of that name".into());
        }
        let mut sources = Self::default();
        for _ in 0..number(&mut rest)? {
            let length = number(&mut rest)? as usize;
            let (source, after) = rest.split_at_checked(length).ok_or_else(cut)?;
            sources.add(source).map_err(|error| error.to_string())?;
            rest = after;
        }
        Ok(sources)
    }

    /// Writes a merged map and its sources beside it.
    ///
    /// # Errors
    /// As [`atomic_file::write`].
    pub fn write(&self, map: &Path, map_bytes: &[u8]) -> Result<()> {
        // The map last: where the run ends between the two, the old map does
        // not pass for one of these sources.
        atomic_file::write(path_beside(map), &self.to_bytes(map_bytes))?;
        atomic_file::write(map, map_bytes)?;
        Ok(())
    }
}

/// Where the sources of a merged map lie.
pub fn path_beside(map: &Path) -> PathBuf {
    map.with_extension("sources")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(note: &str) -> SemanticMap {
        SemanticMap { frame_note: note.into(), ..SemanticMap::default() }
    }

    fn two() -> Sources {
        let mut sources = Sources::default();
        for note in ["b", "a"] {
            assert!(sources.add_map(&map(note), &EncodeOptions::default()).unwrap());
        }
        sources
    }

    #[test]
    fn sources_belong_to_one_map_and_every_damage_is_seen() {
        let bytes = two().to_bytes(b"merged map");
        assert_eq!(Sources::from_bytes(&bytes, b"merged map"), Ok(two()));
        assert!(Sources::from_bytes(&bytes, b"another map").unwrap_err().contains("another map"));
        for at in 0..bytes.len() {
            let mut flipped = bytes.clone();
            flipped[at] ^= 4;
            assert!(Sources::from_bytes(&flipped, b"merged map").is_err());
            assert!(Sources::from_bytes(&bytes[..at], b"merged map").is_err());
        }
    }

    #[test]
    fn a_map_without_sources_beside_it_is_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csm");
        common::map::write(&path, &map("a"), &EncodeOptions::default()).unwrap();
        let mut sources = Sources::default();
        assert_eq!(sources.add_file(&path).unwrap(), 0);
        assert_eq!(sources.add_file(&path).unwrap(), 1);
        assert_eq!(sources.0.len(), 1);
        let area = folder.path().join("area.csm");
        two().write(&area, &map("area").encode(&EncodeOptions::default()).unwrap()).unwrap();
        assert_eq!(sources.add_file(&area).unwrap(), 1);
        assert_eq!(sources, two());
    }
}
