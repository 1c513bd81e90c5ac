//! One-to-one matches between features and landmarks at one pose.

mod assign;
mod lanes;
mod marks;
mod poles;
mod signs;
mod spread;

use common::geometry::{PinholeCamera, Pose};
use nalgebra::{Matrix2, Matrix6, Vector2, Vector3, Vector6};

use super::detection::{Clutter, DetectionConfig};
use super::foreseen::Foreseen;
use super::odds::UsualOdds;
use crate::estimate::LandmarkId;
use crate::measurement::{LaneEnds, LaneVertex, NoiseConfig, Pairing};
use crate::prepare::Prepared;
use crate::preselect::Candidates;
use crate::projection::{ImageSize, View};
use crate::residual::Observation;
use assign::Assignment;
use lanes::LaneAt;
use marks::EdgePair;
use poles::PoleAt;
use spread::Spread;

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
    /// What probabilities of regions say.
    pub odds: UsualOdds,
}

/// A feature and a landmark that are taken for the same.
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

impl Match {
    /// Both are of the same feature and landmark.
    pub fn is_same(&self, other: &Self) -> bool {
        self.landmark == other.landmark && self.feature == other.feature
    }
}

/// Buffers of the matching, and its result.
#[derive(Debug, Clone, Default)]
pub struct Matcher {
    /// The pairs that say most together, in the order poles, lanes, marks of lanes, signs.
    pub matches: Vec<Match>,
    pairs: Vec<Pair>,
    assignment: Assignment,
    poles: Vec<Option<PoleAt>>,
    lanes: Vec<LaneAt>,
    vertices: Vec<LaneVertex>,
    edge_pairs: Vec<EdgePair>,
    /// What the matches say, nats.
    matched: f64,
    /// What the other candidates cost if each was missed for its own reason,
    /// nats.
    apart: f64,
    /// Poles and signs that were not matched.
    missed: Foreseen,
}

/// A pair within the gate.
#[derive(Debug, Clone, Copy)]
struct Pair {
    feature: usize,
    candidate: usize,
    distance2: f64,
    support: f64,
}

const NONE: usize = usize::MAX;

/// What is asked of a matching.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wanted {
    /// The support of the frame alone.
    Support,
    /// The matches alone.
    Matches,
    /// Both.
    Both,
}

/// A scene seen from a pose.
#[derive(Debug, Clone, Copy)]
struct Look<'a> {
    scene: &'a Scene<'a>,
    view: View,
    /// Of the pose (camera tangent).
    covariance: &'a Matrix6<f64>,
    spread: Spread,
    clutter: Clutter,
    wanted: Wanted,
}

/// A distance in the image, and what the pose's uncertainty makes of it.
#[derive(Debug, Clone, Copy)]
struct End {
    distance_px: f64,
    /// Its derivative for the pose's tangent.
    row: Vector6<f64>,
    /// The pose's covariance times the row.
    spread: Vector6<f64>,
    /// Its variance by the pose's alone.
    variance_px2: f64,
}

/// As [`Look::judge`], of two ends with their own standard deviations.
fn judge_ends(first: &End, first_sigma_px: f64, last: &End, last_sigma_px: f64) -> Option<(f64, f64)> {
    let cross = last.row.dot(&first.spread);
    let first_px2 = first.variance_px2 + first_sigma_px * first_sigma_px;
    let last_px2 = last.variance_px2 + last_sigma_px * last_sigma_px;
    let determinant = Matrix2::new(first_px2, cross, cross, last_px2).determinant();
    if determinant <= 0.0 {
        return None;
    }
    let (r0, r1) = (first.distance_px, last.distance_px);
    let distance2 = (last_px2 * r0 * r0 - 2.0 * cross * r0 * r1 + first_px2 * r1 * r1) / determinant;
    // Unlike `<=` this lets what is no number pass, to be judged no worse.
    if distance2 > GATE {
        return None;
    }
    Some((distance2, -0.5 * distance2 - 0.5 * determinant.ln() - std::f64::consts::TAU.ln()))
}

