//! Maps and stitched clouds in the formats of other programs.
//!
//! A landmark has the same number in all of them: [`common::map::Numbering`].

mod classes;
mod cloud;
mod csv;
mod frame;
mod geojson;
mod landmarks;
mod lanelet2;
#[cfg(test)]
mod tests;

use std::path::Path;

use common::map::SemanticMap;

pub use self::cloud::{CloudCount, CloudFile};
pub use self::frame::{Coordinates, Frame};
use crate::error::{Error, Result};

/// A format that a map can be written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// `GeoJSON` (RFC 7946): metres, or WGS 84 with an origin.
    Geojson,
    /// `OpenStreetMap` XML with the tags of Lanelet2.
    Lanelet2,
    /// One row per point of a landmark.
    Csv,
    /// The paper's text, one landmark per line, in the map frame.
    Ascii,
}

impl Format {
    /// The format that a file's extension asks for.
    ///
    /// # Errors
    /// [`Error::UnknownExport`] where it asks for none.
    pub fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "geojson" | "json" => Ok(Self::Geojson),
            "osm" => Ok(Self::Lanelet2),
            "csv" => Ok(Self::Csv),
            "txt" => Ok(Self::Ascii),
            _ => Err(Error::UnknownExport { path: path.to_path_buf() }),
        }
    }

    /// The map in this format.
    ///
    /// # Errors
    /// [`Error::MapFrameOnly`] where the format has the map's own coordinates
    /// and others were asked for.
    pub fn text(self, map: &SemanticMap, frame: &Frame) -> Result<String> {
        match self {
            Self::Geojson => Ok(geojson::text(map, frame)),
            Self::Lanelet2 => Ok(lanelet2::text(map, frame)),
            Self::Csv => Ok(csv::text(map, frame)),
            Self::Ascii if matches!(frame, Frame::Local(_)) => Ok(common::map::ascii(map)),
            Self::Ascii => Err(Error::MapFrameOnly),
        }
    }
}
