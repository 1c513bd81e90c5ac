//! Where a map is on the Earth: its metres as latitude, longitude and altitude, and back.

mod grid;

use std::fmt;
use std::str::FromStr;

use map_3d::{Ellipsoid, enu2geodetic, geodetic2enu};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

pub use self::grid::Grid;
use crate::Error;
use crate::geometry::PoseParameters;
use crate::kitti::Mercator;

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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Projection {
    /// Metres east, north and up of a plane that touches the Earth at the map's
    /// origin.
    #[default]
    Topocentric,
    /// Those of KITTI's development kit: Mercator's projection of a sphere, true
    /// at the map's origin, with altitudes for heights.
    Mercator,
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

impl Geodetic {
    /// The place that is so many metres east, north and up of this one, in the plane that
    /// touches the Earth here.
    #[must_use]
    pub fn offset(&self, enu_m: &Point3<f64>) -> Self {
        let [latitude_rad, longitude_rad] = self.radians();
        let (latitude_rad, longitude_rad, altitude_m) =
            enu2geodetic(enu_m.x, enu_m.y, enu_m.z, latitude_rad, longitude_rad, self.altitude_m, Ellipsoid::WGS84);
        Self { latitude_deg: latitude_rad.to_degrees(), longitude_deg: longitude_rad.to_degrees(), altitude_m }
    }

    /// Metres east, north and up of this place, of another one: the inverse of
    /// [`Self::offset`].
    pub fn enu_m(&self, of: &Self) -> Point3<f64> {
        let ([lat, lon], [lat0, lon0]) = (of.radians(), self.radians());
        let (east_m, north_m, up_m) =
            geodetic2enu(lat, lon, of.altitude_m, lat0, lon0, self.altitude_m, Ellipsoid::WGS84);
        Point3::new(east_m, north_m, up_m)
    }

    fn radians(&self) -> [f64; 2] {
        [self.latitude_deg.to_radians(), self.longitude_deg.to_radians()]
    }
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

/// A map's frame on the Earth.
#[derive(Debug, Clone)]
pub struct OnEarth(Metres);

/// What the metres of a map are.
#[derive(Debug, Clone)]
enum Metres {
    /// Those around an origin.
    Origin { origin: Origin, projection: Projection, turn: UnitQuaternion<f64> },
    /// Those of a survey in a grid.
    Grid { grid: Box<Grid>, world: World, reduced_by_m: [f64; 3] },
}

impl OnEarth {
    /// The frame of a map whose origin is there.
    pub fn new(origin: Origin, projection: Projection) -> Self {
        Self(Metres::Origin { origin, projection, turn: origin.turn() })
    }

    /// The frame of a map whose survey is in a grid, and was reduced by so much along its own
    /// axes.
    ///
    /// # Errors
    /// [`Error::OffGrid`] where the grid does not reach the map.
    pub fn in_grid(grid: Grid, world: World, reduced_by_m: [f64; 3]) -> Result<Self, Error> {
        let at = world.survey_from_map(reduced_by_m, &Point3::origin());
        if grid.degrees([at.x, at.y]).iter().all(|degrees| degrees.is_finite()) {
            return Ok(Self(Metres::Grid { grid: Box::new(grid), world, reduced_by_m }));
        }
        Err(Error::OffGrid { grid: grid.to_string(), east_m: at.x, north_m: at.y })
    }

    /// Where the map's origin is.
    pub fn origin(&self) -> Geodetic {
        match &self.0 {
            Metres::Origin { origin: Origin { latitude_deg, longitude_deg, altitude_m, .. }, .. } => {
                Geodetic { latitude_deg: *latitude_deg, longitude_deg: *longitude_deg, altitude_m: *altitude_m }
            }
            Metres::Grid { .. } => self.place(&Point3::origin()),
        }
    }

    /// Metres east, north and up of the map's origin, in the plane that touches the Earth
    /// there, of a point of the map.
    pub fn enu_m(&self, map: &Point3<f64>) -> Point3<f64> {
        match &self.0 {
            Metres::Origin { projection: Projection::Topocentric, turn, .. } => projected_m(turn, map),
            _ => self.origin().enu_m(&self.place(map)),
        }
    }

    /// The place on the Earth of a point of the map. In a grid its altitude is the height that
    /// the survey says.
    pub fn place(&self, map: &Point3<f64>) -> Geodetic {
        match &self.0 {
            Metres::Origin { projection: Projection::Topocentric, turn, .. } => {
                self.origin().offset(&projected_m(turn, map))
            }
            Metres::Origin { origin, projection: Projection::Mercator, turn } => {
                let at = projected_m(turn, map);
                let [latitude_deg, longitude_deg] = mercator(origin).degrees(at.x, at.y);
                Geodetic { latitude_deg, longitude_deg, altitude_m: origin.altitude_m + at.z }
            }
            Metres::Grid { grid, world, reduced_by_m } => {
                let survey = world.survey_from_map(*reduced_by_m, map);
                let [latitude_deg, longitude_deg] = grid.degrees([survey.x, survey.y]);
                Geodetic { latitude_deg, longitude_deg, altitude_m: survey.z }
            }
        }
    }

    /// The point of the map at a place on the Earth: the inverse of [`Self::place`]. NaN where
    /// a grid does not reach.
    pub fn map_from_place(&self, place: &Geodetic) -> Point3<f64> {
        let (turn, at) = match &self.0 {
            Metres::Origin { projection: Projection::Topocentric, turn, .. } => (turn, self.origin().enu_m(place)),
            Metres::Origin { origin, projection: Projection::Mercator, turn } => {
                let [east_m, north_m] = mercator(origin).metres(place.latitude_deg, place.longitude_deg);
                (turn, Point3::new(east_m, north_m, place.altitude_m - origin.altitude_m))
            }
            Metres::Grid { grid, world, reduced_by_m } => {
                let [east_m, north_m] = grid.metres([place.latitude_deg, place.longitude_deg]);
                return world.map_from_survey(*reduced_by_m, &Point3::new(east_m, north_m, place.altitude_m));
            }
        };
        turn.inverse() * Point3::new(at.x, -at.z, at.y)
    }

    /// The bearing of a direction of the map at a point of it, radians clockwise from north,
    /// 0 to 2 pi.
    pub fn bearing_rad(&self, map: &Point3<f64>, direction_map: &Vector3<f64>) -> f64 {
        let [here, ahead] = [*map, map + direction_map].map(|point| self.place(&point));
        let way_m = here.enu_m(&ahead);
        way_m.x.atan2(way_m.y).rem_euclid(std::f64::consts::TAU)
    }

    /// The level direction of the map, at a place, of a bearing, radians clockwise from north:
    /// the inverse of [`Self::bearing_rad`].
    pub fn direction_map(&self, place: &Geodetic, bearing_rad: f64) -> Vector3<f64> {
        let (east, north) = bearing_rad.sin_cos();
        let ahead = place.offset(&Point3::new(east, north, 0.0));
        (self.map_from_place(&ahead) - self.map_from_place(place)).normalize()
    }

    /// The frame in words, for people.
    pub fn note(&self) -> String {
        match &self.0 {
            Metres::Origin { origin: o, projection, .. } => {
                let metres = match projection {
                    Projection::Topocentric => "",
                    Projection::Mercator => ", and its metres are those of KITTI's development kit",
                };
                format!(
                    "WGS 84; the map's origin is at {} N {} E, {} m, heading {} degrees clockwise from north, pitch {}, roll {}{metres}",
                    o.latitude_deg, o.longitude_deg, o.altitude_m, o.heading_deg, o.pitch_deg, o.roll_deg
                )
            }
            Metres::Grid { grid, .. } => format!("WGS 84, of the survey's coordinates in {grid}, with its heights"),
        }
    }
}

/// Three coordinates, metres, with commas between them, as a command line has them.
///
/// # Errors
/// What to give instead of what is none.
pub fn coordinates_m(text: &str) -> Result<Vector3<f64>, String> {
    let number = |word: &str| word.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    let numbers: Option<Vec<f64>> = text.split(',').map(number).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) => Ok(Vector3::new(x, y, z)),
        _ => Err("give three finite numbers, in metres".into()),
    }
}

