use super::*;

#[test]
fn wheels_that_lock_or_spin_and_numbers_that_no_vehicle_drives_are_not_believed() {
    let world = World::new(street());
    let nonsense = |frame: usize, Odometry { speed_m_s, yaw_rate_rad_s }: Odometry| match frame {
        30..40 => Odometry { speed_m_s: Some(0.0), yaw_rate_rad_s },
        50..60 => Odometry { speed_m_s: speed_m_s.map(|m_s| 2.0 * m_s), yaw_rate_rad_s },
        70 => Odometry { speed_m_s, yaw_rate_rad_s: 14.0 },
        74..78 => Odometry { speed_m_s, yaw_rate_rad_s: -1.5 },
        80 => Odometry { speed_m_s: Some(1e200), yaw_rate_rad_s: -1e200 },
        _ => Odometry { speed_m_s, yaw_rate_rad_s },
    };
    let run = run(&world, &GpsConfig::default(), 1, &Mishap { has_wheels: true, wheels: &nonsense, ..NONE });
    let started = run.ok_from(0).unwrap();
    assert_eq!(run.lies(), 0);
    assert!(run.rms_m(started) < 0.15, "{}", run.rms_m(started));
    let ok = run.statuses[started..].iter().filter(|status| **status == Status::Ok).count();
    assert!(10 * ok > 9 * (run.statuses.len() - started), "{ok}");
}
