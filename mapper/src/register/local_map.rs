//! The local map that a scan is registered against: voxels of surfaces.

use common::geometry::Pose;
use nalgebra::{Matrix3, Point3, Vector3};
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};

use crate::voxel::{Moments, VoxelKey};

/// What one voxel says of the surface in it.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// Mean of its points, metres.
    pub mean: Point3<f64>,
    /// Projector on the directions in which the surface constrains a point:
    /// the normal of a plane, both normals of a rod.
    pub constrained: Matrix3<f64>,
    /// Standard deviation of the points in those directions, metres.
    pub sigma_m: f64,
    /// Normal of a planar voxel.
    pub normal: Option<Vector3<f64>>,
}

/// What counts as a surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SurfaceConfig {
    /// Fewest points of a voxel: three span a plane, one more tells noise.
    pub fewest_points: usize,
    /// A direction whose spread is below this share of the next larger one is
    /// constrained. Strict shares leave roads without houses with little that
    /// tells the forward motion: 0.35 gave 0.1 m a step on generated drives
    /// where 0.5 gives 0.01.
    pub flatness: f64,
    /// A plane is at least this share of its length wide, else it is a rod.
    pub narrowest: f64,
    /// Range noise of the lidar, metres: no surface is believed thinner.
    pub range_sigma_m: f64,
    /// Cosine of the largest angle between the normals of two voxels that are
    /// taken for one plane.
    pub same_plane_cos: f64,
}

impl Default for SurfaceConfig {
    fn default() -> Self {
        Self { fewest_points: 4, flatness: 0.5, narrowest: 0.2, range_sigma_m: 0.02, same_plane_cos: 0.8 }
    }
}

impl Surface {
    /// The surface of a voxel; none where too few points tell.
    pub fn of(moments: &Moments, config: &SurfaceConfig) -> Option<Self> {
        if moments.count < config.fewest_points as f64 {
            return None;
        }
        let (sigma, axis) = moments.axes();
        let outer = |v: &Vector3<f64>| v * v.transpose();
        let mean = moments.mean;
        // Planes constrain along their normal alone: within the plane the
        // mean follows the pattern of the beams, which moves with the sensor.
        if sigma[2] < config.flatness * sigma[1] && sigma[1] > config.narrowest * sigma[0] {
            return Some(Self {
                mean,
                constrained: outer(&axis[2]),
                sigma_m: sigma[2].max(config.range_sigma_m),
                normal: Some(axis[2]),
            });
        }
        if sigma[1] < config.flatness * sigma[0] {
            return Some(Self {
                mean,
                constrained: outer(&axis[1]) + outer(&axis[2]),
                sigma_m: sigma[1].max(config.range_sigma_m),
                normal: None,
            });
        }
        // A blob (leaves, a car's corner) tells places apart by where its
        // points happen to lie: it holds a moving vehicle as well as a hedge,
        // and left the forward motion 0.1 m off where planes and rods agree
        // with the survey to 0.015 m.
        None
    }
}

struct Cell {
    moments: Moments,
    surface: Option<Surface>,
    last_scan: usize,
}

/// Voxels of the scans registered so far, within a distance of the sensor.
pub struct LocalMap {
    cells: FxHashMap<VoxelKey, Cell>,
    inverse_cell: f64,
    keep_scans: usize,
    surface: SurfaceConfig,
}

impl LocalMap {
    /// An empty map of voxels of `cell_m` that forgets a voxel which none of
    /// the last `keep_scans` scans has seen.
    pub fn new(cell_m: f64, keep_scans: usize, surface: SurfaceConfig) -> Self {
        Self { cells: FxHashMap::default(), inverse_cell: 1.0 / cell_m, keep_scans, surface }
    }

    /// Adds a registered scan, given as voxel moments in its own frame.
    pub fn insert(&mut self, scan: usize, cells: &[Moments], map_from_velodyne: &Pose) {
        for cell in cells {
            let moved = cell.transformed(map_from_velodyne);
            let key = VoxelKey::of(&moved.mean, self.inverse_cell);
            self.cells
                .entry(key)
                .and_modify(|c| {
                    c.moments = c.moments.merged(&moved);
                    c.last_scan = scan;
                    c.surface = None;
                })
                .or_insert(Cell { moments: moved, surface: None, last_scan: scan });
        }
        let keep = self.keep_scans;
        self.cells.retain(|_, c| c.last_scan + keep > scan);
        for cell in self.cells.values_mut().filter(|c| c.last_scan == scan) {
            cell.surface = Surface::of(&cell.moments, &self.surface);
        }
    }

    /// The surface in the voxel that holds a point.
    pub fn surface_at(&self, point_map: &Point3<f64>) -> Option<&Surface> {
        self.cells.get(&VoxelKey::of(point_map, self.inverse_cell))?.surface.as_ref()
    }

    /// All surfaces, in no order that means anything.
    pub fn surfaces(&self) -> impl Iterator<Item = &Surface> {
        self.cells.values().filter_map(|c| c.surface.as_ref())
    }

    /// Whether nothing was inserted yet.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }
}
