//! One-to-one matches between features and landmarks at one pose.

use common::geometry::{PinholeCamera, Pose};
use nalgebra::{Matrix2, Matrix6, Point3, Vector2};

use super::detection::{Clutter, DetectionConfig};
use crate::estimate::LandmarkId;
use crate::measurement::{LaneVertex, NoiseConfig, Pairing, PoleImage, pair_lane, pair_sign, project_lane};
use crate::prepare::Prepared;
use crate::preselect::Candidates;
use crate::projection::{ImageSize, View};
use crate::residual::Observation;

/// Squared Mahalanobis distance, two degrees of freedom, beyond which a pair
/// is no pair: 99.9 % of the true ones lie within.
pub const GATE: f64 = 13.8;

/// One frame: what is seen and what may be seen.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// The camera.
    pub camera: &'a PinholeCamera,
    /// Its image.
    pub image: ImageSize,
    /// What is seen.
    pub features: &'a Prepared,
    /// What may be seen.
    pub candidates: &'a Candidates,
    /// Standard deviations.
    pub noise: &'a NoiseConfig,
    /// Detection model.
    pub detection: &'a DetectionConfig,
}

/// A feature and a landmark that are each other's best.
#[derive(Debug, Clone, Copy)]
pub struct Match {
    /// The landmark.
    pub landmark: LandmarkId,
    /// Index of the feature among those of its semantics (as extracted).
    pub feature: usize,
    /// Their observations.
    pub pairing: Pairing,
    /// Squared Mahalanobis distance, two degrees of freedom.
    pub distance2: f64,
    /// Its share of the support, nats.
    pub support: f64,
    /// What the landmark would cost unseen, nats (not above 0).
    pub unseen: f64,
}

/// Buffers of the matching, and its result.
#[derive(Debug, Clone, Default)]
pub struct Matcher {
    /// Mutual best pairs, in the order poles, lanes, signs.
    pub matches: Vec<Match>,
    pairs: Vec<Pair>,
    best_of_feature: Vec<usize>,
    best_of_candidate: Vec<usize>,
    vertices: Vec<LaneVertex>,
}

/// A pair within the gate.
#[derive(Debug, Clone, Copy)]
struct Pair {
    feature: usize,
    candidate: usize,
    found: Match,
}

const NONE: usize = usize::MAX;

/// Squared Mahalanobis distance of a pair and the logarithm of its density.
fn judge(view: &View, pairing: &Pairing, covariance: &Matrix6<f64>) -> Option<(f64, f64)> {
    let (first, last) = pairing.ends();
    let (r0, j0) = first.linearise(view)?;
    let (r1, j1) = last.linearise(view)?;
    let (p0, p1) = (covariance * j0, covariance * j1);
    let cross = j1.dot(&p0);
    let s = Matrix2::new(
        j0.dot(&p0) + first.sigma_px * first.sigma_px,
        cross,
        cross,
        j1.dot(&p1) + last.sigma_px * last.sigma_px,
    );
    let determinant = s.determinant();
    if determinant <= 0.0 {
        return None;
    }
    let r = Vector2::new(r0, r1);
    let distance2 = (s[(1, 1)] * r.x * r.x - 2.0 * cross * r.x * r.y + s[(0, 0)] * r.y * r.y) / determinant;
    let log_density = -0.5 * distance2 - 0.5 * determinant.ln() - std::f64::consts::TAU.ln();
    Some((distance2, log_density))
}

/// Standard deviations of a point's place in the image, columns and rows.
fn pixel_sigma(view: &View, point_map: &Point3<f64>, covariance: &Matrix6<f64>) -> Vector2<f64> {
    let p = view.to_camera(point_map);
    let along = |normal: Vector2<f64>| {
        let row = view.jacobian_row(&p, &normal);
        row.dot(&(covariance * row)).max(0.0).sqrt()
    };
    Vector2::new(along(Vector2::x()), along(Vector2::y()))
}

impl Matcher {
    /// Matches the scene at a pose that is known to `covariance` (camera
    /// tangent) and returns the support of the frame for it, in nats. The
    /// matches are left in `self.matches`.
    pub fn run(&mut self, scene: &Scene<'_>, map_from_camera: &Pose, covariance: &Matrix6<f64>) -> f64 {
        let view = View::new(scene.camera, map_from_camera);
        let clutter = scene.detection.clutter(scene.features, scene.image);
        self.matches.clear();
        let unseen = self.match_poles(scene, &view, covariance, &clutter)
            + self.match_lanes(scene, &view, covariance, &clutter)
            + self.match_signs(scene, &view, covariance, &clutter);
        self.matches.iter().map(|found| found.support).sum::<f64>() + unseen
    }

