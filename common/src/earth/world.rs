//! The worlds that surveys are in.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// The world of a survey, and how the map's axes (x right, y down, z forward) lie in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum World {
    /// Camera 0 at the first frame, as KITTI has it: the map's axes are its own.
    FirstCamera,
    /// A world with the axes of a camera: the map's are the same.
    CameraAxes,
    /// A world with z up: map x is its -y, map y its -z, map z its x.
    ZUp,
}

impl World {
    /// The place in the survey's world, metres, of a point of a map that was reduced by so
    /// much along the axes of that world. All worlds have z up here, as clouds have it: of one
    /// with the axes of a camera x right, y forward, z up.
    pub fn survey_from_map(self, [x, y, z]: [f64; 3], map: &Point3<f64>) -> Point3<f64> {
        match self {
            Self::FirstCamera | Self::CameraAxes => Point3::new(map.x + x, map.z + z, -(map.y + y)),
            Self::ZUp => Point3::new(map.z + x, y - map.x, z - map.y),
        }
    }

    /// The point of the map at a place in the survey's world: the inverse of
    /// [`Self::survey_from_map`].
    pub fn map_from_survey(self, [x, y, z]: [f64; 3], survey: &Point3<f64>) -> Point3<f64> {
        match self {
            Self::FirstCamera | Self::CameraAxes => Point3::new(survey.x - x, -survey.z - y, survey.y - z),
            Self::ZUp => Point3::new(y - survey.y, z - survey.z, survey.x - x),
        }
    }
}
