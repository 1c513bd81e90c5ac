//! From bytes to a checked map: the only place where a file is trusted.

use super::envelope::{CHECKSUM_BYTES, PREFIX_BYTES, open};
use super::grid::{Grid, GridPoint};
use super::pole::{GridPole, Leans};
use super::varint::Signed;
use super::wire::{Body, ByRoad, List, Marks, Polyline, Step};
use super::{
    EncodeOptions, LaneKind, LaneLine, MapLayout, Pole, PoleKind, Road, RoadId, SectionSize, SemanticMap, Sign,
    SignKind,
};
use crate::{Error, Result};

impl SemanticMap {
    /// The map in the bytes of a map file. What it accepts is exactly what
    /// [`SemanticMap::encode`] writes, or wrote in older versions: the same map
    /// has the same bytes.
    ///
    /// # Errors
    /// [`Error::NotAMap`], [`Error::MapVersion`], [`Error::MapLength`],
    /// [`Error::MapChecksum`], or [`Error::MapMalformed`] where the bytes are
    /// as they were written and still are no map.
    pub fn decode(bytes: &[u8]) -> Result<Self> {
        decode(bytes).map(|(map, _)| map)
    }
}

/// What stands where in the bytes of a map file.
///
/// # Errors
/// As [`SemanticMap::decode`].
pub fn layout(bytes: &[u8]) -> Result<MapLayout> {
    decode_with_layout(bytes).map(|(_, layout)| layout)
}

/// [`SemanticMap::decode`] and [`layout`] in one go.
///
/// # Errors
/// As [`SemanticMap::decode`].
pub fn decode_with_layout(bytes: &[u8]) -> Result<(SemanticMap, MapLayout)> {
    let (map, layout) = decode(bytes)?;
    let bounds = map.bounds();
    Ok((map, MapLayout { bounds, ..layout }))
}

fn decode(bytes: &[u8]) -> Result<(SemanticMap, MapLayout)> {
    let (form, body) = open(bytes)?;
    let (body, mut sections) = Body::from_bytes(body, form)?;
    if let Some(header) = sections.first_mut() {
        header.bytes += PREFIX_BYTES;
    }
    sections.push(SectionSize { name: "checksum".into(), items: 1, bytes: CHECKSUM_BYTES });
    let quantum_um = body.head.quantum_um.0;
    let grid =
        Grid::from_um(quantum_um).ok_or_else(|| malformed(format!("its quantum is {quantum_um} micrometres")))?;
    let map = checked(body, grid, form.leans)?;
    // One comparison refuses every other spelling of the same map: another
    // order, other bounds, empty groups, the longer form of a polyline.
    let options = EncodeOptions { quantum_m: grid.quantum_m() };
    if map.encode_with(form.leans, options).is_ok_and(|canonical| canonical == bytes) {
        Ok((map, MapLayout { version: form.version(), quantum_m: grid.quantum_m(), bounds: None, sections }))
    } else {
        Err(malformed("it is not in canonical form (order of landmarks, bounds, or form of polylines)".into()))
    }
}

