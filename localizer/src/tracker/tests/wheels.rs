use super::*;

#[test]
fn wheels_that_lock_or_spin_and_numbers_that_no_vehicle_drives_are_not_believed() {
    let world = World::new(street());
    let nonsense = |frame: usize, shown: Odometry| match frame {
        30..40 => Odometry { speed_m_s: Some(0.0), ..shown },
        50..60 => Odometry { speed_m_s: shown.speed_m_s.map(|m_s| 2.0 * m_s), ..shown },
        70 => Odometry { yaw_rate_rad_s: 14.0, ..shown },
        74..78 => Odometry { yaw_rate_rad_s: -1.5, ..shown },
        80 => Odometry { speed_m_s: Some(1e200), yaw_rate_rad_s: -1e200, ..shown },
        _ => shown,
    };
    let run = run(&world, &GpsConfig::default(), 1, &Mishap { has_wheels: true, wheels: &nonsense, ..NONE });
    let started = run.ok_from(0).unwrap();
    assert_eq!(run.lies(), 0);
    assert!(run.rms_m(started) < 0.15, "{}", run.rms_m(started));
    let ok = run.statuses[started..].iter().filter(|status| **status == Status::Ok).count();
    assert!(10 * ok > 9 * (run.statuses.len() - started), "{ok}");
}

#[test]
fn what_is_odd_is_followed_and_not_and_the_images_decide() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = followed_by(&world, &mut map, 30, true);
    let right = world.odometry(30);
    let faster = |m_s: f64| Odometry { speed_m_s: right.speed_m_s.map(|speed_m_s| speed_m_s + m_s), ..right };
    let turned = |rad_s: f64| Odometry { yaw_rate_rad_s: right.yaw_rate_rad_s + rad_s, ..right };
    for (shown, usual) in [
        (right, Some(right)),
        (faster(0.2), Some(faster(0.2))),
        (faster(1.1), Some(Odometry { speed_m_s: None, ..right })),
        (turned(0.3), Some(turned(0.3))),
        (turned(0.8), None),
    ] {
        let believed = tracker.believed(0.1, Some(shown));
        assert_eq!((believed.shown, believed.usual), (Some(shown), usual));
    }
    // It was not faster: the one that did not follow that is the best.
    let input =
        FrameInput { time_s: time_s(30), features: &world.features(30), gps: None, odometry: Some(faster(1.1)) };
    tracker.step(&input).unwrap();
    let speeds_m_s: Vec<f64> = tracker.bank.iter().map(|hypothesis| hypothesis.state.velocity[2]).collect();
    assert!((speeds_m_s[0] - world.odometry(30).speed_m_s.unwrap()).abs() < 0.3, "{speeds_m_s:?}");
    assert!(!tracker.bank[0].is_carried);
}

#[test]
fn no_bend_is_taken_harder_than_brakes_hold() {
    let world = World::new(street());
    let mut map = LocalMap::whole(world.map.clone());
    let mut tracker = followed_by(&world, &mut map, 30, true);
    tracker.config.odometry.hardest_rad_s2 = 100.0;
    let speed_m_s = tracker.bank[0].state.velocity[2];
    for (aside_m_s2, is_believed) in [(9.0, true), (15.0, false)] {
        let shown = Odometry { yaw_rate_rad_s: aside_m_s2 / speed_m_s, ..world.odometry(30) };
        assert_eq!(tracker.believed(0.1, Some(shown)).shown.is_some(), is_believed, "{aside_m_s2} m/s^2");
    }
}
