//! Where the origin of a map is, as its user says it.

use std::fmt;
use std::str::FromStr;

use nalgebra::UnitQuaternion;
use serde::{Deserialize, Serialize};

use super::PlaceError;
use crate::Error;
use crate::geometry::PoseParameters;
use crate::text::comma_separated;

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
        let wrong = |what: String| Error::from(PlaceError::Origin { text: text.to_owned(), what });
        let numbers = comma_separated(text).map_err(|word| wrong(format!("`{word}` is not a finite number")))?;
        let count = numbers.len();
        let mut values = [0.0; 6];
        values.iter_mut().zip(&numbers).for_each(|(slot, value)| *slot = *value);
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
    pub(super) fn turn(&self) -> UnitQuaternion<f64> {
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

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
        fn an_origin_is_read_as_it_is_written(
            (latitude_deg, longitude_deg) in (-80.0..80.0_f64, -179.0..179.0_f64),
            (heading_deg, altitude_m) in (0.0..360.0_f64, -100.0..5e3_f64),
        ) {
            let origin = Origin { latitude_deg, longitude_deg, altitude_m, heading_deg, pitch_deg: 1.5, roll_deg: -0.25 };
            prop_assert_eq!(origin.to_string().parse::<Origin>().unwrap(), origin);
        }
    }
}
