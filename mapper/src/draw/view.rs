//! From the map to the picture.

use std::fmt::Write as _;

use common::map::SemanticMap;
use nalgebra::{Matrix2, Point2, Point3, SymmetricEigen, Vector2};

use super::{MARGIN_PX, TITLE_PX, WIDTH_PX};

/// Highest picture of the map itself, pixels.
const HIGHEST_PX: f64 = 960.0;
/// Lowest picture of the map itself, pixels.
const LOWEST_PX: f64 = 60.0;

/// From the map to the picture.
pub struct View {
    /// Unit vector of the picture's right, in map (x, z).
    right: Vector2<f64>,
    /// What lies at the upper left corner of the drawn part, along the
    /// picture's right and down, metres.
    corner_m: Vector2<f64>,
    /// Scale of the picture.
    pub px_per_m: f64,
    /// Height of the drawn part, pixels.
    pub height_px: f64,
    /// Empty space left of the drawn part, pixels.
    indent_px: f64,
}

impl View {
    /// Fits all of a map into the width of the picture.
    pub fn of(map: &SemanticMap) -> Self {
        let drawn: Vec<Vector2<f64>> = map
            .roads
            .iter()
            .flat_map(|r| &r.path_map)
            .chain(map.poles.iter().map(|p| &p.foot_map))
            .chain(map.signs.iter().map(|s| &s.centroid_map))
            .chain(map.lanes.iter().flat_map(|l| &l.points_map))
            .map(above)
            .collect();
        let right = drive_direction(map);
        let turned = drawn.iter().map(|p| turned(p, &right));
        let low = turned.clone().reduce(|a, b| a.inf(&b)).unwrap_or_default();
        let high = turned.reduce(|a, b| a.sup(&b)).unwrap_or_default();
        let size = (high - low).map(|extent| extent.max(1.0));
        let width_px = WIDTH_PX - 2.0 * MARGIN_PX;
        let px_per_m = (width_px / size.x).min(HIGHEST_PX / size.y);
        let height_px = (size.y * px_per_m).max(LOWEST_PX);
        Self {
            right,
            corner_m: Vector2::new(low.x, f64::midpoint(low.y, high.y) - height_px / px_per_m / 2.0),
            px_per_m,
            height_px,
            indent_px: (width_px - size.x * px_per_m) / 2.0,
        }
    }

    /// Where a point is drawn, pixels.
    pub fn at(&self, p: &Point3<f64>) -> Point2<f64> {
        let px = (turned(&above(p), &self.right) - self.corner_m) * self.px_per_m;
        Point2::new(MARGIN_PX + self.indent_px + px.x, MARGIN_PX + TITLE_PX + px.y)
    }

    /// A polyline in the words of SVG.
    pub fn path(&self, points: &[Point3<f64>]) -> String {
        let mut d = String::new();
        for (i, p) in points.iter().enumerate() {
            let p = self.at(p);
            let _ = write!(d, "{}{:.1} {:.1}", if i == 0 { 'M' } else { 'L' }, p.x, p.y);
        }
        d
    }

    /// Size of a landmark, pixels: what can be told apart, but no larger than
    /// two metres where there is little room.
    pub fn mark_px(&self) -> f64 {
        (1.0 * self.px_per_m).clamp(1.6, 4.5)
    }
}

fn above(p: &Point3<f64>) -> Vector2<f64> {
    Vector2::new(p.x, p.z)
}

/// Coordinates along the picture's right and down. Seen from above with y
/// down, the right hand of (x, z) is (z, -x).
fn turned(p: &Vector2<f64>, right: &Vector2<f64>) -> Vector2<f64> {
    Vector2::new(p.dot(right), p.dot(&Vector2::new(right.y, -right.x)))
}

/// The main direction of the roads, such that the drive ends on the right.
fn drive_direction(map: &SemanticMap) -> Vector2<f64> {
    let path: Vec<Vector2<f64>> = map.roads.iter().flat_map(|road| &road.path_map).map(above).collect();
    let (Some(first), Some(last)) = (path.first(), path.last()) else { return Vector2::y() };
    let mean = path.iter().sum::<Vector2<f64>>() / path.len() as f64;
    let scatter: Matrix2<f64> = path.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
    if scatter.trace() < 1e-6 {
        return Vector2::y();
    }
    let eigen = SymmetricEigen::new(scatter);
    let axis: Vector2<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
    if axis.dot(&(last - first)) < 0.0 { -axis } else { axis }
}
