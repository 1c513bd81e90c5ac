use super::*;

/// Two of three images show another place, as a network that is wrong in one image is in the
/// next: only the third is looked at, and the others are answered with where it went.
#[test]
fn of_a_fast_camera_two_of_three_images_are_answered_by_the_motion() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let fixes = simulate(&world.truth[..2], &GpsConfig::default(), 1);
    let mut tracker = Tracker::new(&mut map, &world.camera, IMAGE, &Config::default());
    let (mut ok, mut between) = (0, 0);
    for frame in 0..world.truth.len() {
        // The camera is faster from frame 20 on; what is gone through then are the frames.
        let first = [2, 1, 0][usize::from(frame >= 20) + usize::from(frame > 20)];
        for third in first..3 {
            let is_between = third < 2;
            let shown = if is_between && frame > 22 { frame / 2 } else { frame };
            let features = world.features(shown);
            let time_s = time_s(frame) - 0.033 * f64::from(2 - third);
            let input = FrameInput {
                time_s,
                features: &features,
                gps: fixes.get(frame),
                odometry: Some(world.odometry(frame)),
            };
            let estimate = tracker.step(&input).unwrap().unwrap();
            let before = world.truth[frame.max(1) - 1];
            let moved = local(&before, &world.truth[frame]) * (f64::from(third + 1) / 3.0);
            let error_m = local(&retract(&before, &moved), &estimate.map_from_camera).fixed_rows::<3>(0).norm();
            if frame > 25 {
                assert!(error_m < 0.5 || estimate.status != Status::Ok, "{frame}, {third}: {error_m} m");
                assert_eq!(estimate.correspondences.is_empty(), is_between, "{frame}, {third}");
                assert!(estimate.covariance.cholesky().is_some());
                between += usize::from(is_between);
                ok += usize::from(estimate.status == Status::Ok);
            }
        }
    }
    assert!(between > 100 && ok > between, "{between} {ok}");
}

#[test]
fn a_fix_of_an_image_that_is_passed_by_counts_for_the_next() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = Tracker::new(&mut map, &world.camera, IMAGE, &Config::default());
    let features = world.features(0);
    let input = |time_s, gps| FrameInput { time_s, features: &features, gps, odometry: None };
    let fix = GpsFix::from_pose(&world.truth[0], &GpsConfig::default());
    tracker.step(&input(0.0, Some(&fix))).unwrap();
    tracker.pass_by(0.03, &input(0.03, Some(&fix)));
    let velocity_m_s = tracker.bank[0].state.velocity.fixed_rows::<3>(0).norm();
    let later = tracker.fix_for(&input(0.1, None)).unwrap();
    let off_m = (later.position_map - fix.position_map).norm();
    assert!((off_m - 0.07 * velocity_m_s).abs() < 1e-9, "{off_m} m at {velocity_m_s} m/s");
    assert!(tracker.fix_for(&input(0.1, None)).is_none());
}
