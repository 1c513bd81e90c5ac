//! How well the times of images are kept, told by the images themselves.
//!
//! A time that is wrong by `d` puts a vehicle of speed `v` off by `v d` along
//! its way, there and back again: no motion of a vehicle, however its speed is
//! allowed to change. Where the images shift the prediction forward and back by
//! more than the filter expects, what is too much is put down to their times,
//! and the position along the way is believed that much less (covariance
//! matching: R. K. Mehra, *Approaches to adaptive filtering*, 1972).

use common::geometry::local;
use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use crate::associate::robust::Refined;
use crate::filter::State;

/// Settings of what is made of the times.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClockConfig {
    /// Share of what was learnt that counts a frame later: 20 frames, for a
    /// vehicle that brakes hard for one second is no clock.
    pub memory: f64,
    /// Largest standard deviation that a time between two images is taken to
    /// have, seconds: an image of 10 Hz. 0 takes all times as exact.
    pub max_sigma_s: f64,
    /// `localizer run` tells of times that are off by this in half of the
    /// frames, seconds: at 10 m/s 5 cm.
    pub told_sigma_s: f64,
}

impl Default for ClockConfig {
    fn default() -> Self {
        Self { memory: 0.95, max_sigma_s: 0.1, told_sigma_s: 0.005 }
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
}

/// What is known of the times of images: the straight line through the origin
/// that fits the surplus of the frames over their exposure best.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Clock {
    /// Sum of exposure times surplus, m^4/s^2.
    surplus: f64,
    /// Sum of the squared exposures, m^4/s^4.
    exposure: f64,
}

impl Clock {
    /// Variance of the time between two images, s^2.
    pub fn variance_s2(&self, config: &ClockConfig) -> f64 {
        if self.exposure > 0.0 {
            (self.surplus / self.exposure).clamp(0.0, config.max_sigma_s * config.max_sigma_s)
        } else {
            0.0
        }
    }

    /// Learns from a frame. With the gain `K` of the forward position, of which
    /// the variance was `P`, an innovation `n` moves it by `K n`, and `n^2` is
    /// expected to be `P / K`. The surplus is `(K n)^2 - K P`, less what was put
    /// down to the time already; a variance `s^2` of that makes `(K v)^2 s^2` of
    /// it, `(K v)^2` being the exposure: little where a vehicle goes slowly.
    pub fn learn(&mut self, interval: &Interval, config: &ClockConfig) {
        let gain = 1.0 - interval.after_m2 / interval.before_m2;
        // The variances may be none.
        if !(0.0..=1.0).contains(&gain) {
            return;
        }
        let exposure = (gain * interval.speed_m_s).powi(2);
        let known_m2 = exposure * self.variance_s2(config);
        let surplus_m2 = interval.moved_m.powi(2) - gain * interval.before_m2 + known_m2;
        self.surplus = self.surplus * config.memory + exposure * surplus_m2;
        self.exposure = self.exposure * config.memory + exposure * exposure;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    /// What a filter of the forward position alone learns in 300 frames of
    /// 0.1 s at 10 m/s, of which the times are off by `-off_s` or `off_s`. The
    /// images tell the position to 5 cm, the speed wanders by 5 cm a frame.
    fn learnt_s(off_s: f64, config: &ClockConfig) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(4);
        let (step_m2, seen_m2, speed_m_s) = (0.05_f64.powi(2), 0.05_f64.powi(2), 10.0);
        let mut noise = |variance: f64| variance.sqrt() * Distribution::<f64>::sample(&StandardNormal, &mut random);
        let (mut clock, mut error_m, mut after_m2, mut late_s) = (Clock::default(), 0.0, seen_m2, 0.0);
        (0..300)
            .map(|i| {
                let now_s = if i % 2 == 0 { -off_s } else { off_s };
                // How far the prediction is ahead of the vehicle.
                error_m += speed_m_s * (now_s - late_s) + noise(step_m2);
                late_s = now_s;
                let known_m2 = speed_m_s * speed_m_s * clock.variance_s2(config);
                let before_m2 = after_m2 + step_m2 + known_m2;
                let gain = before_m2 / (before_m2 + seen_m2);
                after_m2 = (1.0 - gain) * before_m2;
                let moved_m = gain * (noise(seen_m2) - error_m);
                error_m += moved_m;
                clock.learn(&Interval { moved_m, before_m2, after_m2, speed_m_s }, config);
                clock.variance_s2(config).sqrt()
            })
            .collect()
    }

    #[test]
    fn times_that_are_off_are_told() {
        let config = ClockConfig::default();
        for off_s in [0.01, 0.025, 0.04] {
            // From one image to the next by twice that.
            let told_s = learnt_s(off_s, &config)[20..].iter().sum::<f64>() / 280.0;
            assert!((told_s / (2.0 * off_s) - 1.0).abs() < 0.25, "{off_s} s: {told_s}");
        }
        assert!(learnt_s(0.5, &config).iter().all(|s| *s <= config.max_sigma_s));
    }

    #[test]
    fn good_times_are_believed() {
        let mut learnt = learnt_s(0.0, &ClockConfig::default());
        learnt.sort_by(f64::total_cmp);
        assert!(learnt[150] < 0.002 && learnt[299] < 0.01, "{} {}", learnt[150], learnt[299]);
        let exact = ClockConfig { max_sigma_s: 0.0, ..ClockConfig::default() };
        assert!(learnt_s(0.05, &exact).iter().all(|s| *s <= 0.0));
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
}
