//! What can be wrong with where a map is said to be.

/// What can be wrong with where a map is said to be.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlaceError {
    /// An origin that is none.
    #[error("--origin {text}: {what}; give LAT,LON,ALT[,HEADING[,PITCH,ROLL]] in degrees and metres")]
    Origin {
        /// What was given.
        text: String,
        /// What is wrong with it.
        what: String,
    },
    /// A grid that is none.
    #[error("--crs {text}: {what}; give an EPSG code of projected metres, as EPSG:25832, or a string of PROJ")]
    Grid {
        /// What was given.
        text: String,
        /// What is wrong with it.
        what: String,
    },
    /// A map outside of the grid that it is said to be in.
    #[error(
        "--crs {grid} does not reach the map, whose origin is at {east_m} east, {north_m} north; give the grid of its survey, and what its coordinates were reduced by"
    )]
    OffGrid {
        /// The grid.
        grid: String,
        /// Coordinates of the map's origin, metres.
        east_m: f64,
        /// The other one.
        north_m: f64,
    },
}
