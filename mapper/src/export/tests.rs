//! What another program reads is what the map says.

use std::collections::BTreeMap;
use std::path::Path;

use common::earth::{OnEarth, Projection, World};
use common::map::{LaneKind, LaneLine, Pole, PoleKind, Road, RoadId, SemanticMap, Sign, SignKind};
use nalgebra::{Point3, Vector3};
use quick_xml::events::Event;
use quick_xml::reader::Reader;

use super::*;
use crate::input::{MapFrame, SurveyFrame};

fn map() -> SemanticMap {
    let road = RoadId(0);
    let point = |x, y, z| Point3::new(x, y, z);
    SemanticMap {
        frame_note: "a <b> & \"c\"".into(),
        roads: vec![Road { path_map: vec![Point3::origin(), point(0.0, 0.0, 50.0)] }],
        poles: vec![Pole {
            kind: PoleKind::LampPost,
            foot_map: point(-4.5, 1.6, 30.0),
            top_map: point(-4.47, -4.6, 29.98),
            road,
        }],
        signs: vec![Sign { kind: SignKind::TrafficLight, centroid_map: point(4.2, -0.6, 20.0), size_m: 0.8, road }],
        lanes: vec![LaneLine {
            kind: LaneKind::Dashed,
            points_map: vec![point(-1.8, 1.65, 5.0), point(-1.8, 1.65, 15.0), point(-1.7, 1.6, 35.0)],
            road,
            marks_m: Vec::new(),
        }],
    }
}

fn wgs84() -> Frame {
    Frame::Earth(OnEarth::new("49.0337,8.395,114,62".parse().unwrap(), Projection::Topocentric))
}

/// Elements of an OSM file with their attributes and tags.
#[derive(Default)]
struct Osm {
    nodes: BTreeMap<i64, BTreeMap<String, String>>,
    ways: BTreeMap<i64, (Vec<i64>, BTreeMap<String, String>)>,
}

fn osm(text: &str) -> Osm {
    let mut reader = Reader::from_str(text);
    let mut osm = Osm::default();
    let (mut node, mut way) = (None, None);
    loop {
        let event = reader.read_event().unwrap();
        let (Event::Start(element) | Event::Empty(element)) = &event else {
            match event {
                Event::Eof => return osm,
                Event::End(end) if end.name().as_ref() != "osm" => (node, way) = (None, None),
                _ => {}
            }
            continue;
        };
        let attributes: BTreeMap<String, String> = element
            .attributes()
            .map(|a| a.unwrap())
            .map(|a| (a.key.as_ref().to_owned(), a.value.into_owned()))
            .collect();
        let number = |key: &str| attributes[key].parse::<i64>().unwrap();
        match element.name().as_ref() {
            "node" => {
                node = Some(number("id"));
                assert!(osm.nodes.insert(number("id"), attributes).is_none());
            }
            "way" => {
                way = Some(number("id"));
                assert!(osm.ways.insert(number("id"), Default::default()).is_none());
            }
            "nd" => osm.ways.get_mut(&way.unwrap()).unwrap().0.push(number("ref")),
            "tag" => {
                let tags = match (node, way) {
                    (Some(node), _) => osm.nodes.get_mut(&node).unwrap(),
                    (_, Some(way)) => &mut osm.ways.get_mut(&way).unwrap().1,
                    _ => panic!("a tag of nothing"),
                };
                tags.insert(attributes["k"].clone(), attributes["v"].clone());
            }
            name => assert_eq!(name, "osm"),
        }
    }
}

