//! The options that say where the map is on the Earth.

use clap::Args;
use common::earth::{OnEarth, Projection, World};
use nalgebra::Vector3;

use crate::Result;

/// Where the map is on the Earth.
#[derive(Debug, Clone, Default, Args)]
pub struct EarthArgs {
    /// Where the map's origin is on the Earth (WGS 84), degrees and metres, as
    /// `mapper build --raw` prints it and `mapper export` takes it. With it fixes
    /// are latitudes and longitudes, and estimates say theirs.
    #[arg(long, value_name = "LAT,LON,ALT[,HEADING[,PITCH,ROLL]]", allow_hyphen_values = true)]
    origin: Option<String>,
    /// What the map's metres are on the Earth: those of maps that were built of
    /// KITTI's poses are in the projection of its development kit.
    #[arg(long, value_enum, default_value_t, requires = "origin")]
    projection: Projection,
    /// Instead: the grid of the survey that the map was built with, which has z up:
    /// an EPSG code or a string of PROJ. Altitudes are the survey's heights.
    #[arg(long, value_name = "EPSG:CODE", conflicts_with = "origin")]
    crs: Option<String>,
    /// With `--crs`: what `mapper build` said that it reduced the survey by, metres.
    #[arg(
        long,
        value_name = "X,Y,Z",
        value_parser = common::coordinates_m,
        allow_hyphen_values = true,
        requires = "crs",
        default_value = "0,0,0"
    )]
    reduced: Vector3<f64>,
}

impl EarthArgs {
    /// The map's frame on the Earth, where it is said.
    ///
    /// # Errors
    /// [`common::earth::PlaceError`] where it is none.
    pub fn on_earth(&self) -> Result<Option<OnEarth>> {
        if let Some(grid) = &self.crs {
            return Ok(Some(OnEarth::in_grid(grid.parse()?, World::ZUp, self.reduced.into())?));
        }
        let origin = self.origin.as_deref().map(str::parse).transpose()?;
        Ok(origin.map(|origin| OnEarth::new(origin, self.projection)))
    }
}
