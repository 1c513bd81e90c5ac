//! Odometry of the scans: each registered against those before it.

use std::borrow::Cow;
use std::collections::BTreeMap;

use common::geometry::Pose;
use nalgebra::Matrix6;
use rayon::prelude::*;

use super::RefineConfig;
use super::align::{AlignConfig, Alignment, ScanSurface, align, scan_surfaces};
use super::graph::Motion;
use super::jumps::Jumps;
use super::local_map::LocalMap;
use super::weak::held_by_survey;
use crate::drive::Drive;
use crate::error::Result;
use crate::scan::{position, raised};
use crate::voxel::{Moments, voxel_moments};

/// Scans that are read ahead in parallel: what is held in memory at a time.
pub(super) const BATCH: usize = 8;

/// The motions between scans.
pub(super) struct Odometry {
    /// Between each scan and the next: one fewer.
    pub motions: Vec<Motion>,
    /// Root mean square distance of scan surfaces to the local map at the
    /// survey's poses, metres.
    pub rms_given_m: f64,
    /// The same at the registered poses, metres.
    pub rms_refined_m: f64,
}

/// What is registered of a scan, in its own frame.
#[derive(Clone)]
pub(super) struct ScanCells {
    /// Its voxels.
    pub cells: Vec<Moments>,
    /// The surfaces in them.
    pub surfaces: Vec<ScanSurface>,
}

/// Scans that were read already, by frame.
pub(super) type KnownCells = BTreeMap<usize, ScanCells>;

impl ScanCells {
    /// Reads a scan, not raised.
    pub fn read(drive: &Drive, frame: usize, config: &AlignConfig) -> Result<Self> {
        let cells = read_cells(drive, frame, config)?;
        let surfaces = scan_surfaces(&cells, &config.surface);
        Ok(Self { cells, surfaces })
    }

    /// Raises the scan by an angle. A voxel is too small to be bent by it: its
    /// mean moves.
    pub fn raise(&mut self, angle_rad: f64) {
        let turn = angle_rad.sin_cos();
        for cell in &mut self.cells {
            cell.mean = raised(&cell.mean, turn);
        }
        for ScanSurface { surface } in &mut self.surfaces {
            surface.mean = raised(&surface.mean, turn);
        }
    }
}

/// The voxels of a scan in its own frame, not raised.
pub(super) fn read_cells(drive: &Drive, frame: usize, config: &AlignConfig) -> Result<Vec<Moments>> {
    let range = config.nearest_m.powi(2)..config.farthest_m.powi(2);
    let scan = drive.read_raw(frame)?;
    let used = scan.points.iter().map(position).filter(|p| range.contains(&p.coords.norm_squared()));
    Ok(voxel_moments(used, config.scan_voxel_m))
}

/// The voxels of a scan raised by an angle.
pub(super) fn raised_cells(cells: &[Moments], angle_rad: f64) -> Vec<Moments> {
    let turn = angle_rad.sin_cos();
    cells.iter().map(|c| Moments { mean: raised(&c.mean, turn), ..*c }).collect()
}

/// Registers each scan of `frames`, raised by an angle as those already known are,
/// against those before it. `jumps` hears what the scans say of steps that may be some.
pub(super) fn odometry(
    drive: &Drive,
    frames: &[usize],
    angle_rad: f64,
    config: &RefineConfig,
    known: &KnownCells,
    jumps: &mut Jumps,
) -> Result<Odometry> {
    let prepare = |frame: &usize| {
        if let Some(scan) = known.get(frame) {
            return Ok(Cow::Borrowed(scan));
        }
        let mut scan = ScanCells::read(drive, *frame, &config.align)?;
        scan.raise(angle_rad);
        Ok(Cow::Owned(scan))
    };
    let prepared = |batch: &[usize]| -> Vec<Result<Cow<ScanCells>>> { batch.par_iter().map(prepare).collect() };
    let mut chain = Registered::new(drive, config, jumps);
    // Two of these are held at a time.
    let mut batches = frames.chunks(BATCH / 2);
    let mut ahead = batches.next().map(|batch| (batch, prepared(batch)));
    while let Some((batch, scans)) = ahead {
        // One scan after the other is aligned, while the next ones are read.
        let register =
            || batch.iter().zip(scans).try_for_each(|(&frame, scan)| scan.map(|scan| chain.add(frame, &scan)));
        let (next, registered) = rayon::join(|| batches.next().map(|batch| (batch, prepared(batch))), register);
        registered?;
        ahead = next;
    }
    Ok(chain.result())
}

/// The scans registered so far.
struct Registered<'a> {
    drive: &'a Drive,
    config: &'a RefineConfig,
    map: LocalMap,
    scans: usize,
    last: Option<(usize, Pose)>,
    odometry: Odometry,
    jumps: &'a mut Jumps,
}

