//! Lines in one region: which of its rows support the same straight pole.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg32;

use super::stem::UprightLine;
use crate::vision::Plane;
use crate::vision::centre::{Centre, median};
use crate::vision::config::PoleConfig;
use crate::vision::regions::Region;

/// A line with the rows that support it without a larger gap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Support {
    pub(super) line: UprightLine,
    /// First and last row.
    pub(super) rows: (f64, f64),
    /// Median width along a row.
    pub(super) width_px: f64,
}

/// Rows without support that end a stretch: masks have holes of this size
/// where wires, arms and leaves cross.
const MAX_HOLE_ROWS: f64 = 6.0;

/// The centres of a region's runs. Where a run has two hills with a valley
/// between them, two poles touch there, and each hill gives a centre.
pub(super) fn centres(plane: &Plane, region: &Region) -> Vec<Centre> {
    let mut centres = Vec::with_capacity(region.runs.len());
    for run in &region.runs {
        let values = &plane.row(run.y)[run.start..run.end];
        let mut from = 0;
        for valley in valleys(values).into_iter().chain([values.len()]) {
            centres.extend(Centre::of(&values[from..valley], run.start + from, run.y));
            from = valley;
        }
    }
    centres
}

/// The lowest places between hills that rise to twice their height and by at
/// least a fifth of certainty on both sides.
fn valleys(values: &[u8]) -> Vec<usize> {
    const RISE: u8 = 51;
    let rises = |from: u8, to: u8| to >= from.saturating_add(RISE) && u16::from(to) >= 2 * u16::from(from);
    let mut found = Vec::new();
    let mut hill = 0;
    // The lowest place since the last hill.
    let mut lowest: Option<(usize, u8)> = None;
    for (i, &value) in values.iter().enumerate() {
        match lowest {
            Some((at, low)) if rises(low, value) && rises(low, hill) => {
                found.push(at);
                (hill, lowest) = (value, None);
            }
            _ if value >= hill => (hill, lowest) = (value, None),
            Some((_, low)) if low <= value => {}
            _ => lowest = Some((i, value)),
        }
    }
    found
}

/// The line that most rows support (section IV.B), by mass; none where it
/// would be shorter than `min_rows`.
pub(super) fn best_line(centres: &[Centre], min_rows: f64, config: &PoleConfig, seed: u64) -> Option<Support> {
    let (first, last) = centres.first().zip(centres.last())?;
    if last.v_px - first.v_px + 1.0 < min_rows {
        return None;
    }
    let steepest = config.max_tilt_deg.to_radians().tan();
    let mut random = Pcg32::seed_from_u64(config.ransac_seed ^ seed);
    let mut best: Option<(f64, UprightLine)> = None;
    for _ in 0..config.ransac_rounds {
        let a = &centres[random.random_range(0..centres.len())];
        let b = &centres[random.random_range(0..centres.len())];
        // Neighbouring rows give no direction.
        if (b.v_px - a.v_px).abs() < 0.3 * min_rows {
            continue;
        }
        let slope = (b.u_px - a.u_px) / (b.v_px - a.v_px);
        if slope.abs() > steepest {
            continue;
        }
        let line = UprightLine { u_px: a.u_px, v_px: a.v_px, slope };
        // Rows count by how well they agree, not by yes or no.
        let score: f64 = centres.iter().map(|c| (1.0 - (off(c, &line) / tolerance(c, config)).powi(2)).max(0.0)).sum();
        if best.is_none_or(|(most, _)| score > most) {
            best = Some((score, line));
        }
    }
    let (_, line) = best?;
    stretch(centres, line, config).filter(|s| s.rows.1 - s.rows.0 + 1.0 >= min_rows)
}

/// Drops the centres that belong to a line.
pub(super) fn remove(centres: &mut Vec<Centre>, line: &UprightLine, rows: (f64, f64)) {
    centres.retain(|c| {
        let within = c.v_px >= rows.0 && c.v_px <= rows.1;
        !(within && off(c, line) <= 0.5 * c.width_px + 1.5)
    });
}

fn off(centre: &Centre, line: &UprightLine) -> f64 {
    (centre.u_px - line.at(centre.v_px)).abs()
}

fn tolerance(centre: &Centre, config: &PoleConfig) -> f64 {
    config.inlier_px.max(config.inlier_width_share * centre.width_px)
}

/// The longest stretch of supporting rows: beyond a gap may stand another
/// pole that happens to be in line; whether it is the same is decided later.
fn stretch(centres: &[Centre], line: UprightLine, config: &PoleConfig) -> Option<Support> {
    let near: Vec<&Centre> = centres.iter().filter(|c| off(c, &line) <= tolerance(c, config)).collect();
    let longest = near.chunk_by(|a, b| b.v_px - a.v_px <= MAX_HOLE_ROWS).max_by_key(|chunk| chunk.len())?;
    Some(Support {
        line,
        rows: (longest.first()?.v_px, longest.last()?.v_px),
        width_px: median(longest.iter().map(|c| c.width_px)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_valley_parts_two_hills_and_a_ripple_does_not() {
        assert_eq!(valleys(&[30, 200, 255, 90, 40, 120, 250, 30]), [4]);
        assert!(valleys(&[30, 200, 255, 190, 210, 255, 30]).is_empty());
        assert!(valleys(&[30, 60, 90, 120, 200, 255]).is_empty());
        assert_eq!(valleys(&[255, 0, 255, 0, 255]), [1, 3]);
    }
}
