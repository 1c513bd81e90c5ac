//! Straight lines through points in any direction.

use nalgebra::{Matrix2, Point2, SymmetricEigen, Vector2};

use crate::vision::centre::median;
use crate::vision::config::LaneConfig;

/// A straight line through points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StraightLine {
    pub(super) middle_px: Point2<f64>,
    /// Unit direction, down the image.
    pub(super) direction: Vector2<f64>,
    /// Root mean square distance of the points, pixels.
    pub(super) residual_px: f64,
    /// Extent of the points along the line, pixels.
    pub(super) length_px: f64,
}

impl StraightLine {
    /// Signed distance of a point, pixels.
    pub(super) fn off_px(&self, p: &Point2<f64>) -> f64 {
        self.direction.perp(&(p - self.middle_px))
    }

    /// The foot of a point on the line.
    pub(super) fn foot(&self, p: &Point2<f64>) -> Point2<f64> {
        self.middle_px + self.direction * self.direction.dot(&(p - self.middle_px))
    }

    /// Standard deviation of the offset at the middle: the mask's own error
    /// and what independent stretches of it leave of the rest, pixels.
    pub(super) fn offset_sigma_px(&self, config: &LaneConfig) -> f64 {
        (self.residual_px / self.independent(config).sqrt()).hypot(config.mask_sigma_px)
    }

    /// Standard deviation of the direction, the mask's own error included.
    pub(super) fn angle_sigma_rad(&self, config: &LaneConfig) -> f64 {
        self.angle_of_noise_rad(self.residual_px.hypot(config.mask_sigma_px), config)
    }

    /// How uncertain the scatter of the points leaves the direction.
    pub(super) fn direction_noise_rad(&self, config: &LaneConfig) -> f64 {
        self.angle_of_noise_rad(self.residual_px, config)
    }

    /// n independent points along a length l know the direction of their line
    /// to sigma sqrt(12 / n) / l.
    fn angle_of_noise_rad(&self, sigma_px: f64, config: &LaneConfig) -> f64 {
        sigma_px * (12.0 / self.independent(config)).sqrt() / self.length_px.max(1.0)
    }

    fn independent(&self, config: &LaneConfig) -> f64 {
        (self.length_px / config.correlation_px).max(1.0)
    }
}

/// The line with the least sum of squared distances, with Huber weights;
/// none through fewer than two places.
pub(super) fn straight_line(points: &[Point2<f64>]) -> Option<StraightLine> {
    let mut line: Option<StraightLine> = None;
    for _ in 0..4 {
        let scale = line.map(|line| median(points.iter().map(|p| line.off_px(p).abs())).max(0.05));
        let weight = |p: &Point2<f64>| match line.zip(scale) {
            // 1.5 standard deviations, one being 1.48 median residuals.
            Some((line, scale)) => (2.2 * scale / line.off_px(p).abs().max(1e-9)).min(1.0),
            None => 1.0,
        };
        let total: f64 = points.iter().map(weight).sum();
        let sum = points.iter().fold(Vector2::zeros(), |sum, p| sum + p.coords * weight(p));
        let middle_px = Point2::from(sum / total);
        let scatter = points.iter().fold(Matrix2::zeros(), |scatter, p| {
            let d = p - middle_px;
            scatter + d * d.transpose() * weight(p)
        });
        let eigen = SymmetricEigen::try_new(scatter, 1e-12, 100)?;
        let along = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
        let direction = along.try_normalize(1e-9)? * if along.y < 0.0 { -1.0 } else { 1.0 };
        let new = StraightLine { middle_px, direction, residual_px: 0.0, length_px: 0.0 };
        let squares: f64 = points.iter().map(|p| new.off_px(p).powi(2)).sum();
        let along = |p: &Point2<f64>| direction.dot(&(p - middle_px));
        let (low, high) =
            points.iter().map(along).fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(x), high.max(x)));
        if high - low < 1.0 {
            return None;
        }
        line = Some(StraightLine { residual_px: (squares / points.len() as f64).sqrt(), length_px: high - low, ..new });
    }
    line
}
