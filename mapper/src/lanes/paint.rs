//! The road's points by their place beside an axis, and which are paint.

use rayon::prelude::*;

use super::LaneConfig;
use crate::cloud::{Cloud, CloudPoint};

/// A ground point by its place beside the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Station along the path, metres.
    pub station_m: f64,
    /// Offset to the right of the path, metres.
    pub offset_m: f64,
    /// Height in the map frame, metres, up.
    pub height_m: f32,
    /// How much brighter than its beam on both sides, standard deviations.
    pub contrast: f32,
}

/// The road's points beside an axis, each list sorted by station.
pub struct Paint {
    /// Points of paint.
    pub bright: Vec<PathPoint>,
    /// All road points in range, for where paint could have been seen.
    pub road: Vec<PathPoint>,
}

impl Paint {
    /// The paint in a stitched cloud, by its place beside the driven path.
    pub fn of(cloud: &Cloud, config: &LaneConfig) -> Self {
        let mut road: Vec<PathPoint> = cloud
            .points
            .par_iter()
            .filter_map(|p| {
                let contrast = p.contrast.filter(|_| is_road(p, config))?;
                let place = cloud.place(&p.position);
                (place.offset_m.abs() < config.half_width_m).then_some(PathPoint {
                    station_m: place.station_m,
                    offset_m: place.offset_m,
                    height_m: -p.position.y as f32,
                    contrast,
                })
            })
            .collect();
        // Stable: points of one station keep the order of the scans.
        road.par_sort_by(|a, b| a.station_m.total_cmp(&b.station_m));
        Self { bright: road.iter().filter(|p| p.contrast >= config.least_contrast).copied().collect(), road }
    }
}

/// Whether a point lies on the ground and near enough for paint to be seen.
fn is_road(p: &CloudPoint, config: &LaneConfig) -> bool {
    f64::from(p.height_m.abs()) < config.thickness_m && f64::from(p.range_m) < config.contrast.farthest_m
}

/// Points with stations in a range, of a list sorted by station.
pub(super) fn between(points: &[PathPoint], from_m: f64, to_m: f64) -> &[PathPoint] {
    let a = points.partition_point(|p| p.station_m < from_m);
    let b = points.partition_point(|p| p.station_m < to_m);
    &points[a..b.max(a)]
}
