//! Plates one above the other on a post with hardly a row of hits between them.
//!
//! A gap of a hand's width is narrower than that between two beams at 10 m. But
//! plates are convex, and hang in the middle of their post: how far their edges
//! are from it changes with the height as a concave function, and of a narrow
//! board below a wide one it does not. So rows are told apart where two shapes
//! explain their ends much better than one does. What something hides of a plate
//! is no narrower plate: it ends on one side where the rest of it does.

use std::ops::Range;

use nalgebra::{Matrix2, Vector2};

use super::config::OutlineConfig;
use crate::quantile::quantile;

/// Where a row ends on both sides.
#[derive(Debug, Clone, Copy)]
pub struct Ends {
    /// Height along -y of the map, metres.
    pub height_m: f64,
    /// Its middle across the plate, metres.
    pub middle_m: f64,
    /// Its length across the plate, metres.
    pub width_m: f64,
    /// Standard deviation of each end, metres.
    pub sigma_m: f64,
    /// Standard deviation of its length, metres.
    pub width_sigma_m: f64,
    /// It shows the bare post.
    pub is_bare: bool,
    /// How much it counts, up to 1.
    pub weight: f64,
}

/// Where the rows of one run (ascending heights) are those of several plates: the
/// rows between them, none where they touch. A row that does not fit costs up to
/// 1, and another plate `stacked_cost` and `stacked_share` of the rows.
pub fn gaps(rows: &[Ends], config: &OutlineConfig) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    divide(rows, 0, config, &mut found);
    found
}

fn divide(rows: &[Ends], first: usize, config: &OutlineConfig, found: &mut Vec<Range<usize>>) {
    let gap = |at: usize| {
        let start = rows[..at].iter().rposition(|row| !row.is_bare).map_or(0, |last| last + 1);
        let end = rows[at..].iter().position(|row| !row.is_bare).map_or(rows.len(), |more| at + more);
        start..end
    };
    let is_plate = |rows: &[Ends]| {
        rows.iter().filter(|row| !row.is_bare).count() >= FEWEST_ROWS
            && rows[rows.len() - 1].height_m - rows[0].height_m >= config.least_stacked_m
    };
    let level = |row: &Ends| (row.height_m / LEVEL_M).floor();
    let parts = (1..rows.len())
        .filter(|&at| level(&rows[at]) > level(&rows[at - 1]))
        .map(gap)
        .filter(|gap| is_plate(&rows[..gap.start]) && is_plate(&rows[gap.end..]))
        .map(|gap| (plate_cost(&rows[..gap.start], config) + plate_cost(&rows[gap.end..], config), gap))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((as_two, gap)) = parts else { return };
    let another = config.stacked_cost + config.stacked_share * rows.len() as f64;
    if as_two + another < plate_cost(rows, config) {
        divide(&rows[..gap.start], first, config, found);
        found.push(first + gap.start..first + gap.end);
        divide(&rows[gap.end..], first + gap.end, config, found);
    }
}

/// Fewest rows that tell a plate from a stray.
const FEWEST_ROWS: usize = 4;

/// Boundaries are looked for at each such step in height, metres: however many
/// rows there are.
const LEVEL_M: f64 = 0.01;

/// One end of a row: where it is above the middle of the run and beside that of
/// the plate, metres.
#[derive(Clone, Copy)]
struct Edge<'a> {
    row: &'a Ends,
    up_m: f64,
    aside_m: f64,
}

/// How badly rows fit a plate, in rows: the best convex shape, and how unusual its
/// height is for its width (log-normal, and an odd row has a chance of `odd_share`),
/// up to `tallest_stack`: what is higher is a mast or a jamb, and no stack of plates.
fn plate_cost(rows: &[Ends], config: &OutlineConfig) -> f64 {
    let height_m = rows[rows.len() - 1].height_m - rows[0].height_m;
    let aspect = height_m.max(config.least_stacked_m) / widest_m(rows).max(config.narrowest_m);
    let unusual = (aspect.min(config.tallest_stack).ln() / config.aspect_spread).powi(2) / 2.0;
    shape_cost(rows, config) - unusual / config.odd_share.ln()
}

