use common::geometry::{PinholeCamera, Pose};
use common::map::{Pole, Road, RoadId};
use localizer::config::Config;
use localizer::features::{Features, LineFeature};
use localizer::gps::GpsFix;
use localizer::projection::{NEAR_M, View};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::made_up::{IMAGE, clean, seen};
use super::*;
use crate::trial::Images;

fn features(trial: &Trial) -> impl Iterator<Item = &Features> {
    trial.frames.iter().map(|seen| &seen.features)
}

fn trunks(seen: &Features) -> &[LineFeature] {
    seen.trunks.as_deref().unwrap_or_default()
}

fn off_m(fix: &GpsFix, frame: usize, clean: &Trial) -> f64 {
    (fix.position_map.coords - clean.truth[frame].translation.vector).norm()
}

#[test]
fn every_fault_repeats_with_its_seed_and_changes_something() {
    let clean = clean();
    for &fault in Fault::value_variants() {
        let Faulty { trial, ends, .. } = fault.applied(&clean, 1);
        let again = fault.applied(&clean, 1);
        assert_eq!(trial.frames, again.trial.frames, "{}", fault.name());
        assert_eq!((&trial.fixes, &ends), (&again.trial.fixes, &again.ends), "{}", fault.name());
        assert_eq!(trial == clean, fault == Fault::None, "{}", fault.name());
        assert_eq!(trial.truth, clean.truth, "{}", fault.name());
    }
}

#[test]
fn spoilt_images_are_looked_at_as_they_come_and_wheels_are_believed() {
    let images = |are_beside_wheels| {
        let (root, sequence) = ("".into(), "00".into());
        Some(Images { root, sequence, labels: None, are_beside_wheels, config: Config::default() })
    };
    let by_images = Trial { images: images(false), ..clean() };
    let deliveries = |fault: Fault| {
        let faulty = fault.applied(&by_images, 1);
        assert!(faulty.trial.odometry.is_empty());
        faulty.deliveries
    };
    let frames = |fault: Fault| deliveries(fault).iter().map(|delivery| delivery.frame).collect::<Vec<_>>();
    let black = frames(Fault::Black);
    assert_eq!((black[14], black[15], black[34], black[35]), (Some(14), None, None, Some(35)));
    let frozen = frames(Fault::Frozen);
    assert_eq!((frozen[14], frozen[15], frozen[34], frozen[35]), (Some(14), Some(14), Some(14), Some(35)));
    assert_eq!(frames(Fault::Stale)[4..7], [Some(4), Some(4), Some(6)]);
    assert_eq!(frames(Fault::Dropped)[3..5], [Some(3), Some(5)]);
    assert_eq!(frames(Fault::Dropped50)[..2], [Some(0), Some(1)]);
    let late_s = deliveries(Fault::Clock)[1].time_s - by_images.frames[1].time_s;
    assert!((late_s - 0.05).abs() < 1e-9, "{late_s}");
    // Beside wheels they are looked at for pitch and roll alone.
    let beside_wheels = Trial { images: images(true), ..clean() };
    let faulty = Fault::Black.applied(&beside_wheels, 1);
    assert_eq!(faulty.trial.odometry, beside_wheels.odometry);
    assert!(!faulty.deliveries.is_empty());
    // What is only found in them spoils no motion, and no image spoils wheels.
    for (fault, trial) in [(Fault::NoLanes, &by_images), (Fault::Black, &clean())] {
        let faulty = fault.applied(trial, 1);
        assert!(faulty.deliveries.is_empty() && !faulty.trial.odometry.is_empty());
    }
}

