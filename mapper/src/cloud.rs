//! The stitched cloud of one stretch of road.

use common::geometry::Pose;
use nalgebra::{Point2, Point3, Vector2};
use rayon::prelude::*;

use crate::by_cell::ByCell;
use crate::config::Config;
use crate::drive::Drive;
use crate::error::Result;
use crate::grid::Grid;
use crate::ground::{Ground, GroundConfig, Heights};
use crate::lanes::Contrasts;
use crate::lidar::Sensor;
use crate::path::{Path, PathIndex, PathPlace};
use crate::register::Registration;
use crate::sheeting::Glance;

/// A point of the stitched cloud.
#[derive(Debug, Clone, Copy)]
pub struct CloudPoint {
    /// Position, map frame, metres.
    pub position: Point3<f64>,
    /// Height above the ground, metres.
    pub height_m: f32,
    /// Reflectance, 0 to 1.
    pub reflectance: f32,
    /// Distance from the lidar, metres.
    pub range_m: f32,
    /// How much brighter than its beam on both sides, in standard deviations;
    /// none where the question makes no sense (walls, far points).
    pub contrast: Option<f32>,
    /// Which of the stitched scans it is from.
    pub scan: u16,
}

/// A scan of the stitched cloud, as it was read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StitchedScan {
    /// Its frame.
    pub frame: usize,
    /// Points that could be used.
    pub points: usize,
    /// Points dropped because a value of theirs is not finite.
    pub dropped_not_finite: usize,
    /// Points dropped because they are no returns or too far away.
    pub dropped_out_of_range: usize,
    /// Points dropped because their file says that they are withheld or noise.
    pub dropped_as_noise: usize,
}

/// The stitched cloud of one stretch of road, with its ground.
pub struct Cloud {
    /// Points in the order of the scans.
    pub points: Vec<CloudPoint>,
    /// The ground.
    pub ground: Ground,
    /// The driven path.
    pub path: Path,
    /// Its places, for points of the cloud.
    pub path_index: PathIndex,
    /// The lidar in each stitched scan.
    pub sensors: Vec<Sensor>,
    /// What each stitched scan counts where views are counted: those from one
    /// place count as one.
    pub view_weight: Vec<f64>,
    /// The stitched scans.
    pub scans: Vec<StitchedScan>,
    standing: ByCell<u32>,
    lying: ByCell<u32>,
}

/// What part of the world is stitched.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CloudConfig {
    /// Largest distance from the path, metres: landmarks farther off the road
    /// are hidden from it more often than not, and small in the image.
    pub half_width_m: f64,
    /// Length mapped beyond the first and the last stitched frame, metres.
    pub beyond_m: f64,
    /// Largest range of a point, metres: farther ones are too sparse for
    /// thin poles.
    pub max_range_m: f64,
    /// Smallest range, metres: nearer echoes are the carrier vehicle.
    pub min_range_m: f64,
    /// Most scans that are stitched from one place: a vehicle that stands sees
    /// the same again, for as long as it stands.
    pub most_from_one_place: usize,
}

impl Default for CloudConfig {
    fn default() -> Self {
        Self { half_width_m: 25.0, beyond_m: 40.0, max_range_m: 60.0, min_range_m: 2.5, most_from_one_place: 8 }
    }
}

/// The part of the ground plane beside a driven path.
#[derive(Debug, Clone)]
pub struct Corridor {
    /// The driven path.
    pub path: Path,
    /// Its places, for points of a cloud.
    pub path_index: PathIndex,
    /// Cells of the ground's height map.
    pub grid: Grid,
    inside: Vec<bool>,
}

