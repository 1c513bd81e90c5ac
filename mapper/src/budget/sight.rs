//! What a landmark tells a camera about its pose, place by place.
//!
//! A pole gives the distances of its two ends from a line in the image, a lane
//! line those of its knots and where the nearest of its marks ends along it, a
//! sign the two coordinates of its centre. Each is
//! linearised at the place: a row of the whitened Jacobian, so that the
//! information of a place is the sum of `row row^T` (Gauss-Markov).

use common::map::{LaneLine, Pole, PoleKind, Sign};
use nalgebra::{Point2, Point3, Vector2, Vector3, Vector6};

use super::BudgetConfig;
use super::places::{Place, Places};
use crate::evidence::{LineEvidence, PointEvidence};

/// A whitened row at a place. Pose tangent: right, down, forward (metres),
/// then rotations about them (radians), in the camera's axes.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// Index of the place.
    pub place: usize,
    /// The row, times the square root of `found`: found in a share of the
    /// images, it gives so much of the information.
    pub whitened: Vector6<f64>,
    /// Share of the images in which its landmark is found here.
    pub found: f64,
}

impl Row {
    fn new(place: usize, whitened: Vector6<f64>, found: f64) -> Self {
        let found = found.clamp(0.0, 1.0);
        Self { place, whitened: whitened * found.sqrt(), found }
    }
}

struct Lens<'a> {
    config: &'a BudgetConfig,
}

impl Lens<'_> {
    fn pixel(&self, p: &Vector3<f64>) -> Point2<f64> {
        let camera = &self.config.camera;
        Point2::new(
            camera.focal_px * p.x / p.z + camera.width_px / 2.0,
            camera.focal_px * p.y / p.z + camera.centre_row_px,
        )
    }

    fn is_between_columns(&self, p: &Vector3<f64>) -> bool {
        p.z > self.config.nearest_m && (0.0..=self.config.camera.width_px).contains(&self.pixel(p).x)
    }

    /// Where along its line the nearest end of a mark lies that is in view.
    fn along_line(&self, marks_map: &[[Point3<f64>; 2]], place: &Place) -> Option<Vector6<f64>> {
        let config = self.config;
        let ends = marks_map.iter().flat_map(|[from, to]| [(from, to - from), (to, to - from)]);
        let in_view = ends
            .map(|(end, along)| (place.in_camera(end), place.camera_from_map * along))
            .filter(|(p, _)| (config.lane_near_m..config.lane_far_m).contains(&p.z) && self.is_between_columns(p));
        let (p, along) = in_view.min_by(|a, b| a.0.z.total_cmp(&b.0.z))?;
        let step = along.try_normalize(1e-9)? * STEP_M;
        let way = (self.pixel(&(p + step)) - self.pixel(&p)) / STEP_M;
        let tangent = way.try_normalize(1e-9)?;
        let mark_px = config.mark_sigma_m * way.norm();
        let sigma_px = config.lane_sigma_px.hypot(config.calibration_sigma_px).hypot(mark_px);
        Some(self.row(&p, &tangent, sigma_px))
    }

    /// Derivative of `normal . pixel` for the pose, over its standard
    /// deviation; a point moves by `-rho + p x phi` in the camera's axes.
    fn row(&self, p: &Vector3<f64>, normal: &Vector2<f64>, sigma_px: f64) -> Vector6<f64> {
        let (gx, gy) = (normal.x * self.config.camera.focal_px / p.z, normal.y * self.config.camera.focal_px / p.z);
        let g = Vector3::new(gx, gy, -(gx * p.x + gy * p.y) / p.z);
        let about = g.cross(p);
        Vector6::new(-g.x, -g.y, -g.z, about.x, about.y, about.z) / sigma_px
    }
}

/// What a pole tells.
pub fn of_pole(pole: &Pole, evidence: &PointEvidence, places: &Places, config: &BudgetConfig) -> Vec<Row> {
    let found = &config.found;
    let (of_kind, half_px) = match pole.kind {
        PoleKind::Trunk => (found.trunks, found.half_of_poles_px),
        PoleKind::SignPost => (found.sign_posts, found.half_of_poles_px),
        PoleKind::LampPost => (1.0, found.half_of_poles_px),
        PoleKind::Delineator => (1.0, found.half_of_delineators_px),
    };
    let lens = Lens { config };
    let mut rows = Vec::new();
    for index in places.near(std::iter::once(pole.foot_map), config.farthest_m) {
        let place = &places.list[index];
        let Some((upper, lower)) = visible(place, pole, &lens) else { continue };
        let (a, b) = (lens.pixel(&upper), lens.pixel(&lower));
        let Some(along) = (b - a).try_normalize(1e-9) else { continue };
        let normal = Vector2::new(-along.y, along.x);
        let found = of_kind * share_found((b - a).norm() / half_px.max(1e-9));
        let landmark_m = evidence.sigma_m(&place.camera_from_map.row(0).transpose());
        for p in [upper, lower] {
            let landmark_px = landmark_m.hypot(config.landmark_sigma_m) * config.camera.focal_px / p.z;
            let sigma_px = config.pole_sigma_px.hypot(config.calibration_sigma_px).hypot(landmark_px);
            rows.push(Row::new(index, lens.row(&p, &normal, sigma_px), found));
        }
    }
    rows
}

/// Share of poles that are found at a length over that at which it is half.
fn share_found(length: f64) -> f64 {
    let steep = length.powf(1.5);
    steep / (1.0 + steep)
}