/// The length of the longest rows, metres: these are not hidden.
fn widest_m(rows: &[Ends]) -> f64 {
    of_share(rows, WHOLE, |row| row.width_m)
}

/// The value that a share of the rows lies below.
fn of_share(rows: &[Ends], share: f64, value: fn(&Ends) -> f64) -> f64 {
    quantile(&mut rows.iter().map(value).collect::<Vec<_>>(), share).unwrap_or(0.0)
}

/// How badly rows fit the best convex shape, in rows.
fn shape_cost(rows: &[Ends], config: &OutlineConfig) -> f64 {
    let width_m = widest_m(rows);
    let whole: Vec<Ends> = rows.iter().copied().filter(|row| row.width_m >= LEAST_WHOLE * width_m).collect();
    let middle_m = of_share(&whole, 0.5, |row| row.middle_m);
    let origin = rows[rows.len() / 2].height_m;
    let edges: Vec<Edge<'_>> = rows
        .iter()
        .flat_map(|row| {
            let off_m = row.middle_m - middle_m;
            [off_m, -off_m].map(|off_m| Edge { row, up_m: row.height_m - origin, aside_m: row.width_m / 2.0 + off_m })
        })
        .collect();
    let (low, high) = (rows[0].height_m - origin, rows[rows.len() - 1].height_m - origin);
    let hidden = config.hidden_cost;
    let straight = straight_cost(&edges, hidden, width_m / 2.0, |up_m| up_m - low);
    let diamonds = [0.25, 0.5, 0.75].map(|share| {
        let tip_m = low + (high - low) * share;
        straight_cost(&edges, hidden, width_m / 2.0, |up_m| (up_m - tip_m).abs())
    });
    diamonds.into_iter().fold(straight.min(disc_cost(&edges, hidden)), f64::min)
}

/// The share of rows that are shorter than the plate is wide at most.
const WHOLE: f64 = 0.8;

/// Least length of rows whose middles count, over that.
const LEAST_WHOLE: f64 = 0.75;

/// Standard deviations within which an edge fits.
const FITS: f64 = 3.0;

/// The cost of rows whose ends, in pairs, lie so far outside of a plate, metres;
/// of one of which one end only fits it is `hidden`.
fn rows_cost(edges: &[Edge<'_>], hidden: f64, off_m: impl Fn(&Edge<'_>) -> f64) -> f64 {
    let misfit = |off_m: f64, sigma_m: f64| (off_m / (FITS * sigma_m)).powi(2).min(1.0);
    let of_row = |ends: &[Edge<'_>]| {
        let (row, offs_m) = (ends[0].row, [off_m(&ends[0]), off_m(&ends[1])]);
        // Rows lie beside each other by more than their lengths differ.
        let as_whole =
            misfit(offs_m[0] + offs_m[1], row.width_sigma_m).max(misfit((offs_m[0] - offs_m[1]) / 2.0, row.sigma_m));
        if offs_m[0] + offs_m[1] > 0.0 {
            // Nothing hides what is not there.
            return as_whole;
        }
        let nearer_m = offs_m[0].abs().min(offs_m[1].abs());
        as_whole.min(hidden + (1.0 - hidden) * misfit(nearer_m, row.sigma_m))
    };
    edges.chunks_exact(2).map(|ends| of_row(ends) * ends[0].row.weight).sum()
}

