//! KITTI's raw recordings.

use std::path::Path;

use common::earth::{OnEarth, Origin, Projection};
use common::geometry::PoseParameters;
use common::kitti::{RawDrive, RawSurvey};
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion};

use super::{MapFrame, Source};
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
    // The poses are those of the development kit.
    let origin_text = origin(&surveyed);
    let note = format!(
        "where the map is on the Earth, for `export`, `run` and `live`: --origin={origin_text} --projection mercator"
    );
    // As it is said, to the digit.
    let frame = MapFrame::of_first_camera(origin_text.parse().ok());
    let survey = Survey {
        path: folder.join("oxts/data"),
        map_from_camera: surveyed.map_from_camera,
        times_s,
        camera_from_velodyne: drive.camera_from_velodyne()?,
        camera_is_thought: false,
    };
    let scans = drive.scan_frames()?;
    let mut drive = Drive::new(Source::Raw(drive), &scans, survey, choice, max_range_m)?;
    drive.notes.push(note);
    drive.frame = frame;
    Ok(drive)
}

/// Latitude, longitude, altitude, heading, pitch and roll of camera 0 at
/// frame 0, as `--origin` takes them.
fn origin(survey: &RawSurvey) -> String {
    let first = &survey.first;
    let unit = Origin {
        latitude_deg: first.latitude_deg,
        longitude_deg: first.longitude_deg,
        altitude_m: first.altitude_m,
        heading_deg: 0.0,
        pitch_deg: 0.0,
        roll_deg: 0.0,
    };
    let around_unit = OnEarth::new(unit, Projection::Mercator);
    let offset_m = survey.enu_from_map.translation.vector;
    let at = around_unit.place(&Point3::new(offset_m.x, -offset_m.z, offset_m.y));
    // East, down, north: the axes in which the paper's parameters are bearings.
    let names = Rotation3::from_matrix_unchecked(Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0));
    let mut level = survey.enu_from_map;
    level.rotation = UnitQuaternion::from_rotation_matrix(&names) * level.rotation;
    let p = PoseParameters::from_pose(&level);
    let degrees = |rad: f64| rad.to_degrees();
    format!(
        "{:.8},{:.8},{:.2},{:.3},{:.3},{:.3}",
        at.latitude_deg,
        at.longitude_deg,
        at.altitude_m,
        degrees(p.yaw_rad).rem_euclid(360.0),
        degrees(p.pitch_rad),
        degrees(p.roll_rad)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::geometry::Pose;
    use common::kitti::{Mercator, Packet};

    #[test]
    fn the_origin_that_is_printed_leads_back_to_where_the_unit_was() {
        let rotation = UnitQuaternion::from_euler_angles(-1.5, 0.04, 0.7);
        let enu_from_map = Pose::from_parts(nalgebra::Translation3::new(0.9, -0.4, 0.6), rotation);
        let first = Packet {
            latitude_deg: 49.0,
            longitude_deg: 8.0,
            altitude_m: 100.0,
            roll_rad: 0.0,
            pitch_rad: 0.0,
            yaw_rad: 0.0,
        };
        let survey = RawSurvey { map_from_camera: vec![Pose::identity()], enu_from_map, first };
        let frame = OnEarth::new(origin(&survey).parse().unwrap(), Projection::Mercator);
        // A place 2.6 km away, and the unit at the first frame.
        for (latitude_deg, longitude_deg, tolerance_m) in [(49.018, 8.023, 0.1), (49.0, 8.0, 0.01)] {
            let [east_m, north_m] = Mercator::around(49.0, 8.0).metres(latitude_deg, longitude_deg);
            let place = frame.place(&(enu_from_map.inverse() * Point3::new(east_m, north_m, 5.0)));
            let off_deg = (place.longitude_deg - longitude_deg).hypot(place.latitude_deg - latitude_deg);
            let (off_m, up_m) = (off_deg * 111_000.0, place.altitude_m - 105.0);
            assert!(off_m < tolerance_m && up_m.abs() < tolerance_m, "{off_m} {up_m}");
        }
    }
}
