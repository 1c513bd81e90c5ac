use super::*;
use crate::projection::tests::camera;
use crate::projection::{NEAR_M, View};
use common::geometry::{Pose, PoseParameters, Tangent, retract};
use common::map::{LaneKind, PoleKind, SignKind};
use nalgebra::Point2;
use proptest::prelude::*;

use crate::features::{Features, LaneFeature, LineFeature};
use crate::prepare::{Prepared, PreparedPole};
use crate::preselect::{Candidates, LaneCandidate, PoleCandidate};
use crate::testing::IMAGE;

const FOCAL_PX: f64 = 707.0;

fn pose() -> Pose {
    PoseParameters { x_m: 1.0, y_m: -0.5, z_m: 10.0, yaw_rad: 0.1, pitch_rad: 0.01, roll_rad: 0.02 }.to_pose()
}

fn view() -> View {
    View::new(&camera(), &pose())
}

/// A pole whose foot stands at a place in front of the camera.
fn pole(right_m: f64, ahead_m: f64, height_m: f64) -> PoleCandidate {
    let foot_map = pose() * Point3::new(right_m, 1.6, ahead_m);
    let top_map = pose() * Point3::new(right_m + 0.05, 1.6 - height_m, ahead_m);
    PoleCandidate { index: 0, kind: PoleKind::LampPost, foot_map, top_map, sight_m: 0.0 }
}

fn line(upper_px: Point2<f64>, lower_px: Point2<f64>) -> LineFeature {
    LineFeature {
        upper_px,
        lower_px,
        offset_sigma_px: 0.5,
        angle_sigma_rad: 0.01,
        width_px: 5.0,
        probability: 0.8,
        upper_is_cut: false,
        lower_is_cut: false,
    }
}

fn prepared_pole(upper_px: Point2<f64>, lower_px: Point2<f64>) -> PreparedPole {
    let mut prepared = Prepared::default();
    prepared.fill(&Features { poles: vec![line(upper_px, lower_px)], ..Features::default() });
    prepared.poles[0]
}

/// The feature that a pole gives between two shares of its image's length.
fn feature_of(pole: &PoleCandidate, from: f64, to: f64) -> PreparedPole {
    let image = PoleImage::new(&view(), pole).unwrap();
    let at = |share: f64| image.top_px + (image.foot_px - image.top_px) * share;
    prepared_pole(at(from), at(to))
}

fn pair(pole: &PoleCandidate, feature: &PreparedPole) -> Option<Pairing> {
    PoleImage::new(&view(), pole)?.pair(feature, &NoiseConfig::default(), FOCAL_PX, 0.0).map(Pairing::from)
}

proptest! {
    #[test]
    fn a_pole_and_its_own_feature_have_no_distance_and_exact_derivatives(
        right_m in -9.0..9.0_f64, ahead_m in 6.0..60.0_f64, height_m in 1.0..9.0_f64,
        from in 0.0..0.4_f64, to in 0.6..1.0_f64, axis in 0..6_usize,
    ) {
        let pole = pole(right_m, ahead_m, height_m);
        let pairing = pair(&pole, &feature_of(&pole, from, to)).unwrap();
        prop_assert_eq!(pairing.observations().len(), 2);
        for observation in pairing.observations() {
            let (distance_px, row) = observation.linearise(&view()).unwrap();
            prop_assert!(distance_px.abs() < 1e-6);
            let mut delta = Tangent::zeros();
            delta[axis] = 1e-6;
            let at = |d: Tangent| observation.distance_px(&View::new(&camera(), &retract(&pose(), &d))).unwrap();
            let numeric = (at(delta) - at(-delta)) / 2e-6;
            prop_assert!((numeric - row[axis]).abs() < 1e-4 * (1.0 + row[axis].abs()));
        }
    }
}

#[test]
fn the_ends_that_are_compared_are_those_that_both_have() {
    let pole = pole(3.0, 15.0, 6.0);
    let feature = feature_of(&pole, -0.5, 0.5);
    let pairing = pair(&pole, &feature).unwrap();
    let (first, last) = pairing.extremes();
    assert!((first.point_map - pole.top_map).norm() < 1e-6);
    let (lower, _) = view().project(&last.point_map).unwrap();
    assert!((lower - (feature.upper_px + feature.down * feature.length_px)).norm() < 1e-6);
}

