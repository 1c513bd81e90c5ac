//! The frame of exported coordinates: local metres, or the Earth.

use std::fmt;
use std::str::FromStr;

use common::geometry::PoseParameters;
use common::kitti::Mercator;
use map_3d::Ellipsoid;
use nalgebra::{Point3, UnitQuaternion};
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::input::MapFrame;

/// Where on the Earth the origin of a map is, and how its axes lie.
///
/// Written as `LAT,LON,ALT[,HEADING[,PITCH,ROLL]]`, degrees and metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Latitude of the map's origin, WGS 84, degrees north.
    pub latitude_deg: f64,
    /// Longitude, degrees east.
    pub longitude_deg: f64,
    /// Height above the ellipsoid, metres: above sea level, if that is what
    /// all other heights are, too.
    pub altitude_m: f64,
    /// Compass bearing of the map's z axis (forward), degrees clockwise from
    /// north.
    pub heading_deg: f64,
    /// How far the z axis points up, degrees.
    pub pitch_deg: f64,
    /// How far the map is tilted to the right about its z axis, degrees.
    pub roll_deg: f64,
}

impl FromStr for Origin {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let wrong = |what: String| Error::BadOrigin { text: text.to_owned(), what };
        let mut values = [0.0; 6];
        let mut count = 0;
        for word in text.split(',') {
            let value = word.trim().parse::<f64>().ok().filter(|v| v.is_finite());
            let value = value.ok_or_else(|| wrong(format!("`{word}` is not a finite number")))?;
            if let Some(slot) = values.get_mut(count) {
                *slot = value;
            }
            count += 1;
        }
        if ![3, 4, 6].contains(&count) {
            return Err(wrong(format!("it has {count} numbers")));
        }
        let [latitude_deg, longitude_deg, altitude_m, heading_deg, pitch_deg, roll_deg] = values;
        // At the poles there is no east.
        if latitude_deg.abs() > 89.9 || longitude_deg.abs() > 180.0 {
            return Err(wrong("the latitude must be within 89.9 and the longitude within 180 degrees".into()));
        }
        Ok(Self { latitude_deg, longitude_deg, altitude_m, heading_deg, pitch_deg, roll_deg })
    }
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { latitude_deg, longitude_deg, altitude_m, heading_deg, pitch_deg, roll_deg } = self;
        write!(f, "{latitude_deg},{longitude_deg},{altitude_m},{heading_deg},{pitch_deg},{roll_deg}")
    }
}

impl Origin {
    /// `enu_from_map` without its axes' names: east, down, north.
    fn turn(&self) -> UnitQuaternion<f64> {
        let parameters = PoseParameters {
            x_m: 0.0,
            y_m: 0.0,
            z_m: 0.0,
            // About the axis down: to the right, as a bearing.
            yaw_rad: self.heading_deg.to_radians(),
            pitch_rad: self.pitch_deg.to_radians(),
            roll_rad: self.roll_deg.to_radians(),
        };
        parameters.to_pose().rotation
    }
}

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

/// The frame of exported coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Frame {
    placed: Option<Placed>,
    /// What the report of the map's build says of its frame.
    known: Option<MapFrame>,
}

/// A map's frame on the Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Placed {
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
    /// Local metres: x right, y forward, z up of the map's origin.
    pub fn local() -> Self {
        Self::default()
    }

    /// The same of a map of whose frame its build has said what is known.
    pub fn local_of(known: Option<MapFrame>) -> Self {
        Self { placed: None, known }
    }

    /// WGS 84, of a map whose origin is there.
    pub fn wgs84(origin: Origin, projection: Projection) -> Self {
        Self { placed: Some(Placed { origin, turn: origin.turn(), projection }), known: None }
    }

    /// The place of the map's origin, if it is known.
    pub fn origin(&self) -> Option<&Origin> {
        self.placed.as_ref().map(|placed| &placed.origin)
    }

    /// A point of the map in metres: x east, y north, z up of its origin,
    /// where that is known, else x right, y forward, z up.
    pub fn metres(&self, map: &Point3<f64>) -> Point3<f64> {
        let Some(Placed { origin, turn, projection }) = &self.placed else { return Point3::new(map.x, map.z, -map.y) };
        let turned = turn * map;
        let projected_m = Point3::new(turned.x, turned.z, -turned.y);
        match projection {
            Projection::Topocentric => projected_m,
            Projection::Mercator => topocentric(origin, &projected_m),
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

    /// A point of the map as three rounded numbers, in the order of RFC 7946:
    /// longitude, latitude, altitude where the origin is known, else metres.
    pub fn position(&self, map: &Point3<f64>) -> [f64; 3] {
        let metres = self.metres(map);
        if self.placed.is_none() {
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
        match &self.placed {
            None => {
                let of = self.known.map_or_else(|| "of the map's own frame".into(), |known| known.note());
                format!("local metres: x right, y forward, z up {of}")
            }
            Some(Placed { origin: o, projection, .. }) => {
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
        assert!(near(Frame::local().metres(&Point3::new(1.0, 2.0, 3.0)), [1.0, 3.0, -2.0]));
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
        assert_eq!(Frame::local().note(), "local metres: x right, y forward, z up of the map's own frame");
        let kitti = Frame::local_of(Some(MapFrame::of_first_camera(None)));
        assert!(kitti.note().ends_with("z up of camera 0 at the first frame of the survey"), "{}", kitti.note());
    }

    #[test]
    fn an_origin_that_is_none_is_told() {
        for (text, part) in [
            ("49,8", "it has 2 numbers"),
            ("49,8,1,2,3", "it has 5 numbers"),
            ("49,x,1", "`x` is not a finite number"),
            ("49,nan,1", "`nan` is not"),
            ("95,8,1", "latitude must be within"),
        ] {
            let said = text.parse::<Origin>().unwrap_err().to_string();
            assert!(said.contains(part) && said.contains("LAT,LON,ALT"), "{said}");
        }
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
