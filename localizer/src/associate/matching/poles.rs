//! Poles.

use nalgebra::Vector2;

use super::{Look, Matcher, Pair, judge_ends};
use crate::estimate::LandmarkId;
use crate::measurement::{PoleEnds, PoleImage};
use crate::prepare::PreparedPole;
use crate::preselect::PoleCandidate;

/// A pole shorter than this in the image is not expected to be found, pixels.
const MIN_VISIBLE_PX: f64 = 20.0;
/// What stands nearer to the image border than this is not expected, pixels.
pub(super) const EDGE_PX: f64 = 20.0;

/// A candidate in the image, and what is known of it once a feature is near.
#[derive(Debug, Clone, Copy)]
pub(super) struct PoleAt {
    image: PoleImage,
    near: Option<Near>,
}

#[derive(Debug, Clone, Copy)]
struct Near {
    /// Standard deviation of the pose's shift across, of the landmark and of
    /// the calibration, pixels.
    across_px: f64,
    /// Standard deviation of the pose's shift along the columns, pixels.
    along_px: f64,
}

impl Near {
    /// How far the pose may shift a pole along its line, pixels.
    fn slack_px(&self) -> f64 {
        3.0 * self.along_px
    }
}

/// The probability that a pole is found.
fn probability(look: &Look<'_>, image: &PoleImage, pole: &PoleCandidate) -> f64 {
    look.scene.detection.pole(pole.kind, image.foot_depth_m, pole.sight_m)
}

impl Look<'_> {
    /// As [`Self::judge`], of a pole.
    fn judge_pole(&self, image: &PoleImage, feature: &PreparedPole, slack_px: f64) -> Option<(f64, f64)> {
        let (noise, focal_px) = (self.scene.noise, self.scene.camera.fx_px);
        let stretch = image.stretch(feature, noise, focal_px, slack_px)?;
        let [start_px, end_px] = stretch.places_px;
        let first = image.observe(&stretch, start_px, feature, noise, focal_px);
        let first_end = self.end(&first, first.sigma_px)?;
        let last = image.observe(&stretch, end_px, feature, noise, focal_px);
        let last_end = self.end(&last, last.sigma_px)?;
        judge_ends(&first_end, first.sigma_px, &last_end, last.sigma_px)
    }
}

impl PoleAt {
    /// What it costs that it was not seen, nats: nothing unless most of it is
    /// within the image, and long enough to be found.
    fn missing(&self, look: &Look<'_>, pole: &PoleCandidate) -> f64 {
        let (image, size) = (&self.image, look.scene.image);
        let columns = EDGE_PX..=size.width_px - EDGE_PX;
        let is_expected = columns.contains(&image.foot_px.x) && columns.contains(&image.top_px.x) && {
            let length_px = (image.foot_px - image.top_px).norm();
            image.visible_length_px(size) > (0.5 * length_px).max(MIN_VISIBLE_PX)
        };
        if is_expected { (1.0 - probability(look, image, pole)).ln() } else { 0.0 }
    }
}

impl Matcher {
    pub(super) fn match_poles(&mut self, look: &Look<'_>, matched: &mut f64) -> f64 {
        let scene = look.scene;
        let focal_px = scene.camera.fx_px;
        let rows_px = 0.5 * scene.image.height_px;
        self.poles.clear();
        for (candidate, pole) in scene.candidates.poles.iter().enumerate() {
            let is_told = scene.features.tells_of(pole.kind);
            let Some(image) = is_told.then(|| PoleImage::new(&look.view, pole)).flatten() else {
                self.poles.push(None);
                continue;
            };
            let mut at = PoleAt { image, near: None };
            let mut known: Option<(f64, PoleEnds)> = None;
            let middle = look.view.to_camera(&image.middle_map());
            let landmark_px = scene.noise.pole_sigma_m * focal_px / image.foot_depth_m;
            let calibration_px = scene.noise.calibration_px(focal_px);
            let most_px = look.most_sigma_px(&middle, &Vector2::x()) + landmark_px + calibration_px;
            let slope = (image.foot_px.x - image.top_px.x) / (image.foot_px.y - image.top_px.y).max(1.0);
            for (i, feature) in scene.features.poles.iter().enumerate() {
                if !feature.may_be(pole.kind) {
                    continue;
                }
                // Far outside the gate already by the columns of the middles;
                // first by a bound, which costs less.
                let column = image.foot_px.x + slope * (feature.middle_px.y - image.foot_px.y);
                let off_px = (column - feature.middle_px.x).abs();
                if off_px > 5.0 * most_px + feature.least_off_px {
                    continue;
                }
                let near = at.near.get_or_insert_with(|| {
                    let across_px = look.sigma_px(&middle, &Vector2::x()) + landmark_px.hypot(calibration_px);
                    Near { across_px, along_px: look.sigma_px(&middle, &Vector2::y()) }
                });
                let allowed_px = 5.0 * (near.across_px + feature.offset_sigma_px)
                    + 5.0 * feature.angle_sigma_rad * feature.length_px
                    + 2.0;
                if off_px > allowed_px {
                    continue;
                }
                let Some((distance2, log_density)) = look.judge_pole(&image, feature, near.slack_px()) else {
                    continue;
                };
                let (log_probability, ends) = *known.get_or_insert_with(|| {
                    let ends = image.ends(scene.noise, focal_px, near.along_px);
                    (probability(look, &image, pole).ln(), ends)
                });
                let length_px = feature.length_px.min(image.visible_length_px(scene.image));
                let ends = image.ends_support(feature, &ends, rows_px);
                let odds = scene.odds.of_pole(pole.kind, feature.log_odds);
                let support =
                    log_probability + log_density + ends + odds - look.clutter.poles_per_px2(pole.kind, length_px).ln();
                self.pairs.push(Pair { feature: i, candidate, distance2, support });
            }
            self.poles.push(Some(at));
        }
        self.assignment.find(&self.pairs, scene.features.poles.len(), scene.candidates.poles.len());
        let poles = std::mem::take(&mut self.poles);
        let at = |candidate: usize| poles.get(candidate).copied().flatten().zip(scene.candidates.poles.get(candidate));
        let unseen = self.close(
            look.wanted,
            true,
            matched,
            |candidate| at(candidate).map_or(0.0, |(at, pole)| at.missing(look, pole)),
            |pair| {
                let ((at, pole), feature) = at(pair.candidate).zip(scene.features.poles.get(pair.feature))?;
                let slack_px = at.near?.slack_px();
                let mut pairing = at.image.pair(feature, scene.noise, focal_px, slack_px)?.into();
                at.image.push_ends(feature, scene.noise, focal_px, slack_px, &mut pairing);
                Some((LandmarkId::Pole(pole.index), feature.index, pairing))
            },
        );
        self.poles = poles;
        unseen
    }
}
