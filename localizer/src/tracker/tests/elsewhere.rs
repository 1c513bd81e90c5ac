//! What jumped along its road while the lines went on to fit.

use super::*;

/// Images that were lost while their stamps counted on: what is shown lies so much further on.
const SKIPPED: usize = 11;
/// The first frame after that.
const FROM: usize = 70;

/// A straight street, and what is said of each frame in it, with how far off that is; fixes
/// of what is shown come every tenth frame, moved to the right by what `aside_m` says.
fn jumped(aside_m: Option<&dyn Fn(usize) -> f64>) -> Vec<(Status, f64)> {
    let world = World::new(Recipe { curvature: 0.0, missed: 0.1, length_m: 250.0, ..Recipe::default() });
    let mut map = LocalMap::whole(world.map.clone());
    let config = Config::default();
    let mut tracker = Tracker::new(&mut map, &world.camera, IMAGE, &config);
    let mut said = Vec::new();
    for frame in 0..world.truth.len() - SKIPPED {
        let shown = if frame < FROM { frame } else { frame + SKIPPED };
        let features = world.features(shown);
        let aside_m = if frame == 0 { Some(0.0) } else { aside_m.map(|aside_m| aside_m(frame)) };
        let fix = aside_m
            .filter(|_| frame.is_multiple_of(10))
            .map(|aside_m| GpsFix::from_pose(&retract(&world.truth[shown], &(Tangent::x() * aside_m)), &config.gps));
        let odometry = Some(world.odometry(shown));
        let input = FrameInput { time_s: time_s(frame), features: &features, gps: fix.as_ref(), odometry };
        let estimate = tracker.step(&input).unwrap().unwrap();
        let off = local(&world.truth[shown], &estimate.map_from_camera);
        said.push((estimate.status, off.fixed_rows::<3>(0).norm()));
    }
    said
}

fn lies(said: &[(Status, f64)]) -> usize {
    said.iter().filter(|(status, off_m)| *status == Status::Ok && *off_m > 0.5).count()
}

#[test]
fn lines_alone_hold_no_pose_among_posts_that_the_map_does_not_know() {
    let said = jumped(None);
    assert!(said[FROM - 10..FROM].iter().all(|(status, _)| *status == Status::Ok));
    assert!(lies(&said) <= HealthConfig::default().strange_images + 1, "{}: {said:?}", lies(&said));
}

#[test]
fn fixes_that_agree_with_each_other_find_who_is_elsewhere() {
    let said = jumped(Some(&|_| 0.0));
    assert!(lies(&said) <= 30, "{said:?}");
    let last = said.last().unwrap();
    assert!(last.0 == Status::Ok && last.1 < 0.5, "{said:?}");
}

#[test]
fn fixes_that_do_not_agree_with_each_other_take_nothing_from_what_is_seen() {
    // Reflections on one side, then on the other.
    let said = jumped(Some(&|frame| if frame.is_multiple_of(20) { 25.0 } else { -25.0 }));
    assert!(said[20..FROM].iter().all(|(status, _)| *status == Status::Ok), "{said:?}");
}
