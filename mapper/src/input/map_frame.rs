//! What places a map in the world, as its input tells: kept beside the map, in the report of
//! its build, for whoever exports it.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::survey::SurveyFrame;
use crate::export::Origin;

/// The frame of a map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapFrame {
    /// The world that the survey's poses are in.
    pub world: World,
    /// What was taken off the survey's coordinates, metres along its own axes.
    pub reduced_by_m: [f64; 3],
    /// Where the map's origin is on the Earth, for `mapper export --projection mercator`; of
    /// KITTI's raw recordings only.
    pub origin: Option<Origin>,
}

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

impl MapFrame {
    /// The frame of KITTI's drives; with `origin` of its raw recordings.
    pub fn of_first_camera(origin: Option<Origin>) -> Self {
        Self { world: World::FirstCamera, reduced_by_m: [0.0; 3], origin }
    }

    /// The frame of a map in the world of a survey, off which something was taken.
    pub fn of_survey(frame: SurveyFrame, reduced_by_m: &Vector3<f64>) -> Self {
        let world = match frame {
            SurveyFrame::Camera => World::CameraAxes,
            SurveyFrame::Lidar => World::ZUp,
        };
        Self { world, reduced_by_m: (*reduced_by_m).into(), origin: None }
    }

    /// What local metres (x right, y forward, z up) are of the survey's, for people.
    pub fn note(&self) -> String {
        let [x, y, z] = self.reduced_by_m;
        match self.world {
            World::FirstCamera => {
                let at = self.origin.map_or_else(String::new, |origin| {
                    format!(", which is on the Earth at --origin {origin} --projection mercator")
                });
                format!("of camera 0 at the first frame of the survey{at}")
            }
            World::CameraAxes => format!(
                "of the survey's world, whose coordinates (X right, Y down, Z forward) make them {}",
                axes(&[less("X", x), less("Z", z), from("Y", y)])
            ),
            World::ZUp => format!(
                "of the survey's world, whose coordinates (X, Y, Z up) make them {}",
                axes(&[from("Y", y), less("X", x), less("Z", z)])
            ),
        }
    }
}

fn axes(three: &[String; 3]) -> String {
    format!("({})", three.join(", "))
}

/// A coordinate less what is taken off it.
fn less(name: &str, metres: f64) -> String {
    match metres {
        0.0 => name.to_owned(),
        _ if metres < 0.0 => format!("{name} + {}", -metres),
        _ => format!("{name} - {metres}"),
    }
}

/// The same with the other sign.
fn from(name: &str, metres: f64) -> String {
    if metres == 0.0 { format!("-{name}") } else { format!("{metres} - {name}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::Frame;
    use nalgebra::Point3;

    #[test]
    fn the_note_says_what_exported_metres_are_of_the_surveys() {
        let reduced_by_m = Vector3::new(450_000.0, 5_420_000.0, -20.0);
        let map = Point3::new(1.5, 2.0, 30.0);
        let utm = MapFrame::of_survey(SurveyFrame::Lidar, &reduced_by_m);
        assert!(utm.note().ends_with("(X, Y, Z up) make them (5420000 - Y, X - 450000, Z + 20)"), "{}", utm.note());
        let survey = Point3::new(map.z, -map.x, -map.y) + reduced_by_m;
        let exported = Frame::local().metres(&map);
        let said = Point3::new(5_420_000.0 - survey.y, survey.x - 450_000.0, survey.z + 20.0);
        assert!((said - exported).norm() < 1e-6, "{said} {exported}");
        let camera = MapFrame::of_survey(SurveyFrame::Camera, &reduced_by_m);
        assert!(camera.note().ends_with("make them (X - 450000, Z + 20, 5420000 - Y)"), "{}", camera.note());
        let survey = map + reduced_by_m;
        let said = Point3::new(survey.x - 450_000.0, survey.z + 20.0, 5_420_000.0 - survey.y);
        assert!((said - exported).norm() < 1e-6, "{said} {exported}");
        let near = MapFrame::of_survey(SurveyFrame::Lidar, &Vector3::zeros());
        assert!(near.note().ends_with("make them (-Y, X, Z)"), "{}", near.note());
    }

    #[test]
    fn an_origin_is_said_as_the_option_takes_it() {
        let origin: Origin = "49.0337,8.395,114.5,62,1,-2".parse().unwrap();
        let note = MapFrame::of_first_camera(Some(origin)).note();
        assert!(note.ends_with("at --origin 49.0337,8.395,114.5,62,1,-2 --projection mercator"), "{note}");
    }
}