#[test]
fn the_share_of_false_features_is_as_said_and_the_true_ones_stay() {
    let clean = clean();
    for (fault, share) in [(Fault::False20, 0.2), (Fault::False40, 0.4)] {
        let trial = fault.applied(&clean, 1).trial;
        let (mut all, mut added) = ([0; 4], [0; 4]);
        for (now, before) in features(&trial).zip(features(&clean)) {
            assert!(now.poles.starts_with(&before.poles));
            assert!(now.lanes.starts_with(&before.lanes) && now.signs.starts_with(&before.signs));
            assert!(trunks(now).starts_with(trunks(before)));
            let lengths_px: Vec<f64> = before.poles.iter().map(LineFeature::length_px).collect();
            for pole in &now.poles[before.poles.len()..] {
                assert!(lengths_px.iter().any(|length_px| (length_px - pole.length_px()).abs() < 1e-6));
                assert!(IMAGE.contains(&pole.upper_px, 1.0) && IMAGE.contains(&pole.lower_px, 1.0));
            }
            for lane in &now.lanes[before.lanes.len()..] {
                assert!((lane.points_px[0].y - 200.0).abs() < 1e-9 && !before.lanes.contains(lane));
            }
            let counts = |f: &Features| [f.poles.len(), f.lanes.len(), f.signs.len(), trunks(f).len()];
            for class in 0..4 {
                all[class] += counts(now)[class];
                added[class] += counts(now)[class] - counts(before)[class];
            }
        }
        for class in 0..4 {
            let found = f64::from(added[class] as u32) / f64::from(all[class] as u32);
            assert!((found - share).abs() < 0.03, "class {class}: {found} of {share}");
        }
    }
}

#[test]
fn half_of_the_features_is_missed_and_none_is_new() {
    let trial = Fault::Missed50.applied(&clean(), 1).trial;
    let whole = seen(0);
    assert!(features(&trial).flat_map(|now| &now.poles).all(|pole| whole.poles.contains(pole)));
    let count = |now: &Features| now.poles.len() + trunks(now).len() + now.lanes.len() + now.signs.len();
    let kept: usize = features(&trial).map(count).sum();
    assert!((kept as f64 / (300.0 * 11.0) - 0.5).abs() < 0.05, "{kept}");
}

#[test]
fn classes_and_stretches_are_gone_where_said() {
    let clean = clean();
    let blind = Fault::NoLanes.applied(&clean, 1).trial;
    assert!(features(&blind).all(|now| now.lanes.is_empty() && now.poles.len() == 4 && now.signs.len() == 3));
    let Faulty { trial, ends, .. } = Fault::NoPoles.applied(&clean, 1);
    // Frames are a metre apart: 10 to 60 m and 160 to 210 m.
    assert_eq!(ends, [60, 210]);
    let is_bare = |seen: &Features| seen.poles.is_empty() && seen.trunks == Some(Vec::new());
    let bare: Vec<usize> = trial.frames.iter().filter(|f| is_bare(&f.features)).map(|f| f.frame).collect();
    assert_eq!(bare, (10..60).chain(160..210).collect::<Vec<_>>());
    assert!(features(&trial).all(|now| now.lanes.len() == 2 && now.signs.len() == 3));
    let Faulty { trial, ends, .. } = Fault::Black.applied(&clean, 1);
    assert_eq!(ends, [35, 135, 235]);
    let black: Vec<usize> =
        trial.frames.iter().filter(|f| f.features == Features::default()).map(|f| f.frame).collect();
    assert_eq!(black, (15..35).chain(115..135).chain(215..235).collect::<Vec<_>>());
}

#[test]
fn the_map_is_turned_about_the_middle_of_the_drive() {
    let clean = clean();
    let turned = Fault::MapTurned.applied(&clean, 1).trial;
    let centre = clean.truth[150].translation.vector;
    let (before, after) = (clean.map.poles[0].foot_map.coords - centre, turned.map.poles[0].foot_map.coords - centre);
    assert!((before.norm() - after.norm()).abs() < 1e-9 && (before.y - after.y).abs() < 1e-9);
    assert!((before.angle(&after) - 1.0_f64.to_radians()).abs() < 1e-3);
    // To the right: what is ahead of the middle moves towards x.
    assert!(after.x > before.x + 1.0);
    assert_eq!(turned.fixes, clean.fixes);
}

#[test]
fn in_the_map_of_another_street_all_stands_elsewhere_beside_the_same_road() {
    let clean = clean();
    let other = Fault::MapOther.applied(&clean, 1).trial;
    let (before, after) = (&clean.map.poles[0], &other.map.poles[0]);
    let moved = after.foot_map - before.foot_map;
    assert!((5.0..26.0).contains(&moved.z.abs()) && moved.x.abs() < 1e-9 && moved.y.abs() < 1e-9, "{moved}");
    assert!((after.length_m() - before.length_m()).abs() < 1e-9);
    assert_eq!((&other.map.roads, &other.map.lanes), (&clean.map.roads, &clean.map.lanes));
    assert_eq!(Fault::MapOther.applied(&clean, 1), Fault::MapOther.applied(&clean, 1));
}

