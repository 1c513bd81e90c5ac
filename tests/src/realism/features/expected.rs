//! Where the landmarks of a map should be seen.

use common::map::{LaneLine, Pole, SemanticMap, Sign};
use nalgebra::Point2;

use super::side::View;

/// Places along a landmark that are tried for being hidden.
const PLACES: usize = 8;
/// Farthest landmark, metres.
const FAR_M: f64 = 70.0;
/// Nearest one, metres: nearer ones are cut by the image.
const NEAR_M: f64 = 5.0;

/// A pole in the image.
pub struct ExpectedPole<'a> {
    /// Its number in the map.
    pub id: usize,
    /// The pole.
    pub pole: &'a Pole,
    /// Its upper end.
    pub upper_px: Point2<f64>,
    /// Its lower end.
    pub lower_px: Point2<f64>,
    /// Depth of its middle, metres.
    pub depth_m: f64,
    /// Most of it is in view: it should be found.
    pub is_visible: bool,
}

impl ExpectedPole<'_> {
    /// The column of its axis in a row.
    pub fn column_at(&self, row: f64) -> f64 {
        let (a, b) = (self.upper_px, self.lower_px);
        a.x + (b.x - a.x) * (row - a.y) / (b.y - a.y).max(1e-9)
    }

    /// Its rows inside the image, first and last.
    pub fn rows(&self, view: &View) -> (f64, f64) {
        (self.upper_px.y.max(0.0), self.lower_px.y.min(view.size().1 - 1.0))
    }
}

/// The poles that a view may show.
pub fn poles<'a>(view: &View, map: &'a SemanticMap) -> Vec<ExpectedPole<'a>> {
    let expected = |(id, pole): (usize, &'a Pole)| {
        let (upper_px, top_m) = view.project(&pole.top_map)?;
        let (lower_px, foot_m) = view.project(&pole.foot_map)?;
        let depth_m = 0.5 * (top_m + foot_m);
        let mut pole = ExpectedPole { id, pole, upper_px, lower_px, depth_m, is_visible: false };
        let (top, bottom) = pole.rows(view);
        let is_hidden = |i: usize| {
            let row = top + (bottom - top) * (i as f64 + 0.5) / PLACES as f64;
            let place = Point2::new(pole.column_at(row), row);
            !view.contains(&place, 3.0) || view.is_hidden(&place, depth_m)
        };
        let hidden = (0..PLACES).filter(|&i| is_hidden(i)).count();
        // Shorter ones are nothing that a localizer looks for.
        pole.is_visible = bottom - top >= 12.0 && 2 * hidden <= PLACES;
        (depth_m < FAR_M && depth_m > NEAR_M && bottom > top).then_some(pole)
    };
    map.poles.iter().enumerate().filter_map(expected).collect()
}

/// A sign in the image.
pub struct ExpectedSign<'a> {
    /// Its number in the map.
    pub id: usize,
    /// The sign.
    pub sign: &'a Sign,
    /// Its centre.
    pub centre_px: Point2<f64>,
    /// Its depth, metres.
    pub depth_m: f64,
    /// It is in view.
    pub is_visible: bool,
}

/// The signs that a view may show.
pub fn signs<'a>(view: &View, map: &'a SemanticMap) -> Vec<ExpectedSign<'a>> {
    let expected = |(id, sign): (usize, &'a Sign)| {
        let (centre_px, depth_m) = view.project(&sign.centroid_map)?;
        let is_visible = view.contains(&centre_px, 8.0) && !view.is_hidden(&centre_px, depth_m);
        (depth_m < FAR_M && depth_m > NEAR_M).then_some(ExpectedSign { id, sign, centre_px, depth_m, is_visible })
    };
    map.signs.iter().enumerate().filter_map(expected).collect()
}

/// A place on a lane line in the image.
#[derive(Debug, Clone, Copy)]
pub struct LanePlace {
    /// Where.
    pub at_px: Point2<f64>,
    /// Its depth, metres.
    pub depth_m: f64,
    /// It is in view.
    pub is_visible: bool,
}

/// The lane lines that a view may show: places about [`STEP_M`] apart, as many
/// of them as lie in the image.
pub fn lanes(view: &View, map: &SemanticMap) -> Vec<Vec<LanePlace>> {
    map.lanes.iter().map(|lane| places(view, lane)).collect()
}

/// Distance of places on a lane line, metres.
pub const STEP_M: f64 = 0.5;

fn places(view: &View, lane: &LaneLine) -> Vec<LanePlace> {
    let mut places = Vec::new();
    for pair in lane.points_map.windows(2) {
        let steps = ((pair[1] - pair[0]).norm() / STEP_M).ceil().max(1.0) as usize;
        for i in 0..steps {
            let point = pair[0] + (pair[1] - pair[0]) * (i as f64 / steps as f64);
            if let Some((at_px, depth_m)) = view.project(&point)
                && view.contains(&at_px, 2.0)
                && (3.0..FAR_M).contains(&depth_m)
            {
                places.push(LanePlace { at_px, depth_m, is_visible: !view.is_hidden(&at_px, depth_m) });
            }
        }
    }
    places
}
