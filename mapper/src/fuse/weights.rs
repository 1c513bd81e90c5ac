//! Positions by their information.

use nalgebra::{Matrix3, Point3, Vector3};

use super::FuseConfig;

/// Sum of positions weighted by their information.
#[derive(Debug, Clone)]
pub(super) struct Mean {
    information: Matrix3<f64>,
    weighted: Vector3<f64>,
}

impl Mean {
    pub fn new() -> Self {
        Self { information: Matrix3::zeros(), weighted: Vector3::zeros() }
    }

    pub fn add(&mut self, point: &Point3<f64>, information: &Matrix3<f64>) {
        self.information += information;
        self.weighted += information * point.coords;
    }

    /// The mean and its covariance; none where nothing was added.
    pub fn finish(&self) -> Option<(Point3<f64>, Matrix3<f64>)> {
        let covariance = self.information.try_inverse()?;
        Some((Point3::from(covariance * self.weighted), covariance))
    }
}

/// The covariance (square metres) of a sighting with what all sightings share;
/// the default where none is given or it is none.
pub(super) fn covariance_m2(given: Option<&Matrix3<f64>>, config: &FuseConfig) -> Matrix3<f64> {
    let floor = Matrix3::identity() * config.floor_sigma_m.max(1e-4).powi(2);
    let default = Matrix3::identity() * config.default_sigma_m.powi(2);
    let is_covariance = |p: &Matrix3<f64>| p.iter().all(|v| v.is_finite()) && (p + floor).cholesky().is_some();
    let sound = given.map(|p| (p + p.transpose()) * 0.5).filter(is_covariance);
    sound.unwrap_or(default) + floor
}

/// The inverse of a covariance as [`covariance_m2`] gives them.
pub(super) fn information(covariance_m2: &Matrix3<f64>) -> Matrix3<f64> {
    covariance_m2.try_inverse().unwrap_or_else(Matrix3::identity)
}

/// The kind that most have; of equally many the one with more information in
/// all, then the first.
pub(super) fn vote<K: Copy + Ord>(ballots: impl Iterator<Item = (K, f64)>) -> Option<K> {
    let mut ballots: Vec<(K, f64)> = ballots.collect();
    ballots.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let counted = ballots.chunk_by(|a, b| a.0 == b.0);
    let results = counted.filter_map(|same| Some((same.first()?.0, same.len(), same.iter().map(|b| b.1).sum::<f64>())));
    results.reduce(|best, next| if (next.1, next.2) > (best.1, best.2) { next } else { best }).map(|won| won.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_where_the_information_is() {
        let mut mean = Mean::new();
        assert_eq!(mean.finish(), None);
        mean.add(&Point3::new(0.0, 0.0, 0.0), &Matrix3::from_diagonal(&Vector3::new(3.0, 1.0, 1.0)));
        mean.add(&Point3::new(4.0, 4.0, 4.0), &Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 3.0)));
        let (point, covariance) = mean.finish().unwrap();
        assert!((point - Point3::new(1.0, 2.0, 3.0)).norm() < 1e-12);
        assert!((covariance - Matrix3::from_diagonal(&Vector3::new(0.25, 0.5, 0.25))).norm() < 1e-12);
    }

    #[test]
    fn what_is_no_covariance_counts_as_unknown() {
        let config = FuseConfig::default();
        let unknown = covariance_m2(None, &config);
        for wrong in [Matrix3::repeat(f64::NAN), Matrix3::identity() * -1.0] {
            assert_eq!(covariance_m2(Some(&wrong), &config), unknown);
        }
        let known = covariance_m2(Some(&Matrix3::zeros()), &config);
        assert!((known[(0, 0)].sqrt() - config.floor_sigma_m).abs() < 1e-12);
    }

    #[test]
    fn most_votes_win_and_information_breaks_ties() {
        assert_eq!(vote([(1, 9.0), (2, 1.0), (2, 1.0)].into_iter()), Some(2));
        assert_eq!(vote([(1, 1.0), (2, 2.0)].into_iter()), Some(2));
        assert_eq!(vote(std::iter::empty::<(u8, f64)>()), None);
    }
}
