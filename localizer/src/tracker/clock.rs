//! How well the times of images are kept, told by the images themselves.
//!
//! A time that is wrong by `d` puts a vehicle of speed `v` off by `v d` along
//! its way, there and back again: no motion of a vehicle, however its speed is
//! allowed to change. Where the images shift the prediction forward and back by
//! more than the filter expects, what is too much is put down to their times,
//! and the position along the way is believed that much less (covariance
//! matching: R. K. Mehra, *Approaches to adaptive filtering*, 1972).

use std::collections::VecDeque;

use common::geometry::local;
use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use crate::associate::robust::Refined;
use crate::filter::State;
use crate::pace::Pace;

/// Settings of what is made of the times.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClockConfig {
    /// Frames that it is learnt from, the last ones: a vehicle that brakes hard
    /// for one second is no clock.
    pub frames: usize,
    /// Largest standard deviation that a time between two images is taken to
    /// have, seconds: an image of 10 Hz. 0 takes all times as exact.
    pub max_sigma_s: f64,
    /// `localizer run` tells of times that are off by this in half of the
    /// frames, seconds: at 10 m/s 5 cm.
    pub told_sigma_s: f64,
    /// An image that comes sooner than this share of the usual time after the
    /// one before is too soon: it was taken at another time than it says.
    pub soonest: f64,
    /// Images of a camera that takes them more often than this are gone through so far apart,
    /// seconds, and those between are answered with where the motion leads: what a network gets
    /// wrong in one of them it gets wrong in the next, and a count of images is one of tenths
    /// of a second. 10 Hz and less are as they come.
    pub nearest_s: f64,
}

impl Default for ClockConfig {
    fn default() -> Self {
        Self { frames: 20, max_sigma_s: 0.1, told_sigma_s: 0.005, soonest: 0.6, nearest_s: 0.075 }
    }
}

/// What a frame says of the time since the one before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// By how much the image moved the prediction forward, metres.
    moved_m: f64,
    /// Variance of the forward position before, m^2.
    before_m2: f64,
    /// The same after.
    after_m2: f64,
    /// How fast it went, m/s.
    speed_m_s: f64,
}

impl Interval {
    /// What it says where `predicted` came to be `refined`.
    pub fn new(predicted: &State, refined: &Refined) -> Self {
        let forward = |covariance: &Matrix6<f64>| covariance[(2, 2)];
        let moved = local(&predicted.map_from_camera, &refined.map_from_camera);
        Self {
            moved_m: moved[2],
            before_m2: forward(&predicted.pose_covariance()),
            after_m2: forward(&refined.covariance),
            speed_m_s: predicted.velocity[2],
        }
    }

    /// Share of the innovation by which the image moved the prediction; none where the
    /// variances are none.
    fn gain(&self) -> Option<f64> {
        let gain = 1.0 - self.after_m2 / self.before_m2;
        (0.0..=1.0).contains(&gain).then_some(gain)
    }

    /// By how many standard deviations the image contradicts the prediction along the
    /// way, were its time exact: with the gain `K` of the forward position, of which the
    /// variance was `P`, an innovation `n` moves it by `K n`, and `n^2` is expected to be
    /// `P / K`, `v^2 s^2` of it for a variance `s^2` of the time.
    pub fn contradiction_sigmas(&self, variance_s2: f64) -> f64 {
        let Some(gain) = self.gain().filter(|gain| *gain > 0.0) else { return 0.0 };
        let exact_m2 = self.before_m2 / gain - self.speed_m_s * self.speed_m_s * variance_s2;
        if exact_m2 > 0.0 { (self.moved_m / gain).abs() / exact_m2.sqrt() } else { f64::INFINITY }
    }
}

/// What is known of the times of images.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Clock {
    /// Of the last frames: the variance of its time that each asks for, s^2, and
    /// its weight.
    asked: VecDeque<(f64, f64)>,
    /// Buffer of the same, by the variance.
    sorted: Vec<(f64, f64)>,
    /// Variance of the time between two images by these, s^2.
    learnt_s2: f64,
    /// Variance that the last image asks for by its time alone, s^2.
    hurried_s2: f64,
    /// How often images come.
    pace: Pace,
}

