//! Solution separation: by how much the pose moves when one object is left
//! out (as receivers of satellite navigation monitor their integrity, e.g.
//! Blanch et al., "Advanced RAIM user algorithm description", 2012).
//!
//! A wrong match that decides where the pose lies agrees with itself: its
//! residual is small. It shows when the others are asked without it.

mod doubt;

use common::geometry::{Pose, local, retract};
use nalgebra::{Cholesky, Matrix6, Point3, Vector6};
use serde::{Deserialize, Serialize};

use super::matching::Match;
use crate::estimate::{LandmarkId, horizontal_sigma_m};
use crate::projection::View;
use crate::solver::{Normal, Prior, SolverConfig};

/// Settings of the separation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SeparationConfig {
    /// Share of the prediction's information that is used: the frames before
    /// saw the same wrong match. 0.04 takes it as five times as uncertain.
    pub prior_share: f64,
    /// Seconds after which the pose is kept anew as what it is driven on from, without
    /// what was seen since: it takes the place of the prediction where it leaves the
    /// pose better held. Of two, the older is asked, after once to twice this time:
    /// as long as an object, and so a wrong match, is in view.
    pub anchor_s: f64,
    /// Poles and signs that stand nearer together are one object and are left
    /// out together, metres: a sign and its post err together.
    pub object_m: f64,
    /// Standard deviations of what is left without the object that may be
    /// added to the move: two keep 95 %.
    pub sigmas: f64,
}

impl Default for SeparationConfig {
    fn default() -> Self {
        Self { prior_share: 0.04, anchor_s: 2.0, object_m: 1.0, sigmas: 1.0 }
    }
}

/// What one match says about the pose: normal matrix and gradient.
#[derive(Debug, Clone, Copy)]
struct Part {
    /// What it says for the pose against its landmark unseen, nats.
    worth: f64,
    at_map: Option<Point3<f64>>,
    information: Matrix6<f64>,
    gradient: Vector6<f64>,
}

impl Part {
    fn new(found: &Match, view: &View, solver: &SolverConfig) -> Self {
        let (mut information, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
        for group in found.pairing.groups() {
            let own = Normal::of(group, view);
            let weight = solver.weight(own.square / group.len().max(1) as f64);
            information += own.lower * weight;
            gradient += own.gradient * weight;
        }
        information.fill_upper_triangle_with_lower_triangle();
        let at_map = match found.landmark {
            LandmarkId::Lane(_) | LandmarkId::Marks(_) => None,
            LandmarkId::Pole(_) | LandmarkId::Sign(_) => found.pairing.line().first().map(|o| o.point_map),
        };
        Self { worth: found.support - found.unseen, at_map, information, gradient }
    }

    fn is_same_object(&self, other: &Self, object_m: f64) -> bool {
        let places = self.at_map.zip(other.at_map);
        places.is_some_and(|(a, b)| (a.x - b.x).hypot(a.z - b.z) < object_m)
    }
}

/// Information and gradient of several matches and a prior.
type Sum = (Matrix6<f64>, Vector6<f64>);

impl SeparationConfig {
    /// How far a sum says that its pose may be off, horizontally, metres.
    fn level_m(&self, (information, gradient): &Sum) -> f64 {
        let Some(factor) = Cholesky::new(*information) else { return f64::INFINITY };
        let (step, covariance) = (factor.solve(gradient), factor.inverse());
        step[0].hypot(step[2]) + self.sigmas * horizontal_sigma_m(&covariance)
    }
}

/// How far off a pose may be, horizontally, metres.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Separation {
    /// If one object was matched wrongly, or what was held against the matches is.
    pub one_m: f64,
    /// If two objects were: that without which it may be furthest off, and the
    /// next without that.
    pub two_m: f64,
}

/// What the matches and a belief say about a pose, and each object of the matches by
/// itself. Buffers are reused.
#[derive(Debug, Clone, Default)]
pub struct Balance {
    parts: Vec<Part>,
    information: Matrix6<f64>,
    gradient: Vector6<f64>,
    /// See [`Self::poses_without`].
    pub moved: Vec<(f64, Pose)>,
}

impl Balance {
    fn weigh(&mut self, matches: &[Match], view: &View, pose: &Pose, prior: &Prior, solver: &SolverConfig) {
        self.parts.clear();
        self.parts.extend(matches.iter().map(|found| Part::new(found, view, solver)));
        self.hold(pose, prior);
    }

    /// Holds another belief against the same matches.
    fn hold(&mut self, pose: &Pose, prior: &Prior) {
        self.information = prior.information;
        self.gradient = self.information * local(&prior.map_from_camera, pose);
        for part in &self.parts {
            self.information += part.information;
            self.gradient += part.gradient;
        }
    }

