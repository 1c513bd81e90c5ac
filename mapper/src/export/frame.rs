//! The frame of exported coordinates: local metres, the survey's world, or the Earth.

use common::earth::{Geodetic, OnEarth};
use nalgebra::Point3;

use crate::input::MapFrame;

/// Whose coordinates are exported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Coordinates {
    /// Those of the map, from its origin: x right, y forward, z up, metres.
    #[default]
    Map,
    /// Those of the survey's world, with what they were reduced by: of a national grid eastings,
    /// northings and heights.
    Survey,
}

/// The frame of exported coordinates.
#[derive(Debug, Clone)]
pub enum Frame {
    /// Metres: x right, y forward, z up of the map's origin. With what is known of where that is.
    Local(Option<MapFrame>),
    /// Metres of the survey's world, z up.
    Survey(MapFrame),
    /// WGS 84.
    Earth(OnEarth),
}

impl Frame {
    /// A point of the map in metres, z up: x east, y north of its origin where that is known, in
    /// the survey's world, or x right, y forward of its origin.
    pub fn metres(&self, map: &Point3<f64>) -> Point3<f64> {
        match self {
            Self::Local(_) => local(map),
            Self::Survey(known) => known.survey_from_map(map),
            Self::Earth(on_earth) => on_earth.enu_m(map),
        }
    }

    /// The place on the Earth of a point of the map, for formats that want one. Where nobody
    /// said it, the map's origin is at 0 N 0 E; heights are the survey's in its coordinates, for
    /// these have them.
    pub fn place(&self, map: &Point3<f64>) -> Geodetic {
        match self {
            Self::Local(_) => NOWHERE.offset(&self.metres(map)),
            Self::Survey(known) => {
                let survey_m = known.survey_from_map(map);
                let from_origin_m = survey_m - known.survey_from_map(&Point3::origin());
                Geodetic { altitude_m: survey_m.z, ..NOWHERE.offset(&from_origin_m.into()) }
            }
            Self::Earth(on_earth) => on_earth.place(map),
        }
    }

    /// A point of the map as three rounded numbers, in the order of RFC 7946:
    /// longitude, latitude, altitude where the origin is known, else metres.
    pub fn position(&self, map: &Point3<f64>) -> [f64; 3] {
        let Self::Earth(on_earth) = self else {
            let metres = self.metres(map);
            return [metres.x, metres.y, metres.z].map(|v| rounded(v, METRE_DIGITS));
        };
        let place = on_earth.place(map);
        [
            rounded(place.longitude_deg, DEGREE_DIGITS),
            rounded(place.latitude_deg, DEGREE_DIGITS),
            rounded(place.altitude_m, METRE_DIGITS),
        ]
    }

    /// The frame in words, for people.
    pub fn note(&self) -> String {
        match self {
            Self::Local(known) => {
                let of = known.map_or_else(|| "of the map's own frame".into(), |known| known.note());
                format!("local metres: x right, y forward, z up {of}")
            }
            Self::Survey(known) => format!("metres of {}", known.survey_note()),
            Self::Earth(on_earth) => on_earth.note(),
        }
    }
}

/// Metres of a map, x right, y forward, z up of its origin.
fn local(map: &Point3<f64>) -> Point3<f64> {
    Point3::new(map.x, map.z, -map.y)
}

/// The origin of a map of which nobody said where it is.
const NOWHERE: Geodetic = Geodetic { latitude_deg: 0.0, longitude_deg: 0.0, altitude_m: 0.0 };

/// Digits of a degree: 0.1 mm.
pub const DEGREE_DIGITS: i32 = 9;
/// Digits of a metre: the map's own grid is coarser.
pub const METRE_DIGITS: i32 = 3;

/// The nearest number of so many digits, and never -0.
pub fn rounded(value: f64, digits: i32) -> f64 {
    let scale = 10.0_f64.powi(digits);
    (value * scale).round() / scale + 0.0
}

#[cfg(test)]
mod tests {
    use common::earth::Projection;

    use super::*;

    #[test]
    fn local_metres_are_right_forward_and_up() {
        let at = Point3::new(1.0, 2.0, 3.0);
        assert_eq!(Frame::Local(None).metres(&at), Point3::new(1.0, 3.0, -2.0));
        let east = OnEarth::new("49,8,100,90".parse().unwrap(), Projection::Topocentric);
        let ahead = Frame::Earth(east).metres(&at);
        assert!((ahead - Point3::new(3.0, -1.0, -2.0)).norm() < 1e-9, "{ahead}");
    }

    #[test]
    fn of_local_metres_no_more_is_said_than_is_known() {
        assert_eq!(Frame::Local(None).note(), "local metres: x right, y forward, z up of the map's own frame");
        let kitti = Frame::Local(Some(MapFrame::of_first_camera(None)));
        assert!(kitti.note().ends_with("z up of camera 0 at the first frame of the survey"), "{}", kitti.note());
    }
}
