//! Places along the roads, each with a camera that looks down the road.

use common::map::Road;
use nalgebra::{Matrix3, Point3, Vector3};

use super::BudgetConfig;
use crate::fuse::Buckets;

/// A camera on the road: x right, y down, z forward, as the map's frame.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// Its centre, map frame, metres.
    pub centre_map: Point3<f64>,
    /// Turns directions of the map into the camera's.
    pub camera_from_map: Matrix3<f64>,
    /// Metres driven since the place before; none where a drive begins.
    pub after_m: Option<f64>,
}

impl Place {
    /// A point in the camera's axes, metres.
    pub fn in_camera(&self, point_map: &Point3<f64>) -> Vector3<f64> {
        self.camera_from_map * (point_map - self.centre_map)
    }
}

/// All places, by position.
#[derive(Debug, Clone)]
pub struct Places {
    /// In driving order.
    pub list: Vec<Place>,
    cells: Buckets,
}

/// Edge of the cells by which places are found, metres.
const CELL_M: f64 = 50.0;

impl Places {
    /// Places along roads, in their driving direction.
    pub fn along(roads: &[Road], config: &BudgetConfig) -> Self {
        let step_m = config.place_step_m.max(0.1);
        let mut list: Vec<Place> = Vec::new();
        for road in roads {
            for ends in road.path_map.windows(2) {
                let along = ends[1] - ends[0];
                let length_m = along.norm();
                let Some(camera_from_map) = looking_along(&along) else { continue };
                let count = (length_m / step_m).round().max(1.0);
                for k in 0..count as usize {
                    let centre_map = ends[0] + along * ((k as f64 + 0.5) / count);
                    let after_m = list.last().map(|before| (centre_map - before.centre_map).norm());
                    // Roads follow each other without a gap unless they are of
                    // another drive.
                    let after_m = after_m.filter(|metres| *metres < 4.0 * step_m.max(length_m / count));
                    list.push(Place { centre_map, camera_from_map, after_m });
                }
            }
        }
        let cells = Buckets::of(CELL_M, list.iter().map(|place| &place.centre_map));
        Self { list, cells }
    }

    /// Indices of the places within about `reach_m` (whole cells) of any of
    /// some points, ascending.
    pub fn near(&self, points_map: impl Iterator<Item = Point3<f64>>, reach_m: f64) -> Vec<usize> {
        let mut found: Vec<usize> = Vec::new();
        for p in points_map {
            found.extend(self.cells.near(&p, reach_m));
        }
        found.sort_unstable();
        found.dedup();
        found
    }
}

/// The axes of a level camera that looks along a direction of the map.
fn looking_along(direction_map: &Vector3<f64>) -> Option<Matrix3<f64>> {
    let forward = direction_map.try_normalize(1e-3)?;
    let right = Vector3::y().cross(&forward).try_normalize(1e-6)?;
    let down = forward.cross(&right);
    Some(Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]))
}
