//! Whether a camera takes a wrong pose for the right one.
//!
//! A covariance tells how well a camera knows its pose once it knows which
//! landmark is which. With few landmarks in view it may find none of those that
//! tell, or some others that fit at a wrong pose as well. A landmark that is
//! found with probability `p` and then speaks against a wrong pose with `n`
//! nats leaves of the odds for it `1 - p (1 - exp(-n))` on average; landmarks
//! are found independently, so their shares multiply.

use nalgebra::Matrix6;

use super::BudgetConfig;
use super::sight::Row;

/// Components of the pose tangent in which a camera is searched.
const SEARCHED: [usize; 2] = [0, 2];

/// Logarithm of the odds for a wrong pose, per searched component.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Doubt {
    log_odds: [f64; 2],
}

impl Doubt {
    /// The doubt with one more landmark in view: its rows at this place.
    pub fn less(&self, rows: &[Row], config: &BudgetConfig) -> Self {
        let mut log_odds = self.log_odds;
        for ((log_odds, component), wrong_m) in log_odds.iter_mut().zip(SEARCHED).zip(config.wrong_m) {
            let shift2: f64 = rows.iter().map(|row| (row.whitened[component] * wrong_m).powi(2)).sum();
            // The rows have the share in which it is found in them.
            let found = rows.first().map_or(0.0, |row| row.found);
            let nats = (0.5 * shift2 / found.max(1e-9)).min(config.most_evidence);
            *log_odds += (-found * (1.0 - (-nats).exp())).ln_1p();
        }
        Self { log_odds }
    }

    /// What a wrong pose adds to the covariance: its odds times its error
    /// squared.
    pub fn spread(&self, config: &BudgetConfig) -> Matrix6<f64> {
        let mut spread = Matrix6::zeros();
        for ((log_odds, component), wrong_m) in self.log_odds.iter().zip(SEARCHED).zip(config.wrong_m) {
            spread[(component, component)] = log_odds.exp() * wrong_m * wrong_m;
        }
        spread
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;

    /// A landmark that a metre to the right and a metre forward move by so many
    /// standard deviations in the image.
    fn landmark(right: f64, forward: f64, found: f64) -> Row {
        let whitened = Vector6::new(right, 0.0, forward, 0.0, 0.0, 0.0) * found.sqrt();
        Row { place: 0, whitened, found }
    }

    #[test]
    fn only_what_moves_with_the_pose_speaks_against_a_wrong_one() {
        let config = BudgetConfig::default();
        let spread = |rows: &[Row]| {
            let doubt = rows.iter().fold(Doubt::default(), |doubt, row| doubt.less(std::slice::from_ref(row), &config));
            let spread = doubt.spread(&config);
            [spread[(0, 0)] / config.wrong_m[0].powi(2), spread[(2, 2)] / config.wrong_m[1].powi(2)]
        };
        let is_whole = |share: [f64; 2]| share.iter().all(|s| (s - 1.0).abs() < 1e-12);
        assert!(is_whole(spread(&[])));
        let [right, forward] = spread(&[landmark(10.0, 0.0, 1.0)]);
        assert!((right - (-config.most_evidence).exp()).abs() < 1e-9 && (forward - 1.0).abs() < 1e-12);
        // What is found in half of the images leaves half of the doubt.
        let [half, _] = spread(&[landmark(10.0, 0.0, 0.5)]);
        assert!((half - 0.5 * (1.0 + right)).abs() < 1e-9, "{half}");
        let [two, _] = spread(&[landmark(10.0, 0.0, 0.5); 2]);
        assert!((two - half * half).abs() < 1e-9);
        assert!(is_whole(spread(&[landmark(10.0, 10.0, 0.0)])));
    }
}
