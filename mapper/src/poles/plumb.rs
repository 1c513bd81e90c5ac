//! Which way poles stand.

use nalgebra::{Matrix2, Vector2};

use super::PoleConfig;

/// Which way poles stand: the slope over height of the plumb line in the map,
/// and how far poles lean from it. The first camera does not stand level, so
/// the map's vertical is not it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plumb {
    /// `(dx, dz)` per metre upwards.
    pub slope: Vector2<f64>,
    /// Usual lean, radians, one standard deviation along each axis.
    pub lean_rad: f64,
}

impl Plumb {
    /// What is known before any pole is: the map's vertical, and that the
    /// first camera stands level to some degrees.
    pub fn of_map(config: &PoleConfig) -> Self {
        Self { slope: Vector2::zeros(), lean_rad: config.usual_tilt_rad }
    }

    /// The plumb line that poles of given slopes and slope covariances share:
    /// their mean, each weighted by what it knows and how far poles lean;
    /// those that lean much count little (Cauchy).
    pub fn of_poles(poles: &[(Vector2<f64>, Matrix2<f64>)], config: &PoleConfig) -> Self {
        let lean = Matrix2::identity() * config.usual_lean_rad.powi(2);
        let mut slope = Vector2::zeros();
        let mut left = config.usual_tilt_rad;
        for _ in 0..10 {
            let mut h = Matrix2::identity() / config.usual_tilt_rad.powi(2);
            let mut g = Vector2::zeros();
            for (of_pole, covariance) in poles {
                let Some(weight) = (covariance + lean).try_inverse() else { continue };
                let off = of_pole - slope;
                let robust = (1.0 + off.dot(&(weight * off)) / LEANING).recip();
                h += weight * robust;
                g += weight * of_pole * robust;
            }
            let Some(covariance) = h.try_inverse() else { break };
            slope = covariance * g;
            left = (covariance.trace() / 2.0).sqrt();
        }
        Self { slope, lean_rad: config.usual_lean_rad.hypot(left) }
    }

    /// How well a slope is known beforehand along each axis, rad^-2: the mean over poles that
    /// stand as usual and those few that lean, by how well either explains what the hits tell,
    /// which is `off` the plumb line with this covariance. So a pole that its hits show to
    /// lean is let go of, and one of which they show little is not.
    pub(super) fn uprightness(&self, off: &Vector2<f64>, covariance: &Matrix2<f64>, config: &PoleConfig) -> f64 {
        let explained = |sigma_rad: f64| {
            let spread = covariance + Matrix2::identity() * sigma_rad.powi(2);
            let squared = spread.try_inverse().map_or(0.0, |inverse| off.dot(&(inverse * off)));
            (-0.5 * squared).exp() / spread.determinant().max(f64::MIN_POSITIVE).sqrt()
        };
        let leaning_rad = config.largest_tilt_rad / 2.0;
        let usual = (1.0 - config.leaning_share) * explained(self.lean_rad);
        let leaning = config.leaning_share * explained(leaning_rad);
        let share = if usual + leaning > 0.0 { usual / (usual + leaning) } else { 0.0 };
        share / self.lean_rad.powi(2) + (1.0 - share) / leaning_rad.powi(2)
    }
}

/// Squared standard deviations from which on a pole counts as one that leans:
/// the usual lean then says little about it.
const LEANING: f64 = 6.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pole_is_let_lean_only_where_its_hits_show_it() {
        let (config, off) = (PoleConfig::default(), Vector2::new(0.08, 0.0));
        let plumb = Plumb { slope: Vector2::zeros(), lean_rad: config.usual_lean_rad };
        let known_to = |sigma_rad: f64| {
            plumb.uprightness(&off, &(Matrix2::identity() * sigma_rad.powi(2)), &config).recip().sqrt()
        };
        // Five degrees that are known to half a degree, and to two.
        assert!(known_to(0.01) > 0.04, "{}", known_to(0.01));
        assert!(known_to(0.035) < 0.015, "{}", known_to(0.035));
    }
}