#[test]
fn a_turned_camera_shows_what_it_would_show() {
    let clean = clean();
    let turned = Fault::Extrinsics.applied(&clean, 1).trial;
    assert!(
        (turned.camera.from_reference_m - clean.camera.from_reference_m - Vector3::new(0.1, 0.0, 0.0)).norm() < 1e-12
    );
    // A distant point as the camera would see it, turned and not.
    let axis = UnitVector3::new_normalize(Vector3::new(1.0, 1.0, 0.0));
    let turn = UnitQuaternion::from_axis_angle(&axis, 0.5_f64.to_radians());
    let camera = PinholeCamera { from_reference_m: Vector3::zeros(), ..clean.camera };
    let (straight, real) = (Pose::identity(), Pose::from_parts(Vector3::zeros().into(), turn));
    let point = Point3::new(-3.0, -1.0, 12.0);
    let at = |pose: &Pose| View::new(&camera, pose).project(&point).unwrap().0;
    let mut features = Features { signs: seen(0).signs, ..Features::default() };
    features.signs[0].centre_px = at(&straight);
    images::turn(&mut features, &camera, &axis, 0.5_f64.to_radians());
    assert!((features.signs[0].centre_px - at(&real)).norm() < 1e-6);
    // Turned to the right and up, all moves to the left and down.
    let (now, before) = (&turned.frames[0].features, &clean.frames[0].features);
    assert!(now.poles[2].upper_px.x < before.poles[2].upper_px.x - 3.0);
    assert!(trunks(now)[1].upper_px.x < trunks(before)[1].upper_px.x - 3.0);
    assert!(now.lanes[0].points_px[0].y > before.lanes[0].points_px[0].y + 3.0);
}

#[test]
fn focal_lengths_are_one_percent_off() {
    let clean = clean();
    let camera = Fault::Intrinsics.applied(&clean, 1).trial.camera;
    let point = Point3::new(4.0, 0.0, 10.0);
    let right_px = |camera: &PinholeCamera| camera.project(&point, NEAR_M).unwrap().x - camera.cx_px;
    assert!((right_px(&camera) / right_px(&clean.camera) - 1.01).abs() < 1e-9);
}

#[test]
fn a_fix_comes_each_second_and_every_fifth_is_an_outlier() {
    let clean = clean();
    let good = Fault::Gps.applied(&clean, 1).trial;
    assert_eq!(good.fixes.keys().copied().collect::<Vec<_>>(), [vec![0, 1], (10..300).step_by(10).collect()].concat());
    assert!(good.fixes.iter().all(|(&frame, fix)| off_m(fix, frame, &clean) < 8.0));
    let wild = Fault::GpsOutliers.applied(&clean, 1).trial;
    for (index, (frame, fix)) in wild.fixes.iter().enumerate() {
        let moved_m = (fix.position_map - good.fixes[frame].position_map).norm();
        let expected_m = if index % 5 == 4 { 20.0 } else { 0.0 };
        assert!((moved_m - expected_m).abs() < 1e-9, "fix {index}: {moved_m}");
    }
}

#[test]
fn frames_are_dropped_doubled_and_held() {
    let clean = clean();
    let numbers = |trial: &Trial| trial.frames.iter().map(|seen| seen.frame).collect::<Vec<_>>();
    let dropped = Fault::Dropped.applied(&clean, 1).trial;
    assert_eq!(numbers(&dropped)[..6], [0, 1, 2, 3, 5, 6]);
    assert_eq!(dropped.frames.len(), 240);
    let half = numbers(&Fault::Dropped50.applied(&clean, 1).trial);
    assert!((120..180).contains(&half.len()) && half.windows(2).any(|pair| pair[1] > pair[0] + 2), "{half:?}");
    let Faulty { trial: gap, ends, .. } = Fault::Gap.applied(&clean, 1);
    assert_eq!((numbers(&gap), ends), ((0..30).chain(130..230).collect(), vec![130]));
    assert_eq!(numbers(&Fault::Slow.applied(&clean, 1).trial), (0..300).step_by(5).collect::<Vec<_>>());
    let doubled = Fault::Doubled.applied(&clean, 1).trial;
    assert_eq!(numbers(&doubled)[..7], [0, 1, 2, 3, 4, 4, 5]);
    assert_eq!((doubled.frames.len(), &doubled.frames[4]), (360, &doubled.frames[5]));
    let held = Fault::Stale.applied(&clean, 1).trial;
    let shown: Vec<usize> = features(&held).map(|now| now.signs[0].sigma_px as usize).collect();
    assert_eq!(shown[3..12], [3, 4, 4, 6, 7, 8, 9, 9, 11]);
    assert!(held.frames.iter().zip(&clean.frames).all(|(a, b)| (a.frame, a.time_s) == (b.frame, b.time_s)));
}

