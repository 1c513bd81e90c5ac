//! Lane lines.

use common::map::SemanticMap;
use localizer::features::LaneFeature;
use localizer::vision::Class;
use localizer::vision::config::LaneConfig;
use localizer::vision::regions::{self, Growth};
use nalgebra::Point2;

use super::expected::{self, LanePlace, STEP_M};
use super::persistence::{Changes, Tracks};
use super::poles::size_bin;
use super::side::View;
use super::table::{Row, Samples, Share, per_frame};
use super::{DISTANCES_M, distance_bin, distance_name};

/// Lengths of features that are told apart, pixels.
const LENGTHS_PX: [f64; 2] = [60.0, 200.0];
const SIZES: [&str; 3] = ["short", "medium", "long"];

/// What the label images show of the lane lines of a map.
#[derive(Debug, Default)]
pub struct Lanes {
    regions: usize,
    features: [usize; 3],
    false_features: [usize; 3],
    covered: [Share; DISTANCES_M.len() - 1],
    lateral_m: [Samples; DISTANCES_M.len() - 1],
    lateral_px: Samples,
    angle_deg: Samples,
    offset_px: Samples,
    angle_change_deg: Changes,
    offset_change_px: Changes,
    width_px: Samples,
    near_end_px: Samples,
    probability: Samples,
    gaps_m: Samples,
    seen_m: f64,
    per_line: Samples,
    tracks: Tracks,
}

impl Lanes {
    /// Adds a frame.
    pub fn add(&mut self, view: &View, map: &SemanticMap, config: &LaneConfig) {
        let growth = Growth { threshold: config.threshold, seed: config.seed, min_area_px: config.min_area_px };
        self.regions += regions::grow(view.maps.plane(Class::Lane), &growth).len();
        let expected = expected::lanes(view, map);
        let mut pieces = vec![0_usize; expected.len()];
        for feature in &view.features.lanes {
            let length_px =
                feature.points_px.first().zip(feature.points_px.last()).map_or(0.0, |(a, b)| (a - b).norm());
            let size = size_bin(length_px, LENGTHS_PX);
            self.features[size] += 1;
            self.width_px.push(feature.line.width_px);
            self.probability.push(feature.line.probability);
            let nearest =
                expected.iter().enumerate().filter_map(|(i, lane)| Some((i, Offsets::of(feature, lane, view)?)));
            if let Some((index, offsets)) = nearest.min_by(|a, b| a.1.median_m.total_cmp(&b.1.median_m)) {
                pieces[index] += 1;
                self.add_match(feature, (view.frame, index), &expected[index], &offsets);
            } else {
                self.false_features[size] += 1;
                self.tracks.add(view.frame, nalgebra::center(&feature.line.upper_px, &feature.line.lower_px));
            }
        }
        for (lane, pieces) in expected.iter().zip(pieces) {
            if lane.iter().filter(|place| place.is_visible).count() as f64 * STEP_M > 10.0 {
                self.per_line.push(pieces as f64);
            }
            self.add_cover(lane, view);
        }
    }

    fn add_match(&mut self, feature: &LaneFeature, (frame, id): (usize, usize), lane: &[LanePlace], offsets: &Offsets) {
        for &(du_px, du_m, depth_m) in &offsets.all {
            self.lateral_px.push(du_px);
            if let Some(bin) = distance_bin(depth_m) {
                self.lateral_m[bin].push(du_m);
            }
        }
        // The line through the true line's places in the same rows.
        let (upper, lower) = (feature.line.upper_px, feature.line.lower_px);
        let (Some(far), Some(near)) = (at_row(lane, upper.y), at_row(lane, lower.y)) else { return };
        let (far, near) = (Point2::new(far.0, upper.y), Point2::new(near.0, lower.y));
        if let (Some(found), Some(wanted)) = (feature.line.line(), common::geometry::ImageLine::through(&far, &near)) {
            let sine = found.normal.perp(&wanted.normal).clamp(-1.0, 1.0);
            let offset_px = wanted.signed_distance_px(&nalgebra::center(&upper, &lower));
            self.angle_deg.push(sine.asin().to_degrees());
            self.offset_px.push(offset_px);
            self.angle_change_deg.add(id, frame, sine.asin().to_degrees());
            self.offset_change_px.add(id, frame, offset_px);
        }
        if let (Some(last), Some(place)) =
            (feature.points_px.last(), lane.iter().max_by(|a, b| a.at_px.y.total_cmp(&b.at_px.y)))
        {
            self.near_end_px.push(place.at_px.y - last.y);
        }
    }

