//! The frame of exported coordinates: local metres, the survey's world, or the Earth.

use common::kitti::Mercator;
use map_3d::Ellipsoid;
use nalgebra::{Point3, UnitQuaternion};

use super::origin::Origin;
use crate::input::MapFrame;

/// What the metres of a map's frame are on the Earth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Projection {
    /// Metres east, north and up of a plane that touches the Earth at the map's
    /// origin.
    #[default]
    Topocentric,
    /// Those of KITTI's development kit: Mercator's projection of a sphere, true
    /// at the map's origin, with altitudes for heights.
    Mercator,
}

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
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Frame {
    /// Metres: x right, y forward, z up of the map's origin. With what is known of where that is.
    Local(Option<MapFrame>),
    /// Metres of the survey's world, z up.
    Survey(MapFrame),
    /// WGS 84.
    Earth(Placed),
}

/// A map's frame on the Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    origin: Origin,
    turn: UnitQuaternion<f64>,
    projection: Projection,
}

/// A place on the Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geodetic {
    /// Degrees north, WGS 84.
    pub latitude_deg: f64,
    /// Degrees east.
    pub longitude_deg: f64,
    /// Metres.
    pub altitude_m: f64,
}

impl Frame {
    /// WGS 84, of a map whose origin is there.
    pub fn wgs84(origin: Origin, projection: Projection) -> Self {
        Self::Earth(Placed { origin, turn: origin.turn(), projection })
    }

    /// The place of the map's origin on the Earth, if it is known.
    pub fn origin(&self) -> Option<&Origin> {
        match self {
            Self::Earth(placed) => Some(&placed.origin),
            Self::Local(_) | Self::Survey(_) => None,
        }
    }

    /// A point of the map in metres, z up: x east, y north of its origin where that is known, in
    /// the survey's world, or x right, y forward of its origin.
    pub fn metres(&self, map: &Point3<f64>) -> Point3<f64> {
        match self {
            Self::Local(_) => local(map),
            Self::Survey(known) => known.survey_from_map(map),
            Self::Earth(placed) => placed.metres(map),
        }
    }

    /// The place on the Earth of a point given in metres east, north and up of
    /// the map's origin; an unknown origin counts as 0 N 0 E, 0 m.
    pub fn geodetic(&self, enu_m: &Point3<f64>) -> Geodetic {
        let (latitude_deg, longitude_deg, altitude_m) =
            self.origin().map_or((0.0, 0.0, 0.0), |o| (o.latitude_deg, o.longitude_deg, o.altitude_m));
        let (lat0, lon0) = (latitude_deg.to_radians(), longitude_deg.to_radians());
        let (latitude_rad, longitude_rad, altitude_m) =
            map_3d::enu2geodetic(enu_m.x, enu_m.y, enu_m.z, lat0, lon0, altitude_m, Ellipsoid::WGS84);
        Geodetic { latitude_deg: latitude_rad.to_degrees(), longitude_deg: longitude_rad.to_degrees(), altitude_m }
    }

    /// The place on the Earth of a point of the map, for formats that want one. Where nobody
    /// said it, the map's origin is at 0 N 0 E; heights are the survey's in its coordinates, for
    /// these have them.
    pub fn place(&self, map: &Point3<f64>) -> Geodetic {
        match self {
            Self::Local(_) | Self::Earth(_) => self.geodetic(&self.metres(map)),
            Self::Survey(known) => {
                let survey_m = known.survey_from_map(map);
                let from_origin_m = survey_m - known.survey_from_map(&Point3::origin());
                Geodetic { altitude_m: survey_m.z, ..self.geodetic(&from_origin_m.into()) }
            }
        }
    }

    /// A point of the map as three rounded numbers, in the order of RFC 7946:
    /// longitude, latitude, altitude where the origin is known, else metres.
    pub fn position(&self, map: &Point3<f64>) -> [f64; 3] {
        let metres = self.metres(map);
        if self.origin().is_none() {
            return [metres.x, metres.y, metres.z].map(|v| rounded(v, METRE_DIGITS));
        }
        let place = self.geodetic(&metres);
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
            Self::Earth(Placed { origin: o, projection, .. }) => {
                let metres = match projection {
                    Projection::Topocentric => "",
                    Projection::Mercator => ", and its metres are those of KITTI's development kit",
                };
                format!(
                    "WGS 84; the map's origin is at {} N {} E, {} m, heading {} degrees clockwise from north, pitch {}, roll {}{metres}",
                    o.latitude_deg, o.longitude_deg, o.altitude_m, o.heading_deg, o.pitch_deg, o.roll_deg
                )
            }
        }
    }
}

/// Metres of a map, x right, y forward, z up of its origin.
pub(super) fn local(map: &Point3<f64>) -> Point3<f64> {
    Point3::new(map.x, map.z, -map.y)
}

impl Placed {
    /// Metres east, north and up of the map's origin.
    fn metres(&self, map: &Point3<f64>) -> Point3<f64> {
        let projected_m = local(&(self.turn * map));
        match self.projection {
            Projection::Topocentric => projected_m,
            Projection::Mercator => topocentric(&self.origin, &projected_m),
        }
    }
}

