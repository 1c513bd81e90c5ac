//! The maps that a merged map was made of.
//!
//! A merged map is a function of the *set* of its sources, and the sources of
//! a union of sets are the union of the sources. So it does not matter in
//! which order or in which steps maps are merged. The sources lie beside the
//! merged map: `area.sources` beside `area.csm`.
//!
//! With a source goes what the report of its build knows of its poles and
//! signs, so that a merge weighs them by it, and of its frame, so that the merged
//! map can be exported in the coordinates of the survey.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use common::atomic_file::{self, is_other};
use common::map::{EncodeOptions, SemanticMap, layout};

use super::known;
use crate::error::{Error, Result};
use crate::evidence::{MapEvidence, PointCovariances};
use crate::extent;
use crate::input::MapFrame;
use crate::report::{Beside, checksum, read_beside};

/// The first bytes of a file of sources.
const MAGIC: &[u8; 4] = b"CSMS";
/// Version of that file.
const VERSION: u8 = 3;
/// The version before it, which is read, too: it has no frames.
const WITHOUT_FRAMES: u8 = 2;

/// Map files, each once, in an order of their own, with what is known of them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Sources(BTreeMap<Arc<[u8]>, Told>);

/// What the report of a build tells of its map, as bytes: none where it does not.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct Told {
    /// The covariances of its points.
    known: Arc<[u8]>,
    /// Its [`MapFrame`] as JSON.
    frame: Arc<[u8]>,
}

/// What came of a map file that was added.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Added {
    /// Of its sources those that were there already.
    pub repeated: usize,
    /// Its frame, or the one of all of its sources; none where they are of several, or do not say.
    pub frame: Option<MapFrame>,
    /// Why the report beside it is passed over, for people.
    pub note: Option<String>,
}

/// One source, read.
#[derive(Debug, Clone)]
pub struct Source {
    /// Checksum of its file, which names it.
    pub crc32c: u32,
    /// Step of its coordinates, metres.
    pub quantum_m: f64,
    /// What it holds.
    pub map: SemanticMap,
    /// How well its points are known; empty where nobody said.
    pub known: PointCovariances,
}

impl Sources {
    /// Adds a map, and what is known of its landmarks in the order in which
    /// it is decoded; false where it was there already.
    ///
    /// # Errors
    /// As [`SemanticMap::encode`].
    pub fn add_map(
        &mut self,
        map: &SemanticMap,
        evidence: Option<&MapEvidence>,
        options: &EncodeOptions,
    ) -> Result<bool, common::Error> {
        let told = Told { known: known_bytes(map, evidence), frame: Arc::default() };
        Ok(self.insert(map.encode(options)?.into(), told))
    }

    /// Of a source that was given with several covariances, or frames, those that come
    /// last as bytes are kept, and any before none: so the order in which they
    /// were given does not matter.
    fn insert(&mut self, bytes: Arc<[u8]>, told: Told) -> bool {
        let is_new = !self.0.contains_key(&bytes);
        let held = self.0.entry(bytes).or_default();
        for (held, told) in [(&mut held.known, told.known), (&mut held.frame, told.frame)] {
            if told > *held {
                *held = told;
            }
        }
        is_new
    }

