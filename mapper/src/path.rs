//! The driven path on the ground plane: station along it, offset beside it.

mod quick;

use std::ops::RangeInclusive;

use nalgebra::{Point, Point2, Point3, Vector2, distance};

pub(crate) use self::quick::QuickPath;
use crate::grid::Grid;

/// The way along places that follow each other: it goes on where one is farther than
/// [`SHORTEST_STEP_M`] from the last that it counted. So a vehicle that stands drives
/// no way, however its positions shake.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Way<const D: usize> {
    counted: Option<Point<f64, D>>,
    driven_m: f64,
}

impl<const D: usize> Way<D> {
    /// Way to the next place, metres: never less than that to the place before.
    pub fn to(&mut self, place: Point<f64, D>) -> f64 {
        let step_m = self.counted.map_or(f64::INFINITY, |counted| distance(&counted, &place));
        if step_m > SHORTEST_STEP_M {
            self.driven_m += self.counted.map_or(0.0, |_| step_m);
            self.counted = Some(place);
        }
        self.driven_m
    }
}

/// A place relative to the path: `station_m` along it from its first vertex,
/// `offset_m` to the right of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPlace {
    /// Distance along the path, metres; negative before its start.
    pub station_m: f64,
    /// Distance to the right of the path, metres; negative to the left.
    pub offset_m: f64,
    /// Unit direction of the path there, map (x, z).
    pub direction: Vector2<f64>,
}

/// The driven path, straight on beyond both ends. Map axes: x right, z
/// forward, y down; the path keeps the camera's y.
#[derive(Debug, Clone)]
pub struct Path {
    vertices: Vec<Point3<f64>>,
    stations_m: Vec<f64>,
    segments: Vec<Segment>,
}

/// A straight piece between two vertices, on the ground plane.
#[derive(Debug, Clone, Copy)]
struct Segment {
    start: Point2<f64>,
    /// Of unit length.
    direction: Vector2<f64>,
    length_m: f64,
}

impl Segment {
    /// Distance of a point along its line, metres.
    fn along_m(&self, p: &Point2<f64>) -> f64 {
        (p - self.start).dot(&self.direction)
    }

    /// Distance along it of the place nearest to a point, and the square of
    /// the point's distance from there.
    fn nearest(&self, p: &Point2<f64>) -> (f64, f64) {
        let along_m = self.along_m(p).clamp(0.0, self.length_m);
        (along_m, (p - (self.start + self.direction * along_m)).norm_squared())
    }
}

/// Steps shorter than this say more about noise than about direction.
const SHORTEST_STEP_M: f64 = 0.5;
/// Length over which the direction of the straight continuation is taken.
const END_DIRECTION_M: f64 = 5.0;

fn ground(p: &Point3<f64>) -> Point2<f64> {
    Point2::new(p.x, p.z)
}