#[test]
fn lanelet2_has_a_way_per_landmark_and_no_dangling_node() {
    let text = Format::Lanelet2.text(&map(), &Frame::Local(None)).unwrap();
    let osm = osm(&text);
    assert_eq!(osm.ways.keys().copied().collect::<Vec<_>>(), [1, 2, 3]);
    let used: Vec<i64> = osm.ways.values().flat_map(|(nodes, _)| nodes.clone()).collect();
    assert_eq!(used, osm.nodes.keys().copied().collect::<Vec<_>>());
    assert!(osm.nodes.keys().all(|node| !osm.ways.contains_key(node)));
    let tags = |way: i64, keys: [&str; 2]| keys.map(|key| osm.ways[&way].1[key].clone());
    assert_eq!(tags(1, ["type", "subtype"]), ["pole", "lamp_post"]);
    assert_eq!(tags(1, ["type", "height"]), ["pole", "6.200"]);
    assert_eq!(tags(2, ["type", "size"]), ["traffic_light", "0.800"]);
    assert_eq!(tags(3, ["type", "subtype"]), ["line_thin", "dashed"]);
    let mut kerb = map();
    kerb.lanes[0].kind = LaneKind::Kerb;
    let text = Format::Lanelet2.text(&kerb, &Frame::Local(None)).unwrap();
    assert!(text.contains("v=\"curbstone\"") && text.contains("v=\"low\""), "{text}");
    let of = |way: i64, point: usize| &osm.nodes[&osm.ways[&way].0[point]];
    assert_eq!((of(1, 0)["local_x"].as_str(), of(1, 0)["local_y"].as_str()), ("-4.500", "30.000"));
    assert_eq!(of(1, 1)["ele"], "4.600");
    // Left edge first, for who drives along the road.
    assert_eq!((of(2, 0)["local_x"].as_str(), of(2, 1)["local_x"].as_str()), ("3.800", "4.600"));
}

#[test]
fn latitude_longitude_and_ele_lead_back_to_metres_east_north_and_up() {
    let mut map = map();
    map.poles[0].foot_map = Point3::new(0.0, 1.6, 2600.0);
    let osm = osm(&Format::Lanelet2.text(&map, &wgs84()).unwrap());
    let node = &osm.nodes[&osm.ways[&1].0[0]];
    let of = |key: &str| node[key].parse::<f64>().unwrap();
    let (east_m, north_m, up_m) = map_3d::geodetic2enu(
        of("lat").to_radians(),
        of("lon").to_radians(),
        of("ele"),
        49.0337_f64.to_radians(),
        8.395_f64.to_radians(),
        114.0,
        map_3d::Ellipsoid::WGS84,
    );
    let found = Point3::new(east_m, north_m, up_m);
    assert!((found - Point3::new(of("local_x"), of("local_y"), -1.6)).norm() < 2e-3, "{found}");
    // Half a metre above the plane that touches the Earth at the origin.
    assert!((of("ele") - (114.0 - 1.6) - 0.53).abs() < 0.01, "{}", of("ele"));
}

#[test]
fn geojson_is_read_back_in_metres_and_in_degrees() {
    for frame in [Frame::Local(None), wgs84()] {
        let text = Format::Geojson.text(&map(), &frame).unwrap();
        let read: ::geojson::FeatureCollection = text.parse::<::geojson::GeoJson>().unwrap().try_into().unwrap();
        assert_eq!(read.features.len(), 4);
        let numbers: Vec<_> =
            read.features.iter().map(|f| f.property("id").and_then(serde_json::Value::as_u64)).collect();
        assert_eq!(numbers, [Some(1), Some(2), Some(3), None]);
        let pole = &read.features[0];
        assert_eq!(pole.property("kind").unwrap(), "lamp-post");
        let ::geojson::GeometryValue::Point { coordinates } = &pole.geometry.as_ref().unwrap().value else {
            panic!("a pole is a point")
        };
        assert_eq!(coordinates.as_slice(), frame.position(&map().poles[0].foot_map));
        let kinds: Vec<&str> = read.features.iter().map(|f| f.property("kind").unwrap().as_str().unwrap()).collect();
        assert_eq!(kinds, ["lamp-post", "traffic-light", "dashed-line", "road"]);
    }
    let [longitude, latitude, altitude] = wgs84().position(&map().poles[0].foot_map);
    // RFC 7946: longitude first. 30 m ahead at a bearing of 62 degrees.
    assert!((longitude - 8.395_33).abs() < 1e-4 && (latitude - 49.033_86).abs() < 1e-4, "{longitude} {latitude}");
    assert!((altitude - 112.4).abs() < 1e-3, "{altitude}");
}

