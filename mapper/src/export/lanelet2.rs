//! `OpenStreetMap` XML with the tags of Lanelet2.
//!
//! | landmark | way | tags |
//! |---|---|---|
//! | lane line | its vertices | `type=line_thin`, `subtype=solid` or `dashed` |
//! | traffic sign, traffic light | from its left to its right edge | `type=traffic_sign`, `type=traffic_light` |
//! | pole | from its foot to its top | `type=pole`, `subtype` as the kind, `height` |
//!
//! Type and subtype of lines, signs and lights are those of Lanelet2's
//! `LinestringTagging.md`; poles are none of its types, and it keeps types
//! that it does not know. What a map does not say is not made up: there are no
//! lanelets, no regulatory elements, and no subtype of signs and lights. How a
//! sign faces is not known either: its edges are put across the driven road,
//! as signs stand, at half of its largest extent from its centroid.
//!
//! Latitude and longitude are those from which Lanelet2's
//! `LocalCartesianProjector`, with the map's origin, makes metres east, north
//! and up again. Without an origin they are made around 0 N 0 E, 0 m, with
//! right for east and forward for north. The same metres east and north stand
//! in the tags `local_x` and `local_y`, for Autoware's `local` projector; in the survey's
//! coordinates these are its own, and `ele` its heights. Else `ele`
//! is the altitude of the node, as `OpenStreetMap` has it and Lanelet2 needs it
//! for metres up. Autoware takes it for these: there a map rises with the
//! square of the distance from its origin, by 8 cm at 1 km, for the Earth falls
//! away below the plane. Ways have the numbers of the landmarks, nodes those
//! after them: Lanelet2 wants every number once.

use common::map::{LaneKind, Numbering, PoleKind, SemanticMap, Sign, SignKind};
use nalgebra::{Point3, Vector3};
use quick_xml::events::{BytesDecl, BytesStart, Event};
use quick_xml::writer::Writer;

use super::frame::{DEGREE_DIGITS, Frame, METRE_DIGITS};

