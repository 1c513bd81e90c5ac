//! A camera that drives over a made-up plane.

use super::*;
use crate::tracker::ClockConfig;

const HEIGHT_M: f64 = 1.65;

fn camera() -> PinholeCamera {
    PinholeCamera {
        fx_px: 350.0,
        fy_px: 350.0,
        cx_px: 310.0,
        cy_px: 90.0,
        from_reference_m: nalgebra::Vector3::zeros(),
    }
}

fn odometer(config: &VisualOdometryConfig) -> VisualOdometer {
    VisualOdometer::new(&camera(), HEIGHT_M, config, ClockConfig::default().soonest)
}

/// Grey of a place: noise of several grain sizes.
fn grey(x: f64, y: f64) -> f64 {
    let grain = |size: f64| {
        let corner = |i: f64, j: f64| ((i * 12.9898 + j * 78.233 + size).sin() * 43758.5453).rem_euclid(1.0) - 0.5;
        let (i, j) = ((x / size).floor(), (y / size).floor());
        let (a, b) = (x / size - i, y / size - j);
        let along = |j: f64| corner(i, j) * (1.0 - a) + corner(i + 1.0, j) * a;
        along(j) * (1.0 - b) + along(j + 1.0) * b
    };
    128.0 + 60.0 * [0.15, 0.4, 1.1, 3.0].map(grain).iter().sum::<f64>()
}

#[test]
fn what_may_be_farther_than_the_road_in_both_images_is_not_told() {
    let road = RoadConfig::default();
    let far_m = |most_m: f64| road.for_shifts_of(most_m).map(|road| road.ahead_m[1]);
    // At 10 Hz; at 5 Hz; at 2 Hz and 20 m/s.
    assert_eq!([4.5, 9.0, 13.0].map(far_m), [Some(15.0), Some(23.0), None]);
    assert!((road.for_shifts_of(9.0).unwrap().longest_shift_m() - 9.0).abs() < 1e-9);
}

#[test]
fn as_much_more_of_the_road_is_looked_at_as_is_below_the_image() {
    let road = RoadConfig::default();
    let far_m = |nearest_m: f64| road.seen_from(nearest_m).ahead_m[1];
    // Nearer than the road ahead, hardly farther, farther, and too far.
    for (nearest_m, seen_m) in [(3.0, 15.0), (6.0, 15.0), (9.0, 19.0), (12.0, 15.0), (f64::INFINITY, 15.0)] {
        assert!((far_m(nearest_m) - seen_m).abs() < 1e-9, "{nearest_m}");
    }
    assert!((road.for_shifts_of(10.0).unwrap().seen_from(10.0).ahead_m[1] - road.farthest_m).abs() < 1e-9);
}

/// What the camera sees `ahead_m` along a road, turned by `yaw_rad` to the right
/// and pitched down by `pitch_rad`, between walls 8 m to each side.
fn image(ahead_m: f64, yaw_rad: f64, pitch_rad: f64) -> Plane {
    image_on(0.0, ahead_m, yaw_rad, pitch_rad)
}