impl Corridor {
    /// The corridor along camera centres (map frame, metres).
    pub fn new(centres_map: &[Point3<f64>], config: &CloudConfig, cell_m: f64) -> Self {
        let path = Path::new(centres_map, config.beyond_m);
        let mut low = Point2::new(f64::INFINITY, f64::INFINITY);
        let mut high = Point2::new(f64::NEG_INFINITY, f64::NEG_INFINITY);
        for v in path.vertices() {
            low = Point2::new(low.x.min(v.x), low.y.min(v.z));
            high = Point2::new(high.x.max(v.x), high.y.max(v.z));
        }
        let margin = Vector2::repeat(config.half_width_m);
        let grid = Grid::covering(low - margin, high + margin, cell_m);
        let path_index = PathIndex::new(&path, &grid);
        let inside = (0..grid.len())
            .map(|i| path_index.place(&path, &grid.centre(i)))
            .map(|place| place.is_some_and(|p| p.offset_m.abs() < config.half_width_m))
            .collect();
        Self { path, path_index, grid, inside }
    }

    /// Heights of points in it: none yet.
    fn heights(&self) -> Heights {
        Heights::new(&self.path, &self.path_index, self.grid.clone())
    }

    /// Whether a point (map frame, metres) lies in a cell of the corridor.
    pub fn contains(&self, p: &Point3<f64>) -> bool {
        self.grid.index(&Point2::new(p.x, p.z)).is_some_and(|i| self.inside[i])
    }
}

impl Cloud {
    /// Stitches `frames` of a drive at registered poses.
    ///
    /// # Errors
    /// A scan that cannot be read.
    pub fn stitch(drive: &Drive, frames: &[usize], registration: &Registration, settings: &Config) -> Result<Self> {
        let config = &settings.cloud;
        let map_from_camera = &registration.map_from_camera;
        let (first, last) = (frames.first().copied().unwrap_or(0), frames.last().copied().unwrap_or(0));
        let centres: Vec<Point3<f64>> =
            map_from_camera[first..=last].iter().map(|p| p.translation.vector.into()).collect();
        let corridor = Corridor::new(&centres, config, settings.ground.cell_m);
        let range = config.min_range_m..config.max_range_m;
        let mut heights = corridor.heights();
        let mut points = Vec::new();
        let mut sensors = Vec::new();
        let mut scans = Vec::new();
        drive.for_each(
            frames,
            registration.report.vertical_angle_rad,
            |frame, scan| {
                let map_from_velodyne = map_from_camera[frame] * drive.camera_from_velodyne;
                let (rotation, sensor) =
                    (map_from_velodyne.rotation.to_rotation_matrix(), map_from_velodyne.translation);
                let contrasts = Contrasts::new(&scan, &settings.lanes.contrast);
                let number = frames.partition_point(|f| *f < frame) as u16;
                let mut stitched = Vec::with_capacity(scan.points.len());
                for (i, p) in scan.points.iter().enumerate() {
                    let range_m = p.coords.norm();
                    if !range.contains(&range_m) {
                        continue;
                    }
                    let position = sensor * (rotation * p);
                    if corridor.contains(&position) {
                        stitched.push(CloudPoint {
                            position,
                            height_m: f32::NAN,
                            reflectance: scan.reflectance[i],
                            range_m: range_m as f32,
                            contrast: contrasts.of(i, range_m),
                            scan: number,
                        });
                    }
                }
                let read = StitchedScan {
                    frame,
                    points: scan.points.len(),
                    dropped_not_finite: scan.dropped_not_finite,
                    dropped_out_of_range: scan.dropped_out_of_range,
                    dropped_as_noise: scan.dropped_as_noise,
                };
                (Sensor::new(&map_from_velodyne), read, stitched)
            },
            |_, (sensor, read, mut stitched)| {
                scans.push(read);
                sensors.push(sensor);
                heights.add(stitched.iter().map(|p| p.position));
                points.append(&mut stitched);
            },
        )?;
        let ground = Ground::grow(heights, &corridor.path, &settings.ground);
        Ok(Self::over_ground(ground, corridor, points, sensors, scans, &settings.ground))
    }

