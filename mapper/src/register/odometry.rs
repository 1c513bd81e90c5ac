//! Odometry of the scans: each registered against those before it.

use std::collections::BTreeMap;

use common::geometry::Pose;
use nalgebra::{Matrix6, Point3};
use rayon::prelude::*;

use super::align::{AlignConfig, ScanSurface, align, scan_surfaces};
use super::graph::Motion;
use super::local_map::LocalMap;
use crate::drive::Drive;
use crate::error::Result;
use crate::scan::raised;
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

/// Voxels of scans that were read already, by frame, before any raising.
pub(super) type KnownCells = BTreeMap<usize, Vec<Moments>>;

/// The voxels of a scan in its own frame, not raised.
pub(super) fn read_cells(drive: &Drive, frame: usize, config: &AlignConfig) -> Result<Vec<Moments>> {
    let range = config.nearest_m.powi(2)..config.farthest_m.powi(2);
    let scan = drive.read(frame, 0.0)?;
    let used: Vec<Point3<f64>> = scan.points.into_iter().filter(|p| range.contains(&p.coords.norm_squared())).collect();
    Ok(voxel_moments(&used, config.scan_voxel_m))
}

/// The voxels of a scan raised by an angle. A voxel is too small to be bent by
/// it: its mean moves.
pub(super) fn raised_cells(cells: &[Moments], angle_rad: f64) -> Vec<Moments> {
    let turn = angle_rad.sin_cos();
    cells.iter().map(|c| Moments { mean: raised(&c.mean, turn), ..*c }).collect()
}

/// Registers each scan of `frames`, raised by an angle, against those before it.
pub(super) fn odometry(
    drive: &Drive,
    frames: &[usize],
    angle_rad: f64,
    config: &AlignConfig,
    known: &KnownCells,
) -> Result<Odometry> {
    let camera_from_velodyne = drive.camera_from_velodyne;
    let velodyne_from_camera = camera_from_velodyne.inverse();
    let mut map = LocalMap::new(config.map_voxel_m, config.keep_scans, config.surface);
    let mut last: Option<(usize, Pose)> = None;
    let mut result = Odometry { motions: Vec::new(), rms_given_m: 0.0, rms_refined_m: 0.0 };
    let prepare = |frame: usize| -> Result<(Vec<Moments>, Vec<ScanSurface>)> {
        let cells = match known.get(&frame) {
            Some(cells) => raised_cells(cells, angle_rad),
            None => raised_cells(&read_cells(drive, frame, config)?, angle_rad),
        };
        let surfaces = scan_surfaces(&cells, &config.surface);
        Ok((cells, surfaces))
    };
    for (b, batch) in frames.chunks(BATCH).enumerate() {
        let prepared: Vec<Result<_>> = batch.par_iter().map(|frame| prepare(*frame)).collect();
        for (k, (&frame, scan)) in batch.iter().zip(prepared).enumerate() {
            let (cells, surfaces) = scan?;
            let pose = match last {
                None => drive.survey[frame] * camera_from_velodyne,
                Some((before, before_pose)) => {
                    let guess = before_pose
                        * velodyne_from_camera
                        * drive.survey[before].inverse()
                        * drive.survey[frame]
                        * camera_from_velodyne;
                    let found = align(&map, &surfaces, &guess, config);
                    // The normal matrix is in the tangent of the Velodyne frame.
                    let tangent = adjoint(&velodyne_from_camera);
                    result.motions.push(Motion {
                        before_from_after: camera_from_velodyne
                            * before_pose.inverse()
                            * found.map_from_velodyne
                            * velodyne_from_camera,
                        information: tangent.transpose() * found.information * tangent,
                    });
                    result.rms_given_m += found.first_rms_m.powi(2);
                    result.rms_refined_m += found.rms_m.powi(2);
                    found.map_from_velodyne
                }
            };
            map.insert(b * BATCH + k, &cells, &pose);
            last = Some((frame, pose));
        }
    }
    let n = result.motions.len().max(1) as f64;
    result.rms_given_m = (result.rms_given_m / n).sqrt();
    result.rms_refined_m = (result.rms_refined_m / n).sqrt();
    Ok(result)
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
