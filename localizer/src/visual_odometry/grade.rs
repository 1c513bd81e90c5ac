//! How the grade of the road changes, on crests and in sags.
//!
//! A road that bends upwards by `k` per metre is seen from a height `h` at
//! `z + k z^3 / 2h` instead of `z`, if it is taken for a plane, and what comes
//! nearer there does so by the factor `1 + 3 k z^2 / 2h`: the far half of a view
//! shifts by more than the near one.

use super::config::RoadConfig;
use super::fading::Fading;
use super::road::Shift;

/// The curvature of the road upwards, and how well it is known.
pub(super) struct Grade(Fading);

impl Grade {
    /// Of a road of which nothing is seen yet.
    pub fn new(config: &RoadConfig) -> Self {
        Self(Fading::new(config.sag_sigma_per_m))
    }

    /// Positive in a sag, negative on a crest, 1/m.
    pub fn sag_per_m(&self) -> f64 {
        self.0.value
    }

    /// So much farther along the road it may be another.
    pub fn advance(&mut self, way_m: f64, config: &RoadConfig) {
        self.0.advance(way_m, config.sag_length_m, config.sag_sigma_per_m);
    }

    /// Learns from views that were made with this curvature, and tells by which
    /// factor their shift is too long for what is known then.
    pub fn stretch(&mut self, shift: &Shift, height_m: f64, config: &RoadConfig) -> f64 {
        let Some([far, near]) = shift.halves else { return 1.0 };
        let of_sag = |ahead_m: f64| 1.5 * ahead_m * ahead_m / height_m;
        let way_m = shift.way_m(config);
        let slope = of_sag(far.ahead_m) - of_sag(near.ahead_m);
        let noise = 2.0 * (config.half_sigma_m / way_m).powi(2);
        let differ = (far.forward_m - near.forward_m) / way_m;
        let gain = self.0.learn(slope, differ, noise);
        gain.map_or(1.0, |gain| 1.0 + 0.5 * (of_sag(far.ahead_m) + of_sag(near.ahead_m)) * gain * differ)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::visual_odometry::road::Half;

    const HEIGHT_M: f64 = 1.65;

    /// What a road taken for one of another curvature shows.
    fn seen(way_m: f64, error_per_m: f64) -> Shift {
        let half = |ahead_m: f64| Half {
            ahead_m,
            forward_m: way_m * (1.0 + 1.5 * error_per_m * ahead_m * ahead_m / HEIGHT_M),
        };
        let halves = [half(12.0), half(7.0)];
        Shift {
            forward_m: 0.5 * (halves[0].forward_m + halves[1].forward_m),
            correlation: 0.9,
            lead: 0.4,
            halves: Some(halves),
            sides_m: None,
            middle_m: 0.0,
        }
    }

    #[test]
    fn a_crest_is_learned_and_forgotten() {
        let config = RoadConfig::default();
        let mut grade = Grade::new(&config);
        let crest_per_m = -0.002;
        for _ in 0..20 {
            grade.advance(1.3, &config);
            let shift = seen(1.3, crest_per_m - grade.sag_per_m());
            grade.stretch(&shift, HEIGHT_M, &config);
        }
        assert!((grade.sag_per_m() - crest_per_m).abs() < 0.2 * crest_per_m.abs(), "{}", grade.sag_per_m());
        let shift = seen(1.3, crest_per_m - grade.sag_per_m());
        let way_m = shift.forward_m / grade.stretch(&shift, HEIGHT_M, &config);
        assert!((way_m / 1.3 - 1.0).abs() < 0.03, "{way_m}");
        grade.advance(10.0 * config.sag_length_m, &config);
        assert!(
            grade.sag_per_m().abs() < 1e-5 && (grade.0.variance.sqrt() / config.sag_sigma_per_m - 1.0).abs() < 1e-3
        );
    }

    #[test]
    fn halves_that_no_road_explains_teach_nothing() {
        let config = RoadConfig::default();
        let mut grade = Grade::new(&config);
        for shift in [seen(1.3, 0.05), Shift { halves: None, ..seen(1.3, 0.001) }] {
            let stretch = grade.stretch(&shift, HEIGHT_M, &config);
            assert!((stretch - 1.0).abs() < 1e-12 && grade.sag_per_m().abs() < 1e-12, "{stretch}");
        }
    }
}