impl Path {
    /// The path through camera centres (map frame, metres), continued
    /// straight by `beyond_m` at both ends. Fewer than two distinct centres
    /// give a path along map z.
    pub fn new(centres_map: &[Point3<f64>], beyond_m: f64) -> Self {
        let mut vertices: Vec<Point3<f64>> = Vec::new();
        for p in centres_map {
            if vertices.last().is_none_or(|q| (ground(p) - ground(q)).norm() > SHORTEST_STEP_M) {
                vertices.push(*p);
            }
        }
        if vertices.len() < 2 {
            let p = vertices.first().copied().unwrap_or_else(Point3::origin);
            vertices = vec![p, p + nalgebra::Vector3::z()];
        }
        let continued = |mut from: Box<dyn Iterator<Item = &Point3<f64>> + '_>| {
            let end = *from.next()?;
            let inner = *from.find(|p| (ground(p) - ground(&end)).norm() > END_DIRECTION_M)?;
            Some(end + (end - inner) * (beyond_m / (end - inner).norm()))
        };
        let simple = |end: Point3<f64>, inner: Point3<f64>| end + (end - inner) * (beyond_m / (end - inner).norm());
        let n = vertices.len();
        let before = continued(Box::new(vertices.iter())).unwrap_or_else(|| simple(vertices[0], vertices[1]));
        let after =
            continued(Box::new(vertices.iter().rev())).unwrap_or_else(|| simple(vertices[n - 1], vertices[n - 2]));
        if beyond_m > 0.0 {
            vertices.insert(0, before);
            vertices.push(after);
        }
        let mut stations_m = Vec::with_capacity(vertices.len());
        let mut station = if beyond_m > 0.0 { -beyond_m } else { 0.0 };
        for (i, v) in vertices.iter().enumerate() {
            if i > 0 {
                station += (ground(v) - ground(&vertices[i - 1])).norm();
            }
            stations_m.push(station);
        }
        let segments = vertices
            .windows(2)
            .zip(stations_m.windows(2))
            .map(|(v, s)| {
                let (start, length_m) = (ground(&v[0]), s[1] - s[0]);
                Segment { start, direction: (ground(&v[1]) - start) / length_m, length_m }
            })
            .collect();
        Self { vertices, stations_m, segments }
    }

    /// Station of the last vertex, metres.
    pub fn end_station_m(&self) -> f64 {
        self.stations_m.last().copied().unwrap_or(0.0)
    }

    /// Station of the first vertex, metres.
    pub fn start_station_m(&self) -> f64 {
        self.stations_m.first().copied().unwrap_or(0.0)
    }

    /// The vertices, map frame, metres.
    pub fn vertices(&self) -> &[Point3<f64>] {
        &self.vertices
    }

    /// The place of a point given by its map (x, z).
    pub fn place(&self, p: &Point2<f64>) -> PathPlace {
        self.place_beside(p, 0..self.segments.len())
    }

    /// The nearest of some of the segments, of equally near ones the first; the
    /// distance along it, metres, and the square of that from it.
    fn nearest(&self, p: &Point2<f64>, among: impl IntoIterator<Item = usize>) -> (usize, f64, f64) {
        let mut best = (0, 0.0, f64::INFINITY);
        for i in among {
            let (along_m, squared) = self.segments[i].nearest(p);
            if squared < best.2 {
                best = (i, along_m, squared);
            }
        }
        best
    }

    /// Those of some segments that may be nearest to a point within a distance
    /// (metres) of `middle`: from where all such points have passed one and lie beside
    /// the next, that is the nearer one, and likewise backwards.
    fn between(&self, among: RangeInclusive<usize>, middle: &Point2<f64>, within_m: f64) -> RangeInclusive<usize> {
        let (mut first, mut last) = among.into_inner();
        let is_past = |i: usize| {
            let (segment, next) = (&self.segments[i], &self.segments[i + 1]);
            segment.along_m(middle) > segment.length_m + within_m && next.along_m(middle) > within_m + ROUNDING_M
        };
        let is_before = |i: usize| {
            let (segment, last) = (&self.segments[i], &self.segments[i - 1]);
            segment.along_m(middle) < -within_m && last.along_m(middle) < last.length_m - within_m - ROUNDING_M
        };
        while first < last && is_past(first) {
            first += 1;
        }
        while first < last && is_before(last) {
            last -= 1;
        }
        first..=last
    }

    /// The place of a point beside the nearest of some of the segments.
    fn place_beside(&self, p: &Point2<f64>, among: impl IntoIterator<Item = usize>) -> PathPlace {
        let (i, along_m, squared) = self.nearest(p, among);
        let segment = &self.segments[i];
        // Right of (dx, dz) seen from above, y down: (dz, -dx).
        let right = Vector2::new(segment.direction.y, -segment.direction.x);
        PathPlace {
            station_m: self.stations_m[i] + along_m,
            offset_m: squared.sqrt().copysign((p - segment.start).dot(&right)),
            direction: segment.direction,
        }
    }

    /// Point of the path at a station (camera height), map frame, metres, and
    /// the path's direction there in map (x, z).
    pub fn at(&self, station_m: f64) -> (Point3<f64>, Vector2<f64>) {
        let i = self.stations_m.partition_point(|s| *s <= station_m).clamp(1, self.vertices.len() - 1);
        let (a, b) = (self.vertices[i - 1], self.vertices[i]);
        let length = self.stations_m[i] - self.stations_m[i - 1];
        let point = a + (b - a) * ((station_m - self.stations_m[i - 1]) / length);
        (point, (ground(&b) - ground(&a)) / length)
    }

    /// The map point at a place beside the path, at the path's height.
    pub fn beside(&self, station_m: f64, offset_m: f64) -> Point3<f64> {
        let (p, direction) = self.at(station_m);
        Point3::new(p.x + direction.y * offset_m, p.y, p.z - direction.x * offset_m)
    }
}

