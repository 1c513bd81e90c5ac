use common::geometry::{PinholeCamera, Pose, PoseParameters, Tangent, retract};
use common::map::{LaneKind, LaneLine, PoleKind, Road, RoadId, SemanticMap};
use nalgebra::{Matrix6x2, Point3, Vector6};
use proptest::prelude::*;

use super::*;
use crate::features::{Features, LaneFeature, LineFeature, MarkEdge};
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
            odds: UsualOdds::default(),
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

/// `worth` and `drop_worthless` say what matching anew would.
#[test]
fn the_worth_of_all_matches_is_what_the_frame_loses_without_features() {
    let world = World::new(Recipe { missed: 0.3, ..Recipe::default() });
    for frame in (10..210).step_by(40) {
        let at = world.truth[frame];
        let mut owned = Owned::new(world.camera, &world.map, &at, &world.features(frame));
        let mut matcher = Matcher::default();
        let support = matcher.run(&owned.scene(), &at, &covariance(0.1, 0.003));
        let worth = matcher.worth(&owned.detection);
        let kept = matcher.drop_worthless(&owned.detection);
        assert!(kept >= support - 1e-9 && matcher.worth(&owned.detection) >= worth - 1e-9);
        owned.features = Prepared::default();
        let unseen = Matcher::default().run(&owned.scene(), &at, &covariance(0.1, 0.003));
        assert!((support - worth - unseen).abs() < 1e-9, "{support} - {worth} is not {unseen}");
    }
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
    // A bus hides a row of them as easily as one.
    owned.candidates.poles.extend((0..30).map(|i| pole(0.1 * f64::from(i))));
    let row = matcher.run(&owned.scene(), &at, &covariance(0.1, 0.003));
    assert!(row < missing && row > owned.detection.blocked.ln() - 1e-9);
    // Outside the image nothing is expected.
    owned.candidates.poles.truncate(1);
    owned.candidates.poles[0] = pole(40.0);
    assert!(matcher.run(&owned.scene(), &at, &covariance(0.1, 0.003)).abs() < 1e-12);
}

/// Of a trunk and a mast beside it each is matched with what is seen as such.
#[test]
fn what_is_seen_as_a_trunk_is_a_trunk_and_nothing_is_missed_where_nobody_tells_of_trunks() {
    let camera = crate::projection::tests::camera();
    let at = PoseParameters { x_m: 0.0, y_m: 0.0, z_m: 0.0, yaw_rad: 0.0, pitch_rad: 0.0, roll_rad: 0.0 }.to_pose();
    let pole = |kind, right_m: f64| PoleCandidate {
        index: usize::from(kind == PoleKind::Trunk),
        kind,
        foot_map: Point3::new(right_m, 1.6, 15.0),
        top_map: Point3::new(right_m, -1.4, 15.0),
        sight_m: 0.0,
    };
    let candidates = [pole(PoleKind::LampPost, 4.0), pole(PoleKind::Trunk, 4.1)];
    let seen = |pole: &PoleCandidate| {
        let view = View::new(&camera, &at);
        let pixel = |p: &Point3<f64>| view.project(p).unwrap().0;
        LineFeature {
            upper_px: pixel(&pole.top_map),
            lower_px: pixel(&pole.foot_map),
            offset_sigma_px: 1.0,
            angle_sigma_rad: 0.01,
            width_px: 6.0,
            probability: 0.7,
            upper_is_cut: false,
            lower_is_cut: false,
        }
    };
    // Each is seen where the other stands.
    let both =
        Features { poles: vec![seen(&candidates[1])], trunks: Some(vec![seen(&candidates[0])]), ..Features::default() };
    let mut owned = Owned::new(camera, &SemanticMap::default(), &at, &both);
    owned.candidates.poles.extend(candidates);
    let mut matcher = Matcher::default();
    matcher.run(&owned.scene(), &at, &covariance(0.3, 0.003));
    let pairs = matcher.matches.iter().map(|found| (found.landmark, found.feature));
    assert_eq!(pairs.collect::<Vec<_>>(), [(LandmarkId::Pole(0), 0), (LandmarkId::Pole(1), 1)]);
    // Alone and unseen it costs where vegetation is told, and nothing elsewhere.
    owned.candidates.poles.remove(0);
    owned.detection.trunk = 0.3;
    let mut cost = |trunks| {
        owned.features.fill(&Features { trunks, ..Features::default() });
        matcher.run(&owned.scene(), &at, &covariance(0.1, 0.003))
    };
    assert!(cost(None).abs() < 1e-12 && cost(Some(Vec::new())) < -0.1);
}

