//! The one residual that all landmarks share: a map point seen on an image
//! line.
//!
//! A pole gives two of them, the ends of its projected segment against the
//! feature's line. That is eq. 9 split in two: as one absolute value per line
//! the optimiser crawls (28 to 43 iterations), as two signed distances it
//! takes 3 or 4. A low pole gives its ends, too, each against the place where the
//! feature ends. A lane line gives one per place along its curve, each against
//! the local tangent of the feature; a sign gives two, against the vertical and
//! the horizontal through its centre (eq. 8).

use nalgebra::{Point2, Point3, Vector2, Vector6};

use crate::projection::{NEAR_M, View};

/// A map point that is seen on an image line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// The point, map frame, metres. It is held fixed while the pose moves.
    pub point_map: Point3<f64>,
    /// Unit normal of the image line.
    pub normal: Vector2<f64>,
    /// `normal . pixel` of the line's pixels.
    pub offset_px: f64,
    /// Standard deviation of the distance: feature, landmark, calibration.
    pub sigma_px: f64,
}

impl Observation {
    /// The point is seen on the line through `on_line_px` with this normal.
    #[inline]
    pub fn on_line(point_map: Point3<f64>, normal: Vector2<f64>, on_line_px: &Point2<f64>, sigma_px: f64) -> Self {
        Self { point_map, normal, offset_px: normal.dot(&on_line_px.coords), sigma_px }
    }

    /// Signed distance in the image, pixels; none behind the camera.
    #[inline]
    pub fn distance_px(&self, view: &View) -> Option<f64> {
        let (pixel, _) = view.project(&self.point_map)?;
        Some(self.normal.dot(&pixel.coords) - self.offset_px)
    }

    /// Signed distance (px) and its derivative for the local tangent of the
    /// pose; none behind the camera.
    #[inline]
    pub fn linearise(&self, view: &View) -> Option<(f64, Vector6<f64>)> {
        let p = view.to_camera(&self.point_map);
        (p.z >= NEAR_M).then(|| {
            let distance_px = self.normal.dot(&view.pixel(&p).coords) - self.offset_px;
            (distance_px, view.jacobian_row(&p, &self.normal))
        })
    }
}

/// Observations of one correspondence: they are believed or doubted together.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Group {
    /// First observation.
    pub start: usize,
    /// One past the last.
    pub end: usize,
    /// Filled by the solver: mean of the squared whitened distances.
    pub mean_square: f64,
    /// Filled by the solver: weight under the robust loss, 0 to 1.
    pub weight: f64,
}

impl Group {
    /// The observations `start..end`, not judged yet.
    pub fn new(start: usize, end: usize) -> Self {
        Self { start, end, mean_square: 0.0, weight: 1.0 }
    }
}
