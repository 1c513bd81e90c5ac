//! From a checked map to bytes.

use nalgebra::Point3;

use super::envelope::{Form, seal};
use super::grid::{Grid, GridPoint, RoadFrame};
use super::pole::{GridPole, Leans};
use super::varint::{Signed, Unsigned};
use super::wire::{self, Body, ByRoad, Head, List, Marks, Polyline, Step};
use super::{EncodeOptions, LaneKind, MAX_NOTE_BYTES, PoleKind, RoadId, SemanticMap, SignKind};
use crate::{Error, Result};

impl SemanticMap {
    /// The bytes of a map file. They depend on the set of landmarks and not on
    /// their order; every coordinate and size is rounded to the quantum, every
    /// lean to a thousandth of the pole's height.
    ///
    /// # Errors
    /// [`Error::MapUnencodable`], naming the item, where a coordinate is not
    /// finite or does not fit, a [`RoadId`] has no road, a pole's top is below
    /// its foot or far aside of it, a road has no vertex or a lane line fewer
    /// than two, marks are not in order or not of a dashed line, the note is too
    /// long or the quantum is no quantum.
    pub fn encode(&self, options: &EncodeOptions) -> Result<Vec<u8>> {
        self.encode_with(Leans::Thousandths, *options)
    }

    /// The same with the leans of poles as other versions have them.
    pub(super) fn encode_with(&self, leans: Leans, options: EncodeOptions) -> Result<Vec<u8>> {
        let body = body(self, Grid::from_m(options.quantum_m)?, leans)?;
        let form = Form { has_marks: body.marks.is_some(), has_kerbs: body.kerbs.is_some(), leans };
        seal(form, &body.to_bytes()?)
    }
}

/// The centroid and the size.
type GridSign = (GridPoint, u64);

/// The vertices, and where marks begin and end along them.
type GridLane = (Vec<GridPoint>, Vec<[i64; 2]>);

/// Landmarks on the grid, as they come.
type Unsorted<K, T> = Vec<(K, RoadId, T)>;

fn body(map: &SemanticMap, grid: Grid, leans: Leans) -> Result<Body> {
    let roads = roads(map, grid)?;
    let frames: Vec<RoadFrame> = roads.iter().filter_map(|path| RoadFrame::of(path)).collect();
    let (poles, signs, lanes) = (poles(map, grid, leans)?, signs(map, grid)?, lanes(map, grid)?);
    let head = head(map, corners_around(map, &poles, grid, leans)?, grid)?;
    let poles = by_kind_and_road(PoleKind::ALL, &poles, &frames, |pole: &GridPole| pole.foot)?;
    let signs = by_kind_and_road(SignKind::ALL, &signs, &frames, |sign: &GridSign| sign.0)?;
    let [solid, dashed, kerbs] = by_kind_and_road(LaneKind::ALL, &lanes, &frames, |lane: &GridLane| lane.0[0])?;
    let kerbs = (!kerbs.is_empty()).then_some(kerbs);
    // Where there are kerbs the section of marks is there, too, be it empty.
    let marks = marks(&dashed).or_else(|| kerbs.as_ref().map(|_| List(Vec::new())));
    let lines = |groups: Vec<Vec<GridLane>>| {
        steps(groups, &frames, |before, (line, _): &GridLane| (polyline(before, line), line[0]))
    };
    let mut end = [0; 3];
    let roads = roads
        .iter()
        .map(|path| {
            let line = polyline(end, path);
            end = path[path.len() - 1];
            line
        })
        .collect();
    Ok(Body {
        head,
        roads: List(roads),
        poles: poles.map(|groups| {
            steps(groups, &frames, |before, &GridPole { foot, height, lean }| {
                let pole = wire::Pole {
                    foot: step(before, foot),
                    height: Unsigned(height.cast_unsigned()),
                    lean: lean.map(Signed),
                };
                (pole, foot)
            })
        }),
        signs: signs.map(|groups| {
            steps(groups, &frames, |before, &(centroid, size)| {
                (wire::Sign { centroid: step(before, centroid), size: Unsigned(size) }, centroid)
            })
        }),
        lanes: [solid, dashed].map(lines),
        marks,
        kerbs: kerbs.map(lines),
    })
}

