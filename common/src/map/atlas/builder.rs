//! Makes an atlas of maps, in memory that does not grow with them but for
//! some bytes per tile.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::super::encode::corners;
use super::super::grid::Grid;
use super::super::{EncodeOptions, LaneLine, Pole, RoadId, SemanticMap, Sign};
use super::entry::Entry;
use super::header::{HEADER_BYTES, Header};
use super::sorter::{Record, Sorter};
use super::tile::Tile;
use super::{AtlasSummary, hilbert};
use crate::{Error, Result, atomic_file};

/// Children of a node: with 60 bytes each a node is one page of 4 KB.
const CHILDREN: usize = 64;

/// How an atlas is cut into tiles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AtlasOptions {
    /// A tile takes no further road beyond about this, bytes. Small tiles cost
    /// a header each, large ones are read for a corner: 8 KB are about 2 km of
    /// road, four reads of a page.
    pub tile_bytes: usize,
    /// Nor beyond this length of the longer side of its box, metres: what lies
    /// far apart is not needed together. Some times the distance at which
    /// landmarks are seen.
    pub tile_side_m: f64,
    /// Roads held in memory at a time, bytes; more of them are sorted through
    /// a temporary file.
    pub memory_bytes: usize,
}

impl Default for AtlasOptions {
    fn default() -> Self {
        Self { tile_bytes: 8 << 10, tile_side_m: 1000.0, memory_bytes: 64 << 20 }
    }
}

/// Takes maps and writes them as an atlas.
///
/// The bytes of the atlas follow from the maps, their order and the options:
/// the order gives the roads their numbers.
#[derive(Debug)]
pub struct AtlasBuilder {
    path: PathBuf,
    options: AtlasOptions,
    grid: Option<Grid>,
    /// The note of all maps; empty where they differ.
    note: Option<String>,
    roads: u32,
    sorter: Sorter,
}

impl AtlasBuilder {
    /// A builder of the atlas `path`. Its temporary file stands, without a
    /// name, in the same folder, where there must be room for the atlas anyway.
    pub fn new(path: impl AsRef<Path>, options: AtlasOptions) -> Self {
        let path = path.as_ref().to_path_buf();
        Self { path, options, grid: None, note: None, roads: 0, sorter: Sorter::new(options.memory_bytes) }
    }

    /// Takes a map that is in the frame of the atlas, and the step of its
    /// coordinates (metres), which must be that of the other maps.
    ///
    /// # Errors
    /// [`Error::AtlasUnencodable`] where the steps differ or there are too many
    /// roads, as [`SemanticMap::encode`], and [`Error::Io`] for the temporary
    /// file.
    pub fn add(&mut self, map: &SemanticMap, quantum_m: f64) -> Result<()> {
        let grid = Grid::from_m(quantum_m)?;
        let first = *self.grid.get_or_insert(grid);
        if first != grid {
            return Err(unencodable(format!(
                "its coordinates are whole multiples of {} m, and those of the maps before of {} m; build them with one quantum",
                grid.quantum_m(),
                first.quantum_m(),
            )));
        }
        match &mut self.note {
            Some(note) if *note != map.frame_note => note.clear(),
            Some(_) => (),
            none => *none = Some(map.frame_note.clone()),
        }
        for road in by_road(map)? {
            let number = self.roads;
            self.roads = number.checked_add(1).ok_or_else(too_much)?;
            let path = road.roads.first().map_or(&[][..], |road| &road.path_map);
            let middle = path.get(path.len() / 2).copied().unwrap_or_default();
            let [x, _, z] = grid.point(&middle, || format!("road {number}"))?;
            let key = (hilbert::index(x as i32, z as i32), number);
            let bytes = road.encode(&EncodeOptions { quantum_m })?;
            let create = || tempfile::tempfile_in(atomic_file::work_folder(&self.path));
            self.sorter.push(Record { key, bytes }, create).map_err(Error::io(&self.path))?;
        }
        Ok(())
    }

    /// Writes the atlas. `note` says what its frame is, for people; without
    /// it, it is the note of the maps where they all have the same.
    ///
    /// # Errors
    /// As [`Self::add`] and [`atomic_file::write_with`].
    pub fn write(self, note: Option<String>) -> Result<AtlasSummary> {
        let grid = match self.grid {
            Some(grid) => grid,
            None => Grid::from_m(EncodeOptions::default().quantum_m)?,
        };
        let frame_note = note.or(self.note).unwrap_or_default();
        let (path, options, sorter) = (self.path, self.options, self.sorter);
        let mut header = Header { length: 0, grid, levels: 0, frame_note, root: Entry::default() };
        atomic_file::write_seek_with(&path, |out| {
            // Holds the place of the header until all of it is known.
            out.write_all(&header.to_bytes()?).map_err(Error::io(&path))?;
            let mut tiles = TileWriter::new(out, &path, grid, options);
            sorter.finish(|record| tiles.take(record).map_err(Failure)).map_err(|Failure(error)| error)?;
            tiles.close()?;
            let (mut level, mut at) = (tiles.written, tiles.at);
            while level.len() > 1 {
                (level, at) = write_nodes(out, &path, &level, at)?;
                header.levels += 1;
            }
            header.root = level.first().copied().unwrap_or_default();
            header.length = at;
            out.seek(SeekFrom::Start(0)).map_err(Error::io(&path))?;
            out.write_all(&header.to_bytes()?).map_err(Error::io(&path))
        })?;
        Ok(header.summary())
    }
}

/// An error on the way through the sorter, which adds those of its file.
struct Failure(Error);

impl From<std::io::Error> for Failure {
    fn from(source: std::io::Error) -> Self {
        Self(Error::Io { path: PathBuf::from("the temporary file of the atlas"), source })
    }
}