/// Metres east, north and up of a map's origin in its projection.
fn projected_m(turn: &UnitQuaternion<f64>, map: &Point3<f64>) -> Point3<f64> {
    let turned = turn * map;
    Point3::new(turned.x, turned.z, -turned.y)
}

fn mercator(origin: &Origin) -> Mercator {
    Mercator::around(origin.latitude_deg, origin.longitude_deg)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn on_earth(text: &str, projection: Projection) -> OnEarth {
        OnEarth::new(text.parse().unwrap(), projection)
    }

    #[test]
    fn a_bearing_turns_forward_to_the_right_of_north() {
        let frame = |text: &str| on_earth(text, Projection::Topocentric);
        let ahead = Point3::new(0.0, 0.0, 10.0);
        let near = |a: Point3<f64>, b: [f64; 3]| (a - Point3::from(b)).norm() < 1e-9;
        assert!(near(frame("49,8,100").enu_m(&ahead), [0.0, 10.0, 0.0]));
        assert!(near(frame("49,8,100,90").enu_m(&ahead), [10.0, 0.0, 0.0]));
        assert!(near(frame("49,8,100,90,90,0").enu_m(&ahead), [0.0, 0.0, 10.0]));
        // Tilted to the right: what was right goes down.
        assert!(near(frame("49,8,100,0,0,90").enu_m(&Point3::new(1.0, 0.0, 0.0)), [0.0, 0.0, -1.0]));
    }

    #[test]
    fn a_place_is_that_of_proj() {
        // PROJ: +inv +proj=topocentric +lat_0=49 +lon_0=8 +h_0=100, +inv +proj=cart.
        let frame = on_earth("49,8,100", Projection::Topocentric);
        let place = frame.place(&Point3::new(1000.0, -30.0, 2000.0));
        assert!((place.latitude_deg - 49.017_982_831_111).abs() < 1e-11, "{place:?}");
        assert!((place.longitude_deg - 8.013_671_112_069).abs() < 1e-11, "{place:?}");
        assert!((place.altitude_m - 130.392_115_431).abs() < 1e-6, "{place:?}");
    }

    #[test]
    fn metres_of_the_development_kit_are_its_degrees_and_no_plane() {
        // Some 2.6 km away, as `latlonToMercator.m` has it.
        let (latitude_deg, longitude_deg) = (49.018_f64, 8.023_f64);
        let radius_m = 6_378_137.0 * 49_f64.to_radians().cos();
        let ordinate = |degrees: f64| (degrees.to_radians() / 2.0 + std::f64::consts::FRAC_PI_4).tan().ln();
        let east_m = radius_m * (longitude_deg - 8.0).to_radians();
        let north_m = radius_m * (ordinate(latitude_deg) - ordinate(49.0));
        let map = Point3::new(east_m, -5.0, north_m);
        assert!((2500.0..2700.0).contains(&map.coords.norm()));
        let frame = on_earth("49,8,100", Projection::Mercator);
        let place = frame.place(&map);
        assert!(
            (place.latitude_deg - latitude_deg).abs() < 1e-10 && (place.longitude_deg - longitude_deg).abs() < 1e-10
        );
        assert!((place.altitude_m - 105.0).abs() < 1e-9, "{place:?}");
        // Taken for a plane it is off by metres, and the Earth falls away.
        let off_m = frame.enu_m(&map) - on_earth("49,8,100", Projection::Topocentric).enu_m(&map);
        assert!((off_m - Vector3::new(2.633, -2.047, -0.536)).norm() < 1e-3, "{off_m}");
    }

    #[test]
    fn a_map_in_a_grid_looks_where_its_survey_does() {
        // UTM, 3 degrees east of its meridian: grid north is 2.3 degrees off.
        let frame = OnEarth::in_grid("EPSG:25832".parse().unwrap(), World::ZUp, [720_000.0, 5_430_000.0, 0.0]).unwrap();
        let [east, left] = [Vector3::z(), -Vector3::x()].map(|way| frame.bearing_rad(&Point3::origin(), &way));
        let convergence_rad = 3.0_f64.to_radians().tan() * frame.origin().latitude_deg.to_radians().sin();
        let turned_rad = [east - std::f64::consts::FRAC_PI_2, left];
        assert!(turned_rad.iter().all(|rad| (rad - convergence_rad).abs() < 1e-3), "{turned_rad:?}");
        assert!(frame.note().contains("EPSG:25832"), "{}", frame.note());
        let off = OnEarth::in_grid("EPSG:25832".parse().unwrap(), World::ZUp, [1e12, 0.0, 0.0]);
        assert!(off.unwrap_err().to_string().contains("EPSG:25832"));
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
        fn what_was_brought_to_the_earth_comes_back(
            (latitude_deg, longitude_deg) in (-80.0..80.0_f64, -179.0..179.0_f64),
            (x, y, z) in (-2e4..2e4_f64, -500.0..500.0_f64, -2e4..2e4_f64),
            yaw_rad in 0.0..std::f64::consts::TAU,
        ) {
            let origin =
                Origin { latitude_deg, longitude_deg, altitude_m: 50.0, heading_deg: 30.0, pitch_deg: 1.0, roll_deg: 2.0 };
            let map = Point3::new(x, y, z);
            for projection in [Projection::Topocentric, Projection::Mercator] {
                let frame = OnEarth::new(origin, projection);
                let place = frame.place(&map);
                let off_m = (frame.map_from_place(&place) - map).norm();
                prop_assert!(off_m < 1e-5, "{off_m}");
                let enu_m = frame.origin().enu_m(&place) - frame.enu_m(&map);
                prop_assert!(enu_m.norm() < 1e-5, "{enu_m}");
                let direction = frame.direction_map(&place, yaw_rad);
                let back_rad = frame.bearing_rad(&map, &direction);
                let off_rad = (back_rad - yaw_rad).sin();
                prop_assert!(off_rad.abs() < 1e-5, "{off_rad}");
            }
        }

        #[test]
        fn what_a_survey_has_in_a_grid_comes_back(
            (x, y, z) in (-2e4..2e4_f64, -500.0..500.0_f64, -2e4..2e4_f64),
            bearing_rad in 0.0..std::f64::consts::TAU,
        ) {
            for world in [World::CameraAxes, World::ZUp] {
                // Of an axis that the other world has for its height nothing is taken off.
                let reduced_by_m =
                    if world == World::ZUp { [450_000.0, 5_420_000.0, 100.0] } else { [450_000.0, 0.0, 5_420_000.0] };
                let frame = OnEarth::in_grid("EPSG:25832".parse().unwrap(), world, reduced_by_m).unwrap();
                let map = Point3::new(x, y, z);
                let place = frame.place(&map);
                prop_assert!((48.0..50.0).contains(&place.latitude_deg), "{place:?}");
                prop_assert!((frame.map_from_place(&place) - map).norm() < 1e-5);
                let direction = frame.direction_map(&place, bearing_rad);
                prop_assert!((frame.bearing_rad(&map, &direction) - bearing_rad).sin().abs() < 1e-5);
                let survey = world.survey_from_map(reduced_by_m, &map);
                prop_assert!((world.map_from_survey(reduced_by_m, &survey) - map).norm() < 1e-6);
            }
        }

        #[test]
        fn an_origin_is_read_as_it_is_written(
            (latitude_deg, longitude_deg) in (-80.0..80.0_f64, -179.0..179.0_f64),
            (heading_deg, altitude_m) in (0.0..360.0_f64, -100.0..5e3_f64),
        ) {
            let origin = Origin { latitude_deg, longitude_deg, altitude_m, heading_deg, pitch_deg: 1.5, roll_deg: -0.25 };
            prop_assert_eq!(origin.to_string().parse::<Origin>().unwrap(), origin);
        }
    }
}