/// A way: its number, its points in the map, its tags.
struct Way {
    id: usize,
    points_map: Vec<Point3<f64>>,
    tags: Vec<(&'static str, String)>,
}

/// The map as Lanelet2 OSM.
pub fn text(map: &SemanticMap, frame: &Frame) -> String {
    let ways = ways(map);
    let mut writer = Writer::new_with_indent(Vec::new(), b' ', 2);
    // Writing to memory cannot fail.
    let _ = write(&mut writer, &ways, map, frame);
    let mut bytes = writer.into_inner();
    bytes.push(b'\n');
    String::from_utf8_lossy(&bytes).into_owned()
}

fn write(writer: &mut Writer<Vec<u8>>, ways: &[Way], map: &SemanticMap, frame: &Frame) -> std::io::Result<()> {
    writer.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let mut root = BytesStart::new("osm");
    root.extend_attributes([("version", "0.6"), ("generator", "waymark"), ("upload", "false")]);
    root.extend_attributes([("map", map.frame_note.as_str()), ("frame", frame.note().as_str())]);
    writer.write_event(Event::Start(root))?;
    let first_node = Numbering::of(map).end;
    let all = ways.iter().flat_map(|way| &way.points_map);
    for (node, point) in (first_node..).zip(all) {
        write_node(writer, node, point, frame)?;
    }
    let mut node = first_node;
    for way in ways {
        element(writer, "way", &[("id", way.id.to_string())], |writer| {
            for _ in &way.points_map {
                writer.create_element("nd").with_attribute(("ref", node.to_string().as_str())).write_empty()?;
                node += 1;
            }
            write_tags(writer, &way.tags)
        })?;
    }
    writer.write_event(Event::End(quick_xml::events::BytesEnd::new("osm")))
}

fn write_node(writer: &mut Writer<Vec<u8>>, id: usize, point: &Point3<f64>, frame: &Frame) -> std::io::Result<()> {
    let (place, enu_m) = (frame.place(point), frame.metres(point));
    let attributes =
        [("id", id.to_string()), ("lat", degrees(place.latitude_deg)), ("lon", degrees(place.longitude_deg))];
    let tags = [("ele", metres(place.altitude_m)), ("local_x", metres(enu_m.x)), ("local_y", metres(enu_m.y))];
    element(writer, "node", &attributes, |writer| write_tags(writer, &tags))
}

fn element(
    writer: &mut Writer<Vec<u8>>,
    name: &str,
    attributes: &[(&str, String)],
    content: impl FnOnce(&mut Writer<Vec<u8>>) -> std::io::Result<()>,
) -> std::io::Result<()> {
    let attributes = attributes.iter().map(|(key, value)| (*key, value.as_str()));
    // Editors take what has no version for a draft.
    let element = writer.create_element(name).with_attributes(attributes).with_attribute(("version", "1"));
    element.write_inner_content(content).map(|_| ())
}

fn write_tags(writer: &mut Writer<Vec<u8>>, tags: &[(&str, String)]) -> std::io::Result<()> {
    for (key, value) in tags {
        writer.create_element("tag").with_attributes([("k", *key), ("v", value.as_str())]).write_empty()?;
    }
    Ok(())
}

fn degrees(value: f64) -> String {
    format!("{:.*}", DEGREE_DIGITS as usize, super::frame::rounded(value, DEGREE_DIGITS))
}

fn metres(value: f64) -> String {
    format!("{:.*}", METRE_DIGITS as usize, super::frame::rounded(value, METRE_DIGITS))
}

fn ways(map: &SemanticMap) -> Vec<Way> {
    let numbers = Numbering::of(map);
    let poles = map.poles.iter().enumerate().map(|(i, pole)| Way {
        id: numbers.pole(i),
        points_map: vec![pole.foot_map, pole.top_map],
        tags: vec![
            ("type", "pole".into()),
            ("subtype", pole_subtype(pole.kind).into()),
            ("height", metres(pole.foot_map.y - pole.top_map.y)),
        ],
    });
    let signs = map.signs.iter().enumerate().map(|(i, sign)| Way {
        id: numbers.sign(i),
        points_map: edges(sign, map).to_vec(),
        tags: vec![("type", sign_type(sign.kind).into()), ("size", metres(sign.size_m))],
    });
    let lanes = map.lanes.iter().enumerate().map(|(i, lane)| Way {
        id: numbers.lane(i),
        points_map: lane.points_map.clone(),
        tags: lane_tags(lane.kind).map(|(key, value)| (key, value.into())).to_vec(),
    });
    poles.chain(signs).chain(lanes).collect()
}

fn pole_subtype(kind: PoleKind) -> &'static str {
    match kind {
        PoleKind::LampPost => "lamp_post",
        PoleKind::SignPost => "sign_post",
        PoleKind::Delineator => "delineator",
        PoleKind::Trunk => "trunk",
    }
}

fn sign_type(kind: SignKind) -> &'static str {
    match kind {
        SignKind::TrafficSign => "traffic_sign",
        SignKind::TrafficLight => "traffic_light",
    }
}

/// A vehicle may have to go over a kerb, so it is a low one.
fn lane_tags(kind: LaneKind) -> [(&'static str, &'static str); 2] {
    let (line, subtype) = match kind {
        LaneKind::Solid => ("line_thin", "solid"),
        LaneKind::Dashed => ("line_thin", "dashed"),
        LaneKind::Kerb => ("curbstone", "low"),
    };
    [("type", line), ("subtype", subtype)]
}

/// The left and the right edge of a sign as seen by who drives towards it.
fn edges(sign: &Sign, map: &SemanticMap) -> [Point3<f64>; 2] {
    let ahead = road_direction(sign, map);
    // Right of (x, z) seen from above, y down.
    let right = Vector3::new(ahead.z, 0.0, -ahead.x) * (0.5 * sign.size_m);
    [sign.centroid_map - right, sign.centroid_map + right]
}

/// Level direction of the sign's road at the segment nearest to it; along the
/// map's z axis where the road is a point.
fn road_direction(sign: &Sign, map: &SemanticMap) -> Vector3<f64> {
    let path = map.roads.get(sign.road.0 as usize).map_or(&[][..], |road| &road.path_map);
    let level = |p: &Point3<f64>| Vector3::new(p.x, 0.0, p.z);
    let at = level(&sign.centroid_map);
    let segments = path.windows(2).map(|w| (level(&w[0]), level(&w[1]) - level(&w[0])));
    let distance = |(from, along): &(Vector3<f64>, Vector3<f64>)| {
        let share = ((at - from).dot(along) / along.norm_squared()).clamp(0.0, 1.0);
        (at - from - along * share).norm_squared()
    };
    segments
        .filter(|(_, along)| along.norm_squared() > 0.0)
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .map_or_else(Vector3::z, |(_, along)| along.normalize())
}
