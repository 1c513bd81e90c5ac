//! `mapper export`.

use std::path::PathBuf;

use clap::Args;
use common::atomic_file;
use common::map::SemanticMap;

use super::{MapFile, Outcome, print};
use crate::error::Result;
use crate::export::{Format, Frame, Projection};
use crate::outputs;
use crate::report::read_beside;

/// Write a map in a format of other programs.
#[derive(Debug, Args)]
pub struct Export {
    #[command(flatten)]
    file: MapFile,
    /// The file to write: .geojson, .osm (Lanelet2), .csv, or .txt (the paper's text).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The format [default: as the extension of FILE says].
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// Where the map's origin is on the Earth (WGS 84), degrees and metres;
    /// heading: bearing of the map's z axis clockwise from north [default: 0],
    /// pitch: how far it points up, roll: tilt to the right. Without it
    /// coordinates are local metres: x right, y forward, z up; the file says
    /// what they are of the survey's, where the report of the build beside the
    /// map does.
    #[arg(long, value_name = "LAT,LON,ALT[,HEADING[,PITCH,ROLL]]", allow_hyphen_values = true)]
    origin: Option<String>,
    /// What the map's metres are on the Earth: KITTI's poses, and so maps built
    /// of them, are in the projection of its development kit.
    #[arg(long, value_enum, default_value_t, requires = "origin")]
    projection: Projection,
}

impl Export {
    /// Runs the command.
    pub fn run(&self) -> Result<Outcome> {
        outputs::check(&[("--out", &*self.out)], [&*self.file.map])?;
        let format = self.format.map_or_else(|| Format::of(&self.out), Ok)?;
        let bytes = std::fs::read(&self.file.map).map_err(common::Error::io(&self.file.map))?;
        let map = SemanticMap::decode(&bytes).map_err(common::Error::in_file(&self.file.map))?;
        let frame = if let Some(text) = &self.origin {
            Frame::wgs84(text.parse()?, self.projection)
        } else {
            // A report that cannot be read, or that of another map, says nothing of this one.
            let beside = read_beside(&self.file.map, &bytes).unwrap_or_default();
            Frame::local_of(beside.own.and_then(|report| report.frame))
        };
        let text = format.text(&map, &frame)?;
        atomic_file::write(&self.out, text.as_bytes())?;
        print(&format!("{}: {} bytes, {}\n", self.out.display(), text.len(), frame.note()));
        if format == Format::Geojson && self.origin.is_none() {
            print("GIS programs take GeoJSON for degrees: set local metres there, or give --origin\n");
        }
        Ok(Outcome::Done)
    }
}
