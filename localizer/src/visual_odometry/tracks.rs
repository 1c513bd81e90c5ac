//! Points that are followed from one image to the next (Shi and Tomasi 1994,
//! Bouguet 2000), by `optical-flow-lk`.

use common::geometry::PinholeCamera;
use image::GrayImage;
use nalgebra::Point2;
use optical_flow_lk::{
    DEFAULT_MIN_EIGEN_THRESHOLD, DetectorContext, Grid, TrackOptions, TrackParams, TrackStatus, TrackerContext,
};

use super::config::TrackConfig;
use super::depths::InverseDepth;
use super::rotation::Track;

/// Most steps at a level: nearly all end before.
const ROUNDS: usize = 20;

/// Finds points and follows them; its buffers are used again.
pub(super) struct Follower {
    config: TrackConfig,
    detector: DetectorContext,
    tracker: TrackerContext,
    points_px: Vec<(f32, f32)>,
    /// Depths of the first of them, in the image that they were found in.
    depths: Vec<Option<InverseDepth>>,
    expected_px: Vec<(f32, f32)>,
}

impl Follower {
    pub fn new(config: TrackConfig) -> Self {
        Self {
            config,
            detector: DetectorContext::new(),
            tracker: TrackerContext::new(),
            points_px: Vec::new(),
            depths: Vec::new(),
            expected_px: Vec::new(),
        }
    }

    /// The next image.
    pub fn advance(&mut self, image: &GrayImage) {
        self.tracker.advance(image, self.config.levels.max(1));
    }

    /// The points that are followed on from the last image, pixels, with their depths in it.
    pub fn keep(&mut self, points: impl Iterator<Item = ((f32, f32), Option<InverseDepth>)>) {
        (self.points_px, self.depths) = points.unzip();
    }

    /// Follows none of them on; whether there were any.
    pub fn forget(&mut self) -> bool {
        let had_points = !self.depths.is_empty();
        self.depths.clear();
        had_points
    }

    /// Finds the points of `before`, the image before the last that was given, besides
    /// those that were kept.
    pub fn find(&mut self, before: &GrayImage) {
        let config = &self.config;
        self.points_px.truncate(self.depths.len());
        let grid =
            Grid { cols: config.columns.max(1), rows: config.rows.max(1), max_per_cell: config.most_in_cell.max(1) };
        let corners = self.detector.detect_grid(before, grid, config.least_quality, config.apart_px, &self.points_px);
        self.points_px.extend(corners.iter().map(optical_flow_lk::Corner::position));
    }

    /// Those that were found and are in the last image, too, as directions
    /// (pixels over the focal length from the optical axis). `expected` says
    /// where one may be.
    pub fn follow(
        &mut self,
        camera: &PinholeCamera,
        expected: impl Fn(&Point2<f64>, Option<InverseDepth>) -> Option<Point2<f64>>,
    ) -> Vec<Track> {
        let config = &self.config;
        self.expected_px.clear();
        self.expected_px.extend(self.points_px.iter().enumerate().map(|(i, &point_px)| {
            let depth = self.depths.get(i).copied().flatten();
            expected(&direction(camera, point_px), depth).map_or(point_px, |expected| {
                let pixel = |value: f64, focal_px: f64, centre_px: f64| (value * focal_px + centre_px) as f32;
                (pixel(expected.x, camera.fx_px, camera.cx_px), pixel(expected.y, camera.fy_px, camera.cy_px))
            })
        }));
        let params = TrackParams {
            window_size: config.window_px | 1,
            max_iterations: ROUNDS,
            min_eigen_threshold: DEFAULT_MIN_EIGEN_THRESHOLD,
        };
        let options = TrackOptions::new().with_fb_levels(1);
        let (points_px, expected_px) = (&self.points_px, &self.expected_px);
        let found = self.tracker.track_fb_with(points_px, Some(expected_px), params, config.round_trip_px, options);
        let depths = self.depths.iter().copied().chain(std::iter::repeat(None));
        let points = points_px.iter().zip(depths).zip(found);
        points
            .filter(|(_, found)| found.status == TrackStatus::Tracked)
            .map(|((&point_px, depth), found)| Track {
                before: direction(camera, point_px),
                after: direction(camera, found.pos),
                depth,
                after_px: found.pos,
            })
            .collect()
    }
}

fn direction(camera: &PinholeCamera, (u_px, v_px): (f32, f32)) -> Point2<f64> {
    Point2::new((f64::from(u_px) - camera.cx_px) / camera.fx_px, (f64::from(v_px) - camera.cy_px) / camera.fy_px)
}
