//! CSV: one row per point of a landmark.

use std::fmt::Write as _;

use common::map::{Numbering, SemanticMap};
use nalgebra::Point3;

use super::frame::{DEGREE_DIGITS, Frame, METRE_DIGITS};

/// The map as CSV: `id,kind,road,point` and three coordinates, then `size_m`,
/// which only signs have. A pole has two points, its foot and its top; a sign
/// one, its centroid; a lane line its vertices.
pub fn text(map: &SemanticMap, frame: &Frame) -> String {
    let (axes, digits) = match frame {
        Frame::Local(_) => ("x_right_m,y_forward_m,z_up_m", METRE_DIGITS),
        Frame::Survey(_) => ("x_survey_m,y_survey_m,z_survey_m", METRE_DIGITS),
        Frame::Earth(_) => ("longitude_deg,latitude_deg,altitude_m", DEGREE_DIGITS),
    };
    let mut out = format!("id,kind,road,point,{axes},size_m\n");
    let (digits, up_digits) = (digits as usize, METRE_DIGITS as usize);
    let mut row = |id: usize, kind: &str, road: u32, point: usize, at: &Point3<f64>, size: &str| {
        let [x, y, z] = frame.position(at);
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{id},{kind},{road},{point},{x:.digits$},{y:.digits$},{z:.up_digits$},{size}");
    };
    let numbers = Numbering::of(map);
    for (i, pole) in map.poles.iter().enumerate() {
        for (point, at) in [pole.foot_map, pole.top_map].iter().enumerate() {
            row(numbers.pole(i), pole.kind.name(), pole.road.0, point, at, "");
        }
    }
    for (i, sign) in map.signs.iter().enumerate() {
        let size = format!("{:.up_digits$}", sign.size_m);
        row(numbers.sign(i), sign.kind.name(), sign.road.0, 0, &sign.centroid_map, &size);
    }
    for (i, lane) in map.lanes.iter().enumerate() {
        for (point, at) in lane.points_map.iter().enumerate() {
            row(numbers.lane(i), lane.kind.name(), lane.road.0, point, at, "");
        }
    }
    out
}
