//! The local map that a scan is registered against: voxels of surfaces.

use std::collections::VecDeque;
use std::collections::hash_map::Entry;
use std::sync::OnceLock;

use common::geometry::Pose;
use nalgebra::{Point3, Vector3};
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};

use crate::voxel::{Moments, VoxelKey};

/// What one voxel says of the surface in it.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// Mean of its points, metres.
    pub mean: Point3<f64>,
    /// Directions in which the surface constrains a point: the normal of a
    /// plane (the second is then zero), both normals of a rod.
    pub constrained: [Vector3<f64>; 2],
    /// Standard deviation of the points in those directions, metres.
    pub sigma_m: f64,
    /// Normal of a planar voxel.
    pub normal: Option<Vector3<f64>>,
}

/// Cosine of the largest angle between a rod and the way on which the beams of a lidar rise
/// from one to the next: 60 degrees.
const ACROSS_BEAMS_COS: f64 = 0.5;

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
        let mean = moments.mean;
        // Planes constrain along their normal alone: within the plane the
        // mean follows the pattern of the beams, which moves with the sensor.
        if sigma[2] < config.flatness * sigma[1] && sigma[1] > config.narrowest * sigma[0] {
            return Some(Self {
                mean,
                constrained: [axis[2], Vector3::zeros()],
                sigma_m: sigma[2].max(config.range_sigma_m),
                normal: Some(axis[2]),
            });
        }
        if sigma[1] < config.flatness * sigma[0] {
            return Some(Self {
                mean,
                constrained: [axis[1], axis[2]],
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

    /// Those of the constrained directions that are any: one of a plane.
    pub fn normals(&self) -> &[Vector3<f64>] {
        if self.normal.is_some() { &self.constrained[..1] } else { &self.constrained }
    }

    /// Whether it is a rod along which one beam after the other lies, seen along `view` by a
    /// lidar that turns about `up` (unit length). Where the beams are farther apart than voxels
    /// are wide, what a single one leaves on the ground or on a wall is as thin as a rod, and
    /// would hold the scan back: it moves with the sensor.
    pub fn is_rod_across_beams(&self, view: &Vector3<f64>, up: &Vector3<f64>) -> bool {
        let rod = self.constrained[0].cross(&self.constrained[1]);
        let rising = up * view.norm_squared() - view * up.dot(view);
        rod.dot(&rising).abs() >= ACROSS_BEAMS_COS * rising.norm()
    }

    /// Squared distance of a point, metres^2.
    pub fn squared_distance_m2(&self, point: &Point3<f64>) -> f64 {
        let off = point - self.mean;
        self.normals().iter().map(|axis| axis.dot(&off).powi(2)).sum()
    }
}

/// The surface in a voxel, once looked up.
#[derive(Clone, Copy)]
pub(super) struct Target<'a> {
    voxel: VoxelKey,
    surface: Option<&'a Surface>,
}

struct Cell {
    moments: Moments,
    /// Told when it is asked for: most voxels are asked for in few scans, and
    /// telling takes the axes of an ellipsoid.
    surface: OnceLock<Option<Surface>>,
    last_scan: usize,
}

/// Voxels of the scans registered so far, within a distance of the sensor.
pub struct LocalMap {
    /// Places in `cells`: a table of small entries stays in the cache.
    places: FxHashMap<VoxelKey, u32>,
    cells: Vec<Cell>,
    /// Places in `cells` that are free.
    free: Vec<u32>,
    /// Voxels that each of the last scans saw, the oldest first.
    seen: VecDeque<(usize, Vec<VoxelKey>)>,
    inverse_cell: f64,
    keep_scans: usize,
    surface: SurfaceConfig,
}

impl LocalMap {
    /// An empty map of voxels of `cell_m` that forgets a voxel which none of
    /// the last `keep_scans` scans has seen.
    pub fn new(cell_m: f64, keep_scans: usize, surface: SurfaceConfig) -> Self {
        Self {
            places: FxHashMap::default(),
            cells: Vec::new(),
            free: Vec::new(),
            seen: VecDeque::new(),
            inverse_cell: 1.0 / cell_m,
            keep_scans,
            surface,
        }
    }

    /// Adds a registered scan, given as voxel moments in its own frame. Scans
    /// are numbered upwards.
    pub fn insert(&mut self, scan: usize, cells: &[Moments], map_from_velodyne: &Pose) {
        let mut seen = Vec::with_capacity(cells.len());
        let rotation = map_from_velodyne.rotation.to_rotation_matrix().into_inner();
        for cell in cells {
            let moments = cell.transformed(&rotation, &map_from_velodyne.translation.vector);
            let key = VoxelKey::of(&moments.mean, self.inverse_cell);
            seen.push(key);
            match self.places.entry(key) {
                Entry::Occupied(place) => {
                    let known = &mut self.cells[*place.get() as usize];
                    known.moments = known.moments.merged(&moments);
                    known.last_scan = scan;
                    known.surface.take();
                }
                Entry::Vacant(place) => {
                    let cell = Cell { moments, surface: OnceLock::new(), last_scan: scan };
                    if let Some(free) = self.free.pop() {
                        self.cells[free as usize] = cell;
                        place.insert(free);
                    } else {
                        place.insert(self.cells.len() as u32);
                        self.cells.push(cell);
                    }
                }
            }
        }
        self.seen.push_back((scan, seen));
        self.forget(scan);
    }

    /// Forgets what was seen last so many scans before `scan`.
    fn forget(&mut self, scan: usize) {
        let is_old = |last_scan: usize| last_scan + self.keep_scans <= scan;
        while let Some((_, seen)) = self.seen.pop_front_if(|(last_scan, _)| is_old(*last_scan)) {
            for key in seen {
                if let Entry::Occupied(place) = self.places.entry(key)
                    && is_old(self.cells[*place.get() as usize].last_scan)
                {
                    self.free.push(place.remove());
                }
            }
        }
    }

    fn surface_of<'a>(&'a self, cell: &'a Cell) -> Option<&'a Surface> {
        cell.surface.get_or_init(|| Surface::of(&cell.moments, &self.surface)).as_ref()
    }

    /// The surface in the voxel that holds a point.
    pub fn surface_at(&self, point_map: &Point3<f64>) -> Option<&Surface> {
        let place = *self.places.get(&VoxelKey::of(point_map, self.inverse_cell))?;
        self.surface_of(&self.cells[place as usize])
    }

    /// As [`Self::surface_at`], given what it gave for a place near by.
    pub(super) fn surface_again<'a>(
        &'a self,
        point_map: &Point3<f64>,
        last: &mut Option<Target<'a>>,
    ) -> Option<&'a Surface> {
        let voxel = VoxelKey::of(point_map, self.inverse_cell);
        match last {
            Some(last) if last.voxel == voxel => last.surface,
            _ => {
                let surface = self.surface_at(point_map);
                *last = Some(Target { voxel, surface });
                surface
            }
        }
    }

    /// All surfaces, in no order that means anything.
    pub fn surfaces(&self) -> impl Iterator<Item = &Surface> {
        self.places.values().filter_map(|place| self.surface_of(&self.cells[*place as usize]))
    }

    /// Whether nothing was inserted yet.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }
}
