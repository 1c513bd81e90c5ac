//! The commands that look at a map.

use std::path::Path;

use common::atomic_file;
use common::map::atlas::is_atlas;
use common::map::{SemanticMap, layout};

use super::{Outcome, print, print_json};
use crate::draw::svg;
use crate::error::Result;
use crate::inspect::Inspection;

pub fn inspect(map: &Path, json: bool) -> Result<Outcome> {
    if is_atlas(map)? {
        return super::atlas::inspect(map, json);
    }
    let inspection = Inspection::of_file(map)?;
    if json {
        print_json(&inspection)?;
    } else {
        print(&format!("{}: {}", map.display(), inspection.text()));
    }
    Ok(Outcome::Done)
}

pub fn ascii(map: &Path) -> Result<Outcome> {
    print(&common::map::ascii(&common::map::read(map)?));
    Ok(Outcome::Done)
}

pub fn draw(map: &Path, out: &Path) -> Result<Outcome> {
    let bytes = std::fs::read(map).map_err(common::Error::io(map))?;
    let content = SemanticMap::decode(&bytes).map_err(common::Error::in_file(map))?;
    let layout = layout(&bytes).map_err(common::Error::in_file(map))?;
    let picture = svg(&content, &layout);
    atomic_file::write(out, picture.as_bytes())?;
    print(&format!("{}: {} bytes of SVG\n", out.display(), picture.len()));
    Ok(Outcome::Done)
}