    /// Adds the sources of a map file: those that lie beside it, else the map
    /// itself with what the report of its build knows of it.
    ///
    /// # Errors
    /// A file that cannot be read or is no map; sources beside it that are not
    /// its own; a report that is none.
    pub fn add_file(&mut self, path: &Path) -> Result<Added> {
        let bytes = std::fs::read(path).map_err(common::Error::io(path))?;
        let map = SemanticMap::decode(&bytes).map_err(common::Error::in_file(path))?;
        extent::check(&map, &path.display().to_string())?;
        let beside = path_beside(path);
        let mut added = Added::default();
        let sources = match std::fs::read(&beside) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                let Beside { own, note } = read_beside(path, &bytes)?;
                added.note = note;
                let known = known_bytes(&map, own.as_ref().map(|report| &report.evidence));
                let frame = own.and_then(|report| report.frame).as_ref().map_or_else(Arc::default, frame_bytes);
                Self([(bytes.into(), Told { known, frame })].into())
            }
            read => Self::from_bytes(&read.map_err(common::Error::io(&beside))?, &bytes)
                .map_err(|reason| Error::BadSources { path: beside, map: path.to_path_buf(), reason })?,
        };
        added.frame = one_frame(sources.0.values().map(|told| &*told.frame));
        added.repeated = sources.0.into_iter().map(|(bytes, told)| usize::from(!self.insert(bytes, told))).sum();
        Ok(added)
    }

    /// The maps, in their own order.
    ///
    /// # Errors
    /// None that is not a fault of the program: only maps were added.
    pub fn read(&self) -> Result<Vec<Source>> {
        use rayon::prelude::*;
        let files: Vec<_> = self.0.iter().collect();
        let sources: Result<Vec<Source>, common::Error> = files
            .par_iter()
            .map(|&(bytes, told)| {
                let quantum_m = layout(bytes)?.quantum_m;
                let map = SemanticMap::decode(bytes)?;
                let known = known::from_bytes(&told.known, &map).unwrap_or_default();
                Ok(Source { crc32c: checksum(bytes), quantum_m, map, known })
            })
            .collect();
        Ok(sources?)
    }

    /// The bytes of the only source, if there is but one.
    pub fn only(&self) -> Option<&[u8]> {
        self.0.keys().next().filter(|_| self.0.len() == 1).map(|bytes| &bytes[..])
    }

    /// The bytes of the file of sources of a merged map: magic, version, length
    /// and checksum of the map; the number of sources, the length and the
    /// bytes of each, of its covariances and of its frame (all numbers of four bytes, the
    /// lowest first); CRC-32C of all before.
    fn to_bytes(&self, map_bytes: &[u8]) -> Vec<u8> {
        let mut bytes = [&MAGIC[..], &[VERSION]].concat();
        // Map files have lengths of four bytes, by their format.
        let number = |bytes: &mut Vec<u8>, value: usize| bytes.extend_from_slice(&(value as u32).to_le_bytes());
        number(&mut bytes, map_bytes.len());
        number(&mut bytes, checksum(map_bytes) as usize);
        number(&mut bytes, self.0.len());
        for part in self.0.iter().flat_map(|(source, told)| [source, &told.known, &told.frame]) {
            number(&mut bytes, part.len());
            bytes.extend_from_slice(part);
        }
        let crc = crc32c::crc32c(&bytes);
        number(&mut bytes, crc as usize);
        bytes
    }

    /// The sources of this very map; else what is wrong.
    fn from_bytes(bytes: &[u8], map_bytes: &[u8]) -> Result<Self, String> {
        let mut sources = Self::default();
        for [source, known, frame] in parts(bytes, map_bytes)? {
            let map = SemanticMap::decode(source).map_err(|error| error.to_string())?;
            extent::check(&map, "a map in it").map_err(|error| error.to_string())?;
            if !known.is_empty() && known::from_bytes(known, &map).is_none() {
                return Err("it has covariances of other landmarks than its map".into());
            }
            if !frame.is_empty() && frame_from_bytes(frame).is_none() {
                return Err("it has a frame that is none".into());
            }
            sources.insert(source.into(), Told { known: known.into(), frame: frame.into() });
        }
        Ok(sources)
    }

    /// Writes a merged map and its sources beside it; none lie beside what is no file.
    ///
    /// # Errors
    /// As [`atomic_file::write`].
    pub fn write(&self, map: &Path, map_bytes: &[u8]) -> Result<()> {
        let beside = (!is_other(map)).then(|| atomic_file::stage(path_beside(map), &self.to_bytes(map_bytes)));
        let map = atomic_file::stage(map, map_bytes)?;
        // The map last: where the run ends between the two, the old map does
        // not pass for one of these sources.
        if let Some(beside) = beside.transpose()? {
            beside.commit()?;
        }
        Ok(map.commit()?)
    }
}

/// The covariances of a map's points as bytes; none where the evidence is of
/// another map.
fn known_bytes(map: &SemanticMap, evidence: Option<&MapEvidence>) -> Arc<[u8]> {
    let own = evidence.filter(|evidence| evidence.fits(map));
    own.map_or_else(Arc::default, |evidence| known::to_bytes(&evidence.covariances()).into())
}

/// The parts of a file of sources, if it is that of this very map: of each its bytes, those of
/// its covariances, and those of its frame.
fn parts<'a>(bytes: &'a [u8], map_bytes: &[u8]) -> Result<Vec<[&'a [u8]; 3]>, String> {
    let cut = || "it was cut off".to_owned();
    let rest = bytes.strip_prefix(MAGIC).ok_or("it is no file of sources")?;
    let (&version, _) = rest.split_first().ok_or_else(cut)?;
    if ![WITHOUT_FRAMES, VERSION].contains(&version) {
        return Err(format!("it has version {version}, and this program reads versions up to {VERSION}"));
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
    let count = number(&mut rest)?;
    let mut part = || -> Result<&'a [u8], String> {
        let length = number(&mut rest)? as usize;
        let (part, after) = rest.split_at_checked(length).ok_or_else(cut)?;
        rest = after;
        Ok(part)
    };
    (0..count).map(|_| Ok([part()?, part()?, if version == WITHOUT_FRAMES { &[] } else { part()? }])).collect()
}

/// The frame of a merged map, by the sources beside it; none where what lies there is not that.
pub fn frame_beside(map: &Path, map_bytes: &[u8]) -> Option<MapFrame> {
    let sources = std::fs::read(path_beside(map)).ok()?;
    one_frame(parts(&sources, map_bytes).ok()?.into_iter().map(|[_, _, frame]| frame))
}

/// The frame of all maps that say theirs, where that is one.
fn one_frame<'a>(frames: impl Iterator<Item = &'a [u8]>) -> Option<MapFrame> {
    let mut frames = frames.filter_map(frame_from_bytes);
    let first = frames.next()?;
    frames.all(|frame| frame == first).then_some(first)
}

