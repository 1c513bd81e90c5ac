//! Medians and other quantiles.

/// The value below which a share of the values lies; of an even number of them the median
/// is the larger of both in the middle. None of no values, which are put into another order.
pub(crate) fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let at = ((values.len() as f64 * share) as usize).min(last);
    Some(*values.select_nth_unstable_by(at, f64::total_cmp).1)
}

/// The median, of an even number the larger of both in the middle: of two
/// passes the one that saw more of a landmark, of many what most agree on. 0
/// for no values.
pub(crate) fn upper_median(mut values: Vec<f64>) -> f64 {
    quantile(&mut values, 0.5).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_of_the_values_lies_below() {
        assert!((upper_median(vec![4.0, 1.0]) - 4.0).abs() < 1e-12);
        assert!((upper_median(vec![4.0, 1.0, 2.0]) - 2.0).abs() < 1e-12);
        let at = |share| quantile(&mut [3.0, 0.0, 2.0, 1.0, 4.0], share).unwrap();
        for (share, value) in [(0.0, 0.0), (0.3, 1.0), (0.8, 4.0), (1.0, 4.0)] {
            assert!((at(share) - value).abs() < 1e-12, "{share}");
        }
        assert!(quantile(&mut [], 0.5).is_none() && upper_median(Vec::new()).abs() < 1e-12);
    }
}
