//! PLY, through `ply-rs-bw`: the element `vertex`.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use common::kitti::ScanPoint;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Property, PropertyAccess, PropertyAccessResult};

use super::{INTENSITY, Points, RING, bad};
use crate::error::{Error, Result};

/// A vertex.
#[derive(Debug, Default)]
struct Vertex {
    point: ScanPoint,
    ring: u16,
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let value = match property {
            Property::Char(v) => f64::from(v),
            Property::UChar(v) => f64::from(v),
            Property::Short(v) => f64::from(v),
            Property::UShort(v) => f64::from(v),
            Property::Int(v) => f64::from(v),
            Property::UInt(v) => f64::from(v),
            Property::Float(v) => f64::from(v),
            Property::Double(v) => v,
            _ => return PropertyAccessResult::Ignored,
        };
        let name = name.to_ascii_lowercase();
        match name.as_str() {
            "x" => self.point.x_m = value as f32,
            "y" => self.point.y_m = value as f32,
            "z" => self.point.z_m = value as f32,
            name if INTENSITY.contains(&name) => self.point.reflectance = value as f32,
            name if RING.contains(&name) => self.ring = value as u16,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

/// Reads a scan.
///
/// # Errors
/// [`Error::BadScan`] with what the parser says.
pub fn read(path: &Path) -> Result<Points> {
    let file = File::open(path).map_err(common::Error::io(path))?;
    let mut reader = Reader::new(BufReader::new(file));
    let parser = Parser::<Vertex>::new();
    let header = parser.read_header(&mut reader).map_err(fault(path))?;
    let is_vertex = |element: &ElementDef| element.name == "vertex";
    let vertex = header.elements.iter().map(|(_, element)| element).find(|element| is_vertex(element));
    let vertex = vertex.ok_or_else(|| bad(path, "it has elements, but not `vertex`; export it as a point cloud"))?;
    let has =
        |names: &[&str]| vertex.properties.iter().any(|(name, _)| names.contains(&name.to_ascii_lowercase().as_str()));
    if !["x", "y", "z"].iter().all(|axis| has(&[*axis])) {
        return Err(bad(path, "its vertices have no properties x, y and z; export it with positions"));
    }
    // Some write the camera or the faces before the points.
    for before in header.elements.iter().map(|(_, element)| element).take_while(|element| !is_vertex(element)) {
        parser.read_payload_for_element(&mut reader, before, &header).map_err(fault(path))?;
    }
    let vertices = parser.read_payload_for_element(&mut reader, vertex, &header).map_err(fault(path))?;
    let ring = if has(&RING) { vertices.iter().map(|v| v.ring).collect() } else { Vec::new() };
    Ok(Points { points: vertices.into_iter().map(|v| v.point).collect(), ring, noise: 0 })
}

fn fault(path: &Path) -> impl Fn(ParseError) -> Error {
    move |error| {
        let what = error.to_string().replace('\n', " ");
        bad(path, format!("it is no whole PLY file ({what}); copy or export it again"))
    }
}