/// Smallest and largest coordinates on the grid of anything in a map as it is
/// stored; none for an empty one.
pub(super) fn corners(map: &SemanticMap, grid: Grid) -> Result<Option<[GridPoint; 2]>> {
    corners_around(map, &poles(map, grid, Leans::Thousandths)?, grid, Leans::Thousandths)
}

/// The same with its poles as they are stored.
fn corners_around(
    map: &SemanticMap,
    poles: &Unsorted<PoleKind, GridPole>,
    grid: Grid,
    leans: Leans,
) -> Result<Option<[GridPoint; 2]>> {
    let tops_map: Vec<Point3<f64>> = poles.iter().filter_map(|(_, _, pole)| pole.top_m(grid, leans)).collect();
    let corner = |point: &Point3<f64>| grid.point(point, || "the corner of the map".to_owned());
    let around = map.bounds_with(tops_map.iter());
    around.map(|bounds| Ok([corner(&bounds.min_map)?, corner(&bounds.max_map)?])).transpose()
}

fn head(map: &SemanticMap, corners: Option<[GridPoint; 2]>, grid: Grid) -> Result<Head> {
    if let Some(fault) = super::note_fault(&map.frame_note) {
        return Err(unencodable(format!("{fault}; shorten or correct it (at most {MAX_NOTE_BYTES} bytes)")));
    }
    let [min, max] = corners.unwrap_or_default();
    Ok(Head {
        quantum_um: Unsigned(grid.quantum_um()),
        frame_note: List(map.frame_note.as_bytes().to_vec()),
        min: min.map(Signed),
        extent: [0, 1, 2].map(|axis| Unsigned((max[axis] - min[axis]) as u64)),
    })
}

fn roads(map: &SemanticMap, grid: Grid) -> Result<Vec<Vec<GridPoint>>> {
    let road = |(index, road): (usize, &super::Road)| {
        if road.path_map.is_empty() {
            return Err(unencodable(format!("road {index} has no vertex; remove it")));
        }
        road.path_map.iter().map(|point| grid.point(point, || format!("road {index}"))).collect()
    };
    map.roads.iter().enumerate().map(road).collect()
}

fn poles(map: &SemanticMap, grid: Grid, leans: Leans) -> Result<Unsorted<PoleKind, GridPole>> {
    let pole = |(index, pole): (usize, &super::Pole)| {
        Ok((pole.kind, pole.road, GridPole::of(pole, grid, leans, || format!("pole {index}"))?))
    };
    map.poles.iter().enumerate().map(pole).collect()
}

fn signs(map: &SemanticMap, grid: Grid) -> Result<Unsorted<SignKind, GridSign>> {
    let sign = |(index, sign): (usize, &super::Sign)| {
        let centroid = grid.point(&sign.centroid_map, || format!("sign {index}"))?;
        let size = grid.quanta(sign.size_m, || format!("size of sign {index}"))?;
        let size = u64::try_from(size)
            .map_err(|_| unencodable(format!("the size of sign {index} is {} m; correct it", sign.size_m)))?;
        Ok((sign.kind, sign.road, (centroid, size)))
    };
    map.signs.iter().enumerate().map(sign).collect()
}

fn lanes(map: &SemanticMap, grid: Grid) -> Result<Unsorted<LaneKind, GridLane>> {
    let lane = |(index, lane): (usize, &super::LaneLine)| {
        if lane.points_map.len() < 2 {
            return Err(unencodable(format!("lane line {index} has fewer than two vertices; remove it")));
        }
        let points: Result<Vec<_>> =
            lane.points_map.iter().map(|point| grid.point(point, || format!("lane line {index}"))).collect();
        let is_apart = |pair: &[[f64; 2]]| pair[0][1] <= pair[1][0];
        let is_ordered = lane.marks_m.iter().all(|[from, to]| from <= to) && lane.marks_m.windows(2).all(is_apart);
        if !is_ordered || (lane.kind != LaneKind::Dashed && !lane.marks_m.is_empty()) {
            let what = format!("the marks of lane line {index} are not in order, or it is not dashed; remove them");
            return Err(unencodable(what));
        }
        let marks = grid_marks(&lane.marks_m, grid, || format!("a mark of lane line {index}"))?;
        Ok((lane.kind, lane.road, (points?, marks)))
    };
    map.lanes.iter().enumerate().map(lane).collect()
}

