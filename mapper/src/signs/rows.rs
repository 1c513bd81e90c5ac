//! What single beams see of a post and of what hangs on it.
//!
//! A beam of one scan sweeps over a post as a short row of hits, and over a
//! plate as a long one. Rows need no reflectance: they see a plate from behind
//! and from afar, where the lidar reports none.

use nalgebra::{Matrix2, Point2, Point3, Vector2};

use super::views::Views;
use crate::cloud::CloudPoint;

/// An upright line that plates may hang on, map frame.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    /// Lower end, metres.
    pub foot: Point3<f64>,
    /// Upper end, metres.
    pub top: Point3<f64>,
    /// Radius of what stands there, metres.
    pub radius_m: f64,
}

impl Axis {
    /// A vertical line through a point.
    pub fn through(p: &Point3<f64>, radius_m: f64) -> Self {
        Self { foot: Point3::new(p.x, p.y + 1.0, p.z), top: Point3::new(p.x, p.y - 1.0, p.z), radius_m }
    }

    /// Its place (x, z) at a height along -y, metres.
    pub fn at(&self, height: f64) -> Point2<f64> {
        let rise = self.foot.y - self.top.y;
        let share = if rise > 1e-3 { (self.foot.y + height) / rise } else { 0.0 };
        Point2::new(self.foot.x + (self.top.x - self.foot.x) * share, self.foot.z + (self.top.z - self.foot.z) * share)
    }
}

/// The hits of one beam in one scan that hang together across the axis.
#[derive(Debug, Clone)]
pub struct Row {
    /// Which of the stitched scans.
    pub scan: u16,
    /// Distance from the lidar in the plane (x, z), metres.
    pub range_m: f64,
    /// Height of its middle along -y of the map, metres.
    pub height_m: f64,
    /// The same above the ground, metres.
    pub above_ground_m: f64,
    /// Direction of view in the plane (x, z), of unit length.
    pub view: Vector2<f64>,
    /// Outermost hits across the view from the axis, metres.
    pub span_m: (f64, f64),
    /// Middle between the outermost hits (x, z), metres.
    pub middle: Point2<f64>,
    /// Scatter of the hits in the plane (x, z) about their mean, m^2.
    pub scatter: Matrix2<f64>,
    /// Places (map frame, metres) and reflectances of the hits.
    pub hits: Vec<(Point3<f64>, f32)>,
    /// Mean reflectance of the hits.
    pub reflectance: f32,
    /// Largest reflectance of the hits.
    pub brightest: f32,
}

impl Row {
    /// Distance of the outermost hits across the view, metres.
    pub fn width_m(&self) -> f64 {
        self.span_m.1 - self.span_m.0
    }
}

/// Farthest off the axis that is looked at, metres: half of a large plate and
/// free space beside it.
pub const REACH_M: f64 = 1.4;
/// Largest difference in elevation of neighbours of a row, radians: a fifth of
/// the distance between two beams, for a vehicle that leans.
const SAME_BEAM: f64 = 0.2;
/// Largest step in depth within a row, metres: the corner of a box, not what
/// stands behind.
const STEP_M: f64 = 0.2;
/// Largest distance of a row's hits from the axis along the view, metres:
/// plates and lights hang before posts.
const BEFORE_M: f64 = 0.5;

struct Hit<'a> {
    point: &'a CloudPoint,
    across: f64,
    along: f64,
    elevation: f64,
}

/// The rows across an axis between two heights above ground (m), in the order
/// of the scans.
pub fn rows(views: &Views<'_>, axis: &Axis, heights_m: (f64, f64)) -> Vec<Row> {
    let cloud = views.cloud;
    let middle = nalgebra::center(&axis.foot, &axis.top);
    let mut points: Vec<&CloudPoint> = Vec::new();
    // Not collected: iterators of many short pieces are fast from within only.
    cloud
        .within_cells(&Point2::new(middle.x, middle.z), (REACH_M / cloud.ground.grid().cell_m).ceil() as usize)
        .filter(|p| (heights_m.0..=heights_m.1).contains(&f64::from(p.height_m)))
        .for_each(|p| points.push(p));
    points.sort_by_key(|p| p.scan);
    points.chunk_by(|a, b| a.scan == b.scan).flat_map(|of_scan| rows_of_scan(views, axis, of_scan)).collect()
}

