//! Poles.

use common::map::{PoleKind, SemanticMap};
use localizer::features::LineFeature;
use localizer::vision::Class;
use localizer::vision::config::PoleConfig;
use localizer::vision::regions::{self, Growth};
use nalgebra::Point2;

use super::expected::{self, ExpectedPole};
use super::persistence::{Changes, Sightings, Tracks};
use super::side::View;
use super::table::{Row, Samples, Share, per_frame};
use super::{DISTANCES_M, distance_bin, distance_name, pixels};

/// Lengths of features that are told apart, pixels.
const LENGTHS_PX: [f64; 2] = [30.0, 80.0];
/// Areas of regions that are told apart, pixels.
const AREAS_PX: [f64; 2] = [60.0, 400.0];
/// A map of so few frames holds little beyond, metres.
const FAR_M: f64 = 60.0;
/// Height of KITTI's cameras over the road, metres.
const CAMERA_HEIGHT_M: f64 = 1.65;
const SIZES: [&str; 3] = ["small", "medium", "large"];
const KINDS: [(PoleKind, &str); 4] = [
    (PoleKind::LampPost, "lamp posts"),
    (PoleKind::SignPost, "sign posts"),
    (PoleKind::Delineator, "delineators"),
    (PoleKind::Trunk, "trunks"),
];

/// What the label images show of the poles of a map.
#[derive(Debug, Default)]
pub struct Poles {
    features: [usize; 3],
    regions: [usize; 3],
    false_features: [usize; 3],
    /// Those whose foot lies so high in the image that the map ends before.
    beyond: usize,
    found: [Share; DISTANCES_M.len() - 1],
    found_by_kind: [Share; KINDS.len()],
    fragments: Samples,
    angle_deg: Samples,
    offset_px: Samples,
    top_px: Samples,
    foot_px: Samples,
    angle_change_deg: Changes,
    offset_change_px: Changes,
    foot_change_px: Changes,
    width_px: Samples,
    width_of_m: Samples,
    probability: Samples,
    false_probability: Samples,
    ripple_px: Samples,
    faint: Share,
    strong: Share,
    sightings: Sightings,
    tracks: Tracks,
}

pub(super) fn size_bin(size: f64, limits: [f64; 2]) -> usize {
    limits.iter().filter(|limit| size >= **limit).count()
}

impl Poles {
    /// Adds a frame.
    pub fn add(&mut self, view: &View, map: &SemanticMap, config: &PoleConfig) {
        let growth = Growth { threshold: config.threshold, seed: config.seed, min_area_px: 6 };
        for region in regions::grow(view.maps.plane(Class::Pole), &growth) {
            self.regions[size_bin(region.area as f64, AREAS_PX)] += 1;
        }
        let expected = expected::poles(view, map);
        let mut pieces = vec![0_usize; expected.len()];
        for feature in &view.features.poles {
            let size = size_bin(feature.length_px(), LENGTHS_PX);
            self.features[size] += 1;
            if let Some(index) = explanation(feature, &expected, view) {
                pieces[index] += 1;
                self.add_match(feature, &expected[index], view);
            } else {
                self.false_features[size] += 1;
                let horizon_px = view.camera.cy_px;
                let is_far = feature.lower_px.y < horizon_px + pixels(&view.camera, CAMERA_HEIGHT_M, FAR_M);
                self.beyond += usize::from(is_far);
                self.false_probability.push(feature.probability);
                self.tracks.add(view.frame, nalgebra::center(&feature.upper_px, &feature.lower_px));
            }
        }
        for (pole, pieces) in expected.iter().zip(pieces).filter(|(pole, _)| pole.is_visible) {
            let found = pieces > 0;
            if let Some(bin) = distance_bin(pole.depth_m) {
                self.found[bin].add(found);
            }
            if let Some(kind) = KINDS.iter().position(|(kind, _)| *kind == pole.pole.kind) {
                self.found_by_kind[kind].add(found);
            }
            if pole.pole.kind != PoleKind::Trunk {
                self.sightings.add(pole.id, view.frame, found);
            }
            if found {
                self.fragments.push(pieces as f64);
            }
        }
        self.add_background(view, &expected);
    }

    fn add_match(&mut self, feature: &LineFeature, pole: &ExpectedPole<'_>, view: &View) {
        let direction = |a: Point2<f64>, b: Point2<f64>| ((b.x - a.x) / (b.y - a.y).max(1e-9)).atan();
        let angle = direction(feature.upper_px, feature.lower_px) - direction(pole.upper_px, pole.lower_px);
        let middle = nalgebra::center(&feature.upper_px, &feature.lower_px);
        let offset_px = middle.x - pole.column_at(middle.y);
        self.angle_deg.push(angle.to_degrees());
        self.offset_px.push(offset_px);
        self.angle_change_deg.add(pole.id, view.frame, angle.to_degrees());
        self.offset_change_px.add(pole.id, view.frame, offset_px);
        if view.contains(&pole.upper_px, 6.0) {
            self.top_px.push(feature.upper_px.y - pole.upper_px.y);
        }
        if view.contains(&pole.lower_px, 6.0) {
            self.foot_px.push(feature.lower_px.y - pole.lower_px.y);
            self.foot_change_px.add(pole.id, view.frame, feature.lower_px.y - pole.lower_px.y);
        }
        self.width_px.push(feature.width_px);
        self.width_of_m.push(feature.width_px / pixels(&view.camera, 1.0, pole.depth_m));
        self.probability.push(feature.probability);
        self.ripple_px.push(feature.offset_sigma_px);
    }

