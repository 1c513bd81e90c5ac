//! Grids of projected coordinates, in which countries are surveyed.

use std::fmt;
use std::str::FromStr;

use proj4rs::Proj;
use proj4rs::transform::transform;

use super::PlaceError;
use crate::Error;

/// Degrees of WGS 84, to which grids lead.
const WGS84: &str = "+proj=longlat +datum=WGS84 +no_defs";

/// A grid of metres east and north: `EPSG:25832`, or a string of PROJ.
#[derive(Clone)]
pub struct Grid {
    name: String,
    metres: Proj,
    degrees: Proj,
}

impl fmt::Debug for Grid {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_tuple("Grid").field(&self.name).finish()
    }
}

impl fmt::Display for Grid {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.name)
    }
}

impl FromStr for Grid {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let wrong = |what: String| Error::from(PlaceError::Grid { text: text.to_owned(), what });
        let failed = |error: proj4rs::errors::Error| wrong(error.to_string());
        let grid = Proj::from_user_string(&spelled(text)).map_err(failed)?;
        if grid.is_latlong() || grid.is_geocent() {
            return Err(wrong("it is no grid of metres".into()));
        }
        if (grid.to_meter() - 1.0).abs() > f64::EPSILON {
            return Err(wrong(format!("its unit is {}, and a survey is in metres", grid.units())));
        }
        if !grid.is_normalized_axis() || !grid.has_inverse() || !grid.has_forward() {
            return Err(wrong("it does not lead from east and north to degrees and back".into()));
        }
        let degrees = Proj::from_proj_string(WGS84).map_err(failed)?;
        Ok(Self { name: text.trim().to_owned(), metres: grid, degrees })
    }
}

/// A code of EPSG as PROJ spells it.
fn spelled(text: &str) -> String {
    let text = text.trim();
    let code =
        text.split_once(':').filter(|(name, _)| name.eq_ignore_ascii_case("EPSG")).map_or(text, |(_, code)| code);
    if code.starts_with(|c: char| c.is_ascii_digit()) { format!("EPSG:{code}") } else { text.to_owned() }
}

impl Grid {
    /// Degrees north and east (WGS 84), of metres east and north; NaN where the grid does not
    /// reach.
    pub fn degrees(&self, [east_m, north_m]: [f64; 2]) -> [f64; 2] {
        let [longitude_rad, latitude_rad] = brought([east_m, north_m], &self.metres, &self.degrees);
        [latitude_rad.to_degrees(), longitude_rad.to_degrees()]
    }

    /// Metres east and north, of degrees north and east: the inverse of [`Self::degrees`].
    pub fn metres(&self, [latitude_deg, longitude_deg]: [f64; 2]) -> [f64; 2] {
        brought([longitude_deg.to_radians(), latitude_deg.to_radians()], &self.degrees, &self.metres)
    }
}

/// Two coordinates from one system in the other.
fn brought([x, y]: [f64; 2], from: &Proj, to: &Proj) -> [f64; 2] {
    // Heights are left alone: what a survey says of them is above a geoid that no grid knows.
    let mut point = (x, y, 0.0);
    match transform(from, to, &mut point) {
        Ok(()) => [point.0, point.1],
        Err(_) => [f64::NAN; 2],
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn places_are_where_proj_has_them() {
        // 49 N 8.4 E by Krueger's series (UTM), and by Snyder's formulas for Lambert's conic (France).
        for (name, east_m, north_m) in [
            ("EPSG:25832", 456_114.596, 5_427_629.204),
            ("2154", 1_094_819.769, 6_891_292.218),
            ("+proj=utm +zone=32", 456_114.596, 5_427_629.204),
        ] {
            let [east, north] = name.parse::<Grid>().unwrap().metres([49.0, 8.4]);
            assert!((east - east_m).abs() < 0.002 && (north - north_m).abs() < 0.002, "{name}: {east} {north}");
        }
    }

    #[test]
    fn what_is_no_grid_of_metres_is_told() {
        for (text, part) in [
            ("EPSG:4326", "no grid of metres"),
            ("EPSG:2263", "its unit is us-ft"),
            ("EPSG:99999", "--crs EPSG:99999: "),
            ("+proj=nonsense", "--crs +proj=nonsense: "),
            ("UTM32", "an EPSG code"),
            ("", "an EPSG code"),
            ("+", "an EPSG code"),
            ("+proj=utm +zone=99", "--crs"),
            ("+proj=utm +zone", "--crs"),
            ("EPSG:", "--crs"),
            ("+proj=tmerc +lat_0=\u{e4} +k=0", "--crs"),
        ] {
            let said = text.parse::<Grid>().unwrap_err().to_string();
            assert!(said.contains(part), "{text}: {said}");
        }
    }

    proptest! {
        #[test]
        fn metres_survive_degrees(east_m in 2e5..8e5_f64, north_m in 3e6..7e6_f64) {
            // UTM, and a grid on another ellipsoid and datum.
            for name in ["EPSG:25832", "+proj=tmerc +lat_0=0 +lon_0=9 +k=1 +x_0=500000 +ellps=bessel +towgs84=598.1,73.7,418.2"] {
                let grid: Grid = name.parse().unwrap();
                let [east, north] = grid.metres(grid.degrees([east_m, north_m]));
                prop_assert!((east - east_m).hypot(north - north_m) < 2e-3, "{east} {north}");
            }
        }
    }
}
