//! The commands that look at a map.

use std::path::Path;

use common::atomic_file;
use common::map::atlas::is_atlas;
use common::map::decode_with_layout;
use serde::Serialize;

use super::{Outcome, print, print_json};
use crate::atlas::AtlasInspection;
use crate::draw::svg;
use crate::error::Result;
use crate::inspect::Inspection;
use crate::outputs;

pub fn inspect(map: &Path, json: bool) -> Result<Outcome> {
    if is_atlas(map)? {
        show(map, &AtlasInspection::of_file(map)?, AtlasInspection::text, json)
    } else {
        show(map, &Inspection::of_file(map)?, Inspection::text, json)
    }
}

/// Prints what was found in a file as text, or as JSON.
fn show<T: Serialize>(file: &Path, found: &T, text: fn(&T) -> String, json: bool) -> Result<Outcome> {
    if json {
        print_json(found)?;
    } else {
        print(&format!("{}: {}", file.display(), text(found)));
    }
    Ok(Outcome::Done)
}

pub fn ascii(map: &Path) -> Result<Outcome> {
    print(&common::map::ascii(&common::map::read(map)?));
    Ok(Outcome::Done)
}

pub fn draw(map: &Path, out: &Path) -> Result<Outcome> {
    outputs::check(&[("--out", out)], [map])?;
    let bytes = std::fs::read(map).map_err(common::Error::io(map))?;
    let (content, layout) = decode_with_layout(&bytes).map_err(common::Error::in_file(map))?;
    let picture = svg(&content, &layout);
    atomic_file::write(out, picture.as_bytes())?;
    print(&format!("{}: {} bytes of SVG\n", out.display(), picture.len()));
    Ok(Outcome::Done)
}
