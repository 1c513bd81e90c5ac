//! `mapper atlas`.

use std::path::PathBuf;

use clap::Args;
use common::map::atlas::AtlasOptions;
use indicatif::ProgressBar;

use super::{Outcome, print};
use crate::atlas::make;
use crate::error::Result;

/// Put maps into one file, of which a localizer loads what is around it.
///
/// The maps share one frame and overlap nowhere: drives of one area become one
/// map first.
#[derive(Debug, Args)]
pub struct MakeAtlas {
    /// The maps; of a folder, all its .csm files.
    #[arg(value_name = "MAP.csm", required = true)]
    maps: Vec<PathBuf>,
    /// The atlas to write.
    #[arg(long, value_name = "ATLAS.csa")]
    out: PathBuf,
    /// What the frame is, for people [default: the maps' note, if they agree].
    #[arg(long, value_name = "TEXT")]
    note: Option<String>,
    /// Largest size of a tile of several roads, bytes.
    #[arg(long, value_name = "BYTES", default_value_t = AtlasOptions::default().tile_bytes, value_parser = super::some_bytes)]
    tile_bytes: usize,
    /// Largest extent of a tile of several roads, metres.
    #[arg(long, value_name = "M", default_value_t = AtlasOptions::default().tile_side_m, value_parser = super::distance_m)]
    tile_side: f64,
}

impl MakeAtlas {
    /// Runs the command.
    pub fn run(&self) -> Result<Outcome> {
        let options =
            AtlasOptions { tile_bytes: self.tile_bytes, tile_side_m: self.tile_side, ..AtlasOptions::default() };
        let bar = ProgressBar::new(0);
        let made = make(&self.maps, &self.out, options, self.note.clone(), |done, of| {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
        });
        bar.finish_and_clear();
        let summary = made?;
        let counts = summary.counts;
        print(&format!(
            "{}: {} bytes, {} tiles: {} roads, {} poles, {} signs, {} lane lines\n",
            self.out.display(),
            summary.bytes,
            counts.tiles,
            counts.roads,
            counts.poles,
            counts.signs,
            counts.lanes,
        ));
        Ok(Outcome::Done)
    }
}
