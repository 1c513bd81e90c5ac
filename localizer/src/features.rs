//! What one image gives to the localizer: lines and points in the image.
//!
//! All coordinates are pixels of the original image (not of a network's
//! input); (0, 0) is the centre of the top-left pixel, u right, v down.

use common::geometry::ImageLine;
use nalgebra::{Point2, Vector2};

/// Everything that one image gives.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Features {
    /// Centre lines of poles.
    pub poles: Vec<LineFeature>,
    /// Centre lines of trunks; none where nothing tells of vegetation.
    pub trunks: Option<Vec<LineFeature>>,
    /// Lane lines.
    pub lanes: Vec<LaneFeature>,
    /// Signs and lights.
    pub signs: Vec<PointFeature>,
}

impl Features {
    /// How many poles and trunks there are.
    pub fn uprights(&self) -> usize {
        self.poles.len() + self.trunks.as_ref().map_or(0, Vec::len)
    }
}

/// A straight centre line with its two ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineFeature {
    /// Upper end.
    pub upper_px: Point2<f64>,
    /// Lower end.
    pub lower_px: Point2<f64>,
    /// Standard deviation of the line's offset at its middle.
    pub offset_sigma_px: f64,
    /// Standard deviation of the line's direction.
    pub angle_sigma_rad: f64,
    /// Median width of the region across the line.
    pub width_px: f64,
    /// Mean class probability over the region.
    pub probability: f64,
    /// The upper end is cut: by the image border or by another object.
    pub upper_is_cut: bool,
    /// The lower end is cut: by the image border or by another object.
    pub lower_is_cut: bool,
}

impl LineFeature {
    /// The infinite line; none where both ends coincide.
    pub fn line(&self) -> Option<ImageLine> {
        ImageLine::through(&self.upper_px, &self.lower_px)
    }

    /// Distance of the two ends, pixels.
    pub fn length_px(&self) -> f64 {
        (self.upper_px - self.lower_px).norm()
    }
}

/// A lane line: its centre points from far to near, and the straight line
/// through the part that the paper uses.
#[derive(Debug, Clone, PartialEq)]
pub struct LaneFeature {
    /// Centre points, one per image row at most, from far (top) to near.
    pub points_px: Vec<Point2<f64>>,
    /// The straight line fitted to them.
    pub line: LineFeature,
    /// Where its marks begin and end, from near to far; none where the image
    /// was not asked, or shows no marks.
    pub edges: Vec<MarkEdge>,
}

/// An end of a mark of a dashed line, read from the brightness of the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkEdge {
    /// On the middle of the line.
    pub at_px: Point2<f64>,
    /// It is the end of the mark that is nearer to the camera.
    pub is_near: bool,
    /// Standard deviation along the line.
    pub sigma_px: f64,
}

/// A compact region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointFeature {
    /// What the network takes it for.
    pub kind: common::map::SignKind,
    /// Centroid of the region, weighted with its probability.
    pub centre_px: Point2<f64>,
    /// Width and height of its bounding box.
    pub extent_px: Vector2<f64>,
    /// Standard deviation of the centre, per axis.
    pub sigma_px: f64,
    /// Mean class probability over the region.
    pub probability: f64,
    /// It touches the image border, so its centre is not the sign's.
    pub is_cut: bool,
}
