//! What places a map in the world, as its input tells: kept beside the map, in the report of
//! its build, for whoever exports it, and with the maps that a merged one was made of.

use common::earth::{Origin, World};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::survey::SurveyFrame;

/// What two frames are told apart by, metres: the step of a map's coordinates.
const LEAST_APART_M: f64 = 0.01;
/// The same of places on the Earth and of bearings, degrees: a centimetre, at the origin and
/// some metres from it. What is written as text and read comes back with another last bit.
const LEAST_APART_DEG: f64 = 1e-7;

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

impl MapFrame {
    /// The frame of KITTI's drives; with `origin` of its raw recordings.
    pub fn of_first_camera(origin: Option<Origin>) -> Self {
        Self { world: World::FirstCamera, reduced_by_m: [0.0; 3], origin }
    }

    /// The frame of a map in the world of a survey, off which something was taken.
    pub fn of_survey(frame: SurveyFrame, reduced_by_m: &Vector3<f64>) -> Self {
        Self { world: frame.world(), reduced_by_m: (*reduced_by_m).into(), origin: None }
    }

    /// The place in the survey's world, metres, of a point of the map. All worlds have z up
    /// here, as clouds have it: of one with the axes of a camera x right, y forward, z up.
    pub fn survey_from_map(&self, map: &Point3<f64>) -> Point3<f64> {
        self.world.survey_from_map(self.reduced_by_m, map)
    }

    /// Whether the metres of two maps are those of one frame, as far as is known. One world may
    /// be given with z up or with the axes of a camera.
    pub fn may_be(&self, other: &Self) -> bool {
        let [ours, others] = [self, other].map(Self::survey_origin_map);
        let is_one = |a: f64, b: f64, least: f64| (a - b).abs() < least;
        let is_one_place = |a: Origin, b: Origin| {
            is_one(a.altitude_m, b.altitude_m, LEAST_APART_M)
                && [
                    (a.latitude_deg, b.latitude_deg),
                    (a.longitude_deg, b.longitude_deg),
                    (a.heading_deg, b.heading_deg),
                    (a.pitch_deg, b.pitch_deg),
                    (a.roll_deg, b.roll_deg),
                ]
                .iter()
                .all(|(a, b)| is_one(*a, *b, LEAST_APART_DEG))
        };
        (ours - others).amax() < LEAST_APART_M
            && self.origin.zip(other.origin).is_none_or(|(ours, other)| is_one_place(ours, other))
    }

    /// Where the survey's world has its origin in the map, metres.
    fn survey_origin_map(&self) -> Point3<f64> {
        self.world.map_from_survey(self.reduced_by_m, &Point3::origin())
    }

    /// The frame in a few words, for people: what tells it from another.
    pub fn name(&self) -> String {
        let [x, y, z] = self.reduced_by_m;
        match (self.world, self.origin) {
            (World::FirstCamera, Some(origin)) => format!("in the frame of a camera at {origin}"),
            (World::FirstCamera, None) => "in the frame of its first camera".into(),
            (World::CameraAxes | World::ZUp, _) => format!("reduced by ({x}, {y}, {z}) m"),
        }
    }

    /// What the coordinates of [`Self::survey_from_map`] are, for people.
    pub fn survey_note(&self) -> String {
        match self.world {
            World::FirstCamera => "camera 0 at the first frame of the survey: x right, y forward, z up".into(),
            World::CameraAxes => "the survey's world, x right, y forward, z up".into(),
            World::ZUp => "the survey's world, in its own coordinates X, Y, Z up".into(),
        }
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
    use proptest::prelude::*;

    use super::super::survey::Placement;
    use super::*;
    use crate::export::Frame;

    #[test]
    fn the_note_says_what_exported_metres_are_of_the_surveys() {
        let reduced_by_m = Vector3::new(450_000.0, 5_420_000.0, -20.0);
        let map = Point3::new(1.5, 2.0, 30.0);
        let utm = MapFrame::of_survey(SurveyFrame::Lidar, &reduced_by_m);
        assert!(utm.note().ends_with("(X, Y, Z up) make them (5420000 - Y, X - 450000, Z + 20)"), "{}", utm.note());
        let survey = Point3::new(map.z, -map.x, -map.y) + reduced_by_m;
        let exported = Frame::Local(None).metres(&map);
        assert!((utm.survey_from_map(&map) - survey).norm() < 1e-6);
        let said = Point3::new(5_420_000.0 - survey.y, survey.x - 450_000.0, survey.z + 20.0);
        assert!((said - exported).norm() < 1e-6, "{said} {exported}");
        let camera = MapFrame::of_survey(SurveyFrame::Camera, &reduced_by_m);
        assert!(camera.note().ends_with("make them (X - 450000, Z + 20, 5420000 - Y)"), "{}", camera.note());
        let survey = map + reduced_by_m;
        assert!((camera.survey_from_map(&map) - Point3::new(survey.x, survey.z, -survey.y)).norm() < 1e-6);
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

    proptest! {
        #[test]
        fn a_point_of_a_cloud_comes_back_to_where_it_was(
            (x, y, z) in (-2e4..2e4_f64, -2e4..2e4_f64, -500.0..500.0_f64),
            (by_x, by_y, by_z) in (-6e6..6e6_f64, -6e6..6e6_f64, -100.0..100.0_f64),
        ) {
            for frame in [SurveyFrame::Lidar, SurveyFrame::Camera] {
                let reduced_by_m = Vector3::new(by_x, by_y, by_z);
                let placement = Placement::new(frame, None, None, Some(reduced_by_m)).unwrap();
                let cloud = Point3::new(by_x + x, by_y + y, by_z + z);
                let back = MapFrame::of_survey(frame, &reduced_by_m).survey_from_map(&placement.map_from_cloud(&cloud));
                prop_assert!((back - cloud).norm() < 1e-6, "{back} {cloud}");
            }
        }
    }
}