/// A product that the compiler unrolls.
#[inline]
fn times(matrix: &Matrix6<f64>, vector: &Vector6<f64>) -> Vector6<f64> {
    let mut product = matrix.fixed_columns::<1>(0) * vector[0];
    for column in 1..6 {
        for row in 0..6 {
            product[row] += matrix[(row, column)] * vector[column];
        }
    }
    product
}

impl Look<'_> {
    /// One end of a pair; none where its distance is beyond the gate, however
    /// it goes with the other. Its standard deviation is at most
    /// `most_sigma_px`.
    fn end(&self, observation: &Observation, most_sigma_px: f64) -> Option<End> {
        let (distance_px, row) = observation.linearise(&self.view)?;
        // The margin is far above what rounding does to the exact distance.
        let is_beyond = |variance_px2: f64| {
            distance_px * distance_px > 1.001 * GATE * (variance_px2 + most_sigma_px * most_sigma_px)
        };
        // First by a bound, which costs less.
        let most_px = self.spread.most(&row);
        if is_beyond(most_px * most_px) {
            return None;
        }
        let spread = times(self.covariance, &row);
        let variance_px2 = row.dot(&spread);
        // With another beside it the distance only grows.
        (!is_beyond(variance_px2)).then_some(End { distance_px, row, spread, variance_px2 })
    }

    /// Squared Mahalanobis distance of a pair and the logarithm of its
    /// density; none outside the gate.
    fn judge(&self, first: &Observation, last: &Observation) -> Option<(f64, f64)> {
        let ends = (self.end(first, first.sigma_px)?, self.end(last, last.sigma_px)?);
        judge_ends(&ends.0, first.sigma_px, &ends.1, last.sigma_px)
    }

    /// As [`Self::judge`], of the ends of a lane line.
    fn judge_lane(&self, mut pair: LaneEnds<'_>) -> Option<(f64, f64)> {
        let first = pair.first()?;
        let first_end = self.end(&first, first.sigma_px * pair.most_share(1))?;
        let last = pair.last()?;
        let last_end = self.end(&last, last.sigma_px * pair.most_share(2))?;
        let share = pair.share();
        judge_ends(&first_end, first.sigma_px * share, &last_end, last.sigma_px * share)
    }

    /// Standard deviation of a point (camera axes) along a direction in the
    /// image, pixels.
    fn sigma_px(&self, p: &Vector3<f64>, normal: &Vector2<f64>) -> f64 {
        self.row_sigma_px(&self.view.jacobian_row(p, normal))
    }

    /// Standard deviation that the pose's covariance gives to a distance with
    /// this derivative, pixels.
    fn row_sigma_px(&self, row: &Vector6<f64>) -> f64 {
        row.dot(&times(self.covariance, row)).max(0.0).sqrt()
    }

    /// No less than [`Self::sigma_px`], and sooner known.
    fn most_sigma_px(&self, p: &Vector3<f64>, normal: &Vector2<f64>) -> f64 {
        self.spread.most(&self.view.jacobian_row(p, normal))
    }
}

impl Matcher {
    /// Matches the scene at a pose that is known to `covariance` (camera
    /// tangent) and returns the support of the frame for it, in nats. The
    /// matches are left in `self.matches`.
    pub fn run(&mut self, scene: &Scene<'_>, map_from_camera: &Pose, covariance: &Matrix6<f64>) -> f64 {
        self.ask(scene, map_from_camera, covariance, Wanted::Both)
    }

    /// The support that [`Self::run`] returns, less that of marks; leaves no
    /// matches.
    pub fn support(&mut self, scene: &Scene<'_>, map_from_camera: &Pose, covariance: &Matrix6<f64>) -> f64 {
        self.ask(scene, map_from_camera, covariance, Wanted::Support)
    }

    /// Leaves the matches that [`Self::run`] leaves.
    pub fn find(&mut self, scene: &Scene<'_>, map_from_camera: &Pose, covariance: &Matrix6<f64>) {
        self.ask(scene, map_from_camera, covariance, Wanted::Matches);
    }

