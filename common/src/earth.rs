//! Where a map is on the Earth: its metres as latitude, longitude and altitude, and back.

mod error;
mod geodetic;
mod grid;
mod origin;
mod world;

use nalgebra::{Point3, UnitQuaternion, Vector3};

pub use self::error::PlaceError;
pub use self::geodetic::Geodetic;
pub use self::grid::Grid;
pub use self::origin::{Origin, Projection};
pub use self::world::World;
use crate::Error;
use crate::kitti::Mercator;

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
    /// [`PlaceError::OffGrid`] where the grid does not reach the map.
    pub fn in_grid(grid: Grid, world: World, reduced_by_m: [f64; 3]) -> Result<Self, Error> {
        let at = world.survey_from_map(reduced_by_m, &Point3::origin());
        if grid.degrees([at.x, at.y]).iter().all(|degrees| degrees.is_finite()) {
            return Ok(Self(Metres::Grid { grid: Box::new(grid), world, reduced_by_m }));
        }
        Err(PlaceError::OffGrid { grid: grid.to_string(), east_m: at.x, north_m: at.y }.into())
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
    }
}
