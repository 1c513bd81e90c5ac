//! The options that say where the map is on the Earth.

use clap::Args;
use common::earth::{OnEarth, Projection};

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
}

impl EarthArgs {
    /// The map's frame on the Earth, where it is said.
    ///
    /// # Errors
    /// [`common::Error::BadOrigin`] where it is none.
    pub fn on_earth(&self) -> Result<Option<OnEarth>> {
        let origin = self.origin.as_deref().map(str::parse).transpose()?;
        Ok(origin.map(|origin| OnEarth::new(origin, self.projection)))
    }
}
