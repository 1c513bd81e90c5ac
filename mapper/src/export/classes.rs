//! The class of a point of the stitched cloud, and the points of a window as
//! columns.

use common::geometry::{distance_from_above_m, distance_to_segment};
use common::map::{LaneLine, Pole, PoleKind, Sign, SignKind};
use nalgebra::Point3;
use pasture_core::containers::HashMapBuffer;
use pasture_core::layout::PointLayout;
use pasture_core::layout::attributes::{CLASSIFICATION, GPS_TIME, INTENSITY, POINT_SOURCE_ID, POSITION_3D};
use pasture_core::nalgebra::Vector3 as PastureVector3;
use rayon::prelude::*;

use crate::build::Window;
use crate::cloud::CloudPoint;
use crate::config::Config;

/// Distance from a pole's axis within which a point is the pole's, metres: a
/// thick post, and what is left of the poses' errors.
pub(super) const POLE_RADIUS_M: f64 = 0.25;
/// Distance beyond a sign's radius within which a bright point is the sign's,
/// metres.
pub(super) const SIGN_MARGIN_M: f64 = 0.15;
/// Half the width of what the vehicle drove over, metres: a narrow car.
const DRIVEN_HALF_WIDTH_M: f64 = 0.8;

const OTHER: u8 = 1;
const GROUND: u8 = 2;
const ROAD_SURFACE: u8 = 11;
pub(super) const POLE: u8 = 64;
pub(super) const SIGN: u8 = 68;
pub(super) const LANE_PAINT: u8 = 70;

/// The points that a window owns, in the order of the scans, as columns.
/// `times_s` are the times of the drive's frames, seconds.
pub(super) fn columns(window: &Window, times_s: &[f64], config: &Config) -> HashMapBuffer {
    let cloud = window.cloud;
    let owned: Vec<(&CloudPoint, u8)> = cloud
        .points
        .par_iter()
        .filter_map(|p| {
            let place = cloud.place(&p.position);
            window.owned.contains(&place.station_m).then(|| (p, class(p, place.offset_m, window, config)))
        })
        .collect();
    let frame = |p: &CloudPoint| cloud.scans.get(usize::from(p.scan)).map_or(0, |s| s.frame);
    let position = |p: &CloudPoint| PastureVector3::new(p.position.x, p.position.z, -p.position.y);
    // As the lidar reported it.
    let times = config.lidar.intensity.times_as_bright();
    let intensity = |p: &CloudPoint| ((p.reflectance * times).clamp(0.0, 1.0) * 65535.0).round() as u16;
    // Of a longer drive than the field has numbers, later frames have the last.
    let source = |p: &CloudPoint| frame(p).min(usize::from(u16::MAX)) as u16;
    let time_s = |p: &CloudPoint| times_s.get(frame(p)).copied().unwrap_or(0.0);
    buffer(
        &owned.iter().map(|(p, _)| position(p)).collect::<Vec<_>>(),
        &owned.iter().map(|(p, _)| intensity(p)).collect::<Vec<_>>(),
        &owned.iter().map(|(_, class)| *class).collect::<Vec<_>>(),
        &owned.iter().map(|(p, _)| source(p)).collect::<Vec<_>>(),
        &owned.iter().map(|(p, _)| time_s(p)).collect::<Vec<_>>(),
    )
}

pub(super) fn buffer(
    positions: &[PastureVector3<f64>],
    intensities: &[u16],
    classes: &[u8],
    sources: &[u16],
    times_s: &[f64],
) -> HashMapBuffer {
    let layout = PointLayout::from_attributes(&[POSITION_3D, INTENSITY, CLASSIFICATION, POINT_SOURCE_ID, GPS_TIME]);
    let mut buffer = HashMapBuffer::with_capacity(positions.len(), layout);
    let mut pusher = buffer.begin_push_attributes();
    pusher.push_attribute_range(&POSITION_3D, positions);
    pusher.push_attribute_range(&INTENSITY, intensities);
    pusher.push_attribute_range(&CLASSIFICATION, classes);
    pusher.push_attribute_range(&POINT_SOURCE_ID, sources);
    pusher.push_attribute_range(&GPS_TIME, times_s);
    pusher.done();
    buffer
}

/// The class of a point: of all that it could be, the one that says most.
fn class(p: &CloudPoint, offset_m: f64, window: &Window, config: &Config) -> u8 {
    let at = &p.position;
    if p.reflectance >= config.signs.least_reflectance
        && let Some(sign) = window.signs.iter().find(|s| is_on_sign(at, s))
    {
        return SIGN + u8::from(sign.kind == SignKind::TrafficLight);
    }
    let is_ground = f64::from(p.height_m).abs() <= config.ground.thickness_m;
    let is_paint = is_ground && p.contrast.is_some_and(|c| c >= config.lanes.least_contrast);
    if is_paint && window.lanes.iter().any(|l| l.kind.is_painted() && is_on_lane(at, l, config.lanes.half_line_m)) {
        return LANE_PAINT;
    }
    if is_ground {
        return if offset_m.abs() <= DRIVEN_HALF_WIDTH_M { ROAD_SURFACE } else { GROUND };
    }
    window.poles.iter().find(|pole| is_on_pole(at, pole)).map_or(OTHER, |pole| POLE + pole_index(pole.kind))
}

fn pole_index(kind: PoleKind) -> u8 {
    PoleKind::ALL.iter().position(|k| *k == kind).unwrap_or(0) as u8
}

fn is_on_sign(p: &Point3<f64>, sign: &Sign) -> bool {
    (p - sign.centroid_map).norm() <= 0.5 * sign.size_m + SIGN_MARGIN_M
}

fn is_on_pole(p: &Point3<f64>, pole: &Pole) -> bool {
    distance_to_segment(p, [&pole.foot_map, &pole.top_map]) <= POLE_RADIUS_M
}

fn is_on_lane(p: &Point3<f64>, lane: &LaneLine, half_line_m: f64) -> bool {
    distance_from_above_m(p, &lane.points_map) <= half_line_m
}

#[cfg(test)]
mod tests {
    use pasture_core::containers::{BorrowedBuffer as _, BorrowedBufferExt as _};

    use super::*;
    use crate::cloud::StitchedScan;
    use crate::testing::Street;

    #[test]
    fn frames_beyond_the_numbers_of_the_field_have_their_own_times() {
        let mut street = Street::new();
        street.add(Point3::new(3.0, 0.0, 30.0), 9, 0.2, None);
        let mut cloud = street.cloud();
        let scan = |frame| StitchedScan {
            frame,
            points: 0,
            dropped_not_finite: 0,
            dropped_out_of_range: 0,
            dropped_as_noise: 0,
        };
        cloud.scans = (65_530..65_540).map(scan).collect();
        let window = Window {
            cloud: &cloud,
            owned: f64::NEG_INFINITY..f64::INFINITY,
            poles: Vec::new(),
            signs: &[],
            lanes: &[],
            done: 1,
            count: 1,
        };
        let times_s: Vec<f64> = (0..65_540).map(|frame| f64::from(frame) * 0.1).collect();
        let columns = columns(&window, &times_s, &Config::default());
        let last = columns.len() - 1;
        assert_eq!(columns.view_attribute::<u16>(&POINT_SOURCE_ID).at(last), 65_535);
        assert!((columns.view_attribute::<f64>(&GPS_TIME).at(last) - 6553.9).abs() < 1e-9);
    }
}
