//! Lane lines: regions of the class lane to curves, and the straight line
//! through the part that the paper uses.

mod fit;
mod join;
mod marks;
mod trace;

use nalgebra::Point2;

use super::centre::median;
use super::config::{LaneConfig, MarkConfig};
use super::regions::{self, Growth};
use super::{Class, Plane, ProbabilityMaps};
use crate::features::{LaneFeature, LineFeature};
use fit::straight_line;
use trace::{Track, TrackPoint};

/// The lane lines of an image, by the column of their near ends.
pub fn extract(maps: &ProbabilityMaps, config: &LaneConfig) -> Vec<LaneFeature> {
    let plane = maps.plane(Class::Lane);
    let growth = Growth { threshold: config.threshold, seed: config.seed, min_area_px: config.min_area_px };
    let regions = regions::grow(plane, &growth);
    let tracks = regions.iter().flat_map(|region| trace::trace(plane, region, config.min_piece_px)).collect();
    let tracks = join::join(tracks, config);
    let size = (maps.width() as f64, maps.height() as f64);
    let mut lanes: Vec<LaneFeature> = tracks.iter().filter_map(|track| feature(track, size, config)).collect();
    lanes.sort_by(|a, b| a.line.lower_px.x.total_cmp(&b.line.lower_px.x));
    lanes
}

/// Reads the ends of the marks along each line from the image; nothing where
/// the settings do not say where the ground is.
pub fn read_marks(lanes: &mut [LaneFeature], image: &Plane, config: &LaneConfig, marks: &MarkConfig) {
    let Some(ground) = &config.ground else { return };
    for lane in lanes {
        lane.edges = marks::edges(image, &lane.points_px, ground, marks);
    }
}

fn feature(track: &Track, size: (f64, f64), config: &LaneConfig) -> Option<LaneFeature> {
    let points_px = by_row(&track.points);
    let fitted = used_part(&points_px, config);
    let line = straight_line(fitted)?;
    let across = |p: &TrackPoint| p.width_px * if p.is_column { line.direction.x.abs() } else { line.direction.y };
    let width_px = median(track.points.iter().map(across));
    let length = track.length_px();
    let is_lane = length >= config.min_length_px
        && length >= config.min_aspect * width_px
        && line.direction.y >= config.min_slope_deg.to_radians().sin();
    let (far, near) = fitted.first().zip(fitted.last())?;
    let (upper_px, lower_px) = (line.foot(far), line.foot(near));
    let near_border = |p: &Point2<f64>| {
        const BORDER_PX: f64 = 2.5;
        p.x.min(p.y).min(size.0 - 1.0 - p.x).min(size.1 - 1.0 - p.y) < BORDER_PX.max(0.5 * width_px)
    };
    let probability = track.points.iter().map(|p| p.probability).sum::<f64>() / track.points.len().max(1) as f64;
    let line = LineFeature {
        upper_px,
        lower_px,
        offset_sigma_px: line.offset_sigma_px(config),
        angle_sigma_rad: line.angle_sigma_rad(config),
        width_px,
        probability,
        upper_is_cut: near_border(&upper_px),
        lower_is_cut: near_border(&lower_px),
    };
    is_lane.then_some(LaneFeature { points_px, line, edges: Vec::new() })
}

/// One point per row: the mean of those that fall into it.
fn by_row(points: &[TrackPoint]) -> Vec<Point2<f64>> {
    let mut sorted: Vec<Point2<f64>> = points.iter().map(|p| p.at_px).collect();
    sorted.sort_by(|a, b| a.y.total_cmp(&b.y));
    sorted
        .chunk_by(|a, b| b.y.round() - a.y.round() < 0.5)
        .map(|row| Point2::from(row.iter().map(|p| p.coords).sum::<nalgebra::Vector2<f64>>() / row.len() as f64))
        .collect()
}

/// The points between the near and the far distance, where the ground is
/// known and enough of them are there to give a direction; else all.
fn used_part<'a>(points: &'a [Point2<f64>], config: &LaneConfig) -> &'a [Point2<f64>] {
    const ENOUGH: usize = 10;
    let Some(ground) = &config.ground else { return points };
    let (far, near) = (ground.row_px(config.far_m), ground.row_px(config.near_m));
    let first = points.partition_point(|p| p.y < far);
    let last = points.partition_point(|p| p.y <= near);
    points.get(first..last).filter(|part| part.len() >= ENOUGH).unwrap_or(points)
}

#[cfg(test)]
mod tests;