    /// Share of the pixels away from all poles, above the road's vanishing
    /// line or not, that look a little or much like a pole.
    fn add_background(&mut self, view: &View, expected: &[ExpectedPole<'_>]) {
        let plane = view.maps.plane(Class::Pole);
        for row in (0..plane.height()).step_by(4) {
            let near: Vec<(f64, f64)> = expected
                .iter()
                .filter(|pole| row as f64 > pole.upper_px.y - 10.0 && (row as f64) < pole.lower_px.y + 10.0)
                .map(|pole| (pole.column_at(row as f64), 8.0 + pixels(&view.camera, 0.3, pole.depth_m)))
                .collect();
            for (column, &value) in plane.row(row).iter().enumerate().step_by(2) {
                if near.iter().all(|(u, reach)| (column as f64 - u).abs() > *reach) {
                    self.faint.add(value >= 26);
                    self.strong.add(value >= 128);
                }
            }
        }
    }

    /// All rows.
    pub fn rows(&self, frames: usize) -> Vec<Row> {
        let mut rows = Vec::new();
        for (size, name) in SIZES.iter().enumerate() {
            rows.push(per_frame(format!("pole regions, {name}, per frame"), self.regions[size], frames));
        }
        rows.push(per_frame("pole features per frame", self.features.iter().sum(), frames));
        for (size, name) in SIZES.iter().enumerate() {
            rows.push(per_frame(format!("pole features, {name}, per frame"), self.features[size], frames));
        }
        rows.push(per_frame("pole features false, per frame", self.false_features.iter().sum(), frames));
        for (size, name) in SIZES.iter().enumerate() {
            rows.push(per_frame(format!("pole features false, {name}, per frame"), self.false_features[size], frames));
        }
        let near = self.false_features.iter().sum::<usize>() - self.beyond;
        rows.push(per_frame("pole features false beyond 60 m, per frame", self.beyond, frames));
        rows.push(per_frame("pole features false nearer, per frame", near, frames));
        for (bin, share) in self.found.iter().enumerate() {
            rows.push(share.row(format!("poles found at {}, share", distance_name(bin))));
        }
        for ((_, name), share) in KINDS.iter().zip(&self.found_by_kind) {
            rows.push(share.row(format!("{name} found, share")));
        }
        rows.push(self.fragments.mean("pieces of a found pole"));
        rows.extend(self.angle_deg.magnitudes("pole angle error, degrees"));
        rows.extend(self.offset_px.magnitudes("pole offset error, px"));
        rows.push(self.top_px.quantile("pole top below the true one, px, median", 0.5));
        rows.extend(self.top_px.magnitudes("pole top error, px"));
        rows.push(self.foot_px.quantile("pole foot below the true one, px, median", 0.5));
        rows.extend(self.foot_px.magnitudes("pole foot error, px"));
        rows.extend(self.angle_change_deg.rows("pole angle, frame to frame, degrees"));
        rows.extend(self.offset_change_px.rows("pole offset, frame to frame, px"));
        rows.extend(self.foot_change_px.rows("pole foot, frame to frame, px"));
        rows.push(self.width_px.quantile("pole width in the mask, px, median", 0.5));
        rows.push(self.width_of_m.quantile("pole width in the mask, m, median", 0.5));
        rows.push(self.probability.quantile("pole probability, p10", 0.1));
        rows.push(self.probability.quantile("pole probability, median", 0.5));
        rows.push(self.false_probability.quantile("false pole probability, median", 0.5));
        rows.push(self.ripple_px.quantile("pole offset sigma as claimed, px, median", 0.5));
        rows.push(self.faint.row("pixels with a pole probability > 0.1 off poles, share"));
        rows.push(self.strong.row("pixels with a pole probability > 0.5 off poles, share"));
        rows.extend(self.sightings.rows("poles"));
        rows.push(self.tracks.row("pole features"));
        rows
    }
}

/// The pole that a feature shows: along at least a third of the feature, as
/// steep, and beside it by no more than masks are wrong; the nearest one.
fn explanation(feature: &LineFeature, expected: &[ExpectedPole<'_>], view: &View) -> Option<usize> {
    /// Raggedness of masks, pixels.
    const BESIDE_PX: f64 = 4.0;
    const MAX_ANGLE_RAD: f64 = 0.09;
    let (top, bottom) = (feature.upper_px.y, feature.lower_px.y);
    let column_at = |row: f64| {
        feature.upper_px.x + (feature.lower_px.x - feature.upper_px.x) * (row - top) / (bottom - top).max(1e-9)
    };
    let beside = |pole: &ExpectedPole<'_>| {
        let (upper, lower) = (top.max(pole.upper_px.y), bottom.min(pole.lower_px.y));
        let overlap = lower - upper;
        let angle = ((column_at(bottom) - column_at(top)) - (pole.column_at(bottom) - pole.column_at(top)))
            / (bottom - top).max(1.0);
        let row = 0.5 * (upper + lower);
        let off = (column_at(row) - pole.column_at(row)).abs();
        let reach = BESIDE_PX + pixels(&view.camera, 0.2, pole.depth_m);
        let long = (bottom - top).min(pole.lower_px.y - pole.upper_px.y);
        (overlap > 0.33 * long && off < reach && angle.abs() < MAX_ANGLE_RAD + 2.0 / (bottom - top)).then_some(off)
    };
    let candidates = expected.iter().enumerate().filter_map(|(index, pole)| Some((index, beside(pole)?)));
    candidates.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
}
