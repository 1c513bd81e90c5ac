//! Which landmark of a map a point lies on.

use common::geometry::{above, distance_to_segment};
use common::map::{Numbering, SemanticMap};
use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::classes::{LANE_PAINT, POLE, POLE_RADIUS_M, SIGN, SIGN_MARGIN_M};

/// Side of a cell in which landmarks are looked up, metres.
const CELL_M: f64 = 4.0;
/// What a landmark of the map may be off the one that a window found, metres:
/// its rounding, and what merging it with others changed.
const MOVED_M: f64 = 0.05;
/// Paint is of a lane line no farther above or below it than this, metres: less
/// than between the levels of a road.
const LEVEL_M: f64 = 1.0;

/// A landmark's number, and a part of it: a segment, and how far points of it
/// may be from it.
#[derive(Debug, Clone, Copy)]
struct Part {
    number: u32,
    ends: [Point3<f64>; 2],
    radius_m: f64,
}

/// The landmarks of a map by place.
#[derive(Debug, Default)]
pub struct LandmarkIndex {
    poles: Parts,
    signs: Parts,
    lanes: Parts,
}

impl LandmarkIndex {
    /// The landmarks of a map, as it is read from its file; paint of a lane
    /// line is up to `half_line_m` from its middle.
    pub fn new(map: &SemanticMap, half_line_m: f64) -> Self {
        let numbers = Numbering::of(map);
        let mut index = Self::default();
        for (i, pole) in map.poles.iter().enumerate() {
            index.poles.add(numbers.pole(i), [pole.foot_map, pole.top_map], POLE_RADIUS_M);
        }
        for (i, sign) in map.signs.iter().enumerate() {
            let radius_m = 0.5 * sign.size_m + SIGN_MARGIN_M;
            index.signs.add(numbers.sign(i), [sign.centroid_map; 2], radius_m);
        }
        for (i, lane) in map.lanes.iter().enumerate().filter(|(_, lane)| lane.kind.is_painted()) {
            for ends in lane.points_map.windows(2) {
                index.lanes.add(numbers.lane(i), [ends[0], ends[1]], half_line_m);
            }
        }
        index
    }

    /// The number of the landmark that a point (map frame, metres) of a class
    /// lies on; 0 for none.
    pub fn number(&self, class: u8, at: &Point3<f64>) -> u32 {
        match class {
            POLE..SIGN => self.poles.nearest(at, distance_to_segment),
            SIGN..LANE_PAINT => self.signs.nearest(at, distance_to_segment),
            LANE_PAINT => self.lanes.nearest(at, distance_on_level_m),
            _ => 0,
        }
    }
}

/// Parts of landmarks by the cells that they reach.
#[derive(Debug, Default)]
struct Parts {
    parts: Vec<Part>,
    by_cell: FxHashMap<(i64, i64), Vec<u32>>,
}

impl Parts {
    fn add(&mut self, number: usize, ends: [Point3<f64>; 2], radius_m: f64) {
        let index = self.parts.len() as u32;
        let radius_m = radius_m + MOVED_M;
        self.parts.push(Part { number: number as u32, ends, radius_m });
        let cells = |a: f64, b: f64| cell(a.min(b) - radius_m)..=cell(a.max(b) + radius_m);
        for x in cells(ends[0].x, ends[1].x) {
            for z in cells(ends[0].z, ends[1].z) {
                self.by_cell.entry((x, z)).or_default().push(index);
            }
        }
    }

    /// The nearest, by a distance in metres, of those that reach a point, the
    /// first of several.
    fn nearest(&self, at: &Point3<f64>, distance_m: impl Fn(&Point3<f64>, [&Point3<f64>; 2]) -> f64) -> u32 {
        let mut best = (f64::INFINITY, 0);
        for index in self.by_cell.get(&(cell(at.x), cell(at.z))).into_iter().flatten() {
            let Some(part) = self.parts.get(*index as usize) else { continue };
            let off_m = distance_m(at, part.ends.each_ref());
            if off_m <= part.radius_m && off_m < best.0 {
                best = (off_m, part.number);
            }
        }
        best.1
    }
}

fn cell(metres: f64) -> i64 {
    (metres / CELL_M).floor() as i64
}

/// Distance of a point from a segment of a lane line, seen from above, metres;
/// infinite where it is on another level.
fn distance_on_level_m(p: &Point3<f64>, [a, b]: [&Point3<f64>; 2]) -> f64 {
    let (from, to, at) = (above(a), above(b), above(p));
    let way = to - from;
    let share = ((at - from).dot(&way) / way.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    let line_y = a.y + (b.y - a.y) * share;
    if (line_y - p.y).abs() <= LEVEL_M { (from + way * share - at).norm() } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::map::{LaneKind, LaneLine, RoadId, Sign, SignKind};

    #[test]
    fn the_nearest_landmark_of_the_class_is_told() {
        let road = RoadId(0);
        let lane = |x: f64| LaneLine {
            kind: LaneKind::Solid,
            points_map: vec![Point3::new(x, 1.6, -30.0), Point3::new(x, 1.8, 50.0)],
            road,
            marks_m: Vec::new(),
        };
        // On a deck over the first.
        let mut raised = lane(2.02);
        raised.points_map.iter_mut().for_each(|p| p.y -= 5.5);
        let sign = |x| Sign { kind: SignKind::TrafficSign, centroid_map: Point3::new(x, -1.0, 3.0), size_m: 0.6, road };
        let map = SemanticMap {
            signs: vec![sign(5.0), sign(5.5)],
            lanes: vec![lane(2.0), lane(-2.0), raised],
            ..SemanticMap::default()
        };
        let index = LandmarkIndex::new(&map, 0.1);
        let at = |class, x, y, z| index.number(class, &Point3::new(x, y, z));
        assert_eq!((at(LANE_PAINT, 2.05, 1.2, 49.0), at(LANE_PAINT, -2.1, 1.7, -29.0)), (3, 4));
        assert_eq!((at(LANE_PAINT, 2.05, -3.8, 10.0), at(LANE_PAINT, 2.05, -1.0, 10.0)), (5, 0));
        assert_eq!((at(LANE_PAINT, 0.0, 1.7, 0.0), at(1, 2.0, 1.7, 0.0), at(POLE, 2.0, 1.7, 0.0)), (0, 0, 0));
        assert_eq!((at(SIGN, 5.1, -1.0, 3.0), at(SIGN + 1, 5.4, -1.0, 3.0), at(SIGN, 5.2, -3.0, 3.0)), (1, 2, 0));
    }
}
