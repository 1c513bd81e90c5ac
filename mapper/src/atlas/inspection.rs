//! What is in an atlas, for people and for programs.

use std::fmt::Write as _;
use std::path::Path;

use common::map::atlas::Atlas;
use serde::Serialize;

use crate::error::Result;
use crate::inspect::road_length_m;

/// What is in an atlas. Making one reads the whole file, tile by tile.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AtlasInspection {
    /// What the frame is, for people.
    pub frame_note: String,
    /// Version of the file format.
    pub version: u8,
    /// Step of all coordinates, metres.
    pub quantum_m: f64,
    /// Length of the file, bytes.
    pub bytes: u64,
    /// Of these, header and nodes.
    pub index_bytes: u64,
    /// Read to open it, bytes.
    pub opening_bytes: u64,
    /// Smallest and largest coordinates (map frame, metres); none for an
    /// empty atlas.
    pub bounds_m: Option<[[f64; 3]; 2]>,
    /// Length of all roads, metres.
    pub road_m: f64,
    /// Bytes of the file per kilometre of road; none without a road.
    pub bytes_per_km: Option<f64>,
    /// Levels of nodes over the tiles.
    pub levels: u8,
    /// Number of tiles.
    pub tiles: u32,
    /// The shortest, the median and the longest tile, bytes.
    pub tile_bytes: [usize; 3],
    /// Number of roads.
    pub roads: u32,
    /// Number of poles.
    pub poles: u32,
    /// Number of signs.
    pub signs: u32,
    /// Number of lane lines.
    pub lanes: u32,
}

impl AtlasInspection {
    /// Looks into every part of an atlas.
    ///
    /// # Errors
    /// A file that cannot be read or is no atlas, or is damaged anywhere.
    pub fn of_file(path: &Path) -> Result<Self> {
        let atlas = Atlas::open(path)?;
        let opening_bytes = atlas.bytes_read();
        let mut road_m = 0.0;
        let mut lengths: Vec<usize> = Vec::new();
        atlas.read_all(|place, tile| {
            road_m += road_length_m(&tile.map);
            lengths.push(place.bytes());
            Ok(())
        })?;
        let summary = atlas.summary();
        let in_tiles: u64 = lengths.iter().map(|&bytes| bytes as u64).sum();
        lengths.sort_unstable();
        let at = |index: usize| lengths.get(index).copied().unwrap_or(0);
        Ok(Self {
            frame_note: summary.frame_note,
            version: summary.version,
            quantum_m: summary.quantum_m,
            bytes: summary.bytes,
            index_bytes: summary.bytes.saturating_sub(in_tiles),
            opening_bytes,
            bounds_m: summary.bounds.map(|b| [b.min_map.into(), b.max_map.into()]),
            road_m,
            bytes_per_km: (road_m > 0.0).then(|| summary.bytes as f64 / road_m * 1000.0),
            levels: summary.levels,
            tiles: summary.counts.tiles,
            tile_bytes: [at(0), at(lengths.len() / 2), at(lengths.len().saturating_sub(1))],
            roads: summary.counts.roads,
            poles: summary.counts.poles,
            signs: summary.counts.signs,
            lanes: summary.counts.lanes,
        })
    }

    /// The inspection as lines of text.
    pub fn text(&self) -> String {
        let mut out = String::new();
        // Writing to a string cannot fail.
        let _ =
            writeln!(out, "{}, atlas, format version {}, quantum {} m", self.frame_note, self.version, self.quantum_m);
        if let Some([min, max]) = self.bounds_m {
            let km = |axis: usize| (min[axis] / 1e3, max[axis] / 1e3);
            let ((left, right), (low, high)) = (km(0), km(2));
            let _ = writeln!(out, "bounds, km: x right {left:.3} to {right:.3}, z forward {low:.3} to {high:.3}");
        }
        let _ = write!(out, "{:.1} km of road", self.road_m / 1e3);
        if let Some(bytes) = self.bytes_per_km {
            let _ = write!(out, ", {bytes:.0} bytes per km");
        }
        let _ = writeln!(
            out,
            "\n{} roads, {} poles, {} signs, {} lane lines",
            self.roads, self.poles, self.signs, self.lanes
        );
        let [least, median, most] = self.tile_bytes;
        let _ = writeln!(
            out,
            "{} bytes: {} tiles of {least} to {most} bytes (median {median}), {} of index in {} levels; opening reads {}",
            self.bytes, self.tiles, self.index_bytes, self.levels, self.opening_bytes
        );
        out
    }
}