#[test]
fn what_does_not_overlap_or_reaches_into_the_ground_is_no_pair() {
    let pole = pole(3.0, 15.0, 3.0);
    assert!(pair(&pole, &feature_of(&pole, -2.0, -1.0)).is_none());
    assert!(pair(&pole, &feature_of(&pole, 0.2, 1.2)).is_some());
    assert!(pair(&pole, &feature_of(&pole, 0.2, 1.9)).is_none());
}

#[test]
fn a_foot_in_its_place_speaks_for_the_pole_and_one_in_the_ground_against() {
    let pole = pole(3.0, 15.0, 6.0);
    let noise = NoiseConfig::default();
    let ends = |from, to| {
        let image = PoleImage::new(&view(), &pole).unwrap();
        image.ends_support(&feature_of(&pole, from, to), &image.ends(&noise, FOCAL_PX, 1.0), 185.0)
    };
    assert!(ends(0.0, 1.0) > 0.5);
    // Hidden by a car: no surprise. The top behind leaves: neither.
    assert!(ends(0.0, 0.6) < 0.0 && ends(0.0, 0.6) > -1.5);
    assert!(ends(0.0, 1.25) < ends(0.0, 0.6) - 1.0);
    // The lidar saw only the lower part.
    assert!((ends(-0.6, 1.0) - ends(0.0, 1.0)).abs() < 0.05);
    assert!(ends(0.5, 1.0) < ends(0.0, 1.0) - 0.5);
}

#[test]
fn what_goes_on_above_a_sign_is_not_its_post_though_it_is_cut() {
    let noise = NoiseConfig::default();
    let ends = |kind: PoleKind, from: f64| {
        let pole = PoleCandidate { kind, ..pole(3.0, 15.0, 3.0) };
        let image = PoleImage::new(&view(), &pole).unwrap();
        let cut = PreparedPole { upper_is_cut: true, ..feature_of(&pole, from, 1.0) };
        image.ends_support(&cut, &image.ends(&noise, FOCAL_PX, 1.0), 185.0)
    };
    assert!(ends(PoleKind::SignPost, -1.0) < ends(PoleKind::SignPost, 0.2) - 2.0);
    let (over, own) = (ends(PoleKind::LampPost, -1.0), ends(PoleKind::LampPost, 0.2));
    assert!((over - own).abs() < 0.3, "{over} {own}");
}

/// The ends that are seen of a pole's feature, and its observations.
fn with_ends(kind: PoleKind, height_m: f64, feature: &PreparedPole) -> (Vec<Observation>, Pairing) {
    let pole = PoleCandidate { kind, ..pole(3.0, 15.0, height_m) };
    let image = PoleImage::new(&view(), &pole).unwrap();
    let noise = NoiseConfig::default();
    let mut pairing: Pairing = image.pair(feature, &noise, FOCAL_PX, 0.0).unwrap().into();
    image.push_ends(feature, &noise, FOCAL_PX, 0.0, &mut pairing);
    let ends = pairing.groups().skip(1).flatten().copied().collect();
    (ends, pairing)
}

#[test]
fn both_ends_of_a_low_pole_fix_its_height_in_the_image_where_they_are_seen() {
    let own = feature_of(&pole(3.0, 15.0, 1.0), 0.0, 1.0);
    let (ends, pairing) = with_ends(PoleKind::Delineator, 1.0, &own);
    assert_eq!((ends.len(), pairing.line().len(), pairing.observations().len()), (2, 2, 4));
    assert!(ends.iter().all(|end| end.distance_px(&view()).unwrap().abs() < 1e-6));
    // A camera that looks up sees both lower.
    let up = retract(&pose(), &Tangent::new(0.0, 0.0, 0.0, 0.01, 0.0, 0.0));
    for end in &ends {
        let off_px = end.distance_px(&View::new(&camera(), &up)).unwrap();
        assert!((off_px.abs() - 0.01 * FOCAL_PX).abs() < 1.0, "{off_px}");
    }
    // The foot behind a car, or cut; the foot of a sign post behind one.
    let hidden = feature_of(&pole(3.0, 15.0, 1.0), 0.0, 0.4);
    assert_eq!(with_ends(PoleKind::Delineator, 1.0, &hidden).0.len(), 1);
    let cut = PreparedPole { lower_is_cut: true, upper_is_cut: true, ..own };
    assert_eq!(with_ends(PoleKind::Delineator, 1.0, &cut).0.len(), 0);
    assert_eq!(with_ends(PoleKind::SignPost, 1.0, &own).0.len(), 1);
    assert_eq!(with_ends(PoleKind::LampPost, 1.0, &own).0.len(), 0);
}

