use common::geometry::{PinholeCamera, Pose, PoseParameters, Tangent, retract};
use common::map::{PoleKind, SemanticMap};
use nalgebra::{Point3, Vector6};

use super::*;
use crate::features::Features;
use crate::local_map::LocalMap;
use crate::preselect::{Lookup, PoleCandidate, PreselectConfig, Reach};
use crate::testing::{IMAGE, Recipe, World};

fn covariance(sigma_m: f64, sigma_rad: f64) -> Matrix6<f64> {
    let sigmas = Vector6::new(sigma_m, 0.05, sigma_m, 0.005, sigma_rad, 0.005);
    Matrix6::from_diagonal(&sigmas.component_mul(&sigmas))
}

/// Everything that a scene borrows.
struct Owned {
    camera: PinholeCamera,
    features: Prepared,
    candidates: Candidates,
    noise: NoiseConfig,
    detection: DetectionConfig,
}

impl Owned {
    fn new(camera: PinholeCamera, map: &SemanticMap, at: &Pose, features: &Features) -> Self {
        let (mut map, config) = (LocalMap::whole(map.clone()), PreselectConfig::default());
        let lookup = Lookup { map: &mut map, camera: &camera, image: IMAGE, config: &config };
        let mut candidates = Candidates::default();
        lookup.select(at, &Reach { position_m: 8.0, angle_rad: 0.1 }, &mut candidates).unwrap();
        let mut prepared = Prepared::default();
        prepared.fill(features);
        Self {
            camera,
            features: prepared,
            candidates,
            noise: NoiseConfig::default(),
            detection: DetectionConfig::default(),
        }
    }

    fn scene(&self) -> Scene<'_> {
        Scene {
            camera: &self.camera,
            image: IMAGE,
            features: &self.features,
            candidates: &self.candidates,
            noise: &self.noise,
            detection: &self.detection,
        }
    }
}

#[test]
fn no_landmark_and_no_feature_is_used_twice() {
    let world = World::new(Recipe { pole_spacing_m: 3.0, ..Recipe::default() });
    for frame in (0..200).step_by(20) {
        let at = world.truth[frame];
        let owned = Owned::new(world.camera, &world.map, &at, &world.features(frame));
        let mut matcher = Matcher::default();
        matcher.run(&owned.scene(), &at, &covariance(0.5, 0.02));
        assert!(matcher.matches.len() >= 3);
        for (i, a) in matcher.matches.iter().enumerate() {
            assert!(a.distance2 <= GATE);
            for b in &matcher.matches[i + 1..] {
                let same_kind = std::mem::discriminant(&a.landmark) == std::mem::discriminant(&b.landmark);
                assert!(a.landmark != b.landmark || matches!(a.landmark, LandmarkId::Lane(_)));
                assert!(!same_kind || a.feature != b.feature);
            }
        }
    }
}

#[test]
fn the_true_pose_has_more_support_than_those_beside_it() {
    let world = World::new(Recipe { missed: 0.1, ..Recipe::default() });
    let mut better = 0;
    let frames = (10..210).step_by(20);
    for frame in frames.clone() {
        let at = world.truth[frame];
        let owned = Owned::new(world.camera, &world.map, &at, &world.features(frame));
        let mut matcher = Matcher::default();
        let mut support = |right_m, forward_m| {
            let moved = retract(&at, &Tangent::new(right_m, 0.0, forward_m, 0.0, 0.0, 0.0));
            matcher.run(&owned.scene(), &moved, &covariance(0.1, 0.003))
        };
        let own = support(0.0, 0.0);
        better += usize::from([(3.5, 0.0), (-3.5, 0.0), (0.0, 5.0)].iter().all(|&(r, f)| support(r, f) < own));
    }
    assert!(better * 10 >= frames.count() * 9);
}

#[test]
fn a_landmark_that_should_be_seen_and_is_not_costs() {
    let camera = crate::projection::tests::camera();
    let at = PoseParameters { x_m: 0.0, y_m: 0.0, z_m: 0.0, yaw_rad: 0.0, pitch_rad: 0.0, roll_rad: 0.0 }.to_pose();
    let mut owned = Owned::new(camera, &SemanticMap::default(), &at, &Features::default());
    let mut matcher = Matcher::default();
    assert!(matcher.run(&owned.scene(), &at, &covariance(0.1, 0.003)).abs() < 1e-12);
    let pole = |right_m: f64| PoleCandidate {
        index: 0,
        kind: PoleKind::LampPost,
        foot_map: Point3::new(right_m, 1.6, 15.0),
        top_map: Point3::new(right_m, -3.0, 15.0),
        sight_m: 0.0,
    };
    owned.candidates.poles.push(pole(4.0));
    let missing = matcher.run(&owned.scene(), &at, &covariance(0.1, 0.003));
    assert!(missing < -0.2);
    // Outside the image nothing is expected.
    owned.candidates.poles[0] = pole(40.0);
    assert!(matcher.run(&owned.scene(), &at, &covariance(0.1, 0.003)).abs() < 1e-12);
}
