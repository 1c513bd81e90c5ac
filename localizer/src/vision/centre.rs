//! What one row (or column) of a region says about a line through it.

/// The part of a row that shows a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Centre {
    /// Its weighted centre, pixels along the row.
    pub(super) u_px: f64,
    /// The row.
    pub(super) v_px: f64,
    /// Its width along the row, pixels: that of a bar of the row's largest
    /// probability with the same sum.
    pub(super) width_px: f64,
    /// Sum of the probabilities.
    pub(super) mass: f64,
}

impl Centre {
    /// Of neighbouring values of a row, the first one at column `start`; none
    /// where all are zero.
    pub(super) fn of(values: &[u8], start: usize, row: usize) -> Option<Self> {
        let sum: u64 = values.iter().map(|&v| u64::from(v)).sum();
        let moment: u64 = (0..).zip(values).map(|(i, &v)| i * u64::from(v)).sum();
        let peak = values.iter().copied().max().filter(|&peak| peak > 0)?;
        Some(Self {
            u_px: start as f64 + moment as f64 / sum as f64,
            v_px: row as f64,
            width_px: sum as f64 / f64::from(peak),
            mass: sum as f64 / 255.0,
        })
    }
}

/// The middle one; of an even number, the upper of the two. Zero of none.
pub(super) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
