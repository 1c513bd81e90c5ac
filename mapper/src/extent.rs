//! How large a map may be for what looks at every few metres of it.

use std::path::Path;

use common::map::SemanticMap;

use crate::error::{Error, Result};

/// Most metres of roads and lines: every few of them there is a place to look from, or a knot
/// of a line to look at, of some hundred bytes. One map of the roads of a country is as long,
/// and a damaged or made one longer than memory.
const LONGEST_M: f64 = 1e7;

/// Length of all roads and lines of a map, metres.
fn length_m(map: &SemanticMap) -> f64 {
    let lines = map.roads.iter().map(|road| &road.path_map).chain(map.lanes.iter().map(|lane| &lane.points_map));
    lines.flat_map(|points| points.windows(2)).map(|pair| (pair[1] - pair[0]).norm()).sum()
}

/// That what looks at a map every few metres comes to an end.
///
/// # Errors
/// [`Error::TooLong`] where its roads and lines are longer than those of a country; it calls
/// the map `name`.
pub fn check(map: &SemanticMap, name: &str) -> Result<()> {
    let length_m = length_m(map);
    if length_m > LONGEST_M {
        return Err(Error::TooLong { name: name.to_owned(), length_m, longest_m: LONGEST_M });
    }
    Ok(())
}

/// Reads a map that is not too long.
///
/// # Errors
/// As [`common::map::read`] and [`check`].
pub fn read(path: &Path) -> Result<SemanticMap> {
    let map = common::map::read(path)?;
    check(&map, &path.display().to_string())?;
    Ok(map)
}

#[cfg(test)]
mod tests {
    use common::map::Road;
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn a_map_longer_than_a_country_is_refused_by_its_name() {
        let road = |end_m: f64| Road { path_map: vec![Point3::origin(), Point3::new(0.0, 0.0, end_m)] };
        let mut map = SemanticMap { roads: vec![road(9e6)], ..SemanticMap::default() };
        assert!(check(&map, "a.csm").is_ok());
        map.roads.push(road(4e6));
        let error = check(&map, "a.csm").unwrap_err().to_string();
        assert!(error.contains("a.csm") && error.contains("1.3e7 m"), "{error}");
    }
}