#[test]
fn a_near_landmark_is_less_certain_in_the_image() {
    let sigma = |ahead_m: f64| {
        let pole = pole(3.0, ahead_m, 3.0);
        pair(&pole, &feature_of(&pole, 0.0, 1.0)).unwrap().observations()[0].sigma_px
    };
    assert!(sigma(6.0) > 2.0 * sigma(20.0));
    // However far: the calibration's floor.
    assert!(sigma(90.0) > NoiseConfig::default().calibration_px(FOCAL_PX));
}

/// A lane line on flat ground to one side, between two distances ahead.
fn lane(right_m: f64, from_m: f64, to_m: f64) -> Candidates {
    let at = |ahead_m: f64| pose() * Point3::new(right_m, 1.6, ahead_m);
    Candidates {
        lane_points_map: vec![at(from_m), at(f64::midpoint(from_m, to_m)), at(to_m)],
        lanes: vec![LaneCandidate { index: 0, kind: LaneKind::Solid, start: 0, end: 3, marks: (0, 0) }],
        ..Candidates::default()
    }
}

fn vertices(candidates: &Candidates) -> Vec<LaneVertex> {
    let mut out = Vec::new();
    project_lane(&view(), candidates, &candidates.lanes[0], &mut out);
    out
}

#[test]
fn a_lane_that_begins_behind_is_cut_at_the_near_plane_and_kept() {
    let seen = vertices(&lane(-1.7, -20.0, 50.0));
    assert!((seen[0].depth_m - NEAR_M).abs() < 1e-6);
    assert_eq!(seen.len(), 3);
    assert!(vertices(&lane(-1.7, -20.0, -5.0)).is_empty());
}

#[test]
fn a_lane_feature_is_compared_where_the_map_has_the_line() {
    let whole = vertices(&lane(-1.7, 6.0, 30.0));
    let points_px = (0..120).map(|i| {
        let share = f64::from(i) / 119.0;
        let ahead_m = 1.0 / ((1.0 - share) / 28.0 + share / 7.0);
        view().project(&(pose() * Point3::new(-1.7, 1.6, ahead_m))).unwrap().0
    });
    let points_px: Vec<_> = points_px.collect();
    let feature = LaneFeature { line: line(points_px[0], points_px[119]), points_px, edges: Vec::new() };
    let mut prepared = Prepared::default();
    prepared.fill(&Features { lanes: vec![feature], ..Features::default() });
    let noise = NoiseConfig::default();
    let paired = |vertices: &[LaneVertex]| pair_lane(vertices, &prepared.lanes[0], &noise, FOCAL_PX, 30.0);
    let pairing = paired(&whole).unwrap();
    assert_eq!(pairing.observations().len(), MAX_KNOTS);
    assert!(pairing.observations().iter().all(|o| o.distance_px(&view()).unwrap().abs() < 0.3));
    // Half of the line: the far knots have nothing beside them.
    let half = paired(&vertices(&lane(-1.7, 6.0, 11.0))).unwrap();
    assert!(half.observations().len() < MAX_KNOTS);
    // More knots tell no more than two.
    let information = |p: &Pairing| p.observations().iter().map(|o| o.sigma_px.powi(-2)).sum::<f64>();
    assert!(information(&pairing) < 2.0 / noise.calibration_px(FOCAL_PX).powi(2));
    assert!(paired(&vertices(&lane(2.0, 6.0, 30.0))).is_none());
    // Networks put a kerb less well than paint.
    let mut kerb = lane(-1.7, 6.0, 30.0);
    kerb.lanes[0].kind = LaneKind::Kerb;
    assert!(information(&paired(&vertices(&kerb)).unwrap()) < 0.5 * information(&pairing));
    // From the ends inwards these are the same places, as sure, and never less so
    // than bound.
    for (right_m, from_m, to_m) in [(-1.7, 6.0, 30.0), (-1.7, 6.0, 11.0), (-1.5, 9.0, 20.0), (2.0, 6.0, 30.0)] {
        let vertices = vertices(&lane(right_m, from_m, to_m));
        let mut ends = LaneEnds::new(&vertices, &prepared.lanes[0], &noise, FOCAL_PX, 30.0);
        let most_of_one = ends.most_share(0);
        let taken = ends.first().and_then(|first| Some((first, ends.last()?)));
        let pairing = paired(&vertices);
        assert_eq!(taken.is_some(), pairing.is_some());
        let Some(((first, last), pairing)) = taken.zip(pairing) else { continue };
        let (share, most) = (ends.share(), ends.most_share(2));
        assert!(share <= most && most <= most_of_one);
        for (end, of_pair) in [(first, pairing.extremes().0), (last, pairing.extremes().1)] {
            assert_eq!(end.point_map, of_pair.point_map);
            let distance_px = |of: &Observation| of.distance_px(&view()).unwrap().abs();
            assert!((distance_px(&end) - distance_px(of_pair)).abs() < 0.05);
            assert!((end.sigma_px * share / of_pair.sigma_px - 1.0).abs() < 0.01);
        }
    }
}

