//! Opens an atlas, and reads the parts of it that are asked for.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use super::super::Bounds;
use super::entry::{ENTRY_BYTES, Entry};
use super::file::PositionedFile;
use super::header::{HEADER_BYTES, Header, MAGIC};
use super::tile::Tile;
use super::{AtlasSummary, Counts};
use crate::{Error, Result, atomic_file};

/// Most children that a node may have: four times what is written.
const MAX_CHILDREN: usize = 256;

/// A rectangle in the horizontal plane of the map frame, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Area {
    /// Smallest x and z.
    pub min_xz: [f64; 2],
    /// Largest x and z.
    pub max_xz: [f64; 2],
}

impl Area {
    /// They have a point in common.
    pub fn touches(&self, bounds: &Bounds) -> bool {
        self.min_xz[0] <= bounds.max_map.x
            && self.min_xz[1] <= bounds.max_map.z
            && self.max_xz[0] >= bounds.min_map.x
            && self.max_xz[1] >= bounds.min_map.z
    }

    /// `other` lies within.
    pub fn contains(&self, other: &Self) -> bool {
        (0..2).all(|i| self.min_xz[i] <= other.min_xz[i] && other.max_xz[i] <= self.max_xz[i])
    }

    /// So much larger to every side, metres.
    #[must_use]
    pub fn grown(&self, by_m: f64) -> Self {
        Self { min_xz: self.min_xz.map(|v| v - by_m), max_xz: self.max_xz.map(|v| v + by_m) }
    }
}

/// A tile that may be read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TilePlace {
    /// The box around it, metres.
    pub bounds: Bounds,
    /// What is in it.
    pub counts: Counts,
    /// What is in the tiles before it, in the order of the file: its first
    /// pole is pole number `before.poles` of the atlas, and so on.
    pub before: Counts,
    entry: Entry,
}

impl TilePlace {
    /// Where it begins in the file, bytes: tiles of one atlas differ in it.
    pub fn offset(&self) -> u64 {
        self.entry.offset
    }

    /// Its length in the file, bytes.
    pub fn bytes(&self) -> usize {
        self.entry.length as usize
    }
}

/// An open atlas. It holds the header and the root of the index, and reads
/// everything else when it is asked for.
#[derive(Debug)]
pub struct Atlas {
    path: PathBuf,
    file: PositionedFile,
    header: Header,
    /// The children of the root; the root itself where it is a tile; none in
    /// an empty atlas.
    root: Vec<Entry>,
    bytes_read: AtomicU64,
}

/// A walk down the index.
struct Walk<'a> {
    area: Option<&'a Area>,
    each: &'a mut dyn FnMut(TilePlace) -> Result<()>,
    /// Where the last part that was met of each level ended, bytes.
    ends: Vec<u64>,
}

/// Whether a file begins as an atlas does.
///
/// # Errors
/// [`Error::Io`] where it cannot be read, [`Error::NoFile`] where it could not be read
/// again.
pub fn is_atlas(path: impl AsRef<Path>) -> Result<bool> {
    if atomic_file::is_other(path.as_ref()) {
        return Err(Error::NoFile { path: path.as_ref().to_path_buf() });
    }
    let mut start = Vec::new();
    let file = std::fs::File::open(&path).map_err(Error::io(&path))?;
    file.take(MAGIC.len() as u64).read_to_end(&mut start).map_err(Error::io(&path))?;
    Ok(start == MAGIC)
}

impl Atlas {
    /// Opens an atlas: some kilobytes are read, whatever its size.
    ///
    /// # Errors
    /// [`Error::Io`], and [`Error::InFile`] around [`Error::NotAnAtlas`],
    /// [`Error::AtlasVersion`], [`Error::AtlasLength`],
    /// [`Error::AtlasChecksum`] or [`Error::AtlasMalformed`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let file = PositionedFile::open(path).map_err(Error::io(path))?;
        let first = file.length.min(HEADER_BYTES as u64) as usize;
        let bytes = file.read(0, first).map_err(Error::io(path))?;
        let header = Header::from_bytes(&bytes, file.length).map_err(Error::in_file(path))?;
        let bytes_read = AtomicU64::new(bytes.len() as u64);
        let mut atlas = Self { path: path.to_path_buf(), file, header, root: Vec::new(), bytes_read };
        let root = atlas.header.root;
        atlas.root = match atlas.header.levels {
            _ if root.counts.tiles == 0 => Vec::new(),
            0 => vec![root],
            _ => atlas.children(&root)?,
        };
        Ok(atlas)
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What its header says.
    pub fn summary(&self) -> AtlasSummary {
        self.header.summary()
    }