/// Marks on the grid: those that touch there are one, and one without length is
/// none.
fn grid_marks(marks_m: &[[f64; 2]], grid: Grid, name: impl Fn() -> String) -> Result<Vec<[i64; 2]>> {
    let mut marks: Vec<[i64; 2]> = Vec::with_capacity(marks_m.len());
    for [from_m, to_m] in marks_m {
        let (from, to) = (grid.quanta(*from_m, &name)?, grid.quanta(*to_m, &name)?);
        match marks.last_mut() {
            Some(before) if from <= before[1] => before[1] = before[1].max(to),
            _ if from < to => marks.push([from, to]),
            _ => {}
        }
    }
    Ok(marks)
}

/// The marks of the dashed lines up to the last that has some; `None` where
/// none has.
fn marks(dashed: &[Vec<GridLane>]) -> Option<List<Marks>> {
    let mut lines: Vec<Marks> = dashed.iter().flatten().map(|(_, marks)| marks_of_line(marks)).collect();
    let count = lines.iter().rposition(|line| !line.0.is_empty())? + 1;
    lines.truncate(count);
    Some(List(lines))
}

fn marks_of_line(marks: &[[i64; 2]]) -> Marks {
    let (mut end, mut gap, mut length) = (0, 0, 0);
    let mut next = |&[from, to]: &[i64; 2]| {
        let change = [Signed(from - end - gap), Signed(to - from - length)];
        (end, gap, length) = (to, from - end, to - from);
        change
    };
    List(marks.iter().map(&mut next).collect())
}

/// Landmarks by kind, then by road up to the last with some, then in driving
/// order, then by value: one order for any order of the input.
fn by_kind_and_road<K: Copy + PartialEq, T: Clone + Ord, const N: usize>(
    kinds: [K; N],
    landmarks: &[(K, RoadId, T)],
    frames: &[RoadFrame],
    anchor: impl Fn(&T) -> GridPoint,
) -> Result<[Vec<Vec<T>>; N]> {
    let mut sorted = kinds.map(|_| Vec::new());
    for (groups, kind) in sorted.iter_mut().zip(kinds) {
        for (_, RoadId(road), landmark) in landmarks.iter().filter(|landmark| landmark.0 == kind) {
            let road = *road as usize;
            if road >= frames.len() {
                let what = format!("a landmark is on road {road} and there are {} roads; add the road", frames.len());
                return Err(unencodable(what));
            }
            if groups.len() <= road {
                groups.resize(road + 1, Vec::new());
            }
            groups[road].push(landmark.clone());
        }
        for (group, frame) in groups.iter_mut().zip(frames) {
            group.sort_by(|a, b| frame.along(anchor(a)).cmp(&frame.along(anchor(b))).then_with(|| a.cmp(b)));
        }
    }
    Ok(sorted)
}

/// Every landmark as a step from the one before it on its road, the first
/// from the road's origin. `wire` also gives the point to go on from.
fn steps<T, W>(groups: Vec<Vec<T>>, frames: &[RoadFrame], wire: impl Fn(GridPoint, &T) -> (W, GridPoint)) -> ByRoad<W> {
    let group = |(group, frame): (Vec<T>, &RoadFrame)| {
        let mut before = frame.origin;
        let mut next = |landmark: &T| {
            let (item, anchor) = wire(before, landmark);
            before = anchor;
            item
        };
        List(group.iter().map(&mut next).collect())
    };
    List(groups.into_iter().zip(frames).map(group).collect())
}

fn step(from: GridPoint, to: GridPoint) -> Step {
    [0, 1, 2].map(|axis| Signed(to[axis] - from[axis]))
}

/// A polyline in the shorter of its two forms, the first where both are equal.
fn polyline(from: GridPoint, vertices: &[GridPoint]) -> Polyline {
    let mut before = from;
    let mut steps = Vec::with_capacity(vertices.len());
    for &vertex in vertices {
        steps.push(step(before, vertex));
        before = vertex;
    }
    let mut changes = steps.clone();
    for index in 2..steps.len() {
        changes[index] = [0, 1, 2].map(|axis| Signed(steps[index][axis].0 - steps[index - 1][axis].0));
    }
    let length = |steps: &[Step]| -> usize { steps.iter().flatten().map(|number| number.len()).sum() };
    let second_order = length(&changes) < length(&steps);
    Polyline { second_order, steps: if second_order { changes } else { steps } }
}

fn unencodable(what: String) -> Error {
    Error::MapUnencodable { what }
}
