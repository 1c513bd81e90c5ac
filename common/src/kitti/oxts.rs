//! Packets of the navigation unit of KITTI's raw recordings, and the poses
//! that its development kit makes of them.

use std::path::Path;

use nalgebra::{Translation3, UnitQuaternion};

use super::mercator::Mercator;
use crate::geometry::Pose;
use crate::{Error, Result, text};

/// Numbers of a packet.
const NUMBERS: usize = 30;
/// Farthest place from the equator, degrees: towards the poles Mercator's
/// ordinate grows without end, and the usual maps stop here.
const MAX_LATITUDE_DEG: f64 = 85.0;
/// No road is as far above the sea or below it, metres.
const MAX_ALTITUDE_M: f64 = 10_000.0;

/// Where a navigation unit was, and how it lay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Packet {
    /// Degrees north.
    pub latitude_deg: f64,
    /// Degrees east.
    pub longitude_deg: f64,
    /// Metres.
    pub altitude_m: f64,
    /// 0 is level, positive is left side up, radians.
    pub roll_rad: f64,
    /// 0 is level, positive is front down, radians.
    pub pitch_rad: f64,
    /// 0 is east, positive is counter-clockwise, radians.
    pub yaw_rad: f64,
}

impl Packet {
    /// Reads `oxts/data/NNNNNNNNNN.txt`.
    ///
    /// # Errors
    /// [`Error::BadPacket`] where the file holds no line, another number of
    /// numbers than 30, or no place on the Earth, [`Error::BadNumber`] where
    /// one of them is none, [`Error::Io`] where it cannot be read.
    pub fn read(path: &Path) -> Result<Self> {
        let content = text::read(path)?;
        let bad = |what: String| Error::BadPacket { path: path.to_path_buf(), what };
        let (line, row) = text::rows(&content).next().ok_or_else(|| bad("it holds no packet".into()))?;
        let found = row.split_whitespace().count();
        if found != NUMBERS {
            return Err(bad(format!("it has {found} numbers and should have {NUMBERS}")));
        }
        let first: Vec<&str> = row.split_whitespace().take(6).collect();
        let [latitude_deg, longitude_deg, altitude_m, roll_rad, pitch_rad, yaw_rad] =
            text::numbers(path, line, &first.join(" "))?;
        if latitude_deg.abs() > MAX_LATITUDE_DEG || longitude_deg.abs() > 180.0 || altitude_m.abs() > MAX_ALTITUDE_M {
            return Err(bad(format!(
                "{latitude_deg} N {longitude_deg} E, {altitude_m} m high is no place that the projection can show"
            )));
        }
        Ok(Self { latitude_deg, longitude_deg, altitude_m, roll_rad, pitch_rad, yaw_rad })
    }
}

/// `enu_from_unit` of packets, metres east, north and up of the first in
/// [`Mercator`]'s projection around it, and `R = Rz(yaw) Ry(pitch) Rx(roll)`, as
/// in the development kit (`convertOxtsToPose.m`).
pub(super) fn mercator_poses(packets: &[Packet]) -> Vec<Pose> {
    let Some(first) = packets.first() else { return Vec::new() };
    let projection = Mercator::around(first.latitude_deg, first.longitude_deg);
    packets
        .iter()
        .map(|p| {
            let [east_m, north_m] = projection.metres(p.latitude_deg, p.longitude_deg);
            Pose::from_parts(
                Translation3::new(east_m, north_m, p.altitude_m - first.altitude_m),
                UnitQuaternion::from_euler_angles(p.roll_rad, p.pitch_rad, p.yaw_rad),
            )
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(latitude_deg: f64, longitude_deg: f64, yaw_rad: f64) -> Packet {
        Packet { latitude_deg, longitude_deg, altitude_m: 100.0, roll_rad: 0.0, pitch_rad: 0.0, yaw_rad }
    }

    #[test]
    fn a_second_of_arc_north_is_31_m_and_a_yaw_of_0_looks_east() {
        let poses = mercator_poses(&[packet(49.0, 8.0, 0.0), packet(49.0 + 1.0 / 3600.0, 8.0, 0.1)]);
        assert!((poses[1].translation.y - 30.92).abs() < 0.01 && poses[1].translation.x.abs() < 1e-9);
        let ahead = poses[1].rotation * nalgebra::Vector3::x();
        assert!((ahead - nalgebra::Vector3::new(0.1_f64.cos(), 0.1_f64.sin(), 0.0)).norm() < 1e-12);
        assert!(mercator_poses(&[]).is_empty());
    }

    #[test]
    fn a_packet_that_is_none_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("0000000003.txt");
        let said = |content: &str| {
            std::fs::write(&path, content).unwrap();
            Packet::read(&path).unwrap_err().to_string()
        };
        assert!(said("").contains("0000000003.txt: it holds no packet"));
        assert!(said("49 8 100").contains("it has 3 numbers and should have 30"));
        assert!(said(&format!("49 8 nan{}", " 0".repeat(27))).contains("`nan` is not a finite number"));
        assert!(said(&format!("91 8 1{}", " 0".repeat(27))).contains("91 N 8 E, 1 m high is no place"));
        assert!(said(&format!("49 8 1e18{}", " 0".repeat(27))).contains("is no place"));
    }
}