    fn ask(&mut self, scene: &Scene<'_>, map_from_camera: &Pose, covariance: &Matrix6<f64>, wanted: Wanted) -> f64 {
        let look = Look {
            scene,
            view: View::new(scene.camera, map_from_camera),
            covariance,
            spread: Spread::new(covariance),
            clutter: scene.detection.clutter(scene.features, scene.image),
            wanted,
        };
        self.matches.clear();
        self.missed = Foreseen::default();
        let mut matched = 0.0;
        self.apart = self.match_poles(&look, &mut matched)
            + self.match_lanes(&look, &mut matched)
            + self.match_signs(&look, &mut matched);
        self.matched = matched;
        self.matched + scene.detection.all_unseen(self.apart)
    }

    /// Closes the matching of one kind of landmark: adds the support of the
    /// pairs that are left to `matched` and returns what the other candidates
    /// cost. `missing` is that of one candidate, `complete` says landmark,
    /// feature and observations of a pair. What is no line of the road is
    /// counted as missed.
    fn close(
        &mut self,
        wanted: Wanted,
        are_objects: bool,
        matched: &mut f64,
        mut missing: impl FnMut(usize) -> f64,
        complete: impl Fn(&Pair) -> Option<(LandmarkId, usize, Pairing)>,
    ) -> f64 {
        let mut unseen = 0.0;
        for (candidate, &taken) in self.assignment.of_candidates().iter().enumerate() {
            match self.pairs.get(taken) {
                Some(pair) => {
                    *matched += pair.support;
                    if wanted == Wanted::Support {
                        continue;
                    }
                    let Some((landmark, feature, pairing)) = complete(pair) else { continue };
                    let (distance2, support) = (pair.distance2, pair.support);
                    let unseen = missing(candidate);
                    self.matches.push(Match { landmark, feature, pairing, distance2, support, unseen });
                }
                None if wanted == Wanted::Matches => {}
                None => {
                    let cost = missing(candidate);
                    unseen += cost;
                    if are_objects && wanted == Wanted::Both {
                        self.missed.count(cost, false);
                    }
                }
            }
        }
        self.pairs.clear();
        unseen
    }

    /// Takes back the matches that are worth less than the landmark unseen;
    /// returns the support that is left.
    pub fn drop_worthless(&mut self, detection: &DetectionConfig) -> f64 {
        let (matched, apart, missed) = (&mut self.matched, &mut self.apart, &mut self.missed);
        self.matches.retain(|found| {
            let worthless = found.support < found.unseen;
            if worthless {
                *matched -= found.support;
                *apart += found.unseen;
                if found.landmark.is_object() {
                    missed.count(found.unseen, false);
                }
            }
            !worthless
        });
        self.matched + detection.all_unseen(self.apart)
    }

    /// What all matches together are worth, against all their landmarks
    /// unseen, nats.
    pub fn worth(&self, detection: &DetectionConfig) -> f64 {
        let (said, unseen) =
            self.matches.iter().fold((0.0, 0.0), |(said, unseen), found| (said + found.support, unseen + found.unseen));
        said + detection.all_unseen(self.apart) - detection.all_unseen(self.apart + unseen)
    }

    /// The poles and signs that should be seen at the pose of [`Self::run`], what of
    /// them is matched, and what of the posts that are seen.
    pub fn foreseen(&self, scene: &Scene<'_>) -> Foreseen {
        let mut foreseen = self.missed;
        for found in self.matches.iter().filter(|found| found.landmark.is_object()) {
            foreseen.count(found.unseen, true);
            foreseen.known += f64::from(matches!(found.landmark, LandmarkId::Pole(_)));
        }
        foreseen.seen = scene.features.poles.len() as f64;
        foreseen
    }

    /// Appends the observations of all matches, grouped.
    pub fn observations(&self, observations: &mut Vec<Observation>, groups: &mut Vec<crate::residual::Group>) {
        observations.clear();
        groups.clear();
        for group in self.matches.iter().flat_map(|found| found.pairing.groups()) {
            let start = observations.len();
            observations.extend_from_slice(group);
            groups.push(crate::residual::Group::new(start, observations.len()));
        }
    }
}

#[cfg(test)]
mod tests;