    /// The cloud of points in a corridor: grows the ground under them and
    /// gives each its height above it.
    pub fn over(
        corridor: Corridor,
        points: Vec<CloudPoint>,
        sensors: Vec<Sensor>,
        scans: Vec<StitchedScan>,
        config: &GroundConfig,
    ) -> Self {
        let mut heights = corridor.heights();
        heights.add(points.iter().map(|p| p.position));
        let ground = Ground::grow(heights, &corridor.path, config);
        Self::over_ground(ground, corridor, points, sensors, scans, config)
    }

    fn over_ground(
        ground: Ground,
        Corridor { path, path_index, .. }: Corridor,
        mut points: Vec<CloudPoint>,
        sensors: Vec<Sensor>,
        scans: Vec<StitchedScan>,
        config: &GroundConfig,
    ) -> Self {
        let thickness_m = config.thickness_m as f32;
        // The height map may lie below a kerb, and above a gutter.
        let step_m = config.largest_step_m as f32;
        // Cell of each point, and whether it stands on the ground or lies on it.
        let cells: Vec<u32> = points
            .par_iter_mut()
            .map(|p| {
                let at = Point2::new(p.position.x, p.position.z);
                p.height_m = f32::NAN;
                let Some((cell, height_m)) = ground.cell_and_height_m(&at) else { return 0 };
                p.height_m = height_m.map_or(f32::NAN, |g| (-p.position.y - g) as f32);
                let flag = |holds: bool, flag: u32| if holds { flag } else { 0 };
                cell as u32 | flag(p.height_m > thickness_m, STANDS) | flag(p.height_m.abs() <= step_m, LIES)
            })
            .collect();
        let by_cell = |flag: u32| {
            let cell = move |c: &u32| (c & flag != 0).then_some((c & !(STANDS | LIES)) as usize);
            ByCell::new(ground.grid(), cells.iter().map(cell).zip(0_u32..))
        };
        let (standing, lying) = rayon::join(|| by_cell(STANDS), || by_cell(LIES));
        let view_weight = view_weights(&sensors);
        Self { points, ground, path, path_index, sensors, view_weight, scans, standing, lying }
    }

    /// Points above the ground whose column is within one cell of the ground's
    /// grid of map (x, z), and a few more.
    pub fn near(&self, at: &Point2<f64>) -> impl Iterator<Item = &CloudPoint> {
        self.within_cells(at, 1)
    }

    /// The same within so many cells.
    pub fn within_cells(&self, at: &Point2<f64>, cells: usize) -> impl Iterator<Item = &CloudPoint> {
        self.standing.near(at, cells, self.ground.grid()).map(move |i| &self.points[*i as usize])
    }

    /// A point as seen from the lidar.
    pub(crate) fn glance(&self, p: &CloudPoint) -> Glance {
        let ray = p.position - self.sensors[usize::from(p.scan)].at_map;
        Glance {
            scan: p.scan,
            from_lidar: Vector2::new(ray.x, ray.z).try_normalize(1e-6).unwrap_or_else(Vector2::y),
            range_m: f64::from(p.range_m),
            reflectance: p.reflectance,
        }
    }

    /// Those near map (x, z) that are where `is_there` says.
    pub(crate) fn glances(&self, at: &Point2<f64>, is_there: impl Fn(&CloudPoint) -> bool) -> Vec<Glance> {
        self.near(at).filter(|p| is_there(p)).map(|p| self.glance(p)).collect()
    }

    /// Points on the ground and up to a kerb above and below it, likewise.
    pub fn near_ground(&self, at: &Point2<f64>) -> impl Iterator<Item = &CloudPoint> {
        self.lying.near(at, 1, self.ground.grid()).map(move |i| &self.points[*i as usize])
    }

