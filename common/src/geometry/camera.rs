//! The pinhole camera and the projections of points and segments (eq. 5-7).

use nalgebra::{Matrix3, Matrix3x4, Point2, Point3, Vector3};

use super::Pose;

/// A rectified pinhole camera beside the reference camera, from a KITTI
/// projection matrix `P = K [I | K^-1 p4]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PinholeCamera {
    /// Focal length along u, pixels.
    pub fx_px: f64,
    /// Focal length along v, pixels.
    pub fy_px: f64,
    /// Principal point, pixels.
    pub cx_px: f64,
    /// Principal point, pixels.
    pub cy_px: f64,
    /// What is added to a point in the reference camera's frame to have it in
    /// this camera's frame, metres: `K^-1 p4` (the axes are parallel).
    pub from_reference_m: Vector3<f64>,
}

impl PinholeCamera {
    /// From a 3x4 projection matrix; none where its left 3x3 part is no upper
    /// triangular calibration matrix with positive focal lengths.
    pub fn from_projection(p: &Matrix3x4<f64>) -> Option<Self> {
        let k: Matrix3<f64> = p.fixed_columns::<3>(0).into_owned();
        let usable = k[(0, 0)] > 0.0
            && k[(1, 1)] > 0.0
            && (k[(2, 2)] - 1.0).abs() < 1e-6
            && k[(0, 1)].abs() < 1e-6
            && k[(1, 0)].abs() + k[(2, 0)].abs() + k[(2, 1)].abs() < 1e-6
            && p.iter().all(|v| v.is_finite());
        if !usable {
            return None;
        }
        let from_reference_m = k.try_inverse()? * p.column(3);
        Some(Self { fx_px: k[(0, 0)], fy_px: k[(1, 1)], cx_px: k[(0, 2)], cy_px: k[(1, 2)], from_reference_m })
    }

    /// The same camera of images that are stretched by so much across and down;
    /// the centres of pixels are at whole numbers.
    #[must_use]
    pub fn stretched(&self, across: f64, down: f64) -> Self {
        Self {
            fx_px: self.fx_px * across,
            fy_px: self.fy_px * down,
            // Half a pixel right of the edge, before and after; not a bit off where nothing is stretched.
            cx_px: self.cx_px * across + 0.5 * (across - 1.0),
            cy_px: self.cy_px * down + 0.5 * (down - 1.0),
            ..*self
        }
    }

    /// The 3x4 projection matrix: the inverse of [`Self::from_projection`].
    pub fn projection(&self) -> Matrix3x4<f64> {
        let k = Matrix3::new(self.fx_px, 0.0, self.cx_px, 0.0, self.fy_px, self.cy_px, 0.0, 0.0, 1.0);
        let p4 = k * self.from_reference_m;
        Matrix3x4::from_columns(&[k.column(0).into(), k.column(1).into(), k.column(2).into(), p4])
    }

    /// `pi_P` (eq. 5): a point in the reference camera's frame (m) to the image
    /// (px); none unless it lies at least `near_m` in front of the camera.
    pub fn project(&self, point_camera: &Point3<f64>, near_m: f64) -> Option<Point2<f64>> {
        let p = point_camera + self.from_reference_m;
        (p.z >= near_m && p.z > 0.0).then(|| self.project_in_front(&p))
    }

    /// `pi_L` (eq. 6, 7): a segment in the reference camera's frame (m) to the
    /// image (px), its part nearer than `near_m` cut off at that plane; none
    /// where nothing of it is in front.
    pub fn project_segment(
        &self,
        a_camera: &Point3<f64>,
        b_camera: &Point3<f64>,
        near_m: f64,
    ) -> Option<(Point2<f64>, Point2<f64>)> {
        let near_m = near_m.max(1e-6);
        let mut a = a_camera + self.from_reference_m;
        let mut b = b_camera + self.from_reference_m;
        if a.z < near_m && b.z < near_m {
            return None;
        }
        // One end may be behind; the division is by a difference of at least
        // its distance to the plane.
        if a.z < near_m {
            a += (b - a) * ((near_m - a.z) / (b.z - a.z));
        } else if b.z < near_m {
            b += (a - b) * ((near_m - b.z) / (a.z - b.z));
        }
        Some((self.project_in_front(&a), self.project_in_front(&b)))
    }

