//! Places on the Earth.

use map_3d::{Ellipsoid, enu2geodetic, geodetic2enu};
use nalgebra::Point3;

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
