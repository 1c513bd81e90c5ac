//! What begins with a wrong heading, and what nobody saw for long.

use std::f64::consts::PI;

use super::*;

/// What is said of each frame, by fixes of some frames and the times of all.
fn said(fix_of: &dyn Fn(usize, &World) -> Option<GpsFix>, late_s: &dyn Fn(usize) -> f64) -> (World, Vec<PoseEstimate>) {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = Tracker::new(&mut map, &world.camera, IMAGE, &Config::default());
    let mut said = Vec::new();
    for frame in 0..world.truth.len() {
        let (features, fix) = (world.features(frame), fix_of(frame, &world));
        let time_s = time_s(frame) + late_s(frame);
        let input = FrameInput { time_s, features: &features, gps: fix.as_ref(), odometry: None };
        said.extend(tracker.step(&input).unwrap().cloned());
    }
    (world, said)
}

#[test]
fn fixes_that_move_on_overrule_a_receiver_that_looks_backwards() {
    let turned = |frame: usize, world: &World| {
        let mut fix = GpsFix::from_pose(&world.truth[frame], &GpsConfig::default());
        fix.heading = fix.heading.map(|(yaw_rad, sigma_rad)| (yaw_rad + PI, sigma_rad));
        Some(fix).filter(|_| frame.is_multiple_of(8))
    };
    let (world, said) = said(&turned, &|_| 0.0);
    let (last, truth) = (said.last().unwrap(), world.truth.last().unwrap());
    let off_m = local(truth, &last.map_from_camera).fixed_rows::<3>(0).norm();
    assert!(off_m < 0.5 && last.status == Status::Ok, "{off_m} m, {:?}", last.status);
}

#[test]
fn after_half_a_minute_without_an_image_nothing_is_known_until_it_is_ok_again() {
    let first = |frame: usize, world: &World| {
        Some(GpsFix::from_pose(&world.truth[frame], &GpsConfig::default())).filter(|_| frame < 2)
    };
    let from = 80;
    let (_, said) = said(&first, &|frame| if frame < from { 0.0 } else { 31.0 });
    let right_m = |estimate: &PoseEstimate| estimate.covariance[(0, 0)].sqrt();
    assert!(said[..from].iter().any(|estimate| estimate.status == Status::Ok));
    assert!(said[1..from].iter().all(|estimate| right_m(estimate) < 5.0));
    let until_ok: Vec<&PoseEstimate> =
        said[from..].iter().take_while(|estimate| estimate.status != Status::Ok).collect();
    assert!(!until_ok.is_empty());
    for estimate in until_ok {
        assert!(estimate.status == Status::Lost && right_m(estimate) > 300.0 && estimate.covariance[(4, 4)] > 1.0);
    }
}
