//! What single rows of hits say about what is on a post at their heights, and
//! how far they are to be believed.

use std::collections::BTreeMap;

use super::config::OutlineConfig;
use super::rows::{Axis, REACH_M, Row};
use super::views::Views;

/// What a row says about its height.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Says {
    /// It is longer than its post is wide, and ends on both sides.
    Plate,
    /// A short row of retro-reflective sheeting: a plate that is partly hidden.
    PartOfPlate,
    /// A short row on the axis.
    Post,
    /// A short row beside the axis: leaves, or a plate behind leaves.
    Nothing,
}

impl Says {
    /// Whether it says that there is a plate.
    pub fn is_plate(self) -> bool {
        matches!(self, Self::Plate | Self::PartOfPlate)
    }
}

/// A row and what it says.
#[derive(Debug, Clone, Copy)]
pub struct Told<'a> {
    /// The row.
    pub row: &'a Row,
    /// What it says.
    pub says: Says,
    /// Share of the beams beside it that something nearer takes.
    pub hidden: f64,
    /// How much it counts against a plate at its height: 1, or less where it is hidden
    /// itself, or [`doubt`] finds that leaves hide the plate from its scan.
    pub weight: f64,
}

/// What each row says by itself, in the order of their heights.
pub fn each<'a>(rows: &'a [Row], axis: &Axis, config: &OutlineConfig) -> Vec<Told<'a>> {
    let mut told: Vec<Told<'_>> =
        rows.iter().map(|row| Told { row, says: says(row, axis, config), hidden: 0.0, weight: 1.0 }).collect();
    told.sort_by(|a, b| a.row.height_m.total_cmp(&b.row.height_m).then(a.row.scan.cmp(&b.row.scan)));
    told
}

/// Lets rows of the bare post count less from where something nearer takes the beams
/// beside them: they may be what shows of a plate.
pub fn doubt_hidden(told: &mut [Told<'_>], axis: &Axis, views: &Views<'_>, config: &OutlineConfig) {
    for told in told.iter_mut().filter(|t| t.says == Says::Post) {
        let row = told.row;
        let half_m = 0.5 * row.range_m * views.lidar.elevation_step_rad;
        let heights = (row.height_m - half_m, row.height_m + half_m);
        told.hidden = views.hidden_share(row.scan, &axis.at(row.height_m), HALF_PLATE_M, heights);
        told.weight = weight(told.hidden, config);
    }
}

/// Half of a usual plate, metres.
const HALF_PLATE_M: f64 = 0.25;

/// What a row of the bare post counts that may be one of a plate with so much of it
/// hidden.
fn weight(hidden: f64, config: &OutlineConfig) -> f64 {
    (hidden.max(config.odd_share).ln() / config.odd_share.ln()).clamp(0.0, 1.0)
}

fn says(row: &Row, axis: &Axis, config: &OutlineConfig) -> Says {
    let beam_m = config.beam_rad * row.range_m;
    let post_m = (2.0 * axis.radius_m + config.slack_m).max(config.narrowest_m) + beam_m;
    let aside_m = axis.radius_m + config.slack_m + beam_m;
    if row.width_m() > post_m {
        let ends = row.span_m.0 > -0.95 * REACH_M && row.span_m.1 < 0.95 * REACH_M;
        if ends { Says::Plate } else { Says::Nothing }
    } else if row.brightest >= config.bright {
        Says::PartOfPlate
    } else if f64::midpoint(row.span_m.0, row.span_m.1).abs() < aside_m {
        Says::Post
    } else {
        Says::Nothing
    }
}

/// Lets rows of the bare post count less where their scan has others among the
/// rows of what looks like one plate: leaves hide it from there. With `h`, the
/// share of the plate's rows that the scan's other rows let expect hidden (the
/// mean of a Beta distribution that `odd_share` and `telling_rows` begin), one
/// more has the weight `ln h / ln odd_share`; and with what [`doubt_hidden`] found of
/// the row, if that is more.
pub fn doubt(of_plate: &mut [Told<'_>], config: &OutlineConfig) {
    // Rows and short rows of each scan.
    let mut counts: BTreeMap<u16, (f64, f64)> = BTreeMap::new();
    for told in of_plate.iter().filter(|t| t.says != Says::Nothing) {
        let (rows, short) = counts.entry(told.row.scan).or_default();
        *rows += 1.0;
        *short += f64::from(u8::from(told.says == Says::Post));
    }
    for told in of_plate.iter_mut().filter(|t| t.says == Says::Post) {
        if let Some((rows, short)) = counts.get(&told.row.scan) {
            let hidden = (short - 1.0 + config.odd_share * config.telling_rows) / (rows - 1.0 + config.telling_rows);
            told.weight = weight(hidden.max(told.hidden), config);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signs::rows::row_across;

    #[test]
    fn a_short_row_is_doubted_where_its_scan_has_more_of_them() {
        let config = OutlineConfig::default();
        let axis = Axis::through(&nalgebra::Point3::origin(), 0.04);
        // The first scan sees a post between two plates, the second one through
        // leaves, the third one beam only.
        let rows: Vec<Row> = (0..12)
            .flat_map(|i| {
                let height = 2.0 + 0.05 * f64::from(i);
                let clear = row_across(0, height, if i == 6 { 0.06 } else { 0.6 });
                let leaves = row_across(1, height + 0.01, if i % 2 == 0 { 0.06 } else { 0.6 });
                [clear, leaves]
            })
            .chain([row_across(2, 2.3, 0.06)])
            .collect();
        let mut told = each(&rows, &axis, &config);
        doubt(&mut told, &config);
        let weights = |scan: u16| {
            let short = told.iter().filter(move |t| t.row.scan == scan && t.says == Says::Post);
            short.map(|t| t.weight).collect::<Vec<f64>>()
        };
        assert_eq!((weights(0), weights(2)), (vec![1.0], vec![1.0]));
        assert!(weights(1).len() == 6 && weights(1).iter().all(|w| (0.2..0.6).contains(w)), "{:?}", weights(1));
    }
}