    /// Bytes read from the file so far, the header included.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read.load(Ordering::Relaxed)
    }

    /// The tiles whose box touches `area`, in the order of the file. Only the
    /// nodes that touch it are read.
    ///
    /// # Errors
    /// As [`Atlas::open`].
    pub fn tiles_in(&self, area: &Area) -> Result<Vec<TilePlace>> {
        let mut found = Vec::new();
        self.each_touching(Some(area), &mut |place| {
            found.push(place);
            Ok(())
        })?;
        Ok(found)
    }

    /// Reads a tile.
    ///
    /// # Errors
    /// As [`Atlas::open`].
    pub fn tile(&self, place: &TilePlace) -> Result<Tile> {
        let bytes = self.part("tile", &place.entry)?;
        let malformed = |what| self.malformed("tile", place.entry.offset, what);
        let tile = Tile::decode(&bytes).map_err(malformed)?;
        if tile.counts() != Some(place.counts) {
            return Err(malformed("holds another number of roads or landmarks than the index says".into()));
        }
        // What leans need not end on the grid.
        let is_around = tile.map.bounds().and_then(|bounds| self.header.grid.around(&bounds)) == Some(place.bounds);
        if !is_around {
            return Err(malformed("has another box than the index says".into()));
        }
        Ok(tile)
    }

    /// Reads everything, one tile after the other, in the order of the file.
    ///
    /// # Errors
    /// As [`Atlas::open`], where there are gaps between the tiles, and whatever
    /// `each` returns.
    pub fn read_all(&self, mut each: impl FnMut(&TilePlace, Tile) -> Result<()>) -> Result<()> {
        let mut at = HEADER_BYTES as u64;
        self.each_touching(None, &mut |place| {
            if place.offset() != at {
                return Err(self.malformed("tile", place.offset(), format!("should stand at byte {at}")));
            }
            at += place.bytes() as u64;
            each(&place, self.tile(&place)?)
        })
    }

    /// Calls `each` with all tiles that touch `area`, or with all, in the order
    /// of the file.
    fn each_touching(&self, area: Option<&Area>, each: &mut dyn FnMut(TilePlace) -> Result<()>) -> Result<()> {
        let level = self.header.levels.max(1);
        let mut walk = Walk { area, each, ends: vec![0; usize::from(level) + 1] };
        self.descend(&self.root, level, Counts::default(), &mut walk)
    }

    /// Goes down from `children`, which are nodes of `level` - 1 or tiles.
    fn descend(&self, children: &[Entry], level: u8, mut before: Counts, walk: &mut Walk<'_>) -> Result<()> {
        for entry in children {
            let bounds = entry.bounds(self.header.grid);
            if walk.area.is_none_or(|area| area.touches(&bounds)) {
                self.stand_in_a_row(entry, level, walk)?;
                if level <= 1 {
                    (walk.each)(TilePlace { bounds, counts: entry.counts, before, entry: *entry })?;
                } else {
                    self.descend(&self.children(entry)?, level - 1, before, walk)?;
                }
            }
            // The counts of a level add up to 32-bit numbers: `children` has seen to it.
            before = before.checked_add(entry.counts).unwrap_or(before);
        }
        Ok(())
    }

    /// The parts of one level stand in the file in the order of the walk. So
    /// none comes twice, and a walk is never longer than the file.
    fn stand_in_a_row(&self, entry: &Entry, level: u8, walk: &mut Walk<'_>) -> Result<()> {
        let Some(end) = walk.ends.get_mut(usize::from(level)) else { return Ok(()) };
        let part = if level <= 1 { "tile" } else { "index node" };
        if entry.offset < *end {
            return Err(self.malformed(part, entry.offset, format!("should not begin before byte {end}")));
        }
        *end = entry.end().unwrap_or(u64::MAX);
        Ok(())
    }

    /// The children of a node, checked against it: they lie inside its box and
    /// before it in the file, and hold together what it holds. So whatever the
    /// bytes are, a walk down ends, and reads no more parts of each level than
    /// the root has tiles.
    fn children(&self, node: &Entry) -> Result<Vec<Entry>> {
        let malformed = |what: &str| self.malformed("index node", node.offset, what.to_owned());
        let length = node.length as usize;
        if length == 0 || !length.is_multiple_of(ENTRY_BYTES) || length > MAX_CHILDREN * ENTRY_BYTES {
            return Err(malformed(&format!("has {length} bytes, which are not 1 to {MAX_CHILDREN} entries")));
        }
        let bytes = self.part("index node", node)?;
        let mut rest = bytes.as_slice();
        let children: Vec<Entry> = std::iter::from_fn(|| Entry::read(&mut rest)).collect();
        let is_inside = |child: &Entry| {
            child.counts.tiles > 0
                && child.length > 0
                && child.offset >= HEADER_BYTES as u64
                && child.end().is_some_and(|end| end <= node.offset)
                && node.contains(child)
        };
        if !children.iter().all(is_inside) {
            return Err(malformed("has an entry that points outside its part of the file or of the ground"));
        }
        if Entry::over(&children).is_none_or(|all| all.counts != node.counts) {
            return Err(malformed("has entries that do not add up to what it holds"));
        }
        Ok(children)
    }

    /// The bytes of a part of the file, if their checksum is right.
    fn part(&self, part: &'static str, entry: &Entry) -> Result<Vec<u8>> {
        // Entries end inside the file, so this is no more than the file has.
        let bytes = self.file.read(entry.offset, entry.length as usize).map_err(Error::io(&self.path))?;
        self.bytes_read.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        let found = crc32c::crc32c(&bytes);
        if found != entry.checksum {
            let damaged = Error::AtlasChecksum { part, at: entry.offset, expected: entry.checksum, found };
            return Err(Error::in_file(&self.path)(damaged));
        }
        Ok(bytes)
    }

    fn malformed(&self, part: &'static str, at: u64, what: String) -> Error {
        Error::in_file(&self.path)(Error::AtlasMalformed { part, at, what })
    }
}
