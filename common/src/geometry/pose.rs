//! 6-DOF poses: a rotation manifold inside, the paper's parameters outside.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3, Vector6};

/// A rigid transform, named `a_from_b` wherever it stands.
pub type Pose = Isometry3<f64>;

/// A small motion in the frame of the moving body: translation (m), then
/// rotation vector (rad).
pub type Tangent = Vector6<f64>;

/// The paper's six pose parameters (section IV.C) in camera axes (x right, y
/// down, z forward): `R = Ry(yaw) Rx(pitch) Rz(roll)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseParameters {
    /// `C_x`: camera centre along map x, metres.
    pub x_m: f64,
    /// `C_y`: camera centre along map y (down), metres.
    pub y_m: f64,
    /// `C_z`: camera centre along map z, metres.
    pub z_m: f64,
    /// Rotation about the y (down) axis, radians; positive turns right.
    pub yaw_rad: f64,
    /// Rotation about the x (right) axis, radians; positive looks up.
    pub pitch_rad: f64,
    /// Rotation about the z (forward) axis, radians; positive tilts right.
    pub roll_rad: f64,
}

impl PoseParameters {
    /// Parameters of `map_from_camera`. Pitch is in [-pi/2, pi/2].
    pub fn from_pose(map_from_camera: &Pose) -> Self {
        let rotation = map_from_camera.rotation.to_rotation_matrix();
        let m = rotation.matrix();
        // R = Ry Rx Rz: R12 = -sin(pitch), R02 / R22 = tan(yaw), R10 / R11 = tan(roll).
        let pitch_rad = (-m[(1, 2)]).clamp(-1.0, 1.0).asin();
        let (yaw_rad, roll_rad) = if pitch_rad.cos() > 1e-9 {
            (m[(0, 2)].atan2(m[(2, 2)]), m[(1, 0)].atan2(m[(1, 1)]))
        } else {
            // Gimbal lock: only yaw -+ roll is defined; give it all to yaw.
            ((-m[(2, 0)]).atan2(m[(0, 0)]), 0.0)
        };
        let t = map_from_camera.translation;
        Self { x_m: t.x, y_m: t.y, z_m: t.z, yaw_rad, pitch_rad, roll_rad }
    }

    /// The pose `map_from_camera` of these parameters.
    pub fn to_pose(self) -> Pose {
        let rotation = Rotation3::from_axis_angle(&Vector3::y_axis(), self.yaw_rad)
            * Rotation3::from_axis_angle(&Vector3::x_axis(), self.pitch_rad)
            * Rotation3::from_axis_angle(&Vector3::z_axis(), self.roll_rad);
        Pose::from_parts(
            Translation3::new(self.x_m, self.y_m, self.z_m),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    }
}

/// `pose` moved by `delta` in its own frame: `(R Exp(phi), t + R rho)`.
pub fn retract(pose: &Pose, delta: &Tangent) -> Pose {
    let rho = Vector3::new(delta[0], delta[1], delta[2]);
    let phi = Vector3::new(delta[3], delta[4], delta[5]);
    Pose::from_parts(
        Translation3::from(pose.translation.vector + pose.rotation * rho),
        UnitQuaternion::new_normalize((pose.rotation * UnitQuaternion::from_scaled_axis(phi)).into_inner()),
    )
}

/// The motion in the frame of `from` that takes `from` to `to`: the inverse of
/// [`retract`], `retract(from, local(from, to)) = to`.
pub fn local(from: &Pose, to: &Pose) -> Tangent {
    let rho = from.rotation.inverse() * (to.translation.vector - from.translation.vector);
    let phi = (from.rotation.inverse() * to.rotation).scaled_axis();
    Tangent::new(rho.x, rho.y, rho.z, phi.x, phi.y, phi.z)
}

/// The pose at `fraction` (0 gives `a`, 1 gives `b`): translation linear,
/// rotation along the shortest arc. Outside [0, 1] it extrapolates.
pub fn interpolate(a: &Pose, b: &Pose, fraction: f64) -> Pose {
    retract(a, &(local(a, b) * fraction))
}

/// The rotation that is nearest to a matrix in the Frobenius norm: `U V^T` of
/// `U S V^T`. None where that mirrors, and for what is not finite. Ends after a
/// known number of steps, as `Rotation3::from_matrix` does not.
pub fn nearest_rotation(matrix: &Matrix3<f64>) -> Option<Rotation3<f64>> {
    let svd = matrix.try_svd(true, true, f64::EPSILON, 100)?;
    let rotation = svd.u? * svd.v_t?;
    (rotation.determinant() > 0.0).then(|| Rotation3::from_matrix_unchecked(rotation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parameters() -> impl Strategy<Value = PoseParameters> {
        (-1e3..1e3_f64, -1e2..1e2_f64, -1e3..1e3_f64, -3.1..3.1_f64, -1.5..1.5_f64, -3.1..3.1_f64).prop_map(
            |(x_m, y_m, z_m, yaw_rad, pitch_rad, roll_rad)| PoseParameters {
                x_m,
                y_m,
                z_m,
                yaw_rad,
                pitch_rad,
                roll_rad,
            },
        )
    }

    proptest! {
        /// Of a scaled rotation that noise disturbs: never worse than its origin.
        #[test]
        fn the_nearest_rotation_is_no_farther_than_another(p in parameters(), scale in 1e-3..1e6_f64, noise in prop::array::uniform9(-0.2..0.2_f64)) {
            let rotation = p.to_pose().rotation.to_rotation_matrix();
            let disturbed = (rotation.matrix() + Matrix3::from_row_slice(&noise)) * scale;
            let nearest = nearest_rotation(&disturbed).unwrap();
            let off = |r: &Rotation3<f64>| (r.matrix() * scale - disturbed).norm();
            prop_assert!(off(&nearest) <= off(&rotation) * (1.0 + 1e-9));
            prop_assert!((nearest.matrix() * nearest.matrix().transpose() - Matrix3::identity()).amax() < 1e-9);
        }

        #[test]
        fn parameters_survive_the_pose(p in parameters()) {
            let q = PoseParameters::from_pose(&p.to_pose());
            prop_assert!((p.yaw_rad - q.yaw_rad).abs() < 1e-9);
            prop_assert!((p.pitch_rad - q.pitch_rad).abs() < 1e-9);
            prop_assert!((p.roll_rad - q.roll_rad).abs() < 1e-9);
            prop_assert!((p.x_m - q.x_m).abs() < 1e-9 && (p.z_m - q.z_m).abs() < 1e-9);
        }

        #[test]
        fn local_undoes_retract(p in parameters(), v in prop::array::uniform6(-0.9..0.9_f64)) {
            let delta = Tangent::from_column_slice(&v);
            let pose = p.to_pose();
            prop_assert!((local(&pose, &retract(&pose, &delta)) - delta).norm() < 1e-9);
        }
    }

    #[test]
    fn positive_yaw_looks_right_and_positive_pitch_looks_up() {
        let base = PoseParameters { x_m: 0.0, y_m: 0.0, z_m: 0.0, yaw_rad: 0.0, pitch_rad: 0.0, roll_rad: 0.0 };
        let forward = Vector3::z();
        let right = PoseParameters { yaw_rad: 0.1, ..base }.to_pose() * forward;
        let up = PoseParameters { pitch_rad: 0.1, ..base }.to_pose() * forward;
        assert!(right.x > 0.09 && up.y < -0.09);
    }
}
