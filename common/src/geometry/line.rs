//! Lines in the image.

use nalgebra::{Point2, Vector2};

/// A line in the image in Hesse form, `normal . p = offset_px`, with a unit
/// normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageLine {
    /// Unit normal.
    pub normal: Vector2<f64>,
    /// Distance of the line from the image origin along the normal, pixels.
    pub offset_px: f64,
}

impl ImageLine {
    /// The line through two points (pixels), or none where they coincide.
    pub fn through(a: &Point2<f64>, b: &Point2<f64>) -> Option<Self> {
        let along = (b - a).try_normalize(1e-9)?;
        let normal = Vector2::new(-along.y, along.x);
        Some(Self { normal, offset_px: normal.dot(&a.coords) })
    }

    /// Signed distance of a point (pixels) from the line, in pixels.
    pub fn signed_distance_px(&self, p: &Point2<f64>) -> f64 {
        self.normal.dot(&p.coords) - self.offset_px
    }

    /// Unit direction of the line.
    pub fn direction(&self) -> Vector2<f64> {
        Vector2::new(self.normal.y, -self.normal.x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_on_the_line_have_no_distance_and_the_sign_tells_the_side() {
        let line = ImageLine::through(&Point2::new(1.0, 1.0), &Point2::new(5.0, 4.0)).unwrap();
        assert!(line.signed_distance_px(&Point2::new(9.0, 7.0)).abs() < 1e-12);
        assert!((line.normal.norm() - 1.0).abs() < 1e-12);
        let left = line.signed_distance_px(&Point2::new(0.0, 9.0));
        let right = line.signed_distance_px(&Point2::new(9.0, 0.0));
        assert!(left * right < 0.0);
        assert!(ImageLine::through(&Point2::origin(), &Point2::origin()).is_none());
    }
}
