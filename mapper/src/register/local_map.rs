//! The local map that a scan is registered against: voxels of surfaces.

use common::geometry::Pose;
use nalgebra::{Matrix3, Point3, Vector3};
use rustc_hash::FxHashMap;

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

/// Fewest points that tell a plane or a rod from noise: three span a plane,
/// twice that gives its thickness.
const FEWEST_POINTS: f64 = 6.0;
/// A direction whose spread is below this share of the next is constrained.
const FLATNESS: f64 = 0.35;
/// Range noise of the lidars in use, metres: no surface is believed to be
/// thinner.
const RANGE_SIGMA_M: f64 = 0.02;

impl Surface {
    /// The surface of a voxel; none where too few points tell.
    pub fn of(moments: &Moments) -> Option<Self> {
        if moments.count < FEWEST_POINTS {
            return None;
        }
        let (sigma, axis) = moments.axes();
        let outer = |v: &Vector3<f64>| v * v.transpose();
        let mean = moments.mean;
        // Planes constrain along their normal alone: within the plane the
        // mean follows the pattern of the beams, which moves with the sensor.
        if sigma[2] < FLATNESS * sigma[1] && sigma[1] > 0.2 * sigma[0] {
            return Some(Self {
                mean,
                constrained: outer(&axis[2]),
                sigma_m: sigma[2].max(RANGE_SIGMA_M),
                normal: Some(axis[2]),
            });
        }
        if sigma[1] < FLATNESS * sigma[0] {
            return Some(Self {
                mean,
                constrained: outer(&axis[1]) + outer(&axis[2]),
                sigma_m: sigma[1].max(RANGE_SIGMA_M),
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
}

impl LocalMap {
    /// An empty map of voxels of `cell_m` that forgets a voxel which none of
    /// the last `keep_scans` scans has seen.
    pub fn new(cell_m: f64, keep_scans: usize) -> Self {
        Self { cells: FxHashMap::default(), inverse_cell: 1.0 / cell_m, keep_scans }
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
            cell.surface = Surface::of(&cell.moments);
        }
    }

    /// The surface in the voxel that holds a point.
    pub fn surface_at(&self, point_map: &Point3<f64>) -> Option<&Surface> {
        self.cells.get(&VoxelKey::of(point_map, self.inverse_cell))?.surface.as_ref()
    }

    /// Whether nothing was inserted yet.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }
}