/// The path's places by cell of a grid, for clouds of points: only the
/// segments near that of a cell's centre are looked at.
#[derive(Debug, Clone)]
pub struct PathIndex {
    grid: Grid,
    /// For each cell the first of the segments looked at, and how many they are.
    segments: Vec<(u32, u8)>,
}

/// Segments to each side of that nearest to a cell's centre that are looked at.
const BESIDE: usize = 2;
/// A difference along the path that tells more than rounding does, metres: its
/// square is a difference of squares of some hundred metres.
const ROUNDING_M: f64 = 1e-3;

/// Cells along the edge of a block that shares the segments looked at.
const BLOCK: usize = 8;

impl PathIndex {
    /// Indexes a path over a grid of cells not much longer than its segments.
    pub fn new(path: &Path, grid: &Grid) -> Self {
        let mut segments = vec![(0, 0); grid.len()];
        // Points of a cell lie within this of its centre, metres.
        let within_m = grid.cell_m * std::f64::consts::FRAC_1_SQRT_2 + ROUNDING_M;
        // Cell centres of a block lie within this of its middle, metres.
        let reach_m = 0.5 * BLOCK as f64 * grid.cell_m * std::f64::consts::SQRT_2;
        let mut distances_m = vec![0.0; path.segments.len()];
        let mut near = Vec::new();
        for low_z in (0..grid.height).step_by(BLOCK) {
            for low_x in (0..grid.width).step_by(BLOCK) {
                let half = Vector2::repeat(0.5 * (BLOCK - 1) as f64 * grid.cell_m);
                let middle = grid.centre(low_z * grid.width + low_x) + half;
                for (distance_m, segment) in distances_m.iter_mut().zip(&path.segments) {
                    *distance_m = segment.nearest(&middle).1.sqrt();
                }
                // What is farther off the middle is farther off every centre.
                let farthest_m = distances_m.iter().copied().fold(f64::INFINITY, f64::min) + 2.0 * reach_m;
                near.clear();
                near.extend((0..distances_m.len()).filter(|i| distances_m[*i] <= farthest_m));
                for z in low_z..(low_z + BLOCK).min(grid.height) {
                    for x in low_x..(low_x + BLOCK).min(grid.width) {
                        let cell = z * grid.width + x;
                        let centre = grid.centre(cell);
                        let nearest = path.nearest(&centre, near.iter().copied()).0;
                        let last = (nearest + BESIDE).min(path.segments.len() - 1);
                        let looked_at = path.between(nearest.saturating_sub(BESIDE)..=last, &centre, within_m);
                        let (first, count) = (*looked_at.start(), looked_at.end() + 1 - looked_at.start());
                        segments[cell] = (first as u32, count as u8);
                    }
                }
            }
        }
        Self { grid: grid.clone(), segments }
    }

