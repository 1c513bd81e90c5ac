//! What single rows of hits say about what is on a post at their heights, and
//! how far they are to be believed.

use std::collections::BTreeMap;

use super::config::OutlineConfig;
use super::rows::{Axis, REACH_M, Row};

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

/// A row and what it says.
#[derive(Debug, Clone, Copy)]
pub struct Told<'a> {
    /// The row.
    pub row: &'a Row,
    /// What it says.
    pub says: Says,
    /// What it costs, in rows that do not fit, to take it for a plate that is
    /// hidden on both sides, if it is as short as a post is wide: 1 unless
    /// [`doubt`] says otherwise.
    pub hidden_cost: f64,
}

/// What each row says by itself, in the order of their heights.
pub fn each<'a>(rows: &'a [Row], axis: &Axis, config: &OutlineConfig) -> Vec<Told<'a>> {
    let mut told: Vec<Told<'_>> =
        rows.iter().map(|row| Told { row, says: says(row, axis, config), hidden_cost: 1.0 }).collect();
    told.sort_by(|a, b| a.row.height.total_cmp(&b.row.height).then(a.row.scan.cmp(&b.row.scan)));
    told
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

/// Doubts the short rows of scans that show the post in many places of what
/// looks like one plate, all between two heights: leaves hide it from there.
/// Of the scan's other rows so many are short that a share `h` of a plate's are,
/// by `odd_share` and as many rows as `telling_rows` before any is seen (a Beta
/// prior); one more costs `ln h / ln odd_share`.
pub fn doubt(between: &mut [Told<'_>], config: &OutlineConfig) {
    // Rows and short rows of each scan.
    let mut counts: BTreeMap<u16, (f64, f64)> = BTreeMap::new();
    for told in between.iter().filter(|t| t.says != Says::Nothing) {
        let (rows, short) = counts.entry(told.row.scan).or_default();
        *rows += 1.0;
        *short += f64::from(u8::from(told.says == Says::Post));
    }
    for told in between.iter_mut().filter(|t| t.says == Says::Post) {
        if let Some((rows, short)) = counts.get(&told.row.scan) {
            let hidden = (short - 1.0 + config.odd_share * config.telling_rows) / (rows - 1.0 + config.telling_rows);
            told.hidden_cost = (hidden.ln() / config.odd_share.ln()).min(1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Point2, Vector2};

    use super::*;

    /// A row of a scan, so long, in the middle of the post.
    fn row(scan: u16, height: f64, width_m: f64) -> Row {
        Row {
            scan,
            range_m: 20.0,
            height,
            above_ground_m: height,
            view: Vector2::y(),
            span_m: (-width_m / 2.0, width_m / 2.0),
            middle: Point2::origin(),
            scatter: Matrix2::zeros(),
            hits: Vec::new(),
            reflectance: 0.4,
            brightest: 0.4,
        }
    }

    #[test]
    fn a_short_row_is_doubted_where_its_scan_has_more_of_them() {
        let config = OutlineConfig::default();
        let axis = Axis::through(&nalgebra::Point3::origin(), 0.04);
        // The first scan sees a post between two plates, the second one through
        // leaves, the third one beam only.
        let rows: Vec<Row> = (0..12)
            .flat_map(|i| {
                let height = 2.0 + 0.05 * f64::from(i);
                let clear = row(0, height, if i == 6 { 0.06 } else { 0.6 });
                let leaves = row(1, height + 0.01, if i % 2 == 0 { 0.06 } else { 0.6 });
                [clear, leaves]
            })
            .chain([row(2, 2.3, 0.06)])
            .collect();
        let mut told = each(&rows, &axis, &config);
        doubt(&mut told, &config);
        let costs = |scan: u16| {
            let short = told.iter().filter(move |t| t.row.scan == scan && t.says == Says::Post);
            short.map(|t| t.hidden_cost).collect::<Vec<f64>>()
        };
        assert_eq!((costs(0), costs(2)), (vec![1.0], vec![1.0]));
        assert!(costs(1).len() == 6 && costs(1).iter().all(|cost| (0.2..0.6).contains(cost)), "{:?}", costs(1));
    }
}