/// A dashed line 1.8 m to the left of a straight road, marks of 3 m every 6 m,
/// and what a camera at a pose sees of it, ends of marks from 5 to 20 m ahead.
fn dashes(camera: &PinholeCamera, at: &Pose) -> (SemanticMap, Features) {
    let line = LaneLine {
        kind: LaneKind::Dashed,
        points_map: vec![Point3::new(-1.8, 1.65, 0.0), Point3::new(-1.8, 1.65, 90.0)],
        road: RoadId(0),
        marks_m: (0..15).map(|i| 6.0 * f64::from(i) + 1.0).map(|from_m| [from_m, from_m + 3.0]).collect(),
    };
    let view = View::new(camera, at);
    let seen = |z: f64| view.project(&Point3::new(-1.8, 1.65, z)).filter(|(_, depth_m)| (5.0..20.0).contains(depth_m));
    let edge = |z: f64, is_near: bool| seen(z).map(|(at_px, _)| MarkEdge { at_px, is_near, sigma_px: 1.0 });
    let edges = line.marks_m.iter().flat_map(|[from_m, to_m]| [edge(*from_m, true), edge(*to_m, false)]);
    let points_px: Vec<_> = (0..900).rev().filter_map(|i| seen(f64::from(i) * 0.1)).map(|(at_px, _)| at_px).collect();
    let straight = LineFeature {
        upper_px: points_px[0],
        lower_px: points_px[points_px.len() - 1],
        offset_sigma_px: 0.7,
        angle_sigma_rad: 0.003,
        width_px: 6.0,
        probability: 0.9,
        upper_is_cut: false,
        lower_is_cut: false,
    };
    let lane = LaneFeature { points_px, line: straight, edges: edges.flatten().collect() };
    let road = Road { path_map: vec![Point3::origin(), Point3::new(0.0, 0.0, 90.0)] };
    let map = SemanticMap { roads: vec![road], lanes: vec![line], ..SemanticMap::default() };
    (map, Features { lanes: vec![lane], ..Features::default() })
}

#[test]
fn marks_tell_how_far_along_the_line_the_camera_is_up_to_a_dash_and_a_gap() {
    let camera = crate::projection::tests::camera();
    let truth = Pose::translation(0.0, 0.0, 30.0);
    let (map, features) = dashes(&camera, &truth);
    let owned = Owned::new(camera, &map, &truth, &features);
    let mut matcher = Matcher::default();
    let marks_at = |matcher: &mut Matcher, ahead_m: f64, sigma_m: f64| {
        let start = Pose::translation(0.0, 0.0, 30.0 + ahead_m);
        matcher.find(&owned.scene(), &start, &covariance(sigma_m, 0.005));
        let found = matcher.matches.iter().find(|found| found.landmark == LandmarkId::Marks(0))?;
        let view = View::new(&camera, &start);
        // The map's marks lie nearer than they are seen: lower in the image.
        let off_px = found.pairing.observations()[0].distance_px(&view)?;
        Some((found.pairing.observations().len(), off_px))
    };
    let (ends, off_px) = marks_at(&mut matcher, 0.3, 0.4).unwrap();
    assert!(ends >= 4 && off_px < -2.0, "{ends} {off_px}");
    let (_, off_px) = marks_at(&mut matcher, 0.0, 0.4).unwrap();
    assert!(off_px.abs() < 1e-6, "{off_px}");
    assert_eq!(marks_at(&mut matcher, 0.3, 6.0), None, "one dash further on looks the same");
    assert!(matcher.matches.iter().any(|found| found.landmark == LandmarkId::Lane(0)), "the line itself does not");
}

proptest! {
    #[test]
    fn what_one_end_refutes_the_pair_refutes(
        factor in prop::array::uniform32(-1.0..1.0_f64),
        scale in 0.001..0.5_f64,
        points in prop::array::uniform2((-4.0..4.0_f64, -2.0..2.0_f64, 4.0..40.0_f64)),
        off_px in prop::array::uniform2(-60.0..60.0_f64),
        angle in 0.0..3.1_f64,
        sigma_px in 0.5..4.0_f64,
    ) {
        let camera = crate::projection::tests::camera();
        let owned = Owned::new(camera, &SemanticMap::default(), &Pose::identity(), &Features::default());
        let (scene, root) = (owned.scene(), Matrix6::from_iterator(factor.into_iter().cycle()) * scale);
        let covariance = root * root.transpose();
        let view = View::new(&camera, &Pose::identity());
        let look = Look {
            scene: &scene,
            view,
            covariance: &covariance,
            spread: Spread::new(&covariance),
            clutter: scene.detection.clutter(scene.features, scene.image),
            wanted: Wanted::Both,
        };
        let normal = Vector2::new(angle.cos(), angle.sin());
        let ends = [0, 1].map(|i| {
            let point_map = Point3::from(<[f64; 3]>::from(points[i]));
            let on_line_px = view.project(&point_map).unwrap().0 - normal * off_px[i];
            Observation::on_line(point_map, normal, &on_line_px, sigma_px)
        });
        let rows = ends.map(|end| end.linearise(&view).unwrap());
        let (r, j) = (Vector2::new(rows[0].0, rows[1].0), Matrix6x2::from_columns(&[rows[0].1, rows[1].1]));
        let s = j.transpose() * covariance * j + Matrix2::identity() * (sigma_px * sigma_px);
        let distance2 = r.dot(&(s.try_inverse().unwrap() * r));
        match look.judge(&ends[0], &ends[1]) {
            Some((judged2, _)) => prop_assert!((judged2 - distance2).abs() < 1e-6 * (1.0 + distance2)),
            None => prop_assert!(distance2 > GATE * (1.0 - 1e-6)),
        }
    }
}
