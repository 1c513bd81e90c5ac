//! How the camera is pitched against the road.

use super::config::RotationConfig;

/// A direction of the motion is asked how the camera is mounted where bumps turn it by no
/// more than this share of what mountings differ by.
const LARGEST_BUMPS: f64 = 0.5;

/// The camera's pitch against the road, as the directions of its motion tell it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Pitch {
    /// Its mean, radians, positive where the camera looks down.
    pub mean_rad: f64,
    /// Of how many images.
    images: f64,
}

impl Pitch {
    /// The pitch in an image in which the direction of the motion says so much, radians: the
    /// slower, the less that tells of it, as bumps move the camera, too.
    pub fn now_rad(&self, told_rad: f64, speed_m_s: f64, config: &RotationConfig) -> f64 {
        let share = self.trust(speed_m_s, config);
        share * told_rad + (1.0 - share) * self.mean_rad
    }

    /// Takes in what the direction of the motion says in one image.
    pub fn learn(&mut self, told_rad: f64, speed_m_s: f64, dt_s: f64, config: &RotationConfig) {
        let trust = self.trust(speed_m_s, config);
        self.images += trust;
        let share = (dt_s / config.pitch_memory_s.max(dt_s)).max(self.images.max(1.0).recip());
        self.mean_rad += trust * share * (told_rad - self.mean_rad);
    }

    /// How far the direction of the motion is believed: by what the pitch varies by, and at
    /// first by what mountings do.
    fn trust(&self, speed_m_s: f64, config: &RotationConfig) -> f64 {
        let bumps_m_s = config.bump_sigma_m_s.max(1e-6);
        let tells_mounting = bumps_m_s < LARGEST_BUMPS * speed_m_s * config.mounting_sigma_rad;
        let mounting_rad = if tells_mounting { config.mounting_sigma_rad / (1.0 + self.images) } else { 0.0 };
        let pitches_m_s = speed_m_s * config.pitch_sigma_rad.hypot(mounting_rad);
        pitches_m_s * pitches_m_s / (pitches_m_s * pitches_m_s + bumps_m_s * bumps_m_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_that_looks_down_is_known_at_once_and_a_bump_at_a_walk_is_none() {
        let config = RotationConfig::default();
        let told_rad = 0.07;
        let first = |speed_m_s: f64| Pitch::default().now_rad(told_rad, speed_m_s, &config);
        assert!((first(10.0) - told_rad).abs() < 0.003, "{}", first(10.0));
        assert!(first(1.0) < 0.1 * told_rad, "{}", first(1.0));
        let mut pitch = Pitch::default();
        (0..3).for_each(|_| pitch.learn(told_rad, 10.0, 0.1, &config));
        assert!((pitch.mean_rad - told_rad).abs() < 0.003, "{}", pitch.mean_rad);
        // Later it varies by as much as it pitches, and no more.
        let still = RotationConfig { pitch_sigma_rad: 0.0, ..config };
        (0..20).for_each(|_| pitch.learn(told_rad, 10.0, 0.1, &config));
        let other_rad = pitch.now_rad(0.0, 10.0, &still);
        assert!(other_rad > 0.8 * told_rad, "{other_rad}");
    }
}
