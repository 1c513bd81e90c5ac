//! What can go wrong while a map is built.

use std::path::{Path, PathBuf};

/// Result of the mapper's functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What can go wrong while a map is built.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Input or output.
    #[error(transparent)]
    Common(#[from] common::Error),
    /// No frame to stitch.
    #[error(
        "{} holds no scan to stitch with --every {every}: check the frames and --every",
        folder.display()
    )]
    NoScans {
        /// Where the scans should lie.
        folder: PathBuf,
        /// Stride of the frames.
        every: usize,
    },
    /// A scan of a frame that the poses do not reach.
    #[error(
        "{} has no pose, for the pose file ends after {poses} rows: give the poses of the whole drive or use --last",
        path.display()
    )]
    FrameWithoutPose {
        /// The scan.
        path: PathBuf,
        /// Rows in the pose file.
        poses: usize,
    },
    /// The LAS writer.
    #[error("{}: the point cloud could not be written: {reason}", path.display())]
    Cloud {
        /// The file.
        path: PathBuf,
        /// What the writer says.
        reason: String,
    },
    /// A file beside a map that is no report of its build.
    #[error("{}: {source}; it is no report of `mapper build`: build the map again, or remove the file", path.display())]
    BadReport {
        /// The file.
        path: PathBuf,
        /// What is wrong in it.
        source: serde_json::Error,
    },
    /// A file to export to whose extension says no format.
    #[error(
        "{}: the extension says no format; name it .geojson, .osm (Lanelet2), .csv or .txt, or give --format",
        path.display()
    )]
    UnknownExport {
        /// The file to be written.
        path: PathBuf,
    },
    /// A place on the Earth that is none.
    #[error("--origin {text}: {what}; give LAT,LON,ALT[,HEADING[,PITCH,ROLL]] in degrees and metres")]
    BadOrigin {
        /// What was given.
        text: String,
        /// What is wrong with it.
        what: String,
    },
    /// A place on the Earth for a format that has none.
    #[error("the paper's text holds local metres only: leave --origin away, or export as CSV or GeoJSON")]
    OriginUnused,
    /// A result that has no JSON form.
    #[error("the result cannot be printed as JSON: {0}")]
    Json(serde_json::Error),
    /// Threads that the operating system does not give.
    #[error("{threads} threads could not be started: {reason}; give a smaller --threads")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// What the operating system says.
        reason: String,
    },
}

impl Error {
    /// For `map_err`: what is wrong with a report, together with its file.
    pub fn report(path: &Path) -> impl FnOnce(serde_json::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::BadReport { path, source }
    }
}
