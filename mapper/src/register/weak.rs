//! The survey holds a scan where those before it hardly do.
//!
//! Along an open road, or with few beams, little tells how far a scan has moved, and what
//! the beams leave on hedges moves with the sensor. A scan that is laid wrong smears the local
//! map, and all that follow stick to it. So in the weak directions of its normal matrix (Zhang,
//! Kaess and Singh 2016, *On degeneracy of optimization-based state estimation problems*) the
//! survey's motion counts, too, before the scan goes into the local map.

use common::geometry::{Pose, Tangent, local, retract};
use nalgebra::Matrix6;

use super::graph::{GraphConfig, cauchy};

/// Where a scan goes into the local map, given where it was laid, the normal matrix of that
/// in its own tangent, and where the survey's motion leads (both `map_from_velodyne`).
pub(super) fn held_by_survey(laid: &Pose, information: &Matrix6<f64>, surveyed: &Pose, config: &GraphConfig) -> Pose {
    let sigmas =
        Tangent::from_fn(|i, _| if i < 3 { config.survey_motion_sigma_m } else { config.survey_motion_sigma_rad });
    let scale = Matrix6::from_diagonal(&sigmas);
    // In standard deviations of the survey: its own information is 1 in every direction.
    let scaled = scale * information * scale / config.motion_inflation.powi(2);
    if !scaled.iter().all(|value| value.is_finite()) {
        return *laid;
    }
    let scaled = scaled.symmetric_eigen();
    let known = scaled.eigenvalues.map(|value| value.max(f64::MIN_POSITIVE));
    let off = scaled.eigenvectors.tr_mul(&local(laid, surveyed).component_div(&sigmas));
    let squared_sigmas = off.zip_map(&known, |off, known| off.powi(2) / (1.0 + known.recip())).sum();
    let survey = cauchy(squared_sigmas, config.weak_sigmas);
    let least = config.weak_times.powi(-2);
    let taken = off.zip_map(&known, |off, known| if known < least { off * survey / (survey + known) } else { 0.0 });
    retract(laid, &(scale * scaled.eigenvectors * taken))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where a scan goes that was laid so far off the survey along x, y and z, known to so much
    /// along these, and well turned.
    fn held(sigmas_m: [f64; 3], off_m: f64) -> [f64; 3] {
        let config = GraphConfig { motion_inflation: 1.0, ..GraphConfig::default() };
        let known = Tangent::from_fn(|i, _| sigmas_m.get(i).map_or(1e8, |sigma_m| sigma_m.powi(-2)));
        let surveyed = Pose::translation(off_m, off_m, off_m);
        held_by_survey(&Pose::identity(), &Matrix6::from_diagonal(&known), &surveyed, &config).translation.vector.into()
    }

    #[test]
    fn the_survey_holds_a_scan_where_it_is_hardly_known() {
        let [along, aside, up] = held([0.5, 0.01, 0.03], 0.1);
        assert!(along > 0.09, "{along}");
        assert!(aside.abs() < 1e-9 && up.abs() < 1e-9, "{aside} {up}");
    }

    #[test]
    fn a_survey_that_is_far_off_moves_no_scan_that_is_known() {
        let near = held([0.1, 0.01, 0.01], 0.1)[0] / 0.1;
        let far = held([0.1, 0.01, 0.01], 3.0)[0] / 3.0;
        assert!(near > 0.5 && far < 0.05, "{near} {far}");
    }

    #[test]
    fn what_is_no_number_holds_nothing() {
        let (laid, config) = (Pose::translation(1.0, 0.0, 0.0), GraphConfig::default());
        let held = held_by_survey(&laid, &Matrix6::from_element(f64::NAN), &Pose::identity(), &config);
        assert_eq!(held, laid);
    }
}