    /// As [`Self::project`], for a point given in the map.
    pub fn project_from_map(
        &self,
        camera_from_map: &Pose,
        point_map: &Point3<f64>,
        near_m: f64,
    ) -> Option<Point2<f64>> {
        self.project(&(camera_from_map * point_map), near_m)
    }

    /// The ray of a pixel in the reference camera's axes: direction with z = 1.
    pub fn ray(&self, pixel: &Point2<f64>) -> Vector3<f64> {
        Vector3::new((pixel.x - self.cx_px) / self.fx_px, (pixel.y - self.cy_px) / self.fy_px, 1.0)
    }

    fn project_in_front(&self, p: &Point3<f64>) -> Point2<f64> {
        Point2::new(self.fx_px * p.x / p.z + self.cx_px, self.fy_px * p.y / p.z + self.cy_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> PinholeCamera {
        PinholeCamera {
            fx_px: 700.0,
            fy_px: 710.0,
            cx_px: 600.0,
            cy_px: 180.0,
            from_reference_m: Vector3::new(0.06, 0.0, 0.005),
        }
    }

    #[test]
    fn projection_matrix_and_camera_are_inverse() {
        let back = PinholeCamera::from_projection(&camera().projection()).unwrap();
        assert!((back.from_reference_m - camera().from_reference_m).norm() < 1e-12);
        assert!((back.cx_px - 600.0).abs() < 1e-12);
    }

    #[test]
    fn a_point_projects_as_its_matrix_says() {
        let point = Point3::new(1.0, -2.0, 10.0);
        let h = camera().projection() * point.to_homogeneous();
        let uv = camera().project(&point, 0.1).unwrap();
        assert!((uv - Point2::new(h.x / h.z, h.y / h.z)).norm() < 1e-9);
    }

    #[test]
    fn what_is_seen_in_a_stretched_image_is_stretched_with_it() {
        let point = Point3::new(1.0, -2.0, 10.0);
        let uv = camera().project(&point, 0.1).unwrap();
        let stretched = camera().stretched(0.5, 0.25).project(&point, 0.1).unwrap();
        let corner = nalgebra::Vector2::repeat(0.5);
        assert!(
            ((uv + corner).coords.component_mul(&nalgebra::Vector2::new(0.5, 0.25)) - corner - stretched.coords).norm()
                < 1e-9
        );
        assert_eq!(camera().stretched(1.0, 1.0), camera());
        let back = camera().stretched(0.5, 0.25).stretched(2.0, 4.0);
        assert!((back.projection() - camera().projection()).norm() < 1e-9);
    }

    #[test]
    fn a_pixel_lies_on_its_ray() {
        let point = Point3::new(1.0, -2.0, 10.0);
        let uv = camera().project(&point, 0.1).unwrap();
        let in_camera = point.coords + camera().from_reference_m;
        assert!(camera().ray(&uv).cross(&in_camera).norm() < 1e-9);
    }

    #[test]
    fn a_segment_through_the_camera_is_cut_at_the_near_plane() {
        let (a, b) = camera().project_segment(&Point3::new(1.0, 1.0, -5.0), &Point3::new(1.0, 1.0, 5.0), 0.5).unwrap();
        assert!(a.coords.iter().chain(b.coords.iter()).all(|v| v.is_finite()));
        assert!((a.x - (600.0 + 700.0 * 1.06 / 0.5)).abs() < 1e-6);
        assert!(camera().project_segment(&Point3::new(0.0, 0.0, -1.0), &Point3::new(0.0, 1.0, 0.0), 0.5).is_none());
    }

    #[test]
    fn a_point_behind_is_none_and_never_divided_by() {
        assert!(camera().project(&Point3::new(0.0, 0.0, -0.005), 0.0).is_none());
        assert!(camera().project(&Point3::new(0.0, 0.0, -3.0), 0.1).is_none());
    }
}