    /// As [`Path::place`]; none outside the grid.
    pub fn place(&self, path: &Path, p: &Point2<f64>) -> Option<PathPlace> {
        let (first, count) = self.segments[self.grid.index(p)?];
        let first = first as usize;
        Some(path.place_beside(p, first..first + usize::from(count)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bend() -> Path {
        let centres: Vec<_> = (0..60)
            .map(|i| {
                let a = f64::from(i) * 0.02;
                Point3::new(50.0 * (1.0 - a.cos()), 0.1 * a, 50.0 * a.sin())
            })
            .collect();
        Path::new(&centres, 20.0)
    }

    #[test]
    fn place_undoes_beside_on_a_bend() {
        let path = bend();
        for (s, d) in [(-10.0, 3.0), (5.0, -4.0), (30.0, 7.5), (45.0, -9.0), (65.0, 2.0)] {
            let p = path.beside(s, d);
            let place = path.place(&Point2::new(p.x, p.z));
            // The vertices of the polyline leave a wedge of a few centimetres.
            assert!((place.station_m - s).abs() < 0.15, "{s} {d} {place:?}");
            assert!((place.offset_m - d).abs() < 0.02, "{s} {d} {place:?}");
        }
    }

    #[test]
    fn the_index_finds_the_same_places() {
        // Places that a vehicle drives through fast, slowly, and around a bend of 12 m.
        let fast: Vec<_> = (0..40).map(|i| Point3::new(0.3 * f64::from(i % 2), 0.0, 2.4 * f64::from(i))).collect();
        let slow: Vec<_> = (0..90).map(|i| Point3::new(0.05 * f64::from(i % 3), 0.0, 0.6 * f64::from(i))).collect();
        let around = |i: i32| Point3::new(12.0 * (0.1 * f64::from(i)).cos(), 0.0, 12.0 * (0.1 * f64::from(i)).sin());
        let sharp: Vec<_> = (0..25).map(around).collect();
        let paths = [bend(), Path::new(&fast, 20.0), Path::new(&slow, 20.0), Path::new(&sharp, 20.0)];
        for path in &paths {
            let grid = Grid::covering(Point2::new(-40.0, -40.0), Point2::new(60.0, 120.0), 1.0);
            let index = PathIndex::new(path, &grid);
            let beside = path.segments.len() as f64 * 2.5;
            for i in 0..4000 {
                let t = f64::from(i);
                let p = path.beside((t * 0.029) % beside - 15.0, (t * 1.7) % 24.0 - 12.0);
                let p = Point2::new(p.x, p.z);
                // As if all segments beside the nearest to the cell's centre were looked at.
                let Some(cell) = grid.index(&p) else { continue };
                let nearest = path.nearest(&grid.centre(cell), 0..path.segments.len()).0;
                let near = nearest.saturating_sub(BESIDE)..(nearest + BESIDE + 1).min(path.segments.len());
                assert_eq!(index.place(path, &p), Some(path.place_beside(&p, near)));
            }
        }
        let index = PathIndex::new(&paths[0], &Grid::covering(Point2::new(-20.0, -20.0), Point2::new(60.0, 70.0), 1.0));
        for i in 0..400 {
            let t = f64::from(i);
            let p = paths[0].beside((t * 0.29) % 70.0 - 10.0, (t * 1.7) % 24.0 - 12.0);
            let p = Point2::new(p.x, p.z);
            assert_eq!(index.place(&paths[0], &p), Some(paths[0].place(&p)));
        }
    }

    #[test]
    fn right_is_positive() {
        let path = Path::new(&[Point3::origin(), Point3::new(0.0, 0.0, 9.0)], 0.0);
        assert!(path.place(&Point2::new(2.0, 4.0)).offset_m > 1.9);
    }

    #[test]
    fn a_vehicle_that_stands_drives_no_way() {
        let mut way = Way::default();
        let shaking = |i: i32| Point2::new(0.02 * f64::from(i % 3), 0.03 * f64::from(i % 2));
        let ways_m: Vec<f64> = (0..1800).map(|i| way.to(shaking(i))).collect();
        assert!(ways_m.iter().all(|way_m| *way_m < 1e-12));
        let on = [way.to(Point2::new(0.0, 2.0)), way.to(Point2::new(0.0, 1.8)), way.to(Point2::new(0.0, 3.5))];
        assert!(on.iter().zip([2.0, 2.0, 3.5]).all(|(found, true_m)| (found - true_m).abs() < 1e-12), "{on:?}");
    }

    #[test]
    fn a_vehicle_that_stands_still_has_a_path() {
        let path = Path::new(&[Point3::origin(); 5], 10.0);
        assert!(path.place(&Point2::new(1.0, 1.0)).offset_m.is_finite());
    }
}
