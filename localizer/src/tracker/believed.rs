//! What of the odometry is believed: wheels lock and slip, and sensors deliver
//! numbers that no vehicle drives.

use super::Tracker;
use super::hypothesis::Hypothesis;
use crate::filter::State;
use crate::odometry::{Odometry, OdometryConfig};

impl Tracker<'_> {
    /// What of the motion of the last `dt_s` can have followed what is tracked; all that
    /// vehicles do where nothing is, or its speed is not known yet.
    pub(super) fn believed(&self, dt_s: f64, shown: Option<Odometry>) -> Option<Odometry> {
        let (config, bank) = (&self.config.odometry, &self.config.bank);
        let tracked = self.bank.first().filter(|best| best.knows_its_speed()).map(|best: &Hypothesis| &best.state);
        let shown = shown.filter(|shown| {
            shown.yaw_rate_rad_s.abs() <= config.most_yaw_rate_rad_s
                && tracked.is_none_or(|state| state.may_turn(dt_s, shown.yaw_rate_rad_s, config))
        })?;
        let speed_m_s = shown.speed_m_s.filter(|speed_m_s| {
            (-bank.max_speed_m_s..=bank.max_speed_m_s).contains(speed_m_s)
                && tracked.is_none_or(|state| state.may_drive(dt_s, *speed_m_s, config))
        });
        Some(Odometry { speed_m_s, ..shown })
    }
}

impl State {
    /// Whether wheels can show this speed `dt_s` later.
    fn may_drive(&self, dt_s: f64, shown_m_s: f64, config: &OdometryConfig) -> bool {
        let off_m_s = shown_m_s - self.velocity[2] * (1.0 + self.wheel_scale);
        let sigma_m_s = self.covariance[(8, 8)].max(0.0).sqrt().hypot(config.sigma_of(shown_m_s));
        off_m_s.abs() <= config.hardest_m_s2 * dt_s + config.believed_sigmas * sigma_m_s
    }

    /// Whether a gyroscope can show this turn rate `dt_s` later.
    fn may_turn(&self, dt_s: f64, shown_rad_s: f64, config: &OdometryConfig) -> bool {
        let off_rad_s = shown_rad_s - (self.yaw_bias_rad_s - self.velocity[4]);
        let sigma_rad_s = self.covariance[(10, 10)].max(0.0).sqrt().hypot(config.yaw_rate_sigma_rad_s);
        off_rad_s.abs() <= config.hardest_rad_s2 * dt_s + config.believed_sigmas * sigma_rad_s
    }
}