/// The part of a pole between the image's upper and lower edge, in the
/// camera's axes; none where it is too small, too far or beside the image.
fn visible(place: &Place, pole: &Pole, lens: &Lens) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let config = lens.config;
    let (foot, top) = (place.in_camera(&pole.foot_map), place.in_camera(&pole.top_map));
    let middle = (foot + top) / 2.0;
    let is_big = pole.length_m() > config.least_relative_size * middle.norm() && middle.norm() < config.farthest_m;
    if !is_big || foot.z < config.nearest_m || top.z < config.nearest_m || !lens.is_between_columns(&middle) {
        return None;
    }
    // Where the axis crosses a row: linear in the share of its length.
    let crossing = |row_px: f64| {
        let slope = (row_px - config.camera.centre_row_px) / config.camera.focal_px;
        let along = foot - top;
        (slope * top.z - top.y) / (along.y - slope * along.z)
    };
    let from = crossing(0.0).clamp(0.0, 1.0);
    let to = crossing(config.camera.height_px).clamp(0.0, 1.0);
    let (upper, lower) = (top + (foot - top) * from, top + (foot - top) * to);
    let least_px = config.least_relative_size * config.camera.focal_px;
    ((lens.pixel(&lower) - lens.pixel(&upper)).norm() > least_px).then_some((upper, lower))
}

/// What a sign tells.
pub fn of_sign(sign: &Sign, evidence: &PointEvidence, places: &Places, config: &BudgetConfig) -> Vec<Row> {
    let lens = Lens { config };
    let mut rows = Vec::new();
    for index in places.near(std::iter::once(sign.centroid_map), config.farthest_m) {
        let place = &places.list[index];
        let p = place.in_camera(&sign.centroid_map);
        let is_big = sign.size_m > config.least_relative_size * p.norm() && p.norm() < config.farthest_m;
        let is_seen = lens.is_between_columns(&p) && (0.0..=config.camera.height_px).contains(&lens.pixel(&p).y);
        if !is_big || !is_seen {
            continue;
        }
        for (axis, normal) in [(0, Vector2::x()), (1, Vector2::y())] {
            let landmark_m = evidence.sigma_m(&place.camera_from_map.row(axis).transpose());
            let landmark_px = landmark_m.hypot(config.landmark_sigma_m) * config.camera.focal_px / p.z;
            let size_px = sign.size_m * config.camera.focal_px / p.z * config.sign_sigma_of_size;
            let sigma_px = config.sign_sigma_px.hypot(size_px).hypot(config.calibration_sigma_px).hypot(landmark_px);
            rows.push(Row::new(index, lens.row(&p, &normal, sigma_px), config.found.signs));
        }
    }
    rows
}

/// So far along a line its direction in the image is taken, metres.
const STEP_M: f64 = 0.1;
/// Distance of the knots of a lane line, metres.
const KNOT_M: f64 = 5.0;

/// What a lane line tells: however many knots are seen, as much as two, and
/// however many marks, as much as one.
pub fn of_lane(lane: &LaneLine, evidence: &LineEvidence, places: &Places, config: &BudgetConfig) -> Vec<Row> {
    let lens = Lens { config };
    let knots = knots(lane);
    let marks: Vec<[Point3<f64>; 2]> = lane.marks_map().collect();
    let mut rows: Vec<Row> = Vec::new();
    for index in places.near(knots.iter().map(|knot| knot.0), config.lane_far_m) {
        let place = &places.list[index];
        let start = rows.len();
        let mut in_view_m = 0.0;
        for (point_map, along_map, length_m) in &knots {
            let (p, along) = (place.in_camera(point_map), place.camera_from_map * along_map);
            let is_ahead = p.z >= config.lane_near_m && p.z <= config.lane_far_m;
            if !is_ahead || !lens.is_between_columns(&p) {
                continue;
            }
            let Some(tangent) = (lens.pixel(&(p + along * STEP_M)) - lens.pixel(&p)).try_normalize(1e-9) else {
                continue;
            };
            let normal = Vector2::new(-tangent.y, tangent.x);
            in_view_m += length_m;
            let scale = config.camera.focal_px / p.z;
            let lateral_px = normal.x * evidence.lateral_sigma_m.hypot(config.lane_sigma_m) * scale;
            let vertical_px = normal.y * evidence.vertical_sigma_m.hypot(config.lane_sigma_m) * scale;
            let sigma_px = config.lane_sigma_px.hypot(config.calibration_sigma_px).hypot(lateral_px).hypot(vertical_px);
            rows.push(Row::new(index, lens.row(&p, &normal, sigma_px), 1.0));
        }
        let share = if lane.kind.is_painted() { config.found.lanes } else { config.found.kerbs };
        let found = share * (in_view_m / config.found.lane_length_m.max(1e-9)).min(1.0).powf(1.5);
        let seen = (rows.len() - start) as f64;
        for row in &mut rows[start..] {
            *row = Row::new(index, row.whitened * (2.0 / seen).min(1.0).sqrt(), found);
        }
        if let Some(whitened) = lens.along_line(&marks, place) {
            rows.push(Row::new(index, whitened, found * config.found.marks));
        }
    }
    rows
}

/// Points along a lane line, its direction there (map frame), and the length
/// that each stands for (metres).
fn knots(lane: &LaneLine) -> Vec<(Point3<f64>, Vector3<f64>, f64)> {
    let mut knots = Vec::new();
    for ends in lane.points_map.windows(2) {
        let along = ends[1] - ends[0];
        let Some(direction) = along.try_normalize(1e-9) else { continue };
        let count = (along.norm() / KNOT_M).ceil().max(1.0);
        let knot = |k: usize| (ends[0] + along * ((k as f64 + 0.5) / count), direction, along.norm() / count);
        knots.extend((0..count as usize).map(knot));
    }
    knots
}
