use std::collections::BTreeMap;

use common::geometry::Pose;
use nalgebra::Matrix6;

use super::*;
use crate::estimate::{PoseEstimate, Status};
use crate::gps::{GpsConfig, simulate};
use crate::run::localize;
use crate::testing::{IMAGE, Recipe, World, time_s};
use crate::vision::ProbabilityMaps;

/// A world, and settings for a vehicle whose features and wheels alone are known.
fn driven() -> (World, Config, ScaledCamera, BTreeMap<usize, GpsFix>) {
    let world = World::new(Recipe { length_m: 150.0, ..Recipe::default() });
    let camera = ScaledCamera::new(&world.camera, (IMAGE.width_px as usize, IMAGE.height_px as usize), 9999);
    let fixes = (0..2).zip(simulate(&world.truth[..2], &GpsConfig::default(), 1)).collect();
    (world, Config::default(), camera, fixes)
}

fn seen(world: &World, frame: usize) -> Seen {
    let features = world.features(frame);
    Seen { features, maps: ProbabilityMaps::zeros(1, 1), grey: None, maps_ms: 0.0, features_ms: 0.0 }
}

const WHEELS: Sensors = Sensors { images: false, wheels: true };

#[test]
fn a_drive_that_comes_image_by_image_is_localized_as_the_whole_and_forgotten() {
    let (world, config, camera, fixes) = driven();
    let mut log = OdometryLog::default();
    let mut frames = Vec::new();
    let mut map = LocalMap::whole(world.map.clone());
    let mut live = LiveLocalizer::new(&mut map, &camera, WHEELS, &config);
    let mut said = Vec::new();
    for frame in 0..world.truth.len() {
        let Odometry { speed_m_s, yaw_rate_rad_s, .. } = world.odometry(frame);
        // The wheels are told five times an image; the first line says nothing but when it ends.
        for i in 1..=5 {
            let ended_s = time_s(frame) - 0.02 * f64::from(5 - i);
            let began_s = log.span_s().map_or(ended_s - 0.02, |[_, ended_s]| ended_s);
            log.push(began_s, ended_s, Odometry::of_wheels(speed_m_s.unwrap(), yaw_rate_rad_s));
            assert!(live.received.odometry(ended_s, speed_m_s.unwrap(), yaw_rate_rad_s));
        }
        if let Some(fix) = fixes.get(&frame) {
            live.received.gps(time_s(frame), *fix);
        }
        said.extend(live.image(frame, time_s(frame), seen(&world, frame)).unwrap());
        assert!(live.log.log().len() <= 1, "{frame}");
        let features = world.features(frame);
        frames.push(FrameFeatures { frame, time_s: time_s(frame), features, maps_ms: 0.0, features_ms: 0.0 });
    }
    let mut map = LocalMap::whole(world.map.clone());
    let localizer = Localizer::new(Method::Robust, &mut map, &world.camera, IMAGE, &config);
    let whole = localize(&frames, &fixes, &log, localizer).unwrap();
    assert_eq!(said.len(), world.truth.len());
    assert!(said.iter().filter(|result| result.estimate.status == Status::Ok).count() > 50);
    for (live, whole) in said.iter().zip(&whole) {
        let off = live.estimate.map_from_camera.inverse() * whole.estimate.map_from_camera;
        // Times of lines are rounded.
        assert!(off.translation.vector.norm() < 1e-6 && off.rotation.angle() < 1e-6, "{}", live.frame);
        assert_eq!(live.estimate.status, whole.estimate.status, "{}", live.frame);
    }
}

#[test]
fn a_fix_is_moved_on_to_the_image_and_left_out_where_it_is_old_or_later() {
    let (world, config, camera, _) = driven();
    let mut map = LocalMap::whole(world.map.clone());
    let mut live = LiveLocalizer::new(&mut map, &camera, WHEELS, &config);
    let fix = GpsFix::from_pose(&Pose::translation(1.0, 0.0, 50.0), &config.gps);
    let z_m = |fix: Option<GpsFix>| fix.map(|fix| fix.position_map.z);
    // Nothing is known of the motion yet.
    live.received.gps(4.9, fix);
    assert_eq!(z_m(live.fix_for(5.0)), Some(50.0));
    let result = |time_s: f64, z_m: f64, status: Status| FrameResult {
        frame: 0,
        time_s,
        estimate: PoseEstimate {
            map_from_camera: Pose::translation(0.0, 0.0, z_m),
            covariance: Matrix6::identity(),
            correspondences: Vec::new(),
            residual_rms_px: 0.0,
            iterations: 0,
            converged: true,
            status,
            support: 0.0,
            margin: 0.0,
            time_sigma_s: 0.0,
        },
        features: [0; 3],
        maps_ms: 0.0,
        features_ms: 0.0,
        localize_ms: 0.0,
    };
    for (time_s, z_m) in [(5.0, 40.0), (5.1, 41.0)] {
        live.passage.pass(Some(&result(time_s, z_m, Status::Ok)));
    }
    live.received.gps(5.15, fix);
    assert!(live.fix_for(5.1).is_none());
    assert!((z_m(live.fix_for(5.2)).unwrap() - 50.5).abs() < 1e-9);
    // Each is taken in once.
    assert!(live.fix_for(5.3).is_none());
    live.received.gps(5.3 - config.gps.oldest_s - 0.01, fix);
    assert!(live.fix_for(5.3).is_none());
    // Who is lost does not know how it moved.
    live.passage.pass(Some(&result(5.2, 99.0, Status::Lost)));
    live.received.gps(5.25, fix);
    assert_eq!(z_m(live.fix_for(5.3)), Some(50.0));
    // An image that takes 60 ms to come, amid fixes of 100 Hz.
    for i in 0..40 {
        live.received
            .gps(5.4 + 0.01 * f64::from(i), GpsFix::from_pose(&Pose::translation(0.0, 0.0, f64::from(i)), &config.gps));
    }
    assert_eq!([5.45, 5.65, 5.73].map(|time_s| z_m(live.fix_for(time_s))), [Some(5.0), Some(25.0), Some(33.0)]);
}