/// The same on a road that bends upwards by so much per metre: on a circle, so
/// that it looks the same from everywhere.
fn image_on(sag_per_m: f64, ahead_m: f64, yaw_rad: f64, pitch_rad: f64) -> Plane {
    let camera = camera();
    let level_from_camera = Rotation3::from_axis_angle(&nalgebra::Vector3::y_axis(), yaw_rad)
        * Rotation3::from_axis_angle(&nalgebra::Vector3::x_axis(), -pitch_rad);
    let mut plane = Plane::zeros(620, 188);
    for (i, pixel) in plane.data_mut().iter_mut().enumerate() {
        let (u, v) = ((i % 620) as f64, (i / 620) as f64);
        let ray = level_from_camera
            * nalgebra::Vector3::new((u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, 1.0);
        // Where height - y - z^2 sag / 2 = 0 on the ray.
        let fall = (ray.y * ray.y + 2.0 * sag_per_m * ray.z * ray.z * HEIGHT_M).max(0.0).sqrt();
        let (wall, road) = (8.0 / ray.x.abs().max(1e-9), 2.0 * HEIGHT_M / (ray.y + fall).max(1e-9));
        let place = ray * wall.min(road).min(80.0);
        let over_road_m = HEIGHT_M - place.y - 0.5 * sag_per_m * place.z * place.z;
        // What is far is as blurred as its pixels are large.
        let blur = (-place.norm() / 25.0).exp();
        let seen = if road < wall { grey(place.x, place.z + ahead_m) } else { grey(over_road_m, place.z + ahead_m) };
        *pixel = (128.0 + blur * (seen - 128.0)).round() as u8;
    }
    plane
}

fn drive(speed_m_s: f64, yaw_rate_rad_s: f64, pitch_rad: f64) -> Vec<Option<Odometry>> {
    let mut odometer = odometer(&VisualOdometryConfig::default());
    let frame = |i: i32| {
        let t = f64::from(i) * 0.1;
        odometer.step(&image(speed_m_s * t, yaw_rate_rad_s * t, pitch_rad), t)
    };
    (0..6).map(frame).collect()
}

#[test]
fn speed_and_turn_are_read_from_the_images() {
    for (speed_m_s, yaw_rate_rad_s, pitch_rad) in [
        (8.0, 0.0, 0.0),
        (12.0, 0.0, 0.02),
        (25.0, 0.0, 0.0),
        (10.0, -0.05, 0.01),
        (12.0, 0.0, 0.07),
        (12.0, 0.0, -0.07),
    ] {
        let steps = drive(speed_m_s, yaw_rate_rad_s, pitch_rad);
        assert!(steps[0].is_none());
        let last = steps.last().copied().flatten().unwrap();
        let speed_off = last.speed_m_s.unwrap() / speed_m_s - 1.0;
        assert!(speed_off.abs() < 0.04, "{speed_m_s} m/s: {steps:?}");
        // To the right is negative.
        assert!((last.yaw_rate_rad_s + yaw_rate_rad_s).abs() < 0.01, "{yaw_rate_rad_s} rad/s: {steps:?}");
    }
}

#[test]
fn a_road_that_goes_on_to_tell_another_speed_is_believed() {
    let speed_m_s = |believed_after: usize| {
        let mut config = VisualOdometryConfig::default();
        // It takes the camera for level at first, and so the speed for another one.
        (config.rotation.mounting_sigma_rad, config.road.usual_m_s) = (1e-4, 0.0);
        config.road.believed_after = believed_after;
        let mut odometer = odometer(&config);
        let step = |i: i32| odometer.step(&image(1.2 * f64::from(i), 0.0, -0.07), 0.1 * f64::from(i));
        (0..20).map(step).last().flatten().unwrap().speed_m_s.unwrap()
    };
    let (soon_m_s, never_m_s) = (speed_m_s(5), speed_m_s(1000));
    assert!((soon_m_s - 12.0).abs() < 0.6 && (never_m_s - 12.0).abs() > 2.0, "{soon_m_s} m/s, {never_m_s} m/s");
}

#[test]
fn who_goes_back_has_a_negative_speed_from_the_first_image_and_after_a_stop() {
    for yaw_rate_rad_s in [0.0, -0.1] {
        let last = drive(-2.5, yaw_rate_rad_s, 0.0).last().copied().flatten().unwrap();
        assert!((last.speed_m_s.unwrap() + 2.5).abs() < 0.1, "{last:?}");
        assert!((last.yaw_rate_rad_s + yaw_rate_rad_s).abs() < 0.01, "{last:?}");
    }
    // From 2 m/s forward to 2.5 m/s back in 1.5 s.
    let mut odometer = odometer(&VisualOdometryConfig::default());
    let way_m = |t: f64| 2.0 * t - 1.5 * t * t;
    for i in 0..16 {
        let t = 0.1 * f64::from(i);
        let step = odometer.step(&image(way_m(t), 0.05 * t, 0.0), t);
        if i > 1 {
            let (speed_m_s, truth_m_s) = (step.unwrap().speed_m_s.unwrap(), (way_m(t) - way_m(t - 0.1)) / 0.1);
            // Half a pixel of the view at worst, where the shift is less than one.
            assert!((speed_m_s - truth_m_s).abs() < 0.2, "at {t} s: {speed_m_s}, not {truth_m_s}");
        }
    }
}

#[test]
fn masks_tell_the_turn_and_no_speed() {
    let mut odometer = VisualOdometer::of_labels(
        &camera(),
        HEIGHT_M,
        &VisualOdometryConfig::default(),
        ClockConfig::default().soonest,
    );
    let step = |i: i32| {
        let t = f64::from(i) * 0.1;
        let mut masks = image(10.0 * t, 0.06 * (t - 0.3), 0.0);
        masks.data_mut().iter_mut().for_each(|value| *value = if *value > 160 { 255 } else { 0 });
        odometer.step(&masks, t)
    };
    let steps: Vec<Option<Odometry>> = (0..7).map(step).collect();
    assert!(steps[0].is_none());
    let turns: Vec<f64> = steps[1..].iter().map(|step| step.unwrap().yaw_rate_rad_s).collect();
    assert!(steps[1..].iter().all(|step| step.unwrap().speed_m_s.is_none()));
    // Their edges flicker.
    let mean = turns.iter().sum::<f64>() / turns.len() as f64;
    assert!((mean + 0.06).abs() < 0.015 && turns.iter().all(|turn| (turn + 0.06).abs() < 0.04), "{turns:?}");
}

#[test]
fn crests_and_sags_are_no_speed() {
    for sag_per_m in [-0.003, 0.003] {
        let speed_off = |sag_sigma_per_m: f64| {
            let mut config = VisualOdometryConfig::default();
            config.road.sag_sigma_per_m = sag_sigma_per_m;
            let mut odometer = odometer(&config);
            let step = |i: i32| {
                let t = f64::from(i) * 0.1;
                odometer.step(&image_on(sag_per_m, 13.0 * t, 0.0, 0.0), t)
            };
            (0..15).map(step).last().flatten().unwrap().speed_m_s.unwrap() / 13.0 - 1.0
        };
        let (taken_for_flat, known) = (speed_off(1e-6), speed_off(0.0015));
        assert!(taken_for_flat.abs() > 0.06, "{sag_per_m}: {taken_for_flat}");
        assert!(known.abs() < 0.04 && known.abs() < 0.5 * taken_for_flat.abs(), "{sag_per_m}: {known}");
    }
}

/// Steps of a vehicle of 10 m/s by the times of its images and by where it was then,
/// in tenths of a second.
fn steps_of(images: &[(f64, f64)]) -> Vec<Option<Odometry>> {
    let mut odometer = odometer(&VisualOdometryConfig::default());
    images.iter().map(|(time, way)| odometer.step(&image(*way, 0.0, 0.0), 0.1 * time)).collect()
}

fn speeds_m_s(steps: &[Option<Odometry>]) -> Vec<f64> {
    steps.iter().filter_map(|step| (*step)?.speed_m_s).collect()
}

#[test]
fn an_image_that_comes_again_tells_nothing_and_the_next_one_all_since() {
    let steps = steps_of(&[(0.0, 0.0), (1.0, 1.0), (2.0, 1.0), (3.0, 3.0), (4.0, 4.0)]);
    assert_eq!(steps[2], None);
    let speeds = speeds_m_s(&steps);
    assert!(speeds.len() == 2 && speeds.iter().all(|speed| (speed / 10.0 - 1.0).abs() < 0.04), "{steps:?}");
}

#[test]
fn times_that_are_early_and_late_in_turn_give_no_speed() {
    for off in [0.25, 0.5] {
        let early_and_late = |i: i32| (f64::from(i) + if i % 2 == 0 { -off } else { off }, f64::from(i));
        let images: Vec<(f64, f64)> = (0..8).map(early_and_late).collect();
        let speeds = speeds_m_s(&steps_of(&images));
        assert!(speeds.is_empty(), "{off}: {speeds:?}");
    }
}

#[test]
fn a_vehicle_that_stands_has_no_speed() {
    let mut odometer = odometer(&VisualOdometryConfig::default());
    let mut step = |i: usize| {
        let mut still = image(0.0, 0.0, 0.0);
        // No two images of a camera are the same.
        still.data_mut().iter_mut().skip(i).step_by(7).for_each(|value| *value ^= 1);
        odometer.step(&still, 0.1 * i as f64)
    };
    assert!(step(0).is_none() && step(1).unwrap().speed_m_s.is_none());
    for step in (2..6).map(step) {
        let step = step.unwrap();
        assert!(step.speed_m_s.unwrap().abs() < 0.05 && step.yaw_rate_rad_s.abs() < 1e-3, "{step:?}");
    }
}

#[test]
fn what_shows_nothing_tells_nothing() {
    let mut odometer = odometer(&VisualOdometryConfig::default());
    let black = Plane::zeros(620, 188);
    assert!((0..3).all(|i| odometer.step(&black, f64::from(i)).is_none()));
    // Images of another size, of no size, and at one time.
    for (plane, time_s) in [(Plane::zeros(40, 30), 4.0), (Plane::zeros(1, 1), 5.0), (image(0.0, 0.0, 0.0), 6.0)] {
        assert_eq!(odometer.step(&plane, time_s), None);
    }
    assert_eq!(odometer.step(&image(1.0, 0.0, 0.0), 6.0), None);
}

#[test]
fn who_nods_goes_as_fast_as_before() {
    let mut odometer = odometer(&VisualOdometryConfig::default());
    let mut step = |i: i32| {
        let t = 0.1 * f64::from(i);
        // A sag, and a pitch of half a degree to and fro twice a second.
        odometer.step(&image_on(0.001, 8.0 * t, 0.0, 0.008 * (12.0 * t).sin()), t)
    };
    let steps: Vec<Option<Odometry>> = (0..25).map(&mut step).collect();
    let speeds = speeds_m_s(&steps[5..]);
    let changes = speeds.windows(2).map(|two| (two[1] - two[0]).abs());
    assert!(speeds.len() == 20 && changes.fold(0.0, f64::max) < 0.12, "{speeds:?}");
}

#[test]
fn who_turns_off_at_once_is_followed() {
    for yaw_rad in [-0.18, 0.18] {
        let mut odometer = odometer(&VisualOdometryConfig::default());
        // Into a bend behind images that are missing.
        let mut step = |i: i32| {
            let yaw_rad = if i < 5 { 0.0 } else { yaw_rad };
            odometer.step(&image(0.8 * f64::from(i), yaw_rad, 0.0), 0.1 * f64::from(i))
        };
        let steps: Vec<Option<Odometry>> = (0..6).map(&mut step).collect();
        let turn_rad_s = steps[5].expect("a turn").yaw_rate_rad_s;
        assert!((turn_rad_s + 10.0 * yaw_rad).abs() < 0.05, "{steps:?}");
    }
}

#[test]
fn of_images_that_come_seldom_the_speed_is_told_once_it_goes_on_to_be_shown() {
    // Two and a half a second, of which the road shows 25 m/s at most.
    let told_of = |step_m: f64| {
        let image = |i: i32| (4.0 * f64::from(i), step_m * f64::from(i));
        speeds_m_s(&steps_of(&(0..14).map(image).collect::<Vec<_>>()))
    };
    let speeds = told_of(3.2);
    assert!(speeds.len() >= 5 && speeds.len() <= 9, "{speeds:?}");
    assert!(speeds.iter().all(|speed_m_s| (speed_m_s - 8.0).abs() < 0.3), "{speeds:?}");
    // Faster than that nothing is shown.
    let speeds = told_of(13.0);
    assert!(speeds.is_empty(), "{speeds:?}");
}

#[test]
fn who_turns_by_much_from_one_image_to_the_next_is_followed() {
    let mut odometer = odometer(&VisualOdometryConfig::default());
    // At 2 m/s, two images a second: it turns before the last.
    let mut step = |i: i32| {
        let yaw_rad = if i < 9 { 0.0 } else { 0.29 };
        odometer.step(&image(f64::from(i), yaw_rad, 0.0), 0.5 * f64::from(i))
    };
    let last = (0..10).map(&mut step).last().flatten().unwrap();
    assert!((last.yaw_rate_rad_s + 0.58).abs() < 0.02, "{last:?}");
}