/// A frame as bytes.
fn frame_bytes(frame: &MapFrame) -> Arc<[u8]> {
    // It has numbers and names only, all of which JSON has.
    serde_json::to_vec(frame).unwrap_or_default().into()
}

/// The frame of such bytes; none where they are no frame.
fn frame_from_bytes(bytes: &[u8]) -> Option<MapFrame> {
    serde_json::from_slice(bytes).ok()
}

/// Where the sources of a merged map lie.
pub fn path_beside(map: &Path) -> PathBuf {
    map.with_extension("sources")
}

#[cfg(test)]
mod tests {
    use common::map::{Pole, PoleKind, Road, RoadId};

    use super::*;
    use crate::evidence::EvidenceConfig;
    use crate::input::SurveyFrame;

    fn map(note: &str) -> SemanticMap {
        SemanticMap { frame_note: note.into(), ..SemanticMap::default() }
    }

    fn two() -> Sources {
        let mut sources = Sources::default();
        for note in ["b", "a"] {
            assert!(sources.add_map(&map(note), None, &EncodeOptions::default()).unwrap());
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
    fn what_is_known_of_a_source_stays_with_it_in_whatever_order_it_was_given() {
        let foot_map = nalgebra::Point3::new(1.0, 1.6, 9.0);
        let pole = Pole { kind: PoleKind::Trunk, foot_map, top_map: foot_map, road: RoadId(0) };
        let road = Road { path_map: vec![nalgebra::Point3::origin(), foot_map] };
        let map = SemanticMap { poles: vec![pole], roads: vec![road], ..map("known") };
        let evidence = MapEvidence::assumed(&map, &EvidenceConfig::default());
        let with = |order: [bool; 2]| {
            let mut sources = Sources::default();
            for knows in order {
                sources.add_map(&map, Some(&evidence).filter(|_| knows), &EncodeOptions::default()).unwrap();
            }
            sources
        };
        assert_eq!(with([true, false]), with([false, true]));
        let back = Sources::from_bytes(&with([true, false]).to_bytes(b"m"), b"m").unwrap();
        assert_eq!(back, with([true, true]));
        assert_eq!(back.read().unwrap()[0].known, evidence.covariances());
        assert!(with([false, false]).read().unwrap()[0].known.poles.is_empty());
    }

    #[test]
    fn the_frame_of_the_sources_is_that_of_those_that_tell_one() {
        let zone = |x| frame_bytes(&MapFrame::of_survey(SurveyFrame::Lidar, &nalgebra::Vector3::new(x, 0.0, 0.0)));
        let of = |frames: &[Option<Arc<[u8]>>]| {
            let mut sources = Sources::default();
            for (frame, note) in frames.iter().zip(["a", "b", "c"]) {
                let told = Told { frame: frame.clone().unwrap_or_default(), ..Told::default() };
                sources.insert(map(note).encode(&EncodeOptions::default()).unwrap().into(), told);
            }
            let folder = tempfile::tempdir().unwrap();
            let area = folder.path().join("area.csm");
            sources.write(&area, b"m").unwrap();
            frame_beside(&area, b"m").map(|frame| frame.reduced_by_m[0])
        };
        assert_eq!(of(&[None, Some(zone(1e4)), Some(zone(1e4))]), Some(1e4));
        assert_eq!((of(&[Some(zone(1e4)), Some(zone(2e4))]), of(&[None, None])), (None, None));
    }

    #[test]
    fn sources_of_the_version_before_are_read_without_frames() {
        let source = map("a").encode(&EncodeOptions::default()).unwrap();
        let mut bytes = [&MAGIC[..], &[WITHOUT_FRAMES]].concat();
        for number in [10, checksum(b"merged map"), 1, source.len() as u32] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        bytes.extend_from_slice(&source);
        bytes.extend_from_slice(&0_u32.to_le_bytes());
        bytes.extend_from_slice(&crc32c::crc32c(&bytes).to_le_bytes());
        let mut expected = Sources::default();
        expected.add_map(&map("a"), None, &EncodeOptions::default()).unwrap();
        assert_eq!(Sources::from_bytes(&bytes, b"merged map"), Ok(expected));
    }

    #[test]
    fn a_map_without_sources_beside_it_is_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csm");
        common::map::write(&path, &map("a"), &EncodeOptions::default()).unwrap();
        let mut sources = Sources::default();
        assert_eq!(sources.add_file(&path).unwrap(), Added::default());
        assert_eq!(sources.add_file(&path).unwrap(), Added { repeated: 1, ..Added::default() });
        assert_eq!(sources.0.len(), 1);
        let area = folder.path().join("area.csm");
        two().write(&area, &map("area").encode(&EncodeOptions::default()).unwrap()).unwrap();
        assert_eq!(sources.add_file(&area).unwrap().repeated, 1);
        assert_eq!(sources, two());
    }
}
