//! A number of the road that is learned as it is driven over, and fades.

/// Standard deviations by which something differs at most from what is known.
pub(super) const MOST_DEVIATION: f64 = 3.0;

/// A number around zero, and how well it is known: so much farther along the road it
/// may be another.
pub(super) struct Fading {
    /// What it is taken to be.
    pub value: f64,
    /// Variance of that.
    pub variance: f64,
}

impl Fading {
    /// Of a road of which nothing is seen yet, among roads with this standard deviation.
    pub fn new(sigma: f64) -> Self {
        Self { value: 0.0, variance: sigma.powi(2) }
    }

    /// What is left `way_m` farther on, where it changes over `length_m`.
    pub fn advance(&mut self, way_m: f64, length_m: f64, sigma: f64) {
        let kept = (-way_m.abs() / length_m.max(f64::MIN_POSITIVE)).exp();
        let prior = sigma.powi(2);
        self.value *= kept;
        self.variance = prior + kept * kept * (self.variance - prior);
    }

    /// Learns from something that is `slope` times as far off as this, known to the
    /// variance `noise`, and tells by which share of it this changed; none where it cannot
    /// be that.
    pub fn learn(&mut self, slope: f64, differ: f64, noise: f64) -> Option<f64> {
        let expected = slope * slope * self.variance + noise;
        if differ * differ > MOST_DEVIATION * MOST_DEVIATION * expected {
            return None;
        }
        let gain = slope * self.variance / expected;
        self.value += gain * differ;
        self.variance *= 1.0 - gain * slope;
        Some(gain)
    }
}
