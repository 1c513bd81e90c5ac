//! `mapper export`.

use std::path::PathBuf;

use clap::Args;
use common::atomic_file;
use common::earth::{OnEarth, Projection, World};
use common::map::SemanticMap;

use super::{MapFile, Outcome, print};
use crate::error::{Error, Result};
use crate::export::{Coordinates, Format, Frame};
use crate::frames;
use crate::input::MapFrame;
use crate::outputs;
use crate::report::path_beside;

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
    /// Whose coordinates are written: the map's, or those of the survey that it was built with,
    /// z up, as the report of the build beside it says: of a national grid eastings, northings
    /// and heights.
    #[arg(long, value_enum, default_value_t, conflicts_with = "origin")]
    coordinates: Coordinates,
    /// Where the map's origin is on the Earth (WGS 84), degrees and metres;
    /// heading: bearing of the map's z axis clockwise from north [default: 0],
    /// pitch: how far it points up, roll: tilt to the right. Without it
    /// coordinates are metres: by default x right, y forward, z up; the file says
    /// what they are of the survey's, where the report of the build beside the
    /// map does.
    #[arg(long, value_name = "LAT,LON,ALT[,HEADING[,PITCH,ROLL]]", allow_hyphen_values = true)]
    origin: Option<String>,
    /// The grid that the survey is in, an EPSG code or a string of PROJ: with it
    /// coordinates are WGS 84, of the survey's as the report beside the map has
    /// them, with its heights.
    #[arg(long, value_name = "EPSG:CODE", conflicts_with_all = ["origin", "coordinates"])]
    crs: Option<String>,
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
        let frame = self.frame(&bytes)?;
        let text = format.text(&map, &frame)?;
        atomic_file::write(&self.out, text.as_bytes())?;
        print(&format!("{}: {} bytes, {}\n", self.out.display(), text.len(), frame.note()));
        if format == Format::Geojson && !matches!(frame, Frame::Earth(_)) {
            let (what, option) = match self.coordinates {
                Coordinates::Map => ("local metres", "--origin"),
                Coordinates::Survey => ("the survey's grid", "--crs"),
            };
            print(&format!("GIS programs take GeoJSON for degrees: set {what} there, or give {option}\n"));
        }
        Ok(Outcome::Done)
    }

    /// What the coordinates are, of a map of these bytes.
    fn frame(&self, bytes: &[u8]) -> Result<Frame> {
        let known = frames::beside(&self.file.map, bytes);
        let survey = || {
            let map = self.file.map.clone();
            known.ok_or_else(|| Error::NoSurveyFrame { report: path_beside(&map), map })
        };
        if let Some(text) = &self.origin {
            return Ok(Frame::Earth(OnEarth::new(text.parse()?, self.projection)));
        }
        if let Some(grid) = &self.crs {
            let MapFrame { world, reduced_by_m, .. } = survey()?;
            if world == World::FirstCamera {
                return Err(Error::NoGrid { map: self.file.map.clone() });
            }
            return Ok(Frame::Earth(OnEarth::in_grid(grid.parse()?, world, reduced_by_m)?));
        }
        match self.coordinates {
            Coordinates::Map => Ok(Frame::Local(known)),
            Coordinates::Survey => Ok(Frame::Survey(survey()?)),
        }
    }
}