#[test]
fn of_a_map_that_ends_or_is_torn_roads_are_missing_with_what_stands_along_them() {
    let mut clean = clean();
    let (road, pole) = (clean.map.roads[0].clone(), clean.map.poles[0]);
    let along = |number: u32| Vector3::new(0.0, 0.0, 30.0 * f64::from(number));
    clean.map.roads = (0..10)
        .map(|i| Road { path_map: vec![Point3::origin() + along(i), road.path_map[0] + along(i + 1)] })
        .collect();
    clean.map.poles =
        (0..10).map(|i| Pole { foot_map: Point3::origin() + along(i), road: RoadId(i), ..pole }).collect();
    let left = |fault: Fault| {
        let map = fault.applied(&clean, 1).trial.map;
        let starts_m = map.roads.iter().map(|road| road.path_map[0].z.round() as u32 / 30);
        assert!(map.poles.iter().enumerate().all(|(i, pole)| pole.road.0 as usize == i), "{:?}", map.poles);
        let poles_m = map.poles.iter().map(|pole| pole.foot_map.z.round() as u32 / 30);
        assert!(starts_m.clone().eq(poles_m));
        starts_m.collect::<Vec<_>>()
    };
    assert_eq!(left(Fault::MapEnds), [0, 1, 2, 3]);
    assert_eq!(left(Fault::MapTorn), [0, 1, 2, 6, 7, 8, 9]);
}

#[test]
fn times_are_early_and_late_in_turns() {
    let clean = clean();
    for (fault, most_s) in [(Fault::Clock, 0.05), (Fault::Clock25, 0.025)] {
        let jittered = fault.applied(&clean, 1).trial;
        for (index, (now, before)) in jittered.frames.iter().zip(&clean.frames).enumerate() {
            let off_s = if index % 2 == 0 { -most_s } else { most_s };
            assert!((now.time_s - before.time_s - off_s).abs() < 1e-12);
        }
    }
}

#[test]
fn the_kidnapped_are_told_a_place_beside() {
    let clean = clean();
    let start = Fault::KidnappedStart.applied(&clean, 1);
    assert_eq!((start.trial.fixes.keys().copied().collect::<Vec<_>>(), start.ends), (vec![0], vec![0]));
    let later = Fault::Kidnapped.applied(&clean, 1);
    assert_eq!(later.ends, [35, 135, 235]);
    assert_eq!(later.trial.fixes.keys().copied().collect::<Vec<_>>(), [0, 1, 35, 135, 235]);
    for (frame, fix) in start.trial.fixes.iter().chain(later.trial.fixes.iter().filter(|(frame, _)| **frame > 1)) {
        assert!((off_m(fix, *frame, &clean) - 3.5).abs() < 1e-9);
        let (yaw_rad, sigma_rad) = fix.heading.unwrap();
        assert!((yaw_rad.abs() - 17.0_f64.to_radians()).abs() < 1e-9);
        assert!((2.0 * sigma_rad - yaw_rad.abs()).abs() < 1e-9 && (fix.horizontal_sigma_m - 1.75).abs() < 1e-9);
    }
}

#[test]
fn wheels_lock_and_gyroscopes_are_off_for_ten_frames_of_a_hundred() {
    let clean = clean();
    let shown = |fault: Fault, frame: usize| {
        let trial = fault.applied(&clean, 1).trial;
        let [before_s, at_s] = [frame - 1, frame].map(|frame| trial.frames[frame].time_s);
        trial.odometry.between(before_s, at_s).unwrap()
    };
    let speed_m_s = |frame| shown(Fault::WheelsLocked, frame).speed_m_s.unwrap();
    assert_eq!([29, 30, 39, 40, 130, 140].map(|frame| speed_m_s(frame) > 5.0), [true, false, false, true, false, true]);
    assert!((shown(Fault::WheelsSpinning, 35).speed_m_s.unwrap() - 20.0).abs() < 1e-6);
    assert!((shown(Fault::GyroscopeOff, 35).yaw_rate_rad_s - 1.5).abs() < 1e-6);
}
