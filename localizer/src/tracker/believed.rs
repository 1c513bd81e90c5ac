//! What of the odometry is believed: wheels lock and slip, and sensors deliver
//! numbers that no vehicle drives.

use super::Tracker;
use crate::filter::State;
use crate::odometry::{Odometry, OdometryConfig};

/// What was not believed of a sensor the last time.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Refused {
    /// How well that was known when it began, m/s or rad/s: what is not told is known
    /// ever less well, and a sensor that is wrong does not get better by that.
    sigma: f64,
    /// For how long, seconds.
    for_s: f64,
}

/// What speed and turn rate were refused as.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Doubts {
    speed: Option<Refused>,
    turn: Option<Refused>,
}

/// Something that is shown, and what is expected.
struct Shown {
    off: f64,
    /// Standard deviation of what is expected.
    sigma: f64,
    /// That of the sensor.
    sensor_sigma: f64,
    /// By how much it can have changed.
    hardest: f64,
}

impl Shown {
    /// Whether it is no more than vehicles `usually` change by.
    fn is_usual(&self, usually: f64, dt_s: f64, config: &OdometryConfig) -> bool {
        self.off.abs() <= usually * dt_s + config.believed_sigmas * self.sigma.hypot(self.sensor_sigma)
    }

    /// Whether it can be, after what was `refused` the last time.
    fn is_believed(&self, refused: &mut Option<Refused>, dt_s: f64, config: &OdometryConfig) -> bool {
        let before = refused.filter(|refused| refused.for_s < config.refused_s);
        let sigma = before.map_or(self.sigma, |before| before.sigma.min(self.sigma));
        let may_be = self.off.abs() <= self.hardest * dt_s + config.believed_sigmas * sigma.hypot(self.sensor_sigma);
        let for_s = refused.map_or(0.0, |before| before.for_s) + dt_s;
        *refused = (!may_be).then_some(Refused { sigma, for_s });
        may_be
    }
}

/// What of the odometry is believed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Believed {
    /// All that can be.
    pub shown: Option<Odometry>,
    /// What of it is no more than vehicles usually do: the rest may be a sensor that is wrong.
    pub usual: Option<Odometry>,
}

impl Believed {
    /// Whether some of it is odd.
    pub fn is_odd(&self) -> bool {
        self.shown != self.usual
    }
}

impl Tracker<'_> {
    /// What of the motion of the last `dt_s` can have followed what is tracked; all that
    /// vehicles do where nothing is, or its speed is not known yet.
    pub(super) fn believed(&mut self, dt_s: f64, shown: Option<Odometry>) -> Believed {
        let (config, bank) = (&self.config.odometry, &self.config.bank);
        let is_driven = |shown: &Odometry| shown.yaw_rate_rad_s.abs() <= config.most_yaw_rate_rad_s;
        let Some(shown) = shown.filter(is_driven) else { return Believed::default() };
        let yaw_rate_rad_s = shown.yaw_rate_rad_s;
        let tracked = self.bank.first().filter(|best| best.knows_its_speed()).map(|best| &best.state);
        let turn = tracked.map(|state| state.shown_turn(yaw_rate_rad_s, config));
        let may_turn = turn.as_ref().is_none_or(|turn| turn.is_believed(&mut self.doubts.turn, dt_s, config));
        let speed = shown.speed_m_s.and_then(|m_s| Some(tracked?.shown_speed(m_s, yaw_rate_rad_s, config)));
        let may_go = speed.as_ref().is_none_or(|speed| speed.is_believed(&mut self.doubts.speed, dt_s, config));
        let is_reached = |m_s: &f64| (-bank.max_speed_m_s..=bank.max_speed_m_s).contains(m_s);
        // Nothing corners harder than it brakes.
        let aside_m_s2 = tracked.map_or(0.0, |state| state.velocity[2] * yaw_rate_rad_s);
        if !may_turn || aside_m_s2.abs() > config.hardest_m_s2 {
            return Believed::default();
        }
        let shown = Odometry { speed_m_s: shown.speed_m_s.filter(|m_s| may_go && is_reached(m_s)), ..shown };
        let turns_usually = turn.is_none_or(|turn| turn.is_usual(config.usual_rad_s2, dt_s, config));
        let goes_usually = speed.is_none_or(|speed| speed.is_usual(config.usual_m_s2, dt_s, config));
        let usual = Odometry { speed_m_s: shown.speed_m_s.filter(|_| goes_usually), ..shown };
        Believed { shown: Some(shown), usual: turns_usually.then_some(usual) }
    }
}

impl State {
    fn shown_speed(&self, shown_m_s: f64, yaw_rate_rad_s: f64, config: &OdometryConfig) -> Shown {
        Shown {
            off: shown_m_s - self.velocity[2] * (1.0 + self.wheel_scale) * self.shown_share(config),
            sigma: self.covariance[(8, 8)].max(0.0).sqrt(),
            sensor_sigma: config.sigma_of(shown_m_s, yaw_rate_rad_s),
            hardest: config.hardest_m_s2,
        }
    }

    fn shown_turn(&self, shown_rad_s: f64, config: &OdometryConfig) -> Shown {
        Shown {
            off: shown_rad_s - (self.yaw_bias_rad_s - self.velocity[4]),
            sigma: self.covariance[(10, 10)].max(0.0).sqrt(),
            sensor_sigma: config.yaw_rate_sigma_rad_s,
            hardest: config.hardest_rad_s2,
        }
    }
}