    /// Where along a line the mask is, and how long its gaps are.
    fn add_cover(&mut self, lane: &[LanePlace], view: &View) {
        let plane = view.maps.plane(Class::Lane);
        let mut gap_m = 0.0;
        for place in lane {
            let Some(bin) = distance_bin(place.depth_m).filter(|_| place.is_visible) else {
                gap_m = 0.0;
                continue;
            };
            let covered = (-3..=3).any(|du| {
                (-1..=1).any(|dv| plane.at(place.at_px.x + f64::from(du), place.at_px.y + f64::from(dv)) >= 77)
            });
            self.covered[bin].add(covered);
            // Beyond 30 m a dash is too short to be told from a gap.
            if place.depth_m < 30.0 {
                self.seen_m += STEP_M;
                if covered {
                    if gap_m >= 1.0 {
                        self.gaps_m.push(gap_m);
                    }
                    gap_m = 0.0;
                } else {
                    gap_m += STEP_M;
                }
            }
        }
    }

    /// All rows.
    pub fn rows(&self, frames: usize) -> Vec<Row> {
        let mut rows = vec![
            per_frame("lane regions per frame", self.regions, frames),
            per_frame("lane features per frame", self.features.iter().sum(), frames),
        ];
        for (size, name) in SIZES.iter().enumerate() {
            rows.push(per_frame(format!("lane features, {name}, per frame"), self.features[size], frames));
        }
        rows.push(per_frame("lane features false, per frame", self.false_features.iter().sum(), frames));
        for (size, name) in SIZES.iter().enumerate() {
            rows.push(per_frame(format!("lane features false, {name}, per frame"), self.false_features[size], frames));
        }
        rows.push(self.per_line.mean("lane features for a line that is in view"));
        for (bin, share) in self.covered.iter().enumerate() {
            rows.push(share.row(format!("lane line covered at {}, share", distance_name(bin))));
        }
        for (bin, samples) in self.lateral_m.iter().enumerate() {
            rows.extend(samples.magnitudes(&format!("lane sideways error at {}, m", distance_name(bin))));
        }
        rows.push(self.lateral_px.quantile("lane sideways error, px, median with sign", 0.5));
        rows.extend(self.angle_deg.magnitudes("lane angle error, degrees"));
        rows.extend(self.offset_px.magnitudes("lane offset error, px"));
        rows.extend(self.angle_change_deg.rows("lane angle, frame to frame, degrees"));
        rows.extend(self.offset_change_px.rows("lane offset, frame to frame, px"));
        rows.push(self.width_px.quantile("lane width in the mask, px, median", 0.5));
        rows.push(self.width_px.quantile("lane width in the mask, px, p95", 0.95));
        rows.push(self.probability.quantile("lane probability, median", 0.5));
        rows.push(self.near_end_px.quantile("lane feature ends above the line's end, rows, median", 0.5));
        rows.push(per_frame(
            "lane gaps within 30 m per 10 m of line",
            self.gaps_m.len(),
            (self.seen_m / 10.0) as usize,
        ));
        rows.push(self.gaps_m.quantile("lane gap length, m, median", 0.5));
        rows.push(self.tracks.row("lane features"));
        rows
    }
}

/// How far the points of a feature lie beside a line of the map.
struct Offsets {
    /// Pixels along the row, metres, depth in metres.
    all: Vec<(f64, f64, f64)>,
    median_m: f64,
}

impl Offsets {
    /// None where the feature shows something else.
    fn of(feature: &LaneFeature, lane: &[LanePlace], view: &View) -> Option<Self> {
        /// Half of what two lines side by side are apart, metres.
        const BESIDE_M: f64 = 0.4;
        let all: Vec<_> = feature
            .points_px
            .iter()
            .filter_map(|p| {
                let (column, depth_m) = at_row(lane, p.y)?;
                let du_px = p.x - column;
                Some((du_px, du_px * depth_m / view.camera.fx_px, depth_m))
            })
            .collect();
        // At least half of the feature lies beside what the map has.
        if 2 * all.len() < feature.points_px.len() || all.is_empty() {
            return None;
        }
        let mut metres: Vec<f64> = all.iter().map(|(_, m, _)| m.abs()).collect();
        metres.sort_by(f64::total_cmp);
        let median_m = metres[metres.len() / 2];
        (median_m < BESIDE_M).then_some(Self { all, median_m })
    }
}

/// Column and depth of a line in a row; none beyond its ends.
fn at_row(lane: &[LanePlace], row: f64) -> Option<(f64, f64)> {
    lane.windows(2).find_map(|pair| {
        let (a, b) = (pair[0], pair[1]);
        let (low, high) = (a.at_px.y.min(b.at_px.y), a.at_px.y.max(b.at_px.y));
        if row < low || row > high || high - low < 1e-9 {
            return None;
        }
        let share = (row - a.at_px.y) / (b.at_px.y - a.at_px.y);
        // Inverse depth is linear in the image.
        let depth_m = 1.0 / ((1.0 - share) / a.depth_m + share / b.depth_m);
        Some((a.at_px.x + (b.at_px.x - a.at_px.x) * share, depth_m))
    })
}