/// Metres east, north and up of an origin, of metres in [`Mercator`]'s
/// projection around it and of altitude above it.
fn topocentric(origin: &Origin, projected_m: &Point3<f64>) -> Point3<f64> {
    let Origin { latitude_deg, longitude_deg, altitude_m, .. } = *origin;
    let [latitude, longitude] = Mercator::around(latitude_deg, longitude_deg).degrees(projected_m.x, projected_m.y);
    let (east_m, north_m, up_m) = map_3d::geodetic2enu(
        latitude.to_radians(),
        longitude.to_radians(),
        altitude_m + projected_m.z,
        latitude_deg.to_radians(),
        longitude_deg.to_radians(),
        altitude_m,
        Ellipsoid::WGS84,
    );
    Point3::new(east_m, north_m, up_m)
}

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
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_bearing_turns_forward_to_the_right_of_north() {
        let frame = |text: &str| Frame::wgs84(text.parse().unwrap(), Projection::Topocentric);
        let ahead = Point3::new(0.0, 0.0, 10.0);
        let near = |a: Point3<f64>, b: [f64; 3]| (a - Point3::from(b)).norm() < 1e-9;
        assert!(near(frame("49,8,100").metres(&ahead), [0.0, 10.0, 0.0]));
        assert!(near(frame("49,8,100,90").metres(&ahead), [10.0, 0.0, 0.0]));
        assert!(near(frame("49,8,100,90,90,0").metres(&ahead), [0.0, 0.0, 10.0]));
        // Tilted to the right: what was right goes down.
        assert!(near(frame("49,8,100,0,0,90").metres(&Point3::new(1.0, 0.0, 0.0)), [0.0, 0.0, -1.0]));
        assert!(near(Frame::Local(None).metres(&Point3::new(1.0, 2.0, 3.0)), [1.0, 3.0, -2.0]));
    }

    #[test]
    fn a_place_is_that_of_proj() {
        // PROJ: +inv +proj=topocentric +lat_0=49 +lon_0=8 +h_0=100, +inv +proj=cart.
        let frame = Frame::wgs84("49,8,100".parse().unwrap(), Projection::Topocentric);
        let place = frame.geodetic(&Point3::new(1000.0, 2000.0, 30.0));
        assert!((place.latitude_deg - 49.017_982_831_111).abs() < 1e-11, "{place:?}");
        assert!((place.longitude_deg - 8.013_671_112_069).abs() < 1e-11, "{place:?}");
        assert!((place.altitude_m - 130.392_115_431).abs() < 1e-6, "{place:?}");
    }

    #[test]
    fn metres_of_the_development_kit_are_its_degrees_and_no_plane() {
        let origin: Origin = "49,8,100".parse().unwrap();
        // Some 2.6 km away, as `latlonToMercator.m` has it.
        let (latitude_deg, longitude_deg) = (49.018_f64, 8.023_f64);
        let radius_m = 6_378_137.0 * 49_f64.to_radians().cos();
        let ordinate = |degrees: f64| (degrees.to_radians() / 2.0 + std::f64::consts::FRAC_PI_4).tan().ln();
        let east_m = radius_m * (longitude_deg - 8.0).to_radians();
        let north_m = radius_m * (ordinate(latitude_deg) - ordinate(49.0));
        let map = Point3::new(east_m, -5.0, north_m);
        assert!((2500.0..2700.0).contains(&map.coords.norm()));
        let frame = Frame::wgs84(origin, Projection::Mercator);
        let [longitude, latitude, altitude_m] = frame.position(&map);
        assert!((latitude - latitude_deg).abs() < 2e-9 && (longitude - longitude_deg).abs() < 2e-9);
        assert!((altitude_m - 105.0).abs() < 2e-3, "{altitude_m}");
        // Taken for a plane it is off by metres, and the Earth falls away.
        let off_m = frame.metres(&map) - Frame::wgs84(origin, Projection::Topocentric).metres(&map);
        assert!((off_m - nalgebra::Vector3::new(2.633, -2.047, -0.536)).norm() < 1e-3, "{off_m}");
    }

    #[test]
    fn of_local_metres_no_more_is_said_than_is_known() {
        assert_eq!(Frame::Local(None).note(), "local metres: x right, y forward, z up of the map's own frame");
        let kitti = Frame::Local(Some(MapFrame::of_first_camera(None)));
        assert!(kitti.note().ends_with("z up of camera 0 at the first frame of the survey"), "{}", kitti.note());
    }

    proptest! {
        #[test]
        fn metres_survive_degrees(
            (latitude_deg, longitude_deg) in (-80.0..80.0_f64, -179.0..179.0_f64),
            (x, y, z) in (-2e4..2e4_f64, -2e4..2e4_f64, -500.0..500.0_f64),
        ) {
            let origin = Origin { latitude_deg, longitude_deg, altitude_m: 50.0, heading_deg: 30.0, pitch_deg: 1.0, roll_deg: 2.0 };
            let place = Frame::wgs84(origin, Projection::Topocentric).geodetic(&Point3::new(x, y, z));
            let radians = |d: f64| d.to_radians();
            let (e, n, u) = map_3d::geodetic2enu(
                radians(place.latitude_deg), radians(place.longitude_deg), place.altitude_m,
                radians(latitude_deg), radians(longitude_deg), 50.0, Ellipsoid::WGS84,
            );
            prop_assert!((Point3::new(e, n, u) - Point3::new(x, y, z)).norm() < 1e-5);
        }
    }
}
