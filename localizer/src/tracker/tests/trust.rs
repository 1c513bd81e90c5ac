//! What is not called ok.

use super::*;

#[test]
fn an_old_image_that_comes_again_is_not_called_ok_as_a_new_one_is() {
    // At this speed it is off by 0.6 m, and by no more than other tests let pass.
    let world = World::new(Recipe { speed_m_s: 6.0, ..street() });
    let is_old = |frame: usize| frame >= 30 && frame.is_multiple_of(5);
    let mishap = Mishap { shows: &|frame| frame - usize::from(is_old(frame)), ..NONE };
    let called_ok = |config: &Config, old: bool| {
        let run = run_with(config, &world, &GpsConfig::default(), 1, &mishap);
        (30..run.statuses.len()).filter(|&frame| is_old(frame) == old && run.statuses[frame] == Status::Ok).count()
    };
    let (config, mut blind) = (Config::default(), Config::default());
    blind.health.max_contradiction_sigmas = f64::INFINITY;
    let (old, old_to_the_blind) = (called_ok(&config, true), called_ok(&blind, true));
    assert!(2 * old <= old_to_the_blind, "{old} {old_to_the_blind}");
    assert!(called_ok(&config, false) > 50, "{}", called_ok(&config, false));
}

#[test]
fn what_is_found_after_a_long_dark_is_not_trusted_for_what_was_before() {
    let world = World::new(street());
    let dark = 50..75;
    let mishap = Mishap { is_black: &|frame| dark.contains(&frame), ..NONE };
    let run = run(&world, &GpsConfig::default(), 1, &mishap);
    let back = run.ok_from(dark.end).unwrap();
    let led_frames = Config::default().health.led_frames;
    assert!((dark.end + led_frames - 1..dark.end + 20).contains(&back), "{back}");
    assert_eq!(run.lies(), 0);
}
