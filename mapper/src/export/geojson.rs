//! `GeoJSON`: one feature per landmark and per road.
//!
//! A landmark's number is the `id` of its feature, and stands among the properties,
//! too: some readers drop the former.
//!
//! Poles and signs are points (a pole's is its foot), lane lines and the
//! driven roads are lines. Without an origin coordinates are local metres,
//! which RFC 7946 (section 4) leaves to those who exchange them: the member
//! `frame` says which.

use common::map::{Numbering, SemanticMap};
use geojson::feature::Id;
use geojson::{Feature, FeatureCollection, GeometryValue, JsonObject, Position};
use nalgebra::Point3;
use serde_json::json;

use super::frame::{Frame, METRE_DIGITS, rounded};

/// The map as `GeoJSON`, a line per feature.
pub fn text(map: &SemanticMap, frame: &Frame) -> String {
    let features = features(map, frame);
    let mut members = JsonObject::new();
    members.insert("frame".into(), frame.note().into());
    members.insert("map".into(), map.frame_note.clone().into());
    let head = FeatureCollection { bbox: None, features: Vec::new(), foreign_members: Some(members) };
    let head = head.to_string();
    // People look into such files: a feature is a line.
    let lines: Vec<String> = features.iter().map(ToString::to_string).collect();
    head.replacen("\"features\":[]", &format!("\"features\":[\n{}\n]", lines.join(",\n")), 1) + "\n"
}

fn features(map: &SemanticMap, frame: &Frame) -> Vec<Feature> {
    let numbers = Numbering::of(map);
    let position = |p: &Point3<f64>| Position::from(frame.position(p));
    let line = |points: &[Point3<f64>]| GeometryValue::new_line_string(points.iter().map(|p| frame.position(p)));
    let metres = |length_m: f64| rounded(length_m, METRE_DIGITS);
    let poles = map.poles.iter().enumerate().map(|(i, pole)| {
        let properties = json!({
            "kind": pole.kind.name(),
            "road": pole.road.0,
            "length_m": metres(pole.length_m()),
            "top": frame.position(&pole.top_map),
        });
        feature(Some(numbers.pole(i)), GeometryValue::Point { coordinates: position(&pole.foot_map) }, properties)
    });
    let signs = map.signs.iter().enumerate().map(|(i, sign)| {
        let properties = json!({ "kind": sign.kind.name(), "road": sign.road.0, "size_m": metres(sign.size_m) });
        feature(Some(numbers.sign(i)), GeometryValue::Point { coordinates: position(&sign.centroid_map) }, properties)
    });
    let lanes = map.lanes.iter().enumerate().map(|(i, lane)| {
        let properties = json!({ "kind": lane.kind.name(), "road": lane.road.0 });
        feature(Some(numbers.lane(i)), line(&lane.points_map), properties)
    });
    // A line string has two positions at least.
    let roads = map.roads.iter().enumerate().filter(|(_, road)| road.path_map.len() >= 2);
    let roads = roads.map(|(i, road)| feature(None, line(&road.path_map), json!({ "kind": "road", "road": i })));
    poles.chain(signs).chain(lanes).chain(roads).collect()
}

fn feature(id: Option<usize>, geometry: GeometryValue, properties: serde_json::Value) -> Feature {
    let properties = match properties {
        serde_json::Value::Object(mut properties) => {
            if let Some(id) = id {
                properties.insert("id".into(), id.into());
            }
            Some(properties)
        }
        _ => None,
    };
    let id = id.map(|id| Id::Number(id.into()));
    Feature { bbox: None, geometry: Some(geometry.into()), id, properties, foreign_members: None }
}
