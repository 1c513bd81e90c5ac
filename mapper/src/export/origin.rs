//! Where on the Earth a map is, as its user says it.

use std::fmt;
use std::str::FromStr;

use common::geometry::PoseParameters;
use nalgebra::UnitQuaternion;
use serde::{Deserialize, Serialize};

use crate::error::Error;

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

#[cfg(test)]
mod tests {
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
}
