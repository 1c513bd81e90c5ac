//! Projection of map points at a pose, with its derivative (eq. 5).

use common::geometry::{PinholeCamera, Pose};
use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3, Vector6};

/// Nothing nearer to the camera than this is projected, metres: half the
/// distance from a roof-mounted camera to its own bonnet.
pub const NEAR_M: f64 = 0.5;

/// Size of the image, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageSize {
    /// Columns.
    pub width_px: f64,
    /// Rows.
    pub height_px: f64,
}

impl ImageSize {
    /// Whether a pixel lies in the image widened by `margin_px` on each side.
    #[inline]
    pub fn contains(&self, p: &Point2<f64>, margin_px: f64) -> bool {
        p.x >= -margin_px
            && p.y >= -margin_px
            && p.x <= self.width_px - 1.0 + margin_px
            && p.y <= self.height_px - 1.0 + margin_px
    }
}

/// A camera at a pose: matrices instead of quaternions, because every landmark
/// goes through it.
#[derive(Debug, Clone, Copy)]
pub struct View {
    camera: PinholeCamera,
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
}

impl View {
    /// The camera at `map_from_camera`.
    pub fn new(camera: &PinholeCamera, map_from_camera: &Pose) -> Self {
        let camera_from_map = map_from_camera.inverse();
        Self {
            camera: *camera,
            rotation: camera_from_map.rotation.to_rotation_matrix().into_inner(),
            translation: camera_from_map.translation.vector + camera.from_reference_m,
        }
    }

    /// The camera.
    pub fn camera(&self) -> &PinholeCamera {
        &self.camera
    }

    /// A map point in the axes of this camera (not the reference), metres.
    #[inline]
    pub fn to_camera(&self, point_map: &Point3<f64>) -> Vector3<f64> {
        self.rotation * point_map.coords + self.translation
    }

    /// The image of a point in this camera's axes that lies in front of it.
    #[inline]
    pub fn pixel(&self, p: &Vector3<f64>) -> Point2<f64> {
        let inverse_depth = 1.0 / p.z;
        Point2::new(
            self.camera.fx_px * p.x * inverse_depth + self.camera.cx_px,
            self.camera.fy_px * p.y * inverse_depth + self.camera.cy_px,
        )
    }

    /// A map point in the image with its depth (m); none behind [`NEAR_M`].
    #[inline]
    pub fn project(&self, point_map: &Point3<f64>) -> Option<(Point2<f64>, f64)> {
        let p = self.to_camera(point_map);
        (p.z >= NEAR_M).then(|| (self.pixel(&p), p.z))
    }

    /// Derivative of `normal . pixel` for the local tangent of the pose
    /// (`retract`), for the point `p` in this camera's axes.
    ///
    /// With q the point in the reference camera's frame, a tangent (rho, phi)
    /// moves it to `q - rho + q x phi`; with `g` the gradient of
    /// `normal . pixel` in p this gives `(-g, g x q)`.
    #[inline]
    pub fn jacobian_row(&self, p: &Vector3<f64>, normal: &Vector2<f64>) -> Vector6<f64> {
        let inverse_depth = 1.0 / p.z;
        let gx = normal.x * self.camera.fx_px * inverse_depth;
        let gy = normal.y * self.camera.fy_px * inverse_depth;
        let g = Vector3::new(gx, gy, -(gx * p.x + gy * p.y) * inverse_depth);
        let about = g.cross(&(p - self.camera.from_reference_m));
        Vector6::new(-g.x, -g.y, -g.z, about.x, about.y, about.z)
    }
}

/// Where on a segment in space (0 at `a`, 1 at `b`) the point lies that is
/// seen at `fraction` of the segment's image; depths in metres. Inverse depth
/// is linear in the image.
#[inline]
pub fn fraction_in_space(fraction: f64, depth_a_m: f64, depth_b_m: f64) -> f64 {
    let toward_b = fraction * depth_a_m;
    let toward_a = (1.0 - fraction) * depth_b_m;
    let sum = toward_a + toward_b;
    if sum.abs() < 1e-12 { fraction } else { toward_b / sum }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use common::geometry::{PoseParameters, Tangent, retract};
    use proptest::prelude::*;

    pub fn camera() -> PinholeCamera {
        PinholeCamera {
            fx_px: 707.0,
            fy_px: 709.0,
            cx_px: 602.0,
            cy_px: 183.0,
            from_reference_m: Vector3::new(0.06, 0.001, 0.006),
        }
    }

    proptest! {
        #[test]
        fn the_jacobian_is_the_derivative_of_the_projection(
            yaw_rad in -3.0..3.0_f64,
            pitch_rad in -0.2..0.2_f64,
            x in -8.0..8.0_f64,
            y in -5.0..2.0_f64,
            depth_m in 2.0..80.0_f64,
            angle in 0.0..6.2_f64,
        ) {
            let pose = PoseParameters { x_m: 3.0, y_m: -1.0, z_m: 40.0, yaw_rad, pitch_rad, roll_rad: 0.03 }.to_pose();
            let point = pose * Point3::new(x, y, depth_m);
            let normal = Vector2::new(angle.cos(), angle.sin());
            let view = View::new(&camera(), &pose);
            let row = view.jacobian_row(&view.to_camera(&point), &normal);
            for axis in 0..6 {
                let step = 1e-6;
                let mut delta = Tangent::zeros();
                delta[axis] = step;
                let at = |d: Tangent| {
                    let moved = View::new(&camera(), &retract(&pose, &d));
                    normal.dot(&moved.project(&point).unwrap().0.coords)
                };
                let numeric = (at(delta) - at(-delta)) / (2.0 * step);
                prop_assert!((numeric - row[axis]).abs() < 1e-4 * (1.0 + row[axis].abs()));
            }
        }

        #[test]
        fn a_view_projects_as_the_camera_does(x in -8.0..8.0_f64, depth_m in 1.0..80.0_f64) {
            let pose = PoseParameters { x_m: 1.0, y_m: 0.0, z_m: 2.0, yaw_rad: 0.4, pitch_rad: 0.01, roll_rad: 0.0 }.to_pose();
            let point = pose * Point3::new(x, 1.0, depth_m);
            let (pixel, _) = View::new(&camera(), &pose).project(&point).unwrap();
            let reference = camera().project_from_map(&pose.inverse(), &point, NEAR_M).unwrap();
            prop_assert!((pixel - reference).norm() < 1e-7);
        }

        #[test]
        fn the_fraction_in_space_projects_to_the_fraction_in_the_image(
            fraction in 0.0..1.0_f64, za in 1.0..50.0_f64, zb in 1.0..50.0_f64,
        ) {
            let view = View::new(&camera(), &Pose::identity());
            let (a, b) = (Point3::new(-2.0, 1.0, za), Point3::new(3.0, -1.0, zb));
            let ((pa, da), (pb, db)) = (view.project(&a).unwrap(), view.project(&b).unwrap());
            let between = a + (b - a) * fraction_in_space(fraction, da, db);
            let (pixel, _) = view.project(&between).unwrap();
            prop_assert!((pixel - (pa + (pb - pa) * fraction)).norm() < 1e-6);
        }
    }

    #[test]
    fn a_point_behind_is_not_projected() {
        let view = View::new(&camera(), &Pose::identity());
        assert!(view.project(&Point3::new(0.0, 0.0, -4.0)).is_none());
        assert!(view.project(&Point3::new(0.0, 0.0, 0.1)).is_none());
    }
}