    /// Mutual best of the offered pairs goes to `matches`; what was expected
    /// of the others is summed up by `missing(candidate)`.
    fn settle(&mut self, features: usize, candidates: usize, mut missing: impl FnMut(usize) -> f64) -> f64 {
        self.best_of_feature.clear();
        self.best_of_feature.resize(features, NONE);
        self.best_of_candidate.clear();
        self.best_of_candidate.resize(candidates, NONE);
        let pairs = &self.pairs;
        let better =
            |new: usize, old: usize| pairs.get(old).is_none_or(|old| pairs[new].found.support > old.found.support);
        for (i, pair) in pairs.iter().enumerate() {
            if better(i, self.best_of_feature[pair.feature]) {
                self.best_of_feature[pair.feature] = i;
            }
            if better(i, self.best_of_candidate[pair.candidate]) {
                self.best_of_candidate[pair.candidate] = i;
            }
        }
        let mut unseen = 0.0;
        for (candidate, &best) in self.best_of_candidate.iter().enumerate() {
            match self.pairs.get(best) {
                Some(pair) if self.best_of_feature[pair.feature] == best => {
                    let cost = missing(candidate);
                    self.matches.push(Match { unseen: cost, ..pair.found });
                }
                _ => unseen += missing(candidate),
            }
        }
        self.pairs.clear();
        unseen
    }

    fn match_poles(&mut self, scene: &Scene<'_>, view: &View, covariance: &Matrix6<f64>, clutter: &Clutter) -> f64 {
        let focal_px = scene.camera.fx_px;
        for (candidate, pole) in scene.candidates.poles.iter().enumerate() {
            let Some(image) = PoleImage::new(view, pole) else { continue };
            let probability = scene.detection.pole(pole.kind, image.foot_depth_m, pole.sight_m);
            let sigma = pixel_sigma(view, &image.middle_map(), covariance);
            let slack_px = 3.0 * sigma.y;
            let noise_px =
                (scene.noise.pole_sigma_m * focal_px / image.foot_depth_m).hypot(scene.noise.calibration_sigma_px);
            for (i, feature) in scene.features.poles.iter().enumerate() {
                // Far outside the gate already by the columns of the middles.
                let middle = feature.upper_px + feature.down * (0.5 * feature.length_px);
                let slope = (image.foot_px.x - image.top_px.x) / (image.foot_px.y - image.top_px.y).max(1.0);
                let column = image.foot_px.x + slope * (middle.y - image.foot_px.y);
                let allowed_px = 5.0 * (sigma.x + noise_px + feature.offset_sigma_px)
                    + 5.0 * feature.angle_sigma_rad * feature.length_px
                    + 2.0;
                if (column - middle.x).abs() > allowed_px {
                    continue;
                }
                let Some(pairing) = image.pair(feature, scene.noise, focal_px, slack_px) else { continue };
                let Some((distance2, log_density)) = judge(view, &pairing, covariance) else { continue };
                if distance2 > GATE {
                    continue;
                }
                let length_px = feature.length_px.min(image.visible_length_px(scene.image));
                let rows_px = 0.5 * scene.image.height_px;
                let ends = image.ends_support(feature, scene.noise, focal_px, sigma.y, rows_px);
                let support = probability.ln() + log_density + ends - clutter.poles_per_px2(length_px).ln();
                self.pairs.push(Pair {
                    feature: i,
                    candidate,
                    found: Match {
                        landmark: LandmarkId::Pole(pole.index),
                        feature: feature.index,
                        pairing,
                        distance2,
                        support,
                        unseen: 0.0,
                    },
                });
            }
        }
        self.settle(scene.features.poles.len(), scene.candidates.poles.len(), |candidate| {
            let pole = &scene.candidates.poles[candidate];
            let expected = PoleImage::new(view, pole).filter(|image| {
                // Most of it within the image, and long enough to be found.
                let length_px = (image.foot_px - image.top_px).norm();
                let columns = EDGE_PX..=scene.image.width_px - EDGE_PX;
                image.visible_length_px(scene.image) > (0.5 * length_px).max(MIN_VISIBLE_PX)
                    && columns.contains(&image.foot_px.x)
                    && columns.contains(&image.top_px.x)
            });
            expected.map_or(0.0, |image| (1.0 - scene.detection.pole(pole.kind, image.foot_depth_m, pole.sight_m)).ln())
        })
    }

