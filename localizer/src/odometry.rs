//! How far the vehicle drove and turned between images, as wheels and gyroscope
//! say, or the images themselves.

mod log;
mod running;

use serde::{Deserialize, Serialize};

pub use log::OdometryLog;
pub use running::{RunningLog, WheelLines};

/// Speed from which a vehicle sways as much as it ever does, m/s.
const SWAYING_M_S: f64 = 1.0;

/// How well the motion is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OdometryConfig {
    /// Standard deviation of the speed over one frame, m/s: quantisation,
    /// slip, and the camera's own swaying against the axle.
    pub speed_sigma_m_s: f64,
    /// The same of a vehicle that stands: it neither slips nor sways, but wheels
    /// do not tell creeping.
    pub standing_sigma_m_s: f64,
    /// What is added to that for each rad/s of turning, metres: how far to the side of the
    /// axle the speed may be that is shown.
    pub speed_sigma_of_turn_m: f64,
    /// Standard deviation of the scale of all speeds (share): tyres wear and
    /// are inflated to within 2 %.
    pub scale_sigma: f64,
    /// Height over the road that a camera is taken to have whose images tell the speed,
    /// metres: one that is twice as high went twice as far. 0 for wheels.
    #[serde(skip)]
    pub seen_from_m: f64,
    /// Standard deviation of the yaw rate over one frame, rad/s, scale
    /// included.
    pub yaw_rate_sigma_rad_s: f64,
    /// Standard deviation of the yaw rate's bias, rad/s: half a degree a
    /// second, of a cheap gyroscope that just started.
    pub yaw_bias_sigma_rad_s: f64,
    /// Standard deviation of the rates of pitch and roll over one frame, rad/s, where images
    /// tell them: held against the worlds 0.001 to 0.002, against KITTI 04 0.003 and 0.006,
    /// what its poses are off by included.
    pub sway_sigma_rad_s: f64,
    /// Change of scale and of bias within a minute, as shares of their
    /// standard deviations: temperature.
    pub drift_per_minute: f64,
    /// Fastest change of speed that is believed, m/s^2: an emergency stop on dry asphalt
    /// takes 10; wheels that lock or spin change by more. No bend is taken any harder.
    pub hardest_m_s2: f64,
    /// Fastest change of the yaw rate that is believed, rad/s^2: a car that swerves
    /// takes 3, and cameras shake: along KITTI 00 poses do so by 8. Robots that turn on
    /// the spot may need more.
    pub hardest_rad_s2: f64,
    /// Change of speed up to which nobody asks whether the wheels are right, m/s^2: who
    /// brakes for a light. Beyond, the images say whether it was so.
    pub usual_m_s2: f64,
    /// The same of the yaw rate, rad/s^2: cameras that shake do so by more now and then.
    pub usual_rad_s2: f64,
    /// What a pose pays for not having followed what is believed, nats: 5 says that
    /// sensors are wrong one time of 150 that they show what is not usual.
    pub disbelief: f64,
    /// Fastest yaw rate that is believed, rad/s: a robot that turns once a second.
    pub most_yaw_rate_rad_s: f64,
    /// Standard deviations, of what is tracked and of the odometry, by which the two may
    /// differ beyond that.
    pub believed_sigmas: f64,
    /// For so long what was not believed is held against what was known when that began,
    /// seconds: a skid takes one or two.
    pub refused_s: f64,
    /// Most that a yaw rate changes from one line of a log to the next beyond that, rad/s:
    /// noise and shaking change it by less, a loose plug by more.
    pub most_jump_rad_s: f64,
}

impl Default for OdometryConfig {
    fn default() -> Self {
        Self {
            speed_sigma_m_s: 0.1,
            standing_sigma_m_s: 0.05,
            speed_sigma_of_turn_m: 0.0,
            scale_sigma: 0.02,
            seen_from_m: 0.0,
            yaw_rate_sigma_rad_s: 0.01,
            yaw_bias_sigma_rad_s: 0.01,
            sway_sigma_rad_s: 0.01,
            drift_per_minute: 0.1,
            hardest_m_s2: 12.0,
            hardest_rad_s2: 10.0,
            usual_m_s2: 4.0,
            usual_rad_s2: 6.0,
            disbelief: 5.0,
            most_yaw_rate_rad_s: 6.0,
            believed_sigmas: 4.0,
            refused_s: 3.0,
            most_jump_rad_s: 0.7,
        }
    }
}

impl OdometryConfig {
    /// Standard deviation of a speed over one frame, m/s: from that of who stands to
    /// that of who drives, and more for who turns, rad/s.
    pub fn sigma_of(&self, speed_m_s: f64, yaw_rate_rad_s: f64) -> f64 {
        let share = (speed_m_s.abs() / SWAYING_M_S).min(1.0);
        let straight_m_s = self.standing_sigma_m_s + share * (self.speed_sigma_m_s - self.standing_sigma_m_s);
        straight_m_s.hypot(self.speed_sigma_of_turn_m * yaw_rate_rad_s)
    }
}

/// Mean motion of the vehicle between two images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Odometry {
    /// Forward speed, m/s, negative in reverse, where it is known.
    pub speed_m_s: Option<f64>,
    /// Turn rate about the vehicle's vertical axis, rad/s, positive to the
    /// left.
    pub yaw_rate_rad_s: f64,
    /// Turn rates of the camera about its axes to the right and forward, rad/s: it
    /// pitches up and rolls to the right where they are positive. Images tell them.
    pub sway_rad_s: Option<[f64; 2]>,
}

impl Odometry {
    /// What wheels, m/s, and a gyroscope, rad/s, show.
    pub fn of_wheels(speed_m_s: f64, yaw_rate_rad_s: f64) -> Self {
        Self { speed_m_s: Some(speed_m_s), yaw_rate_rad_s, sway_rad_s: None }
    }

    /// Whether it tells the speed, and not the turn alone.
    pub fn tells_speed(&self) -> bool {
        self.speed_m_s.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slower_and_the_straighter_the_better_a_speed_is_known() {
        let config = OdometryConfig { speed_sigma_of_turn_m: 1.2, ..OdometryConfig::default() };
        let sigmas = [0.0, -0.2, 0.6, -1.0, 30.0].map(|speed_m_s| config.sigma_of(speed_m_s, 0.0));
        assert!(sigmas.is_sorted() && sigmas[1] > sigmas[0] && sigmas[2] > sigmas[1], "{sigmas:?}");
        assert!((sigmas[0] - config.standing_sigma_m_s).abs() < 1e-12, "{sigmas:?}");
        assert!((sigmas[4] - config.speed_sigma_m_s).abs() < 1e-12, "{sigmas:?}");
        for yaw_rate_rad_s in [-0.5, 0.5] {
            assert!((config.sigma_of(10.0, yaw_rate_rad_s) - config.speed_sigma_m_s.hypot(0.6)).abs() < 1e-12);
        }
    }
}