/// The cost of edges whose distance from the middle changes evenly with `x` of
/// the height (robust least squares): boards, triangles, and diamonds where that
/// is the distance from their widest place.
fn straight_cost(edges: &[Edge<'_>], hidden: f64, usual_m: f64, x: impl Fn(f64) -> f64) -> f64 {
    let off_m = |edge: &Edge<'_>, line: &Vector2<f64>| edge.aside_m - line.x - line.y * x(edge.up_m);
    // From a board as wide as its longest rows, and from all rows alike.
    let starts = [Some(Vector2::new(usual_m, 0.0)), None];
    let costs = starts.map(|start| {
        let mut line = start;
        for _ in 0..ROUNDS {
            let (mut h, mut g) = (Matrix2::identity() * 1e-9, Vector2::zeros());
            for edge in edges {
                let weight = line.as_ref().map_or(1.0, |line| robust(off_m(edge, line) / edge.row.sigma_m));
                let a = Vector2::new(1.0, x(edge.up_m));
                h += a * a.transpose() * weight;
                g += a * (edge.aside_m * weight);
            }
            line = h.try_inverse().map(|inverse| inverse * g);
        }
        line.map_or(f64::INFINITY, |line| rows_cost(edges, hidden, |edge| off_m(edge, &line)))
    });
    costs[0].min(costs[1])
}

/// Rounds of reweighting: the first few settle which edges fit.
const ROUNDS: usize = 4;

/// Weight of an edge so many standard deviations off (Geman and `McClure`).
fn robust(off: f64) -> f64 {
    (1.0 + (off / FITS).powi(2)).powi(-2)
}

/// The cost of a disc: `aside^2 + up^2 = 2 c up + r^2 - c^2` is linear in its
/// middle `c` and in what is left.
fn disc_cost(edges: &[Edge<'_>], hidden: f64) -> f64 {
    // At its ends the edge changes much with the height, of which a row is
    // unsure: it may be that of a disc a little higher or lower.
    let off_m = |edge: &Edge<'_>, &(middle_m, radius2_m2): &(f64, f64)| {
        let aside_m = |up_m: f64| (radius2_m2 - up_m.powi(2)).max(0.0).sqrt();
        let up_m = (edge.up_m - middle_m).abs();
        let (least_m, most_m) = (aside_m(up_m + HEIGHT_SIGMA_M), aside_m((up_m - HEIGHT_SIGMA_M).max(0.0)));
        edge.aside_m - edge.aside_m.clamp(least_m, most_m)
    };
    let mut disc = None;
    for _ in 0..ROUNDS {
        let (mut h, mut g) = (Matrix2::identity() * 1e-9, Vector2::zeros());
        for edge in edges {
            let weight = disc.as_ref().map_or(1.0, |disc| robust(off_m(edge, disc) / edge.row.sigma_m));
            let a = Vector2::new(2.0 * edge.up_m, 1.0);
            h += a * a.transpose() * weight;
            g += a * ((edge.aside_m.powi(2) + edge.up_m.powi(2)) * weight);
        }
        let Some(inverse) = h.try_inverse() else { return f64::INFINITY };
        let found = inverse * g;
        disc = Some((found.x, found.y + found.x.powi(2)));
    }
    disc.map_or(f64::INFINITY, |disc| rows_cost(edges, hidden, |edge| off_m(edge, &disc)))
}

/// Standard deviation of the height of a row, metres: the beam, and the poses.
const HEIGHT_SIGMA_M: f64 = 0.015;

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows as eight scans from 12 to 33 m leave them between two heights, with
    /// the ends that they have at each and the errors of real ones.
    fn rows(heights_m: (f64, f64), half_m: impl Fn(f64) -> f64) -> Vec<Ends> {
        let mut rows: Vec<Ends> = (0..8_u32)
            .flat_map(|scan| {
                let range_m = 12.0 + 3.0 * f64::from(scan);
                let (step_m, between_m) = (0.0073 * range_m, 0.003 * range_m);
                let shift = f64::from(scan) * 0.37 % 1.0;
                let beams = (0..).map(move |i| heights_m.0 + (f64::from(i) + shift) * step_m);
                beams.take_while(|height| *height < heights_m.1).map(move |height| (scan, height, between_m))
            })
            .map(|(scan, height, between_m)| {
                // Any value in -1..1.
                let noise = |salt: f64| (12.9898 * height * 100.0 + f64::from(scan) + salt).sin();
                Ends {
                    height_m: height,
                    middle_m: 0.02 * noise(1.0),
                    width_m: 2.0 * half_m(height) + 0.5 * between_m * noise(2.0),
                    sigma_m: 0.03_f64.hypot(between_m / 12.0_f64.sqrt()),
                    width_sigma_m: 0.015_f64.hypot(between_m / 6.0_f64.sqrt()),
                    is_bare: false,
                    weight: 1.0,
                }
            })
            .collect();
        rows.sort_by(|a, b| a.height_m.total_cmp(&b.height_m));
        rows
    }

    #[test]
    fn a_board_below_a_wider_plate_is_another() {
        let disc = |height: f64| (0.09 - (height - 0.66_f64).powi(2)).max(0.0).sqrt().max(0.04);
        let square = |height: f64| if height > 0.38 { 0.3 } else { 0.04 };
        for upper in [&disc as &dyn Fn(f64) -> f64, &square] {
            let mut stack = rows((0.0, 0.95), |height| if height < 0.32 { 0.21 } else { upper(height) });
            for row in &mut stack {
                row.is_bare = row.width_m < 0.12;
            }
            let gaps = gaps(&stack, &OutlineConfig::default());
            assert_eq!(gaps.len(), 1, "{gaps:?}");
            let (below, above) = (stack[gaps[0].start - 1].height_m, stack[gaps[0].end].height_m);
            // The gap is from 0.32 to 0.36 or 0.38 m, and rows are centimetres apart.
            assert!((0.26..0.36).contains(&below) && (0.32..0.44).contains(&above), "{below} {above}");
        }
    }

    #[test]
    fn what_is_much_higher_than_wide_is_rather_two_with_little_between_them() {
        // Two boards of nearly the same width, and some rows of the bare post.
        let with_gap = |top_m: f64, half_m: f64| {
            let mut stack = rows((0.0, top_m), |height| if height < 0.32 { half_m - 0.03 } else { half_m });
            for row in stack.iter_mut().filter(|row| (0.32..0.34).contains(&row.height_m)) {
                (row.width_m, row.is_bare) = (0.06, true);
            }
            gaps(&stack, &OutlineConfig::default()).len()
        };
        assert_eq!((with_gap(0.8, 0.15), with_gap(0.8, 0.35)), (1, 0));
    }

    #[test]
    fn whatever_is_convex_is_one() {
        let shapes: [&dyn Fn(f64) -> f64; 4] = [
            &|_| 0.3,
            &|height| (0.09 - (height - 0.3_f64).powi(2)).max(0.0).sqrt(),
            &|height| 0.45 - 0.75 * height,
            &|height| 0.3 - (height - 0.3_f64).abs(),
        ];
        for (i, shape) in shapes.into_iter().enumerate() {
            let rows = rows((0.01, 0.59), shape);
            assert!(rows.len() > 30 && gaps(&rows, &OutlineConfig::default()).is_empty(), "shape {i}");
        }
    }

    #[test]
    fn what_leaves_hide_is_no_narrower_plate() {
        let mut rows = rows((0.0, 0.6), |_| 0.3);
        let hidden = rows.iter_mut().filter(|row| row.height_m > 0.35).step_by(2);
        for (i, row) in hidden.enumerate() {
            let hidden_m = 0.1 + 0.05 * (i % 5) as f64;
            row.width_m -= hidden_m;
            row.middle_m += if i % 3 == 0 { 0.5 } else { -0.5 } * hidden_m;
        }
        assert!(gaps(&rows, &OutlineConfig::default()).is_empty());
    }

    #[test]
    fn few_rows_and_none_are_one() {
        let config = OutlineConfig::default();
        assert!(gaps(&[], &config).is_empty() && gaps(&rows((0.0, 0.1), |_| 0.2), &config).is_empty());
    }
}