fn checked(body: Body, grid: Grid, leans: Leans) -> Result<SemanticMap> {
    let frame_note =
        String::from_utf8(body.head.frame_note.0).map_err(|_| malformed("its frame note is not UTF-8".into()))?;
    if let Some(fault) = super::note_fault(&frame_note) {
        return Err(malformed(fault));
    }
    let mut end = [0; 3];
    let mut paths = Vec::new();
    for (index, line) in body.roads.0.iter().enumerate() {
        let path = vertices(end, line, 1, || format!("road {index}"))?;
        end = path[path.len() - 1];
        paths.push(path);
    }
    let mut map = SemanticMap { frame_note, ..SemanticMap::default() };
    for (kind, groups) in PoleKind::ALL.into_iter().zip(&body.poles) {
        each(kind.name(), groups, &paths, |road, before, pole| {
            let foot = add(before, pole.foot)?;
            let height = i64::try_from(pole.height.0).ok()?;
            let top_map = GridPole { foot, height, lean: pole.lean.map(|lean| lean.0) }.top_m(grid, leans)?;
            map.poles.push(Pole { kind, foot_map: grid.point_m(foot), top_map, road });
            Some(foot)
        })?;
    }
    for (kind, groups) in SignKind::ALL.into_iter().zip(&body.signs) {
        each(kind.name(), groups, &paths, |road, before, sign| {
            let centroid = add(before, sign.centroid)?;
            let size = i64::from(i32::try_from(sign.size.0).ok()?);
            map.signs.push(Sign { kind, centroid_map: grid.point_m(centroid), size_m: grid.metres(size), road });
            Some(centroid)
        })?;
    }
    for (kind, groups) in LaneKind::ALL.into_iter().zip(body.lanes.iter().chain(&body.kerbs)) {
        each(kind.name(), groups, &paths, |road, before, line| {
            let points = vertices(before, line, 2, String::new).ok()?;
            let first = points[0];
            let points_map = points.into_iter().map(|point| grid.point_m(point)).collect();
            map.lanes.push(LaneLine { kind, points_map, road, marks_m: Vec::new() });
            Some(first)
        })?;
    }
    if let Some(List(marks)) = body.marks {
        let dashed = map.lanes.iter_mut().filter(|lane| lane.kind == LaneKind::Dashed);
        for (lane, marks) in dashed.zip(&marks) {
            lane.marks_m = marks_of_line(marks, grid)?;
        }
    }
    let road = |path: Vec<GridPoint>| Road { path_map: path.into_iter().map(|point| grid.point_m(point)).collect() };
    map.roads = paths.into_iter().map(road).collect();
    Ok(map)
}

/// Takes every landmark of one kind with its road and the point that it is
/// counted from; `take` returns its own, or none where it is no landmark.
fn each<W>(
    name: &str,
    groups: &ByRoad<W>,
    paths: &[Vec<GridPoint>],
    mut take: impl FnMut(RoadId, GridPoint, &W) -> Option<GridPoint>,
) -> Result<()> {
    if groups.0.len() > paths.len() {
        return Err(malformed(format!("section `{name}` names {} roads of {}", groups.0.len(), paths.len())));
    }
    for ((road, group), path) in (0..).map(RoadId).zip(&groups.0).zip(paths) {
        let mut before = path[0];
        for (index, item) in group.0.iter().enumerate() {
            before = take(road, before, item)
                .ok_or_else(|| malformed(format!("{name} {index} on road {} is out of range or incomplete", road.0)))?;
        }
    }
    Ok(())
}

/// Where the marks of a line begin and end.
fn marks_of_line(marks: &Marks, grid: Grid) -> Result<Vec<[f64; 2]>> {
    let (mut end, mut gap, mut length) = (0_i64, 0, 0);
    let mut next = |[gap_change, length_change]: &[Signed; 2]| {
        (gap, length) = (gap + gap_change.0, length + length_change.0);
        let from = end + gap;
        end = from + length;
        let is_in_range = [gap, length, from, end].iter().all(|&value| i32::try_from(value).is_ok());
        is_in_range.then(|| [from, end].map(|place| grid.metres(place)))
    };
    marks.0.iter().map(&mut next).collect::<Option<_>>().ok_or_else(|| malformed("a mark is out of range".into()))
}

fn vertices(from: GridPoint, line: &Polyline, least: usize, name: impl Fn() -> String) -> Result<Vec<GridPoint>> {
    if line.steps.len() < least {
        return Err(malformed(format!("{} has too few vertices", name())));
    }
    let mut points = Vec::with_capacity(line.steps.len());
    let (mut at, mut last_step) = (from, [0; 3]);
    for (index, step) in line.steps.iter().enumerate() {
        let mut step = step.map(|number| number.0);
        if line.second_order && index >= 2 {
            step = [0, 1, 2].map(|axis| step[axis] + last_step[axis]);
        }
        at = in_range([0, 1, 2].map(|axis| at[axis] + step[axis]))
            .ok_or_else(|| malformed(format!("{} has a vertex out of range", name())))?;
        last_step = step;
        points.push(at);
    }
    Ok(points)
}

fn add(point: GridPoint, step: Step) -> Option<GridPoint> {
    in_range([0, 1, 2].map(|axis| point[axis] + step[axis].0))
}

/// The point, if all its coordinates fit into 32 bits.
fn in_range(point: GridPoint) -> Option<GridPoint> {
    point.iter().all(|&value| i32::try_from(value).is_ok()).then_some(point)
}

fn malformed(what: String) -> Error {
    Error::MapMalformed { what }
}