#[test]
fn csv_has_a_row_per_point() {
    let text = Format::Csv.text(&map(), &Frame::Local(None)).unwrap();
    let expected = "\
id,kind,road,point,x_right_m,y_forward_m,z_up_m,size_m
1,lamp-post,0,0,-4.500,30.000,-1.600,
1,lamp-post,0,1,-4.470,29.980,4.600,
2,traffic-light,0,0,4.200,20.000,0.600,0.800
3,dashed-line,0,0,-1.800,5.000,-1.650,
3,dashed-line,0,1,-1.800,15.000,-1.650,
3,dashed-line,0,2,-1.700,35.000,-1.600,
";
    assert_eq!(text, expected);
    let degrees = Format::Csv.text(&map(), &wgs84()).unwrap();
    assert!(degrees.starts_with("id,kind,road,point,longitude_deg,latitude_deg,altitude_m,size_m\n"), "{degrees}");
}

#[test]
fn the_survey_s_world_is_exported_in_its_own_coordinates() {
    let utm = Frame::Survey(MapFrame::of_survey(SurveyFrame::Lidar, &Vector3::new(450_000.0, 5_420_000.0, 100.0)));
    let text = Format::Csv.text(&map(), &utm).unwrap();
    let first: Vec<&str> = text.lines().take(2).collect();
    let expected = [
        "id,kind,road,point,x_survey_m,y_survey_m,z_survey_m,size_m",
        "1,lamp-post,0,0,450030.000,5420004.500,98.400,",
    ];
    assert_eq!(first, expected);
    let osm = osm(&Format::Lanelet2.text(&map(), &utm).unwrap());
    let foot = &osm.nodes[&osm.ways[&1].0[0]];
    let of = ["local_x", "local_y", "ele"].map(|key| foot[key].as_str());
    assert_eq!(of, ["450030.000", "5420004.500", "98.400"]);
    // Editors of such files need degrees: those of the metres from the map's origin.
    let [lat, lon] = ["lat", "lon"].map(|key| foot[key].parse::<f64>().unwrap());
    assert!((lat - 4.5 / 110_574.0).abs() < 1e-7 && (lon - 30.0 / 111_320.0).abs() < 1e-7, "{lat} {lon}");
    let json = Format::Geojson.text(&map(), &utm).unwrap();
    assert!(json.contains("450030.0,5420004.5,98.4") && json.contains("the survey's world"), "{json}");
}

#[test]
fn a_survey_in_a_grid_is_exported_in_degrees() {
    let grid =
        OnEarth::in_grid("EPSG:25832".parse().unwrap(), World::ZUp, [456_084.596, 5_427_624.704, 100.0]).unwrap();
    // 30 m forward, which is east, 4.5 m to the left: 49 N 8.4 E by Krueger's series.
    let [longitude, latitude, altitude] = Frame::Earth(grid).position(&map().poles[0].foot_map);
    let off = [longitude - 8.4, latitude - 49.0, (altitude - 98.4) * 1e-5];
    assert!(off.iter().all(|off| off.abs() < 1e-8), "{longitude} {latitude} {altitude}");
}

#[test]
fn an_empty_map_is_a_file_too() {
    for format in [Format::Geojson, Format::Lanelet2, Format::Csv, Format::Ascii] {
        format.text(&SemanticMap::default(), &Frame::Local(None)).unwrap();
    }
    let text = Format::Geojson.text(&SemanticMap::default(), &Frame::Local(None)).unwrap();
    assert!(text.parse::<::geojson::GeoJson>().is_ok(), "{text}");
    assert!(osm(&Format::Lanelet2.text(&SemanticMap::default(), &Frame::Local(None)).unwrap()).ways.is_empty());
}

#[test]
fn the_extension_says_the_format_and_an_unknown_one_is_told() {
    assert_eq!(Format::of(Path::new("a.OSM")).unwrap(), Format::Lanelet2);
    let said = Format::of(Path::new("a.shp")).unwrap_err().to_string();
    assert!(said.contains("a.shp") && said.contains("--format"), "{said}");
    assert!(matches!(Format::Ascii.text(&map(), &wgs84()), Err(Error::MapFrameOnly)));
}