impl<'a> Registered<'a> {
    fn new(drive: &'a Drive, config: &'a RefineConfig, jumps: &'a mut Jumps) -> Self {
        let AlignConfig { map_voxel_m, keep_scans, surface, .. } = config.align;
        let map = LocalMap::new(map_voxel_m, keep_scans, surface);
        let odometry = Odometry { motions: Vec::new(), rms_given_m: 0.0, rms_refined_m: 0.0 };
        Self { drive, config, map, scans: 0, last: None, odometry, jumps }
    }

    /// Registers the scan of a frame against those before it.
    fn add(&mut self, frame: usize, scan: &ScanCells) {
        let survey = &self.drive.survey;
        let camera_from_velodyne = self.drive.camera_from_velodyne;
        let velodyne_from_camera = camera_from_velodyne.inverse();
        let pose = match self.last {
            None => survey[frame] * camera_from_velodyne,
            Some((before, before_pose)) => {
                let guess = before_pose
                    * velodyne_from_camera
                    * survey[before].inverse()
                    * survey[frame]
                    * camera_from_velodyne;
                let found = align(&self.map, &scan.surfaces, &guess, &self.config.align);
                if let Some(motion) = self.jumps.without(survey, before, frame) {
                    let elsewhere = before_pose * velodyne_from_camera * motion * camera_from_velodyne;
                    let other = align(&self.map, &scan.surfaces, &elsewhere, &self.config.align);
                    self.jumps.hear((before, frame), &guess, [&found, &other], &self.config.align);
                }
                let (pose, information) = told(&found, &guess, &self.config.align);
                // The normal matrix is in the tangent of the Velodyne frame.
                let tangent = adjoint(&velodyne_from_camera);
                self.odometry.motions.push(Motion {
                    before_from_after: camera_from_velodyne * before_pose.inverse() * pose * velodyne_from_camera,
                    information: tangent.transpose() * information * tangent,
                });
                self.odometry.rms_given_m += found.first_rms_m.powi(2);
                self.odometry.rms_refined_m += found.rms_m.powi(2);
                held_by_survey(&pose, &information, &guess, &self.config.graph)
            }
        };
        self.map.insert(self.scans, &scan.cells, &pose);
        self.scans += 1;
        self.last = Some((frame, pose));
    }

    fn result(self) -> Odometry {
        let Odometry { motions, rms_given_m, rms_refined_m } = self.odometry;
        let n = motions.len().max(1) as f64;
        Odometry { motions, rms_given_m: (rms_given_m / n).sqrt(), rms_refined_m: (rms_refined_m / n).sqrt() }
    }
}

/// Where a scan is by those before it (`map_from_velodyne`), with the normal matrix:
/// where it hardly lies on them it stays at the guess, and they tell nothing.
fn told(found: &Alignment, guess: &Pose, config: &AlignConfig) -> (Pose, Matrix6<f64>) {
    if found.overlap < config.least_overlap {
        return (*guess, Matrix6::zeros());
    }
    (found.map_from_velodyne, found.information)
}

/// Takes a small motion in frame `b` to the same motion in frame `a`.
pub(super) fn adjoint(a_from_b: &Pose) -> Matrix6<f64> {
    let r = a_from_b.rotation.to_rotation_matrix().into_inner();
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(&r);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(&(a_from_b.translation.vector.cross_matrix() * r));
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
    m
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::register::{GraphConfig, refine_poses};

    #[test]
    fn scans_that_hardly_overlap_do_not_outvote_the_survey() {
        let survey: Vec<Pose> = (0..20).map(|i| Pose::translation(0.0, 0.0, 5.0 * f64::from(i))).collect();
        let farthest_m = |overlap: f64| {
            let motion = |pair: &[Pose]| {
                let guess = pair[0].inverse() * pair[1];
                // One of them is laid on the scans before it 3 m too far ahead.
                let is_wrong = pair[0].translation.vector.z > 49.0 && pair[0].translation.vector.z < 51.0;
                let found = Alignment {
                    map_from_velodyne: guess * Pose::translation(0.0, 0.0, if is_wrong { 3.0 } else { 0.0 }),
                    information: Matrix6::identity() * 1e8,
                    overlap: if is_wrong { overlap } else { 0.8 },
                    rms_m: 0.01,
                    first_rms_m: 0.01,
                    iterations: 5,
                };
                let (before_from_after, information) = told(&found, &guess, &AlignConfig::default());
                Motion { before_from_after, information }
            };
            let motions: Vec<Motion> = survey.windows(2).map(motion).collect();
            let refined = refine_poses(&survey, &motions, &[], &GraphConfig::default()).map_from_camera;
            let off_m = |(a, b): (&Pose, &Pose)| (a.translation.vector - b.translation.vector).norm();
            refined.iter().zip(&survey).map(off_m).fold(0.0, f64::max)
        };
        assert!(farthest_m(0.6) > 0.5, "{}", farthest_m(0.6));
        assert!(farthest_m(0.05) < 0.01, "{}", farthest_m(0.05));
    }
}