#[test]
fn a_lane_that_runs_athwart_a_feature_is_far_from_its_ends() {
    // A mapped line across the road, and a feature along it, 12 m and more ahead.
    let across = |right_m: f64| pose() * Point3::new(right_m, 1.6, 15.0);
    let candidates = Candidates { lane_points_map: [-8.0, 0.0, 8.0].map(across).to_vec(), ..lane(0.0, 1.0, 2.0) };
    let seen = |ahead_m: f64| view().project(&(pose() * Point3::new(0.5, 1.6, ahead_m))).unwrap().0;
    let feature = LaneFeature { line: line(seen(20.0), seen(12.0)), points_px: Vec::new(), edges: Vec::new() };
    let mut prepared = Prepared::default();
    prepared.fill(&Features { lanes: vec![feature], ..Features::default() });
    let (vertices, noise) = (vertices(&candidates), NoiseConfig::default());
    let mut ends = LaneEnds::new(&vertices, &prepared.lanes[0], &noise, FOCAL_PX, 60.0);
    let ends_px = [ends.first().unwrap(), ends.last().unwrap()].map(|end| end.distance_px(&view()).unwrap());
    // One lies above the line, one below.
    assert!(ends_px.iter().all(|px| px.abs() > 10.0) && ends_px[0] * ends_px[1] < 0.0, "{ends_px:?}");
}

#[test]
fn signs_must_agree_in_kind_and_size() {
    let sign = SignCandidate {
        index: 0,
        kind: SignKind::TrafficSign,
        centroid_map: pose() * Point3::new(3.0, -1.0, 20.0),
        size_m: 0.7,
        sight_m: 0.0,
    };
    let expected_px = 0.7 * FOCAL_PX / 20.0;
    let feature = |kind, extent_px: f64| PointFeature {
        kind,
        centre_px: IMAGE_CENTRE,
        extent_px: Vector2::repeat(extent_px / std::f64::consts::SQRT_2),
        sigma_px: 1.0,
        probability: 0.8,
        is_cut: false,
    };
    let paired = |f: PointFeature| pair_sign(&sign, 20.0, &f, &NoiseConfig::default(), FOCAL_PX).is_some();
    assert!(paired(feature(SignKind::TrafficSign, expected_px)));
    assert!(!paired(feature(SignKind::TrafficLight, expected_px)));
    assert!(!paired(feature(SignKind::TrafficSign, 5.0 * expected_px)));
}

const IMAGE_CENTRE: Point2<f64> = Point2::new(IMAGE.width_px / 2.0, IMAGE.height_px / 2.0);