/// One map for each road, with the landmarks on it.
fn by_road(map: &SemanticMap) -> Result<Vec<SemanticMap>> {
    let mut roads: Vec<SemanticMap> =
        map.roads.iter().map(|road| SemanticMap { roads: vec![road.clone()], ..SemanticMap::default() }).collect();
    let count = roads.len();
    let mut on = |RoadId(road): RoadId, put: &mut dyn FnMut(&mut SemanticMap)| match roads.get_mut(road as usize) {
        Some(own) => {
            put(own);
            Ok(())
        }
        None => Err(unencodable(format!("a landmark is on road {road} and there are {count} roads; add the road"))),
    };
    let road = RoadId(0);
    for pole in &map.poles {
        on(pole.road, &mut |own| own.poles.push(Pole { road, ..*pole }))?;
    }
    for sign in &map.signs {
        on(sign.road, &mut |own| own.signs.push(Sign { road, ..*sign }))?;
    }
    for lane in &map.lanes {
        on(lane.road, &mut |own| own.lanes.push(LaneLine { road, ..lane.clone() }))?;
    }
    Ok(roads)
}

/// Packs roads into tiles as they come along the curve.
struct TileWriter<'a, 'b> {
    out: &'a mut BufWriter<&'b mut File>,
    path: &'a Path,
    grid: Grid,
    options: AtlasOptions,
    /// The roads of the tile that is being filled, with their numbers.
    open: Vec<(u32, SemanticMap)>,
    open_bytes: usize,
    /// Smallest and largest x and z of the open tile, metres.
    open_box: [f64; 4],
    written: Vec<Entry>,
    at: u64,
}

impl<'a, 'b> TileWriter<'a, 'b> {
    fn new(out: &'a mut BufWriter<&'b mut File>, path: &'a Path, grid: Grid, options: AtlasOptions) -> Self {
        let at = HEADER_BYTES as u64;
        let open_box = EMPTY;
        Self { out, path, grid, options, open: Vec::new(), open_bytes: 0, open_box, written: Vec::new(), at }
    }

    fn take(&mut self, Record { key: (_, number), bytes }: Record) -> Result<()> {
        let map = SemanticMap::decode(&bytes)?;
        let own = map.bounds().map_or(EMPTY, |b| [b.min_map.x, b.min_map.z, b.max_map.x, b.max_map.z]);
        let joined = join(self.open_box, own);
        let side_m = (joined[2] - joined[0]).max(joined[3] - joined[1]);
        let is_full = self.open_bytes + bytes.len() > self.options.tile_bytes || side_m > self.options.tile_side_m;
        if is_full && !self.open.is_empty() {
            self.close()?;
        }
        self.open_box = join(self.open_box, own);
        self.open_bytes += bytes.len();
        self.open.push((number, map));
        Ok(())
    }

    /// Writes the open tile.
    fn close(&mut self) -> Result<()> {
        if self.open.is_empty() {
            return Ok(());
        }
        self.open.sort_by_key(|(number, _)| *number);
        let mut tile = Tile { map: SemanticMap::default(), road_numbers: Vec::with_capacity(self.open.len()) };
        for (road, (number, own)) in (0..).map(RoadId).zip(self.open.drain(..)) {
            tile.road_numbers.push(number);
            tile.map.roads.extend(own.roads);
            tile.map.poles.extend(own.poles.into_iter().map(|pole| Pole { road, ..pole }));
            tile.map.signs.extend(own.signs.into_iter().map(|sign| Sign { road, ..sign }));
            tile.map.lanes.extend(own.lanes.into_iter().map(|lane| LaneLine { road, ..lane }));
        }
        (self.open_bytes, self.open_box) = (0, EMPTY);
        let bytes = tile.encode(EncodeOptions { quantum_m: self.grid.quantum_m() })?;
        let counts = tile.counts().ok_or_else(too_much)?;
        let [min, max] = corners(&tile.map, self.grid)?.unwrap_or_default().map(|corner| corner.map(|at| at as i32));
        self.out.write_all(&bytes).map_err(Error::io(self.path))?;
        let entry = placed(Entry { min, max, counts, ..Entry::default() }, &bytes, self.at)?;
        self.at += bytes.len() as u64;
        self.written.push(entry);
        Ok(())
    }
}

/// The box x, z, x, z around nothing.
const EMPTY: [f64; 4] = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];

fn join(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
}

/// Writes the nodes over `children`, the first of them at byte `at`; their
/// entries and the first byte after them.
fn write_nodes(
    out: &mut BufWriter<&mut File>,
    path: &Path,
    children: &[Entry],
    mut at: u64,
) -> Result<(Vec<Entry>, u64)> {
    let mut nodes = Vec::with_capacity(children.len().div_ceil(CHILDREN));
    for group in children.chunks(CHILDREN) {
        let mut bytes = Vec::new();
        for child in group {
            child.write(&mut bytes);
        }
        let over = Entry::over(group).ok_or_else(too_much)?;
        nodes.push(placed(over, &bytes, at)?);
        out.write_all(&bytes).map_err(Error::io(path))?;
        at += bytes.len() as u64;
    }
    Ok((nodes, at))
}

/// The entry of what stands at byte `offset`.
fn placed(entry: Entry, bytes: &[u8], offset: u64) -> Result<Entry> {
    let length = u32::try_from(bytes.len()).map_err(|_| too_much())?;
    Ok(Entry { offset, length, checksum: crc32c::crc32c(bytes), ..entry })
}

fn too_much() -> Error {
    unencodable("it has more than 2^32 roads or landmarks, or a tile over 4 GB; make several".into())
}

fn unencodable(what: String) -> Error {
    Error::AtlasUnencodable { what }
}