impl Clock {
    /// Variance of the time between two images, s^2.
    pub fn variance_s2(&self) -> f64 {
        self.learnt_s2.max(self.hurried_s2)
    }

    /// Variance of the time of an image, s^2: half of that between two.
    pub fn image_variance_s2(&self) -> f64 {
        0.5 * self.variance_s2()
    }

    /// Takes in that an image is of `dt_s` after the one before. Cameras keep
    /// their pace, and may miss an image: one that comes far too soon and shows
    /// something else was taken at another time than it says, by half of what is
    /// missing at a guess.
    pub fn tick(&mut self, dt_s: f64, shows_the_same: bool, config: &ClockConfig) {
        let missing_s = if shows_the_same { 0.0 } else { self.pace.missing_s(dt_s, config.soonest) };
        self.hurried_s2 = (0.5 * missing_s).min(config.max_sigma_s).powi(2);
        self.pace.tick(dt_s);
    }

    /// Learns from a frame: of the squared innovation that is expected of the forward
    /// position `v^2 s^2` is for a variance `s^2` of the time (see
    /// [`Interval::contradiction_sigmas`]).
    /// What the frame asks that to be counts with `(K v)^2`: little where a
    /// vehicle goes slowly or the image says little. The weighted median is taken:
    /// one image in five that is an old one is no clock, either. It is the mean
    /// where all times are off by as much, and less where few are.
    pub fn learn(&mut self, interval: &Interval, config: &ClockConfig) {
        let Some(gain) = interval.gain() else { return };
        let weight = (gain * interval.speed_m_s).powi(2);
        if weight <= 0.0 {
            return;
        }
        let surplus_m2 = interval.moved_m.powi(2) - gain * interval.before_m2;
        while self.asked.len() >= config.frames.max(1) {
            self.asked.pop_front();
        }
        self.asked.push_back((surplus_m2 / weight + self.variance_s2(), weight));
        self.sorted.clear();
        self.sorted.extend(&self.asked);
        self.sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut left = 0.5 * self.sorted.iter().map(|(_, weight)| weight).sum::<f64>();
        let median_s2 = self.sorted.iter().find(|(_, weight)| {
            left -= weight;
            left <= 0.0
        });
        let most_s2 = config.max_sigma_s * config.max_sigma_s;
        self.learnt_s2 = median_s2.map_or(0.0, |(asked_s2, _)| asked_s2.max(0.0).min(most_s2));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    /// What a filter of the forward position alone learns in 300 frames of
    /// 0.1 s at 10 m/s, of which the times are off by `off_s`. The images tell
    /// the position to 5 cm, the speed wanders by 5 cm a frame.
    fn learnt_s(off_s: impl Fn(usize) -> f64, config: &ClockConfig) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(4);
        let (step_m2, seen_m2, speed_m_s) = (0.05_f64.powi(2), 0.05_f64.powi(2), 10.0);
        let mut noise = |variance: f64| variance.sqrt() * Distribution::<f64>::sample(&StandardNormal, &mut random);
        let (mut clock, mut error_m, mut after_m2, mut late_s) = (Clock::default(), 0.0, seen_m2, 0.0);
        (0..300)
            .map(|i| {
                // How far the prediction is ahead of the vehicle.
                error_m += speed_m_s * (off_s(i) - late_s) + noise(step_m2);
                late_s = off_s(i);
                let known_m2 = speed_m_s * speed_m_s * clock.variance_s2();
                let before_m2 = after_m2 + step_m2 + known_m2;
                let gain = before_m2 / (before_m2 + seen_m2);
                after_m2 = (1.0 - gain) * before_m2;
                let moved_m = gain * (noise(seen_m2) - error_m);
                error_m += moved_m;
                clock.learn(&Interval { moved_m, before_m2, after_m2, speed_m_s }, config);
                clock.variance_s2().sqrt()
            })
            .collect()
    }

