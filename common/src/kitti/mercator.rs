//! The projection of KITTI's development kit.

use std::f64::consts::FRAC_PI_4;

/// Radius of the development kit's sphere, metres: the Earth's at the equator.
const EARTH_RADIUS_M: f64 = 6_378_137.0;

/// Mercator's projection of a sphere, true at the latitude of its origin, as in
/// the development kit (`latToScale.m`, `latlonToMercator.m`), which leaves the
/// origin at 0 N 0 E. All poses of KITTI are in it, those of odometry, too.
///
/// It is no map of the ellipsoid: at 49 degrees it is 0.2 % short in the east
/// and 0.1 % long in the north, and its heights are altitudes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mercator {
    latitude_deg: f64,
    longitude_deg: f64,
    radius_m: f64,
}

impl Mercator {
    /// The projection around a place, degrees north and east.
    pub fn around(latitude_deg: f64, longitude_deg: f64) -> Self {
        Self { latitude_deg, longitude_deg, radius_m: EARTH_RADIUS_M * latitude_deg.to_radians().cos() }
    }

    /// Metres east and north of the origin, of a place in degrees north and
    /// east.
    pub fn metres(&self, latitude_deg: f64, longitude_deg: f64) -> [f64; 2] {
        let east_m = self.radius_m * (longitude_deg - self.longitude_deg).to_radians();
        [east_m, self.radius_m * (ordinate(latitude_deg) - ordinate(self.latitude_deg))]
    }

    /// Degrees north and east, of metres east and north: the inverse of
    /// [`Self::metres`].
    pub fn degrees(&self, east_m: f64, north_m: f64) -> [f64; 2] {
        let ordinate = ordinate(self.latitude_deg) + north_m / self.radius_m;
        let latitude_rad = 2.0 * (ordinate.exp().atan() - FRAC_PI_4);
        [latitude_rad.to_degrees(), self.longitude_deg + (east_m / self.radius_m).to_degrees()]
    }
}

/// Mercator's ordinate of a latitude.
fn ordinate(latitude_deg: f64) -> f64 {
    (FRAC_PI_4 + latitude_deg.to_radians() / 2.0).tan().ln()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn metres_survive_degrees(
            (latitude_deg, longitude_deg) in (-80.0..80.0_f64, -179.0..179.0_f64),
            (east_m, north_m) in (-2e4..2e4_f64, -2e4..2e4_f64),
        ) {
            let projection = Mercator::around(latitude_deg, longitude_deg);
            let [latitude_deg, longitude_deg] = projection.degrees(east_m, north_m);
            let [east, north] = projection.metres(latitude_deg, longitude_deg);
            prop_assert!((east - east_m).hypot(north - north_m) < 1e-6, "{east} {north}");
        }
    }
}