    fn match_lanes(&mut self, scene: &Scene<'_>, view: &View, covariance: &Matrix6<f64>, clutter: &Clutter) -> f64 {
        let focal_px = scene.camera.fx_px;
        // A lane line half a lane away is another line, whatever the gate.
        let lanes = &scene.candidates.lanes;
        for (candidate, lane) in lanes.iter().enumerate() {
            self.vertices.clear();
            project_lane(view, scene.candidates, lane, &mut self.vertices);
            let Some(nearest) = self.vertices.iter().min_by(|a, b| a.depth_m.total_cmp(&b.depth_m)) else { continue };
            let sigma = pixel_sigma(view, &nearest.point_map, covariance);
            let reach_px = 4.0 * sigma.norm() + 0.25 * focal_px / nearest.depth_m.max(1.0) + 10.0;
            let log_probability = scene.detection.lane(lane.kind).ln();
            for (i, feature) in scene.features.lanes.iter().enumerate() {
                let pairing = pair_lane(&self.vertices, feature, scene.noise, focal_px, reach_px);
                let Some(pairing) = pairing else { continue };
                let Some((distance2, log_density)) = judge(view, &pairing, covariance) else { continue };
                if distance2 > GATE {
                    continue;
                }
                let support = log_probability + log_density - clutter.lanes_per_px2().ln();
                self.pairs.push(Pair {
                    feature: i,
                    candidate,
                    found: Match {
                        landmark: LandmarkId::Lane(lane.index),
                        feature: feature.index,
                        pairing,
                        distance2,
                        support,
                        unseen: 0.0,
                    },
                });
            }
        }
        self.settle(scene.features.lanes.len(), lanes.len(), |candidate| {
            let lane = &lanes[candidate];
            let points = &scene.candidates.lane_points_map[lane.start..lane.end];
            let seen = points.iter().filter_map(|p| view.project(p)).filter(|(p, _)| scene.image.contains(p, 0.0));
            let (least_m, most_m) =
                seen.fold((f64::MAX, f64::MIN), |(least, most), (_, depth_m)| (depth_m.min(least), depth_m.max(most)));
            if most_m - least_m > MIN_VISIBLE_LANE_M { (1.0 - scene.detection.lane(lane.kind)).ln() } else { 0.0 }
        })
    }

    fn match_signs(&mut self, scene: &Scene<'_>, view: &View, covariance: &Matrix6<f64>, clutter: &Clutter) -> f64 {
        let focal_px = scene.camera.fx_px;
        for (candidate, sign) in scene.candidates.signs.iter().enumerate() {
            let Some((pixel, depth_m)) = view.project(&sign.centroid_map) else { continue };
            let sigma = pixel_sigma(view, &sign.centroid_map, covariance);
            for (i, (index, feature)) in scene.features.signs.iter().enumerate() {
                let Some(pairing) = pair_sign(sign, depth_m, feature, scene.noise, focal_px) else { continue };
                let own_px = pairing.ends().0.sigma_px;
                let off = pixel - feature.centre_px;
                if off.x.abs() > 4.0 * (sigma.x + own_px) || off.y.abs() > 4.0 * (sigma.y + own_px) {
                    continue;
                }
                let Some((distance2, log_density)) = judge(view, &pairing, covariance) else { continue };
                if distance2 > GATE {
                    continue;
                }
                let support = scene.detection.sign(sign.kind, depth_m, sign.sight_m).ln() + log_density
                    - clutter.signs_per_px2().ln();
                self.pairs.push(Pair {
                    feature: i,
                    candidate,
                    found: Match {
                        landmark: LandmarkId::Sign(sign.index),
                        feature: *index,
                        pairing,
                        distance2,
                        support,
                        unseen: 0.0,
                    },
                });
            }
        }
        self.settle(scene.features.signs.len(), scene.candidates.signs.len(), |candidate| {
            let sign = &scene.candidates.signs[candidate];
            let seen = view.project(&sign.centroid_map).filter(|(p, _)| scene.image.contains(p, -EDGE_PX));
            seen.map_or(0.0, |(_, depth_m)| (1.0 - scene.detection.sign(sign.kind, depth_m, sign.sight_m)).ln())
        })
    }

    /// Takes back the matches that are worth less than the landmark unseen;
    /// returns by how much the support rises.
    pub fn drop_worthless(&mut self) -> f64 {
        let mut gain = 0.0;
        self.matches.retain(|found| {
            let worthless = found.support < found.unseen;
            if worthless {
                gain += found.unseen - found.support;
            }
            !worthless
        });
        gain
    }

    /// What all matches together are worth, against all their landmarks
    /// unseen, nats.
    pub fn worth(&self) -> f64 {
        self.matches.iter().map(|found| found.support - found.unseen).sum()
    }

    /// Appends the observations of all matches, grouped.
    pub fn observations(&self, observations: &mut Vec<Observation>, groups: &mut Vec<crate::residual::Group>) {
        observations.clear();
        groups.clear();
        for found in &self.matches {
            let start = observations.len();
            observations.extend_from_slice(found.pairing.observations());
            groups.push(crate::residual::Group::new(start, observations.len()));
        }
    }
}

/// A pole shorter than this in the image is not expected to be found, pixels.
const MIN_VISIBLE_PX: f64 = 20.0;
/// What stands nearer to the image border than this is not expected, pixels.
const EDGE_PX: f64 = 20.0;
/// A lane line visible over less than this is not expected, metres.
const MIN_VISIBLE_LANE_M: f64 = 5.0;

#[cfg(test)]
mod tests;
