//! What can go wrong while a map is built.

use std::path::PathBuf;

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
}
