//! The scale of all depths together, which points leave open: it changes a little as they
//! come and go, and the road tells it anew in every image. A filter of that one number says
//! how much of each.

use super::config::RoadConfig;
use super::depths::Way;
use super::fading::MOST_DEVIATION;
use super::{LEAST_WAY_M, least_way_m};

/// The scale of all depths.
#[derive(Default)]
pub(super) struct Scale {
    /// Variance of its logarithm; none while no depth is known.
    variance: Option<f64>,
}

impl Scale {
    /// How far the vehicle went, metres, from what points and the road say, and by which
    /// factor all depths were too small. None where neither says it.
    pub fn way(&mut self, of_points: Option<Way>, road_m: Option<f64>, config: &RoadConfig) -> Option<(f64, f64)> {
        let Some((way, before)) = of_points.zip(self.variance) else {
            self.variance = road_m.map(|road_m| lasting(road_m, config));
            return road_m.map(|road_m| (road_m, 1.0));
        };
        let way_m = way.forward_m;
        if way_m.abs() < LEAST_WAY_M {
            return Some((way_m, 1.0));
        }
        let mut variance = before + way.variance / (way_m * way_m);
        let mut factor: f64 = 1.0;
        if let Some(road_m) = road_m.filter(|road_m| road_m * way_m > 0.0) {
            let off = (road_m / way_m).ln();
            let single = single(road_m, config);
            if off * off < MOST_DEVIATION * MOST_DEVIATION * (variance + single) {
                let gain = variance / (variance + lasting(road_m, config));
                factor = (gain * off).exp();
                variance *= 1.0 - gain;
            } else {
                // One of the two is wrong, and which, the next will say.
                variance += single;
            }
        }
        self.variance = Some(variance);
        Some((way_m * factor, factor))
    }
}

/// Variance of the logarithm of one way that the road tells.
fn single(road_m: f64, config: &RoadConfig) -> f64 {
    config.share_sigma.powi(2) + (config.way_sigma_m / least_way_m(road_m)).powi(2)
}

/// The same as one of many that are off alike for a while: the mean of as many is not known
/// as well as if each were off by chance.
fn lasting(road_m: f64, config: &RoadConfig) -> f64 {
    single(road_m, config) * (2.0 * config.alike_m / least_way_m(road_m).abs()).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What points say whose depths are all too small by a factor, to a thousandth.
    fn of_points(way_m: f64, too_small: f64) -> Way {
        Way { forward_m: way_m / too_small, variance: (0.001 * way_m).powi(2) }
    }

    #[test]
    fn the_road_tells_the_scale_and_its_errors_are_evened_out() {
        let config = RoadConfig::default();
        let mut scale = Scale::default();
        assert_eq!(scale.way(None, None, &config), None);
        // The road begins with 3 % too much, and goes on with as much to both sides.
        let mut too_small = 1.0 / 1.03;
        assert_eq!(scale.way(None, Some(1.03), &config), Some((1.03, 1.0)));
        for i in 0..200 {
            let road_m = if i % 8 < 4 { 1.03 } else { 0.97 };
            let (way_m, factor) = scale.way(Some(of_points(1.0, too_small)), Some(road_m), &config).unwrap();
            too_small /= factor;
            if i > 60 {
                assert!((way_m - 1.0).abs() < 0.01, "{i}: {way_m}");
            }
        }
    }

    #[test]
    fn a_road_that_misleads_once_is_not_believed_and_depths_that_are_wrong_are_found_out() {
        let config = RoadConfig::default();
        let mut scale = Scale::default();
        scale.way(None, Some(1.0), &config);
        for _ in 0..50 {
            scale.way(Some(of_points(1.0, 1.0)), Some(1.0), &config);
        }
        let (way_m, factor) = scale.way(Some(of_points(1.0, 1.0)), Some(1.5), &config).unwrap();
        assert!((way_m - 1.0).abs() < 1e-9 && (factor - 1.0).abs() < 1e-9);
        // Nobody shows the road, nor goes back.
        assert_eq!(scale.way(Some(of_points(1.0, 1.0)), None, &config), Some((1.0, 1.0)));
        assert_eq!(scale.way(Some(of_points(1.0, 1.0)), Some(-1.0), &config), Some((1.0, 1.0)));
        let mut too_small = 2.0;
        let mut after = 0;
        while (too_small - 1.0_f64).abs() > 0.1 {
            too_small /= scale.way(Some(of_points(1.0, too_small)), Some(1.0), &config).unwrap().1;
            after += 1;
            assert!(after < 1000, "{too_small}");
        }
    }

    #[test]
    fn who_stands_is_known_to_by_the_points_and_forgets_no_scale() {
        let config = RoadConfig::default();
        let mut scale = Scale::default();
        scale.way(None, Some(1.0), &config);
        let before = scale.variance;
        let standing = Some(Way { forward_m: 0.001, variance: 1e-6 });
        assert_eq!(scale.way(standing, Some(0.05), &config), Some((0.001, 1.0)));
        assert_eq!(scale.variance, before);
    }
}
