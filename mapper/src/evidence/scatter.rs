//! Scatter of residuals within and between scans.

use std::collections::BTreeMap;

use nalgebra::SVector;

use super::EvidenceConfig;

/// Residuals along N axes of a landmark's points, in cells (the hits of one
/// beam, of one piece of a line) within scans.
#[derive(Debug, Clone, Default)]
pub struct Scatter<const N: usize> {
    cells: BTreeMap<(u16, i64), (SVector<f64, N>, f64)>,
    points: usize,
}

/// A scan's share: its mean residual and its number of cells.
struct ScanMean<const N: usize> {
    mean: SVector<f64, N>,
    cells: f64,
}

/// Variances of a residual per axis, square metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Components {
    /// Of a cell about its scan's mean.
    pub cell: f64,
    /// Of a scan's mean beyond what its cells explain: its pose.
    pub scan: f64,
    /// Of the mean of all scans.
    pub mean: f64,
}

impl<const N: usize> Scatter<N> {
    /// Adds a residual (metres) of a point.
    pub fn add(&mut self, scan: u16, cell: i64, residual_m: SVector<f64, N>) {
        let entry = self.cells.entry((scan, cell)).or_insert((SVector::zeros(), 0.0));
        entry.0 += residual_m;
        entry.1 += 1.0;
        self.points += 1;
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.points
    }

    /// Mean residual of each cell with its scan, in order.
    pub fn cells(&self) -> impl Iterator<Item = (u16, i64, SVector<f64, N>)> + '_ {
        self.cells.iter().map(|((scan, cell), (sum, count))| (*scan, *cell, sum / *count))
    }

    /// Number of scans.
    pub fn scans(&self) -> usize {
        self.scan_means().len()
    }

    fn scan_means(&self) -> BTreeMap<u16, ScanMean<N>> {
        let mut means: BTreeMap<u16, ScanMean<N>> = BTreeMap::new();
        for (scan, _, mean) in self.cells() {
            let of = means.entry(scan).or_insert(ScanMean { mean: SVector::zeros(), cells: 0.0 });
            of.mean += mean;
            of.cells += 1.0;
        }
        for of in means.values_mut() {
            of.mean /= of.cells;
        }
        means
    }

    /// One-way analysis of variance with scans as groups (Searle, Casella and
    /// `McCulloch`, Variance Components, 1992), each component drawn towards
    /// what is usual by as much as the expectation is worth.
    pub fn components(&self, config: &EvidenceConfig) -> Components {
        let means = self.scan_means();
        let (usual, axes) = (config.scan_sigma_scans, N as f64);
        let (mut within, mut freedom) = (0.0, 0.0);
        for (scan, _, cell) in self.cells() {
            within += means.get(&scan).map_or(0.0, |of| (cell - of.mean).norm_squared()) / axes;
        }
        for of in means.values() {
            freedom += of.cells - 1.0;
        }
        let cell = (usual * config.slice_sigma_m.powi(2) + within) / (usual + freedom);
        // As the fits do: a scan with many hits counts more, but not in
        // proportion, for they share its pose.
        let weight = |of: &ScanMean<N>| of.cells.sqrt();
        let total: f64 = means.values().map(weight).sum();
        if total <= 0.0 {
            let unknown = config.unknown_sigma_m.powi(2);
            return Components { cell, scan: unknown, mean: unknown };
        }
        let middle = means.values().map(|of| of.mean * weight(of)).sum::<SVector<f64, N>>() / total;
        let scans = means.len() as f64;
        let spread: f64 = means.values().map(|of| (of.mean - middle).norm_squared() / axes).sum();
        let by_cells: f64 = means.values().map(|of| cell / of.cells).sum::<f64>() * (scans - 1.0) / scans;
        let scan = (usual * config.scan_sigma_m.powi(2) + (spread - by_cells).max(0.0)) / (usual + scans - 1.0);
        let mean = means.values().map(|of| weight(of).powi(2) * (scan + cell / of.cells)).sum::<f64>() / total.powi(2);
        Components { cell, scan, mean }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64Mcg;

    #[test]
    fn the_error_of_the_mean_is_what_it_is_said_to_be() {
        let config = EvidenceConfig::default();
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let (pose, hit) = (Normal::new(0.0, 0.03).unwrap(), Normal::new(0.0, 0.04).unwrap());
        let (mut said, mut was) = (0.0, 0.0);
        for _ in 0..300 {
            let mut scatter = Scatter::<2>::default();
            let mut sum = (Vector2::<f64>::zeros(), 0.0);
            for scan in 0..6 {
                let shift = Vector2::new(pose.sample(&mut rng), pose.sample(&mut rng));
                let cells = 2 + 3 * i64::from(scan % 3);
                let mut mean = Vector2::zeros();
                for cell in 0..cells {
                    let residual = shift + Vector2::new(hit.sample(&mut rng), hit.sample(&mut rng));
                    mean += residual / cells as f64;
                    scatter.add(scan, cell, residual);
                }
                sum = (sum.0 + mean * (cells as f64).sqrt(), sum.1 + (cells as f64).sqrt());
            }
            said += scatter.components(&config).mean;
            was += (sum.0 / sum.1).norm_squared() / 2.0;
        }
        assert!((said / was - 1.0).abs() < 0.25, "{}", said / was);
    }

    #[test]
    fn many_hits_of_one_scan_do_not_make_it_sure() {
        let config = EvidenceConfig::default();
        let mut scatter = Scatter::<2>::default();
        for cell in 0..1000 {
            scatter.add(0, cell, Vector2::new(0.001 * (cell % 3) as f64, 0.0));
        }
        assert!(scatter.components(&config).mean.sqrt() >= config.scan_sigma_m * 0.99);
        assert!(Scatter::<1>::default().components(&config).mean.is_finite());
    }
}
