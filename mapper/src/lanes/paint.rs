//! The road's points by their place beside an axis, and which are paint.

use rayon::prelude::*;

use nalgebra::{Point2, Vector2};

use super::LaneConfig;
use crate::by_cell::ByCell;
use crate::cloud::{Cloud, CloudPoint};
use crate::grid::Grid;
use crate::path::Path;

/// A ground point by its place beside the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Station along the path, metres.
    pub station_m: f64,
    /// Offset to the right of the path, metres.
    pub offset_m: f64,
    /// Height in the map frame, metres, up.
    pub height_m: f32,
    /// How much brighter than its beam on both sides, standard deviations.
    pub contrast: f32,
}

/// The road's points beside an axis.
pub struct Paint {
    /// Points of paint, sorted by station.
    pub bright: Vec<PathPoint>,
    /// All road points in range, for where paint could have been seen.
    pub road: RoadPoints,
}

/// Road points by cell of station and offset: a line is asked for what is
/// beside it, and most of the road is not.
pub struct RoadPoints {
    points: ByCell<RoadPoint>,
    /// Cells over (offset, station).
    grid: Grid,
}

/// A point of the road.
// All of them are lengths.
#[allow(clippy::struct_field_names)]
#[derive(Debug, Clone, Copy, Default)]
pub struct RoadPoint {
    /// Station along the path, metres.
    pub station_m: f32,
    /// Offset to the right of the path, metres.
    pub offset_m: f32,
    /// Height in the map frame, metres, up.
    pub height_m: f32,
}

/// Edge of the cells of road points, metres: as long as a line is asked for at
/// a time.
const CELL_M: f64 = 0.25;

impl RoadPoints {
    /// The points of the parts of a cloud, between two stations and as far beside
    /// them as is given, metres.
    fn new(parts: &[Vec<RoadPoint>], (from_m, to_m): (f64, f64), half_m: f64) -> Self {
        let grid = Grid::covering(Point2::new(-half_m, from_m), Point2::new(half_m, to_m), CELL_M);
        let cell = |p: &RoadPoint| grid.index(&Point2::new(f64::from(p.offset_m), f64::from(p.station_m)));
        // Found once: the sort asks twice.
        let cells: Vec<Option<u32>> = parts.iter().flatten().map(|p| cell(p).map(|cell| cell as u32)).collect();
        let cells = cells.iter().map(|cell| cell.map(|cell| cell as usize));
        Self { points: ByCell::new(&grid, cells.zip(parts.iter().flatten().copied())), grid }
    }

    /// The points in the cells that touch a rectangle of stations and offsets,
    /// metres, its last station left out: those in it, and a few more.
    pub fn near(&self, stations_m: [f64; 2], offsets_m: [f64; 2]) -> impl Iterator<Item = &RoadPoint> {
        // In cells; below 0 the casts give 0: the first one.
        let [from, to] = stations_m.map(|m| (m - self.grid.origin.y) / self.grid.cell_m);
        let [left, right] = offsets_m.map(|m| (m - self.grid.origin.x) / self.grid.cell_m);
        let rows = from as usize..(to.ceil() as usize).min(self.grid.height);
        let first = (left as usize).min(self.grid.width);
        let end = (right as usize + 1).clamp(first, self.grid.width);
        rows.flat_map(move |row| {
            let row = row * self.grid.width;
            self.points.of_cells(row + first..row + end)
        })
    }
}

impl Paint {
    /// The paint in a stitched cloud, by its place beside the driven path.
    pub fn of(cloud: &Cloud, config: &LaneConfig) -> Self {
        let place = |p: &CloudPoint| {
            let contrast = p.contrast.filter(|_| is_road(p, config))?;
            let place = cloud.place(&p.position);
            (place.offset_m.abs() < config.half_width_m).then_some(PathPoint {
                station_m: place.station_m,
                offset_m: place.offset_m,
                height_m: -p.position.y as f32,
                contrast,
            })
        };
        let split = |part: &[CloudPoint]| split(part.iter().filter_map(place), part.len(), config);
        Self::new(cloud.points.par_chunks(PART).map(split).collect(), &cloud.path, config.half_width_m)
    }

    /// The paint beside a straight path of another direction, as far as it goes: as far
    /// aside as lines are sought, and as far beyond as the bars of a crossing are that
    /// tell one of them from a line.
    pub fn beside(cloud: &Cloud, path: &Path, config: &LaneConfig) -> Self {
        let ends_m = path.start_station_m()..path.end_station_m();
        let half_m = config.half_width_m + config.fords.across_m[1];
        let (start, direction) = path.at(ends_m.start);
        let place = |p: &CloudPoint| {
            let contrast = p.contrast.filter(|_| is_road(p, config))?;
            let from_start = Vector2::new(p.position.x - start.x, p.position.z - start.z);
            let station_m = ends_m.start + from_start.dot(&direction);
            let offset_m = from_start.perp(&direction);
            let height_m = -p.position.y as f32;
            let is_beside = ends_m.contains(&station_m) && offset_m.abs() < half_m;
            is_beside.then_some(PathPoint { station_m, offset_m, height_m, contrast })
        };
        let corners =
            [ends_m.start, ends_m.end].map(|station_m| [-half_m, half_m].map(|side_m| path.beside(station_m, side_m)));
        let corners = corners.as_flattened().iter().map(|p| Point2::new(p.x, p.z));
        let beside = |p: &Point2<f64>, reach_m: f64| {
            let offset_m = Vector2::new(p.x - start.x, p.y - start.z).perp(&direction);
            offset_m.abs() < half_m + reach_m
        };
        let places = cloud.ground_around(corners, beside).filter_map(place);
        Self::new(vec![split(places, PART, config)], path, half_m)
    }

