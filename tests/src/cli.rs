//! What the command lines of the scores share.

use std::error::Error;
use std::fmt::Display;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use common::geometry::Pose;
use common::kitti::read_poses;
use common::map::SemanticMap;
use fixtures::truth::Truth;

/// Nothing, or one sentence for people.
pub type Outcome = Result<(), Box<dyn Error>>;

/// Ends a program as all of Waymark's end: with 0, or with 2 and one sentence
/// on the error stream.
pub fn ended<E: Display>(result: Result<(), E>) -> ExitCode {
    common::output::ended(match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            common::output::print_error(error);
            ExitCode::from(2)
        }
    })
}

/// A map of a sequence of KITTI.
#[derive(Debug, Args)]
pub struct MapOfSequence {
    /// The map.
    #[arg(long, value_name = "MAP.csm")]
    pub map: PathBuf,
    /// The poses that it was built with, from `mapper build --trajectory`.
    #[arg(long, value_name = "POSES.txt")]
    pub trajectory: PathBuf,
    /// Folder with `sequences/`, as KITTI odometry has it.
    #[arg(long, value_name = "ROOT")]
    pub kitti: PathBuf,
    /// The sequence.
    #[arg(long, value_name = "NN")]
    pub sequence: String,
}

impl MapOfSequence {
    /// The map, and the poses that it was built with (`map_from_camera`).
    ///
    /// # Errors
    /// As [`common::map::read`] and [`read_poses`].
    pub fn read(&self) -> common::Result<(SemanticMap, Vec<Pose>)> {
        Ok((common::map::read(&self.map)?, read_poses(&self.trajectory)?))
    }
}

/// A map of a generated drive.
#[derive(Debug, Args)]
pub struct MapOfDrive {
    /// The map.
    #[arg(long, value_name = "MAP.csm")]
    pub map: PathBuf,
    /// The drive, from `fixtures generate --out`.
    #[arg(long, value_name = "ROOT")]
    pub drive: PathBuf,
}

impl MapOfDrive {
    /// The truth of the drive, and its exact poses (`map_from_camera`).
    ///
    /// # Errors
    /// As [`crate::truth::read`] and [`read_poses`].
    pub fn truth(&self) -> Result<(Truth, Vec<Pose>), Box<dyn Error>> {
        Ok((crate::truth::read(&self.drive)?, read_poses(self.drive.join("truth/poses.txt"))?))
    }
}
