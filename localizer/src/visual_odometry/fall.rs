//! How the road falls to one side, as the camera sees it: the mounting of the
//! camera, the crossfall of the road, and how the vehicle leans.
//!
//! A road that falls by `f` per metre to the right is seen `x` to the right from
//! `1 + f x / h` of the height `h` that it is taken to lie below the camera, and
//! what comes nearer there does so by `1 - f x / h`: the left side of a view
//! shifts by more than the right one, and where the way bends to one side, all of
//! the view shifts by too much or too little.

use super::config::RoadConfig;
use super::fading::Fading;
use super::road::Shift;

/// The fall to the right, and how well it is known.
pub(super) struct Fall(Fading);

impl Fall {
    /// Of a road of which nothing is seen yet.
    pub fn new(config: &RoadConfig) -> Self {
        Self(Fading::new(config.fall_sigma))
    }

    /// How much lower the road is per metre to the right.
    pub fn per_m(&self) -> f64 {
        self.0.value
    }

    /// So much farther along the road it may be another.
    pub fn advance(&mut self, way_m: f64, config: &RoadConfig) {
        self.0.advance(way_m, config.fall_length_m, config.fall_sigma);
    }

    /// Learns from views that were made with this fall, and tells by which factor
    /// their shift is too long for what is known then.
    pub fn stretch(&mut self, shift: &Shift, height_m: f64, config: &RoadConfig) -> f64 {
        let Some([left_m, right_m]) = shift.sides_m else { return 1.0 };
        let way_m = shift.way_m(config);
        // The middles of the sides are half the width apart.
        let slope = config.half_width_m / height_m;
        let noise = 2.0 * (config.side_sigma_m / way_m).powi(2);
        let differ = (left_m - right_m) / way_m;
        let gain = self.0.learn(slope, differ, noise);
        gain.map_or(1.0, |gain| 1.0 - shift.middle_m / height_m * gain * differ)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEIGHT_M: f64 = 1.65;

    /// What a road shows that falls so much more than it is taken to, in a bend.
    fn seen(way_m: f64, error: f64, middle_m: f64) -> Shift {
        let at = |right_m: f64| way_m * (1.0 - error * right_m / HEIGHT_M);
        let aside_m = 0.5 * RoadConfig::default().half_width_m;
        Shift {
            forward_m: at(middle_m),
            correlation: 0.9,
            lead: 0.4,
            halves: None,
            sides_m: Some([at(middle_m - aside_m), at(middle_m + aside_m)]),
            middle_m,
        }
    }

    #[test]
    fn it_is_learned_on_a_straight_and_tells_in_a_bend() {
        let config = RoadConfig::default();
        let mut fall = Fall::new(&config);
        let truth = -0.02;
        for _ in 0..40 {
            fall.advance(1.0, &config);
            let shift = seen(1.0, truth - fall.per_m(), 0.0);
            assert!((shift.forward_m / fall.stretch(&shift, HEIGHT_M, &config) - 1.0).abs() < 1e-9);
        }
        assert!((fall.per_m() - truth).abs() < 0.005, "{}", fall.per_m());
        let shift = seen(1.0, truth - fall.per_m(), 3.0);
        let way_m = shift.forward_m / fall.stretch(&shift, HEIGHT_M, &config);
        assert!((way_m - 1.0).abs() < 0.01, "{way_m}");
        fall.advance(10.0 * config.fall_length_m, &config);
        assert!(fall.per_m().abs() < 1e-5 && (fall.0.variance.sqrt() / config.fall_sigma - 1.0).abs() < 1e-3);
    }

    #[test]
    fn sides_that_no_road_explains_teach_nothing() {
        let config = RoadConfig::default();
        let mut fall = Fall::new(&config);
        for shift in [seen(1.0, 0.5, 1.0), Shift { sides_m: None, ..seen(1.0, 0.01, 1.0) }] {
            let stretch = fall.stretch(&shift, HEIGHT_M, &config);
            assert!((stretch - 1.0).abs() < 1e-12 && fall.per_m().abs() < 1e-12, "{stretch}");
        }
    }
}
