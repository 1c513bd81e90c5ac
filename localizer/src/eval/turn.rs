//! The constant turn between the cameras of truth and estimates.
//!
//! True poses are seldom of the camera that took the images: those of KITTI are of a
//! receiver, brought to the camera by a calibration that is off by a tenth of a degree, and
//! the scans that a map is built of are brought to it by another one. Such a turn is the
//! same in all frames, and no error of who localizes against the map.

use common::geometry::{Pose, Tangent, local};
use nalgebra::{Cholesky, U6, Vector3};
use serde::Serialize;

use crate::estimate::Status;
use crate::output::Recorded;

/// The turn that all estimates share, and what is left without it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ConstantTurn {
    /// About right, down and forward of the camera, from estimate to truth, radians.
    pub turn_rad: [f64; 3],
    /// Mean angle error of all frames without it, radians.
    pub mean_angle_rad: f64,
    /// Mean of the normalised squared errors of those that are called ok, without it.
    pub mean_nees: f64,
}

impl ConstantTurn {
    /// The mean turn of the estimates that are called ok; none where none of them has a
    /// covariance.
    pub fn of(pairs: &[(&Recorded, &Pose)]) -> Option<Self> {
        let errors: Vec<(&Recorded, Tangent)> =
            pairs.iter().map(|(recorded, truth)| (*recorded, local(&recorded.map_from_camera, truth))).collect();
        let trusted: Vec<(Tangent, Cholesky<f64, U6>)> = errors
            .iter()
            .filter(|(recorded, _)| recorded.status == Some(Status::Ok))
            .filter_map(|(recorded, error)| Some((*error, Cholesky::new(recorded.covariance?)?)))
            .collect();
        if trusted.is_empty() {
            return None;
        }
        let angles = |error: &Tangent| error.fixed_rows::<3>(3).into_owned();
        let turn = trusted.iter().map(|(error, _)| angles(error)).sum::<Vector3<f64>>() / trusted.len() as f64;
        let nees = trusted.iter().map(|(error, factor)| {
            let mut left = *error;
            left.fixed_rows_mut::<3>(3).copy_from(&(angles(error) - turn));
            left.dot(&factor.solve(&left))
        });
        let left_rad = errors.iter().map(|(_, error)| (angles(error) - turn).norm());
        Some(Self {
            turn_rad: turn.into(),
            mean_nees: nees.sum::<f64>() / trusted.len() as f64,
            mean_angle_rad: left_rad.sum::<f64>() / errors.len() as f64,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::geometry::retract;
    use nalgebra::Matrix6;

    #[test]
    fn the_turn_that_all_share_is_told_from_errors_that_change() {
        let turn = Tangent::new(0.0, 0.0, 0.0, 0.002, -0.001, 0.0015);
        let covariance = Matrix6::from_diagonal(&nalgebra::Vector6::new(0.01, 0.01, 0.01, 1e-6, 1e-6, 1e-6));
        let recorded: Vec<Recorded> = (0..40)
            .map(|frame| {
                let sign = if frame % 2 == 0 { 1.0 } else { -1.0 };
                let off = Tangent::new(0.05, 0.0, 0.0, 0.0, 0.001, 0.0) * sign;
                Recorded {
                    frame,
                    map_from_camera: retract(&Pose::identity(), &(off - turn)),
                    status: Some(if frame == 7 { Status::Lost } else { Status::Ok }),
                    correspondences: None,
                    covariance: Some(covariance),
                }
            })
            .collect();
        let truth = Pose::identity();
        let pairs: Vec<(&Recorded, &Pose)> = recorded.iter().map(|r| (r, &truth)).collect();
        let found = ConstantTurn::of(&pairs).unwrap();
        let off = Vector3::from(found.turn_rad) - turn.fixed_rows::<3>(3);
        assert!(off.norm() < 1e-4, "{found:?}");
        // What is left is 0.05 m of 0.1 and 0.001 rad of 0.001.
        assert!((found.mean_nees - 1.25).abs() < 0.05, "{found:?}");
        assert!((found.mean_angle_rad - 0.001).abs() < 1e-4, "{found:?}");
        assert!(ConstantTurn::of(&[]).is_none());
    }
}
