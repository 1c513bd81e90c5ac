//! Images to features (section IV.B): class probabilities from networks or
//! files, regions, and the lines and points that they stand for.
//!
//! Coordinates are pixels of the image, (0, 0) the centre of the top-left
//! pixel, u right, v down.

mod centre;
pub mod config;
mod error;
pub mod image;
pub mod labels;
pub mod lanes;
pub mod network;
mod plane;
pub mod poles;
pub mod regions;
pub mod signs;
#[cfg(test)]
mod synthetic;
pub mod trunks;

pub use config::VisionConfig;
pub use error::Error;
pub use image::{RgbImage, read_image, write_png};
pub use network::Network;
pub use plane::{Class, Plane, ProbabilityMaps};

use crate::features::Features;

/// The features of an image: the same from the same maps, always. Marks of
/// dashed lines are read from its brightness, where it is given and the
/// settings of the lanes say where the ground is.
pub fn extract(maps: &ProbabilityMaps, grey: Option<&Plane>, config: &VisionConfig) -> Features {
    let mut lanes = lanes::extract(maps, &config.lanes);
    if let Some(grey) = grey {
        lanes::read_marks(&mut lanes, grey, &config.lanes, &config.marks);
    }
    Features {
        poles: poles::extract(maps, &config.poles),
        trunks: trunks::extract(maps, &config.trunks, &config.poles),
        lanes,
        signs: signs::extract(maps, &config.signs),
    }
}