fn rows_of_scan(views: &Views<'_>, axis: &Axis, points: &[&CloudPoint]) -> Vec<Row> {
    let Views { cloud, lidar, .. } = views;
    let Some(first) = points.first() else { return Vec::new() };
    let sensor = cloud.sensors[usize::from(first.scan)].at_map;
    let eye = Point2::new(sensor.x, sensor.z);
    let middle = nalgebra::center(&axis.foot, &axis.top);
    let away = Point2::new(middle.x, middle.z) - eye;
    let Some(view) = away.try_normalize(0.5) else { return Vec::new() };
    let range_m = away.norm();
    let mut hits: Vec<Hit> = points
        .iter()
        .map(|p| {
            let at = Point2::new(p.position.x, p.position.z);
            let off = at - axis.at(-p.position.y);
            let elevation = (sensor.y - p.position.y).atan2((at - eye).norm());
            Hit { point: p, across: view.perp(&off), along: view.dot(&off), elevation }
        })
        .filter(|h| h.across.abs() < REACH_M && h.along.abs() < BEFORE_M)
        .collect();
    hits.sort_by(|a, b| a.across.total_cmp(&b.across));
    // Two missing returns do not end a row.
    let gap_m = 2.5 * lidar.azimuth_step_rad * range_m + 0.02;
    let mut parent: Vec<usize> = (0..hits.len()).collect();
    for i in 0..hits.len() {
        for j in (0..i).rev() {
            if hits[i].across - hits[j].across > gap_m {
                break;
            }
            if (hits[i].elevation - hits[j].elevation).abs() < SAME_BEAM * lidar.elevation_step_rad
                && (hits[i].along - hits[j].along).abs() < STEP_M
            {
                let (a, b) = (root(&mut parent, i), root(&mut parent, j));
                parent[a.max(b)] = a.min(b);
            }
        }
    }
    let mut named: Vec<(usize, usize)> = (0..hits.len()).map(|i| (root(&mut parent, i), i)).collect();
    named.sort_unstable();
    named
        .chunk_by(|a, b| a.0 == b.0)
        .filter_map(|members| row(&members.iter().map(|(_, i)| &hits[*i]).collect::<Vec<_>>(), view, range_m))
        .filter(|row| {
            let near = axis.radius_m + NEAR_AXIS_M + 0.5 * gap_m;
            row.span_m.0 < near && row.span_m.1 > -near
        })
        .collect()
}

/// A row comes as near to the axis as this, metres: a light hangs before its mast.
const NEAR_AXIS_M: f64 = 0.1;

fn root(parent: &mut [usize], mut i: usize) -> usize {
    while parent[i] != i {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    i
}

fn row(hits: &[&Hit], view: Vector2<f64>, range_m: f64) -> Option<Row> {
    let (first, last) = (hits.first()?, hits.last()?);
    let count = hits.len() as f64;
    let at = |h: &Hit| Point2::new(h.point.position.x, h.point.position.z);
    let mean = hits.iter().map(|h| at(h).coords).sum::<Vector2<f64>>() / count;
    let scatter = hits.iter().fold(Matrix2::zeros(), |sum, h| {
        let d = at(h).coords - mean;
        sum + d * d.transpose()
    });
    Some(Row {
        scan: first.point.scan,
        range_m,
        height_m: hits.iter().map(|h| -h.point.position.y).sum::<f64>() / count,
        above_ground_m: hits.iter().map(|h| f64::from(h.point.height_m)).sum::<f64>() / count,
        view,
        span_m: (first.across, last.across),
        middle: nalgebra::center(&at(first), &at(last)),
        scatter,
        hits: hits.iter().map(|h| (h.point.position, h.point.reflectance)).collect(),
        reflectance: hits.iter().map(|h| h.point.reflectance).sum::<f32>() / count as f32,
        brightest: hits.iter().map(|h| h.point.reflectance).fold(0.0, f32::max),
    })
}

/// A row of a scan 12 m away, so long, in the middle of its post at the origin.
#[cfg(test)]
pub fn row_across(scan: u16, height: f64, width_m: f64) -> Row {
    Row {
        scan,
        range_m: 12.0,
        height_m: height,
        above_ground_m: height,
        view: Vector2::y(),
        span_m: (-width_m / 2.0, width_m / 2.0),
        middle: Point2::origin(),
        scatter: Matrix2::zeros(),
        hits: Vec::new(),
        reflectance: 0.4,
        brightest: 0.4,
    }
}
