//! What the networks' own probabilities say for a match with a pole.
//!
//! The mean probability `p` of a region tells poles from what is taken for one:
//! on KITTI 04 and in the worlds alike, the log-likelihood ratio of a mast is -2
//! nats at 0.25 and +2 at 0.9. It rises with the log odds `ln(p / (1 - p))` above
//! those that features have in the mean, `usual`:
//!
//! `slope (ln(p / (1 - p)) - usual)`, at most so many nats either way.
//!
//! What is usual is learned along the drive, so a network that is too sure, or that
//! gives masks without probabilities, says nothing rather than too much. Of signs
//! it says too little: what is taken for one, frame after frame, is as sure.

use common::map::PoleKind;
use serde::{Deserialize, Serialize};

use crate::prepare::{Prepared, log_odds};

/// How much probabilities of regions say.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OddsConfig {
    /// Nats for each nat of the log odds that a lamp or sign post has beyond the
    /// usual ones.
    pub pole_slope: f64,
    /// The same for delineators: networks are as little sure of them as of what
    /// is none. Of trunks, which are told by another class, nothing is said.
    pub low_pole_slope: f64,
    /// Most that it says either way, nats.
    pub most: f64,
    /// The probability that is usual before any pole was seen.
    pub usual_pole: f64,
    /// So many features count as much as what is assumed before.
    pub assumed_features: f64,
    /// The mean is that of so many features at most.
    pub memory_features: f64,
}

impl Default for OddsConfig {
    fn default() -> Self {
        Self {
            pole_slope: 1.5,
            low_pole_slope: 0.6,
            most: 3.0,
            usual_pole: 0.5,
            assumed_features: 1000.0,
            memory_features: 3000.0,
        }
    }
}

/// The log odds that features have in the mean, and what is made of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UsualOdds {
    config: OddsConfig,
    mean: f64,
    /// So many features make that mean.
    features: f64,
}

impl UsualOdds {
    /// Before anything was seen.
    pub fn new(config: &OddsConfig) -> Self {
        Self { config: *config, mean: log_odds(config.usual_pole), features: config.assumed_features }
    }

    /// Takes in what a frame shows.
    pub fn learn(&mut self, features: &Prepared) {
        for pole in features.poles.iter().filter(|pole| !pole.is_trunk) {
            self.features = (self.features + 1.0).min(self.config.memory_features.max(1.0));
            self.mean += (pole.log_odds - self.mean) / self.features;
        }
    }

    /// What the log odds of a region say for a pole of this kind, nats.
    #[inline]
    pub fn of_pole(&self, kind: PoleKind, log_odds: f64) -> f64 {
        let slope = match kind {
            PoleKind::LampPost | PoleKind::SignPost => self.config.pole_slope,
            PoleKind::Delineator => self.config.low_pole_slope,
            PoleKind::Trunk => 0.0,
        };
        let most = self.config.most.max(0.0);
        (slope * (log_odds - self.mean)).clamp(-most, most)
    }
}

impl Default for UsualOdds {
    fn default() -> Self {
        Self::new(&OddsConfig::default())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::*;
    use crate::features::{Features, LineFeature};

    fn seen(probability: f64) -> Prepared {
        let line = LineFeature {
            upper_px: Point2::new(300.0, 40.0),
            lower_px: Point2::new(302.0, 160.0),
            offset_sigma_px: 0.5,
            angle_sigma_rad: 0.01,
            width_px: 5.0,
            probability,
            upper_is_cut: false,
            lower_is_cut: false,
        };
        let mut prepared = Prepared::default();
        prepared.fill(&Features { poles: vec![line; 10], ..Features::default() });
        prepared
    }

    #[test]
    fn what_is_surer_than_usual_speaks_for_a_landmark() {
        let usual = UsualOdds::default();
        let of = |probability: f64| usual.of_pole(PoleKind::LampPost, log_odds(probability));
        assert!(of(0.25) < -1.0 && of(0.5).abs() < 1e-9 && of(0.9) > 2.0);
        assert!(of(f64::NAN).abs() < 1e-9);
        assert!((of(0.0) + 3.0).abs() < 1e-9 && (of(1.0) - 3.0).abs() < 1e-9);
        assert!(usual.of_pole(PoleKind::Delineator, log_odds(0.25)).abs() < of(0.25).abs());
    }

    #[test]
    fn masks_without_probabilities_come_to_say_nothing() {
        let mut usual = UsualOdds::default();
        for _ in 0..2000 {
            usual.learn(&seen(1.0));
        }
        let sure = usual.of_pole(PoleKind::LampPost, log_odds(1.0));
        assert!(sure.abs() < 0.3, "{sure}");
    }
}