    fn new(parts: Vec<(Vec<PathPoint>, Vec<RoadPoint>)>, path: &Path, half_m: f64) -> Self {
        let (bright, road): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
        let mut bright = bright.concat();
        // Stable: points of one station keep the order of the scans.
        bright.sort_by(|a, b| a.station_m.total_cmp(&b.station_m));
        let stations_m = (path.start_station_m(), path.end_station_m() + CELL_M);
        Self { bright, road: RoadPoints::new(&road, stations_m, half_m) }
    }
}

/// The paint among placed points, and all of them: about so many.
fn split(
    places: impl Iterator<Item = PathPoint>,
    count: usize,
    config: &LaneConfig,
) -> (Vec<PathPoint>, Vec<RoadPoint>) {
    let (mut bright, mut road) = (Vec::new(), Vec::with_capacity(count));
    // From within: those of many cells are many short pieces.
    places.for_each(|p| {
        road.push(RoadPoint { station_m: p.station_m as f32, offset_m: p.offset_m as f32, height_m: p.height_m });
        if p.contrast >= config.least_contrast {
            bright.push(p);
        }
    });
    (bright, road)
}

/// Points of the cloud that are placed at a time.
const PART: usize = 1 << 14;

/// Whether a point lies on the ground and near enough for paint to be seen.
pub(super) fn is_road(p: &CloudPoint, config: &LaneConfig) -> bool {
    f64::from(p.height_m.abs()) < config.thickness_m && f64::from(p.range_m) < config.contrast.farthest_m
}

/// Points with stations in a range, of a list sorted by station.
pub(super) fn between(points: &[PathPoint], from_m: f64, to_m: f64) -> &[PathPoint] {
    let a = points.partition_point(|p| p.station_m < from_m);
    let b = points.partition_point(|p| p.station_m < to_m);
    &points[a..b.max(a)]
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::testing::{CAMERA_HEIGHT_M, Street};

    #[test]
    fn a_rectangle_of_the_road_has_all_of_its_points_once() {
        let config = LaneConfig::default();
        let point = |k: usize| RoadPoint {
            station_m: (k * 37 % 1000) as f32 * 0.05 - 5.0,
            offset_m: (k * 91 % 997) as f32 * 0.028 - 13.95,
            height_m: k as f32,
        };
        let parts: Vec<Vec<RoadPoint>> =
            (0..5).map(|part| (part * 800..(part + 1) * 800).map(point).collect()).collect();
        let road = RoadPoints::new(&parts, (-5.0, 45.5), config.half_width_m);
        for (stations_m, offsets_m) in
            [([3.1, 4.35], [-4.02, -1.0]), ([-5.0, -4.2], [-20.0, -12.0]), ([44.2, 60.0], [11.0, 20.0])]
        {
            let is_in = |p: &&RoadPoint| {
                (stations_m[0]..=stations_m[1]).contains(&f64::from(p.station_m))
                    && (offsets_m[0]..=offsets_m[1]).contains(&f64::from(p.offset_m))
            };
            let names = |points: Vec<&RoadPoint>| {
                let mut names: Vec<u32> = points.iter().map(|p| p.height_m as u32).collect();
                names.sort_unstable();
                names
            };
            let found = names(road.near(stations_m, offsets_m).filter(is_in).collect());
            assert_eq!(found, names(parts.iter().flatten().filter(is_in).collect()));
            assert!(!found.is_empty(), "{stations_m:?}");
            assert!(road.near(stations_m, offsets_m).count() < 400, "most of the road is not looked at");
        }
    }

    #[test]
    fn beside_the_farthest_line_there_is_the_paint_that_tells_whether_it_is_one() {
        let mut street = Street::new();
        for i in 0..1200_i32 {
            let x = f64::from(i) * 0.01 - 6.0;
            street.add(Point3::new(x, CAMERA_HEIGHT_M, 20.0), 3, 0.5, Some(8.0));
        }
        let (cloud, config) = (street.cloud(), LaneConfig { half_width_m: 3.0, ..LaneConfig::default() });
        let path = Path::new(&[Point3::new(0.0, 0.0, 10.0), Point3::new(0.0, 0.0, 30.0)], 0.0);
        let paint = Paint::beside(&cloud, &path, &config);
        let farthest_m = paint.bright.iter().map(|p| p.offset_m.abs()).fold(0.0, f64::max);
        let bars_m = config.half_width_m + config.fords.across_m[1];
        assert!(farthest_m > bars_m - 0.02 && farthest_m <= bars_m, "{farthest_m}");
    }
}