    fn in_turn(off_s: f64) -> impl Fn(usize) -> f64 {
        move |i| if i.is_multiple_of(2) { -off_s } else { off_s }
    }

    #[test]
    fn times_that_are_off_are_told() {
        let config = ClockConfig::default();
        for off_s in [0.02, 0.03, 0.04] {
            // From one image to the next by twice that.
            let told_s = learnt_s(in_turn(off_s), &config)[20..].iter().sum::<f64>() / 280.0;
            assert!((told_s / (2.0 * off_s) - 1.0).abs() < 0.25, "{off_s} s: {told_s}");
        }
        assert!(learnt_s(in_turn(0.5), &config).iter().all(|s| *s <= config.max_sigma_s));
    }

    #[test]
    fn good_times_are_believed() {
        let typical_s = |mut learnt_s: Vec<f64>| {
            learnt_s.sort_by(f64::total_cmp);
            learnt_s[150]
        };
        let config = ClockConfig::default();
        assert!(typical_s(learnt_s(|_| 0.0, &config)) < 0.002);
        // Every fifth image is a little older than it is said to be.
        let fifth_s = typical_s(learnt_s(|i| if i % 5 == 0 { 0.02 } else { 0.0 }, &config));
        assert!(fifth_s < 0.005, "{fifth_s}");
        let exact = ClockConfig { max_sigma_s: 0.0, ..config };
        assert!(learnt_s(in_turn(0.05), &exact).iter().all(|s| *s <= 0.0));
    }

    #[test]
    fn a_time_that_comes_too_soon_is_doubted() {
        let config = ClockConfig::default();
        let mut clock = Clock::default();
        let mut told_s = |dt_s: f64, shows_the_same: bool| {
            clock.tick(dt_s, shows_the_same, &config);
            clock.variance_s2().sqrt()
        };
        assert!(told_s(0.0, false) <= 0.0, "nothing is known of the first");
        assert!(told_s(0.1, false) <= 0.0 && told_s(0.08, false) <= 0.0);
        assert!(told_s(0.0, true) <= 0.0, "it comes again");
        let late_s = told_s(0.0, false);
        assert!((0.03..0.06).contains(&late_s), "{late_s}");
        // One image was missed.
        assert!(told_s(0.2, false) <= 0.0 && told_s(0.1, false) <= 0.0);
        // A pause, and a camera that is slower from then on.
        for dt_s in [0.1; 10].into_iter().chain([3.0, 0.1, 0.1]) {
            assert!(told_s(dt_s, false) <= 0.0);
        }
        for _ in 0..20 {
            told_s(3.0, false);
        }
        assert!((told_s(0.1, false) - config.max_sigma_s).abs() < 1e-9);
    }

    #[test]
    fn who_stands_or_knows_nothing_learns_nothing() {
        let config = ClockConfig::default();
        let mut clock = Clock::default();
        clock.learn(&Interval { moved_m: 0.5, before_m2: 0.01, after_m2: 0.0025, speed_m_s: 0.0 }, &config);
        for (before_m2, after_m2) in [(0.01, 0.01), (0.01, 0.02), (0.0, 0.0), (f64::NAN, 0.01)] {
            clock.learn(&Interval { moved_m: 0.5, before_m2, after_m2, speed_m_s: 10.0 }, &config);
        }
        assert_eq!(clock, Clock::default());
    }

    #[test]
    fn what_asks_for_more_than_the_motion_allows_contradicts_it_however_times_are_doubted() {
        // Half of an innovation of 1 m, known to 0.2 m each, of which 0.1 m is for its time.
        let half = Interval { moved_m: 0.5, before_m2: 0.04, after_m2: 0.02, speed_m_s: 10.0 };
        assert!((half.contradiction_sigmas(0.0) - 1.0 / 0.08_f64.sqrt()).abs() < 1e-9);
        assert!((half.contradiction_sigmas(1e-4) - 1.0 / 0.07_f64.sqrt()).abs() < 1e-9);
        assert!(Interval { after_m2: 0.04, ..half }.contradiction_sigmas(0.0) < 1e-9);
    }
}
