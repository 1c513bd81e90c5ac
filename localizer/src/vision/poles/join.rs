//! Pieces of one pole: regions that a sign, an arm or a gap in the mask parts.

use super::stem::{Stem, UprightLine};
use crate::vision::config::PoleConfig;
use crate::vision::{Class, ProbabilityMaps};

/// Rows by which two pieces of one pole may overlap.
const OVERLAP_ROWS: f64 = 4.0;

/// Joins pieces, the closest ones first, until none fit.
pub(super) fn join(mut stems: Vec<Stem>, maps: &ProbabilityMaps, config: &PoleConfig) -> Vec<Stem> {
    loop {
        let mut best: Option<(f64, usize, usize, Stem)> = None;
        for (i, upper) in stems.iter().enumerate() {
            for (j, lower) in stems.iter().enumerate() {
                let gap = lower.upper_v_px - upper.lower_v_px;
                if i == j || gap < -OVERLAP_ROWS || best.as_ref().is_some_and(|(least, ..)| gap >= *least) {
                    continue;
                }
                if let Some(joined) = joined(upper, lower, gap, maps, config) {
                    best = Some((gap, i, j, joined));
                }
            }
        }
        let Some((_, i, j, joined)) = best else { return stems };
        stems[i] = joined;
        stems.remove(j);
    }
}

/// Both pieces as one, where one straight line explains them and nothing
/// speaks against the gap.
fn joined(upper: &Stem, lower: &Stem, gap: f64, maps: &ProbabilityMaps, config: &PoleConfig) -> Option<Stem> {
    let longer = upper.rows().max(lower.rows());
    // Cheap tests first: nearly all pairs fail here.
    let wide = upper.width_px.max(lower.width_px);
    let limit = config.max_residual_px.max(config.max_residual_width_share * wide);
    let middle = 0.5 * (upper.lower_v_px + lower.upper_v_px);
    let steepest = config.max_tilt_deg.to_radians().tan();
    if (upper.line.at(middle) - lower.line.at(middle)).abs() > 2.0 * limit + steepest * gap.max(0.0)
        || (upper.width_px - lower.width_px).abs() > 1.5 + 0.4 * wide
        || (gap > config.max_gap_share * longer && !is_hidden(upper, lower, maps))
    {
        return None;
    }
    let mut both = Stem {
        line: if upper.rows() > lower.rows() { upper.line } else { lower.line },
        centres: upper.centres.iter().chain(&lower.centres).copied().collect(),
        width_px: (upper.width_px * upper.rows() + lower.width_px * lower.rows()) / (upper.rows() + lower.rows()),
        upper_v_px: upper.upper_v_px,
        lower_v_px: lower.lower_v_px,
    };
    both.centres.sort_by(|a, b| a.v_px.total_cmp(&b.v_px));
    both.centres.dedup_by(|a, b| a.v_px - b.v_px < 0.5);
    both.fit()?;
    // Each piece must lie on the joint line: the longer one alone would carry
    // a shorter one that stands beside it.
    let lies_on_it = |stem: &Stem| {
        let off: f64 = stem.centres.iter().map(|c| c.u_px - both.line.at(c.v_px)).sum();
        (off / stem.centres.len().max(1) as f64).abs() <= limit
    };
    (both.residual_px() <= limit && lies_on_it(upper) && lies_on_it(lower)).then_some(both)
}

/// Whether signs or lights fill most of the gap between two pieces.
fn is_hidden(upper: &Stem, lower: &Stem, maps: &ProbabilityMaps) -> bool {
    const HIDING: u8 = 64;
    let rows = upper.lower_v_px.ceil() as usize..=lower.upper_v_px.floor().max(0.0) as usize;
    let count = rows.clone().count();
    let hidden = rows.filter(|&row| hiding(maps, &upper.line, row as f64) >= HIDING).count();
    2 * hidden > count
}

/// How probably a sign or a light is at a row of a line.
pub(super) fn hiding(maps: &ProbabilityMaps, line: &UprightLine, v: f64) -> u8 {
    let u = line.at(v);
    maps.plane(Class::Sign).at(u, v).max(maps.plane(Class::Light).at(u, v))
}
