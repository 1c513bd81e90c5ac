//! Figures, and two columns of them.

use std::fmt::Write as _;

/// One figure of one drive.
#[derive(Debug, Clone)]
pub struct Row {
    name: String,
    value: f64,
    /// How many observations it comes from.
    count: usize,
}

/// Observations.
#[derive(Debug, Clone, Default)]
pub struct Samples(Vec<f64>);

impl Samples {
    /// Adds one.
    pub fn push(&mut self, value: f64) {
        self.0.push(value);
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Row of their mean.
    pub fn mean(&self, name: impl Into<String>) -> Row {
        let value = self.0.iter().sum::<f64>() / self.0.len() as f64;
        Row { name: name.into(), value, count: self.0.len() }
    }

    /// Row of the value that a share of them lies below.
    pub fn quantile(&self, name: impl Into<String>, share: f64) -> Row {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        let index = (share * sorted.len().saturating_sub(1) as f64).round() as usize;
        Row { name: name.into(), value: sorted.get(index).copied().unwrap_or(f64::NAN), count: sorted.len() }
    }

    /// Rows of the median and the 95th percentile of the magnitudes.
    pub fn magnitudes(&self, name: &str) -> [Row; 2] {
        let magnitudes = Self(self.0.iter().map(|v| v.abs()).collect());
        [magnitudes.quantile(format!("{name}, median"), 0.5), magnitudes.quantile(format!("{name}, p95"), 0.95)]
    }
}

/// How many of how many.
#[derive(Debug, Clone, Copy, Default)]
pub struct Share {
    hits: usize,
    all: usize,
}

impl Share {
    /// Counts one.
    pub fn add(&mut self, hit: bool) {
        self.hits += usize::from(hit);
        self.all += 1;
    }

    /// Row of the share.
    pub fn row(&self, name: impl Into<String>) -> Row {
        Row { name: name.into(), value: self.hits as f64 / self.all as f64, count: self.all }
    }
}

/// Row of a count per frame.
pub fn per_frame(name: impl Into<String>, count: usize, frames: usize) -> Row {
    Row { name: name.into(), value: count as f64 / frames as f64, count }
}

/// Both columns and their ratio: `*` where they differ by more than a quarter,
/// `(*)` where one of them comes from fewer than [`FEW`] observations. In
/// brackets the numbers of observations.
pub fn side_by_side(real: &[Row], generated: &[Row]) -> String {
    /// A share of 20 observations is uncertain by about a quarter of itself.
    const FEW: usize = 20;
    let mut text = format!("{:<58} {:>17} {:>17} {:>7}\n", "", "real", "generated", "ratio");
    for (real, generated) in real.iter().zip(generated) {
        let ratio = generated.value / real.value;
        let beyond = !(0.8..=1.25).contains(&ratio) && real.value.to_bits() != generated.value.to_bits();
        let mark = match (beyond, real.count.min(generated.count) < FEW) {
            (true, true) => " (*)",
            (true, false) => " *",
            _ => "",
        };
        let cell = |row: &Row| format!("{:.3} ({})", row.value, row.count);
        let name = &real.name;
        let _ = writeln!(text, "{name:<58} {:>17} {:>17} {ratio:>7.2}{mark}", cell(real), cell(generated));
    }
    text
}