    /// What is left of `sum` (information and gradient) without the object of a
    /// match.
    fn less(&self, sum: &Sum, of: &Part, object_m: f64) -> Sum {
        let (mut information, mut gradient) = *sum;
        let same = |other: &&Part| std::ptr::eq(*other, of) || of.is_same_object(other, object_m);
        for other in self.parts.iter().filter(same) {
            information -= other.information;
            gradient -= other.gradient;
        }
        (information, gradient)
    }

    /// Information and gradient without the object of each match in turn.
    fn without_each(&self, object_m: f64) -> impl Iterator<Item = Sum> + '_ {
        let whole = (self.information, self.gradient);
        self.parts.iter().map(move |part| self.less(&whole, part, object_m))
    }

    /// How far off the pose (solved with `matches` and `prior`) may be,
    /// horizontally in metres, if something was matched wrongly, or nothing but
    /// most of the prior is wrong: the largest move of the pose without it, and
    /// some standard deviations of what is left. Infinite where nothing fixes
    /// the pose then. Where `anchor`, which knows nothing of the last seconds' matches,
    /// holds it better than a share of the prior does, that is asked.
    pub fn separation(
        &mut self,
        matches: &[Match],
        view: &View,
        pose: &Pose,
        (prior, anchor): (&Prior, Option<&Prior>),
        config: &SeparationConfig,
        solver: &SolverConfig,
    ) -> Separation {
        let shared = Prior { information: prior.information * config.prior_share, ..*prior };
        self.weigh(matches, view, pose, &shared, solver);
        let by_share = self.separation_as_held(config);
        let Some(anchor) = anchor else { return by_share };
        self.hold(pose, anchor);
        let by_anchor = self.separation_as_held(config);
        Separation { one_m: by_share.one_m.min(by_anchor.one_m), two_m: by_share.two_m.min(by_anchor.two_m) }
    }

    /// The same of the belief that is held against the matches.
    fn separation_as_held(&self, config: &SeparationConfig) -> Separation {
        let whole = (self.information, self.gradient);
        let mut separation = Separation { one_m: config.level_m(&whole), two_m: 0.0 };
        let Some((worst_m, rest, worst)) = self.worst_without(&whole, None, config) else { return separation };
        separation.one_m = separation.one_m.max(worst_m);
        let second = self.worst_without(&rest, Some(worst), config);
        separation.two_m = second.map_or(0.0, |(second_m, ..)| second_m).max(separation.one_m);
        separation
    }

    /// The match without whose object the pose may be furthest off, that
    /// distance, and what is left then; of those that are not of the same object
    /// as `gone`.
    fn worst_without(&self, sum: &Sum, gone: Option<&Part>, config: &SeparationConfig) -> Option<(f64, Sum, &Part)> {
        let is_left = |part: &&Part| {
            gone.is_none_or(|gone| !std::ptr::eq(*part, gone) && !gone.is_same_object(part, config.object_m))
        };
        let without = self.parts.iter().filter(is_left).map(|part| {
            let rest = self.less(sum, part, config.object_m);
            (config.level_m(&rest), rest, part)
        });
        without.max_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Leaves in `moved` the poses that the other matches and the whole prior
    /// ask for where one object is left out, with half the squared Mahalanobis
    /// distance that each lies away; furthest first.
    pub fn poses_without(
        &mut self,
        matches: &[Match],
        view: &View,
        pose: &Pose,
        prior: &Prior,
        object_m: f64,
        solver: &SolverConfig,
    ) {
        self.weigh(matches, view, pose, prior, solver);
        let without = |(information, gradient): Sum| {
            let step = -Cholesky::new(information)?.solve(&gradient);
            Some((0.5 * step.dot(&(information * step)), retract(pose, &step)))
        };
        let mut moved = std::mem::take(&mut self.moved);
        moved.clear();
        moved.extend(self.without_each(object_m).filter_map(without));
        moved.sort_by(|a, b| b.0.total_cmp(&a.0));
        self.moved = moved;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::associate::detection::DetectionConfig;
    use crate::associate::matching::{Matcher, Scene};
    use crate::associate::odds::UsualOdds;
    use crate::local_map::LocalMap;
    use crate::measurement::NoiseConfig;
    use crate::prepare::Prepared;
    use crate::preselect::{Candidates, Lookup, PreselectConfig, Reach};
    use crate::testing::{IMAGE, Recipe, World};

    /// The frame at the true pose, with the longest pole seen aside, as `ask`
    /// is told of it: matches, view, pose, prior.
    pub(super) fn with_one_aside<T>(aside_px: f64, ask: impl FnOnce(&[Match], &View, &Pose, &Prior) -> T) -> T {
        let world = World::new(Recipe { missed: 0.0, ..Recipe::default() });
        let pose = world.truth[60];
        let mut seen = world.features(60);
        if let Some(longest) = seen.poles.iter_mut().max_by(|a, b| a.length_px().total_cmp(&b.length_px())) {
            longest.upper_px.x += aside_px;
            longest.lower_px.x += aside_px;
        }
        let mut features = Prepared::default();
        features.fill(&seen);
        let (mut map, preselect) = (LocalMap::whole(world.map.clone()), PreselectConfig::default());
        let mut candidates = Candidates::default();
        let lookup = Lookup { map: &mut map, camera: &world.camera, image: IMAGE, config: &preselect };
        lookup.select(&pose, &Reach { position_m: 1.0, angle_rad: 0.05 }, &mut candidates).unwrap();
        let scene = Scene {
            camera: &world.camera,
            image: IMAGE,
            features: &features,
            candidates: &candidates,
            noise: &NoiseConfig::default(),
            detection: &DetectionConfig::default(),
            odds: UsualOdds::default(),
        };
        let sigmas = Vector6::new(0.05, 0.05, 0.05, 0.003, 0.003, 0.003);
        let covariance = Matrix6::from_diagonal(&sigmas.component_mul(&sigmas));
        let mut matcher = Matcher::default();
        matcher.run(&scene, &pose, &covariance);
        let prior = Prior::new(pose, &covariance).unwrap();
        ask(&matcher.matches, &View::new(&world.camera, &pose), &pose, &prior)
    }

    #[test]
    fn one_match_that_pulls_separates() {
        let separated = |aside_px| {
            with_one_aside(aside_px, |matches, view, pose, prior| {
                let (separation, solver) = (SeparationConfig::default(), SolverConfig::default());
                Balance::default().separation(matches, view, pose, (prior, None), &separation, &solver)
            })
        };
        let (agreeing, pulled) = (separated(0.0), separated(6.0));
        assert!(agreeing.one_m < 0.25 && pulled.one_m > agreeing.one_m, "{agreeing:?}, {pulled:?}");
        assert!(agreeing.two_m >= agreeing.one_m && pulled.two_m >= pulled.one_m, "{agreeing:?}, {pulled:?}");
    }

    #[test]
    fn a_pose_that_two_objects_hold_may_be_anywhere_without_them() {
        let of_two = with_one_aside(0.0, |matches, view, pose, prior| {
            let is_pole = |m: &&Match| matches!(m.landmark, LandmarkId::Pole(_));
            let two: Vec<Match> = matches.iter().filter(is_pole).take(2).copied().collect();
            let (separation, solver) = (SeparationConfig::default(), SolverConfig::default());
            Balance::default().separation(&two, view, pose, (prior, None), &separation, &solver)
        });
        let config = SeparationConfig::default();
        // A share of the prior of 5 cm is left.
        let prior_alone_m = config.sigmas * 0.05 * (2.0 / config.prior_share).sqrt();
        assert!((of_two.two_m - prior_alone_m).abs() < 1e-6, "{of_two:?}, {prior_alone_m} m");
        assert!(of_two.one_m <= of_two.two_m, "{of_two:?}");
    }

    #[test]
    fn what_holds_the_pose_better_than_a_share_of_the_prior_is_asked() {
        let [alone, held, loose] = [None, Some(0.05), Some(2.0)].map(|sigma_m: Option<f64>| {
            with_one_aside(6.0, |matches, view, pose, prior| {
                let (separation, solver) = (SeparationConfig::default(), SolverConfig::default());
                let anchor = sigma_m.and_then(|sigma_m| Prior::new(*pose, &(Matrix6::identity() * sigma_m * sigma_m)));
                let beliefs = (prior, anchor.as_ref());
                Balance::default().separation(matches, view, pose, beliefs, &separation, &solver)
            })
        });
        assert!(held.one_m < 0.7 * alone.one_m && held.two_m < 0.7 * alone.two_m, "{held:?}, {alone:?}");
        assert!(loose == alone, "{loose:?}, {alone:?}");
    }

    #[test]
    fn of_the_poses_without_one_object_the_furthest_comes_first() {
        let poses_of = |aside_px| {
            with_one_aside(aside_px, |matches, view, pose, prior| {
                let object_m = SeparationConfig::default().object_m;
                let mut balance = Balance::default();
                balance.poses_without(matches, view, pose, prior, object_m, &SolverConfig::default());
                let poses = balance.moved;
                assert_eq!(poses.len(), matches.len());
                poses
            })
        };
        let (agreeing, pulled) = (poses_of(0.0), poses_of(6.0));
        assert!(pulled.is_sorted_by(|a, b| a.0 >= b.0));
        assert!(pulled[0].0 > agreeing[0].0, "{} and {}", pulled[0].0, agreeing[0].0);
    }

    #[test]
    fn without_matches_a_share_of_the_prior_is_left() {
        let pose = Pose::identity();
        let prior = Prior::new(pose, &Matrix6::identity()).unwrap();
        let view = View::new(&crate::projection::tests::camera(), &pose);
        let config = SeparationConfig::default();
        let of_none =
            Balance::default().separation(&[], &view, &pose, (&prior, None), &config, &SolverConfig::default());
        assert!((of_none.one_m - config.sigmas * (2.0 / config.prior_share).sqrt()).abs() < 1e-9, "{of_none:?}");
    }
}
