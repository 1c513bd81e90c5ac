//! Signs and lights.

use common::map::SemanticMap;
use localizer::vision::Class;
use localizer::vision::config::SignConfig;
use localizer::vision::regions::{self, Growth};

use super::expected;
use super::persistence::{Sightings, Tracks};
use super::poles::size_bin;
use super::side::View;
use super::table::{Row, Samples, Share, per_frame};
use super::{DISTANCES_M, distance_bin, distance_name, pixels};

/// Sides of the bounding boxes that are told apart, pixels.
const EXTENTS_PX: [f64; 2] = [12.0, 30.0];
const SIZES: [&str; 3] = ["small", "medium", "large"];

/// What the label images show of the signs of a map.
#[derive(Debug, Default)]
pub struct Signs {
    features: [usize; 3],
    regions: [usize; 3],
    light_regions: usize,
    lights: usize,
    false_features: [usize; 3],
    found: [Share; DISTANCES_M.len() - 1],
    centroid_px: Samples,
    size_ratio: Samples,
    probability: Samples,
    false_probability: Samples,
    faint: Share,
    strong: Share,
    faint_light: Share,
    sightings: Sightings,
    tracks: Tracks,
}

impl Signs {
    /// Adds a frame.
    pub fn add(&mut self, view: &View, map: &SemanticMap, config: &SignConfig) {
        let growth = Growth { threshold: config.threshold, seed: config.seed, min_area_px: 10 };
        for region in regions::grow(view.maps.plane(Class::Sign), &growth) {
            let (left, top, right, bottom) = region.bounds();
            let extent = (right - left).max(bottom - top) + 1;
            self.regions[size_bin(extent as f64, EXTENTS_PX)] += 1;
        }
        self.light_regions += regions::grow(view.maps.plane(Class::Light), &growth).len();
        let expected = expected::signs(view, map);
        let mut found = vec![false; expected.len()];
        for feature in &view.features.signs {
            let size = size_bin(feature.extent_px.max(), EXTENTS_PX);
            if feature.kind == common::map::SignKind::TrafficLight {
                self.lights += 1;
                continue;
            }
            self.features[size] += 1;
            let off = |sign: &expected::ExpectedSign<'_>| {
                let reach = 5.0 + 0.7 * pixels(&view.camera, sign.sign.size_m, sign.depth_m);
                let off = (feature.centre_px - sign.centre_px).norm();
                (off < reach).then_some(off)
            };
            let nearest = expected.iter().enumerate().filter_map(|(index, sign)| Some((index, off(sign)?)));
            if let Some((index, off)) = nearest.min_by(|a, b| a.1.total_cmp(&b.1)) {
                let sign = &expected[index];
                found[index] = true;
                self.centroid_px.push(off);
                let size_px = pixels(&view.camera, sign.sign.size_m, sign.depth_m);
                self.size_ratio.push(feature.extent_px.max() / size_px);
                self.probability.push(feature.probability);
            } else {
                self.false_features[size] += 1;
                self.false_probability.push(feature.probability);
                self.tracks.add(view.frame, feature.centre_px);
            }
        }
        for (sign, found) in expected.iter().zip(found).filter(|(sign, _)| sign.is_visible) {
            if let Some(bin) = distance_bin(sign.depth_m) {
                self.found[bin].add(found);
            }
            self.sightings.add(sign.id, view.frame, found);
        }
        self.add_background(view, &expected);
    }

    fn add_background(&mut self, view: &View, expected: &[expected::ExpectedSign<'_>]) {
        let (signs, lights) = (view.maps.plane(Class::Sign), view.maps.plane(Class::Light));
        let near = |column: usize, row: usize| {
            expected.iter().any(|sign| {
                let reach = 6.0 + 0.8 * pixels(&view.camera, sign.sign.size_m, sign.depth_m);
                (column as f64 - sign.centre_px.x).hypot(row as f64 - sign.centre_px.y) < reach
            })
        };
        for row in (0..signs.height()).step_by(4) {
            for (column, &value) in signs.row(row).iter().enumerate().step_by(2) {
                let off_signs = value < 26 || !near(column, row);
                self.faint.add(off_signs && value >= 26);
                self.strong.add(off_signs && value >= 128);
            }
            for &value in lights.row(row).iter().step_by(2) {
                self.faint_light.add(value >= 26);
            }
        }
    }

    /// All rows.
    pub fn rows(&self, frames: usize) -> Vec<Row> {
        let mut rows = Vec::new();
        for (size, name) in SIZES.iter().enumerate() {
            rows.push(per_frame(format!("sign regions, {name}, per frame"), self.regions[size], frames));
        }
        rows.push(per_frame("light regions per frame", self.light_regions, frames));
        rows.push(per_frame("light features per frame", self.lights, frames));
        rows.push(per_frame("sign features per frame", self.features.iter().sum(), frames));
        for (size, name) in SIZES.iter().enumerate() {
            rows.push(per_frame(format!("sign features, {name}, per frame"), self.features[size], frames));
        }
        rows.push(per_frame("sign features false, per frame", self.false_features.iter().sum(), frames));
        for (size, name) in SIZES.iter().enumerate() {
            rows.push(per_frame(format!("sign features false, {name}, per frame"), self.false_features[size], frames));
        }
        for (bin, share) in self.found.iter().enumerate() {
            rows.push(share.row(format!("signs found at {}, share", distance_name(bin))));
        }
        rows.extend(self.centroid_px.magnitudes("sign centre error, px"));
        rows.push(self.size_ratio.quantile("sign size in the mask / true size, median", 0.5));
        rows.push(self.probability.quantile("sign probability, median", 0.5));
        rows.push(self.false_probability.quantile("false sign probability, median", 0.5));
        rows.push(self.faint.row("pixels with a sign probability > 0.1 off signs, share"));
        rows.push(self.strong.row("pixels with a sign probability > 0.5 off signs, share"));
        rows.push(self.faint_light.row("pixels with a light probability > 0.1, share"));
        rows.extend(self.sightings.rows("signs"));
        rows.push(self.tracks.row("sign features"));
        rows
    }
}