    /// The same of the cells of the rectangle around some places of map (x, z),
    /// but for those of which `is_near` says that nothing within a distance
    /// (metres) of their centre is asked for.
    pub fn ground_around(
        &self,
        places: impl IntoIterator<Item = Point2<f64>>,
        is_near: impl Fn(&Point2<f64>, f64) -> bool,
    ) -> impl Iterator<Item = &CloudPoint> {
        let grid = self.ground.grid();
        let cell = |m: f64, low_m: f64| ((m - low_m) / grid.cell_m).max(0.0) as usize;
        let (mut first, mut end) = ([usize::MAX; 2], [0; 2]);
        for place in places {
            let cells = [cell(place.x, grid.origin.x), cell(place.y, grid.origin.y)];
            for (k, cell) in cells.into_iter().enumerate() {
                (first[k], end[k]) = (first[k].min(cell), end[k].max(cell + 1));
            }
        }
        let (columns, rows) = (first[0]..end[0].min(grid.width), first[1]..end[1].min(grid.height));
        let reach_m = grid.cell_m * std::f64::consts::FRAC_1_SQRT_2;
        let cells = rows.flat_map(move |z| columns.clone().map(move |x| z * grid.width + x));
        cells
            .filter(move |cell| is_near(&grid.centre(*cell), reach_m))
            .flat_map(|cell| self.lying.of_cells(cell..cell + 1))
            .map(|i| &self.points[*i as usize])
    }

    /// Where a point lies beside the path.
    pub fn place(&self, p: &Point3<f64>) -> PathPlace {
        let at = Point2::new(p.x, p.z);
        self.path_index.place(&self.path, &at).unwrap_or_else(|| self.path.place(&at))
    }
}

/// Scans from places nearer than this are the same view, metres: what hides
/// something from one hides it from the other.
const SAME_VIEW_M: f64 = 0.5;

/// The frames without most of those in which the vehicle stands: of each place
/// so many as are to be kept, spread over the time that it stands there, so
/// that what moves on meanwhile is seen to.
pub fn without_standing(frames: &[usize], map_from_camera: &[Pose], most: usize) -> Vec<usize> {
    let apart_m =
        |a: usize, b: usize| (map_from_camera[a].translation.vector - map_from_camera[b].translation.vector).norm();
    let mut kept = Vec::with_capacity(frames.len());
    let mut left = frames;
    while let Some(first) = left.first() {
        let (here, later) =
            left.split_at(left.iter().take_while(|f| apart_m(*first, **f) < SAME_VIEW_M).count().max(1));
        let count = here.len().min(most.max(1));
        kept.extend((0..count).map(|k| here[k * (here.len() - 1) / (count - 1).max(1)]));
        left = later;
    }
    kept
}

fn view_weights(sensors: &[Sensor]) -> Vec<f64> {
    let same = |a: &Sensor| sensors.iter().filter(|b| (a.at_map - b.at_map).norm() < SAME_VIEW_M).count();
    sensors.iter().map(|a| (same(a) as f64).recip()).collect()
}

/// Flags beside the index of a cell, of which a window has far fewer than 2^30.
const STANDS: u32 = 1 << 31;
const LIES: u32 = 1 << 30;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vehicle_that_stands_fills_no_memory() {
        // Up to a light in steps of 2 m, 300 frames there, and on.
        let poses: Vec<Pose> = (0..340_i32)
            .map(|f| f64::from(f.min(20) + (f - 320).max(0)) * 2.0 + 0.001 * f64::from(f % 3))
            .map(|z| Pose::translation(0.0, 0.0, z))
            .collect();
        let all: Vec<usize> = (0..340).collect();
        let kept = without_standing(&all, &poses, 8);
        assert_eq!(kept.len(), 20 + 8 + 19);
        assert!(kept.windows(2).all(|w| w[0] < w[1]));
        let there: Vec<usize> = kept.iter().copied().filter(|f| (20..=320).contains(f)).collect();
        assert_eq!((there[0], there[7]), (20, 320), "from when it stops until it goes on");
        assert_eq!(without_standing(&all[..28], &poses, 8), all[..28], "a short stop is seen whole");
        assert_eq!(without_standing(&all, &poses, 1).len(), 40);
        assert!(without_standing(&[], &poses, 8).is_empty());
    }
}
