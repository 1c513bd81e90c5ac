//! KITTI's raw recordings.

use std::path::Path;

use common::geometry::PoseParameters;
use common::kitti::{RawDrive, RawSurvey};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use super::Source;
use crate::drive::{Choice, Drive, Survey};
use crate::error::Result;

/// Opens the drive in `folder` (`DATE_drive_NNNN_sync`); its calibration lies
/// in `calibration`, or in the folder that holds `folder`.
///
/// # Errors
/// What the drive lacks, and as [`Drive::open`].
pub fn open_raw(folder: &Path, calibration: Option<&Path>, choice: Choice, max_range_m: f32) -> Result<Drive> {
    let drive = RawDrive::open(folder, calibration)?;
    let times_s = drive.times_s()?;
    let surveyed = drive.survey(times_s.len())?;
    let note = format!("origin of the map for `mapper export --origin`: {}", origin(&surveyed));
    let survey = Survey {
        path: folder.join("oxts/data"),
        map_from_camera: surveyed.map_from_camera,
        times_s,
        camera_from_velodyne: drive.camera_from_velodyne()?,
    };
    let scans = drive.scan_frames()?;
    let mut drive = Drive::new(Source::Raw(drive), &scans, survey, choice, max_range_m)?;
    drive.notes.push(note);
    Ok(drive)
}

/// Latitude, longitude, altitude, heading, pitch and roll of camera 0 at
/// frame 0, as `--origin` takes them.
fn origin(survey: &RawSurvey) -> String {
    let offset_m = survey.enu_from_map.translation.vector;
    let first = &survey.first;
    let radius_m = 6_378_137.0 * first.latitude_deg.to_radians().cos();
    // A metre of lever arm: the projection is linear over it.
    let latitude = first.latitude_deg + (offset_m.y / 6_378_137.0).to_degrees();
    let longitude = first.longitude_deg + (offset_m.x / radius_m).to_degrees();
    // East, down, north: the axes in which the paper's parameters are bearings.
    let names = Rotation3::from_matrix_unchecked(Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0));
    let mut level = survey.enu_from_map;
    level.rotation = UnitQuaternion::from_rotation_matrix(&names) * level.rotation;
    let p = PoseParameters::from_pose(&level);
    let degrees = |rad: f64| rad.to_degrees();
    format!(
        "{latitude:.8},{longitude:.8},{:.2},{:.3},{:.3},{:.3}",
        first.altitude_m + offset_m.z,
        degrees(p.yaw_rad).rem_euclid(360.0),
        degrees(p.pitch_rad),
        degrees(p.roll_rad)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::Frame;
    use common::geometry::Pose;
    use common::kitti::Packet;

    #[test]
    fn the_origin_that_is_printed_leads_back_to_east_and_north() {
        let rotation = UnitQuaternion::from_euler_angles(-1.5, 0.04, 0.7);
        let enu_from_map = Pose::from_parts(nalgebra::Translation3::new(0.0, 0.0, 0.0), rotation);
        let first = Packet {
            latitude_deg: 49.0,
            longitude_deg: 8.0,
            altitude_m: 100.0,
            roll_rad: 0.0,
            pitch_rad: 0.0,
            yaw_rad: 0.0,
        };
        let survey = RawSurvey { map_from_camera: vec![Pose::identity()], enu_from_map, first };
        let frame = Frame::wgs84(origin(&survey).parse().unwrap());
        let p = nalgebra::Point3::new(10.0, -2.0, 30.0);
        assert!((frame.metres(&p) - enu_from_map * p).norm() < 1e-3);
    }
}
