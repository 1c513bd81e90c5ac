//! Plates along a post: where its rows are long, and how far that reaches.

use nalgebra::Vector2;

use super::config::OutlineConfig;
use super::plate::{MARGIN_M, Plate, cosine, lowest_of_scans, plane, plate, width_m};
use super::rows::{Axis, Row};
use super::stacked::{Ends, gaps};
use super::told::{Says, Told, doubt, doubt_hidden, each};
use super::views::Views;
use crate::lidar::LidarConfig;

/// The axis with the radius of its bare post: where plates hang on it, what
/// was fitted to it is wider. A third of the rows at least are narrow.
pub fn bare(axis: &Axis, rows: &[Row], config: &OutlineConfig) -> Axis {
    let mut widths: Vec<f64> = rows.iter().map(|r| r.width_m() - config.beam_rad * r.range_m).collect();
    widths.sort_by(f64::total_cmp);
    let narrow_m = widths.get(widths.len() / 3).map_or(0.0, |w| w.max(0.0));
    Axis { radius_m: axis.radius_m.min(0.5 * narrow_m), ..*axis }
}

/// The plates among the rows of an axis, from below.
pub fn plates(rows: &[Row], axis: &Axis, views: &Views<'_>, config: &OutlineConfig) -> Vec<Plate> {
    let axis = &bare(axis, rows, config);
    let mut told = each(rows, axis, config);
    doubt_hidden(&mut told, axis, views, config);
    for (from, to) in joined(segments(&told, config), &told) {
        doubt(&mut told[from..=to], config);
    }
    let runs = segments(&told, config);
    runs.iter()
        .enumerate()
        .flat_map(|(i, &(from, to))| {
            // Edge-on a plate is as narrow as its post: rows that look along it
            // say nothing, and without them the plate may be two.
            let (low, high) = (told[from].row.height_m, told[to].row.height_m);
            let long = told[from..=to].iter().filter(|t| t.says == Says::Plate).map(|t| t.row);
            let Some((normal, _)) = plane(&long.collect::<Vec<_>>()) else { return Vec::new() };
            // Rows of its neighbours would make one of them.
            let after_last = i.checked_sub(1).map_or(0, |last| runs[last].1 + 1);
            let before_next = runs.get(i + 1).map_or(told.len(), |next| next.0);
            let facing: Vec<Told<'_>> = told[after_last..before_next]
                .iter()
                .filter(|t| t.row.height_m >= low - MARGIN_M && t.row.height_m <= high + MARGIN_M)
                .filter(|t| t.row.view.dot(&normal).abs() >= config.least_cosine)
                .copied()
                .collect();
            segments(&facing, config)
                .into_iter()
                .flat_map(|s| each_plate(&facing, s, &normal, config, views.lidar))
                .flat_map(|s| unbroken(&facing, s, views, config))
                .filter_map(|s| plate(&facing, s, axis, views, config))
                .collect()
        })
        .collect()
}

/// Runs that are near to each other as one: what leaves cut in two is looked at
/// as a whole.
fn joined(runs: Vec<(usize, usize)>, told: &[Told<'_>]) -> Vec<(usize, usize)> {
    let mut joined: Vec<(usize, usize)> = Vec::new();
    for (from, to) in runs {
        match joined.last_mut() {
            Some(last) if told[from].row.height_m - told[last.1].row.height_m < MARGIN_M => last.1 = to,
            _ => joined.push((from, to)),
        }
    }
    joined
}

/// The parts of a plate between which so many beams missed it that it is not
/// one: where no post stands behind it nothing else says so.
fn unbroken(
    rows: &[Told<'_>],
    (from, to): (usize, usize),
    views: &Views<'_>,
    config: &OutlineConfig,
) -> Vec<(usize, usize)> {
    let on: Vec<usize> = (from..=to).filter(|&i| rows[i].says.is_plate()).collect();
    let scans = lowest_of_scans(on.iter().map(|&i| rows[i].row));
    let beams = |low: f64, high: f64| -> f64 {
        let of_scan =
            |row: &&Row| (high.min(views.ceiling(row)) - low).max(0.0) / (row.range_m * views.lidar.elevation_step_rad);
        scans.iter().map(of_scan).sum()
    };
    let mut parts = Vec::new();
    let mut first = from;
    for pair in on.windows(2) {
        if beams(rows[pair[0]].row.height_m, rows[pair[1]].row.height_m) > config.most_missed {
            parts.push((first, pair[0]));
            first = pair[1];
        }
    }
    parts.push((first, to));
    parts
}

/// The plates among the rows of a run, first and last index of each.
fn each_plate(
    rows: &[Told<'_>],
    (from, to): (usize, usize),
    normal: &Vector2<f64>,
    config: &OutlineConfig,
    lidar: &LidarConfig,
) -> Vec<(usize, usize)> {
    let telling: Vec<usize> = (from..=to).filter(|&i| matches!(rows[i].says, Says::Plate | Says::Post)).collect();
    let ends = |&i: &usize| {
        let Told { row, says, weight, .. } = rows[i];
        let between_m = lidar.azimuth_step_rad * row.range_m;
        // From behind, left is right.
        let to_plate = row.view.dot(normal).signum() / cosine(row, normal);
        Ends {
            height_m: row.height_m,
            middle_m: f64::midpoint(row.span_m.0, row.span_m.1) * to_plate,
            width_m: width_m(row, normal, config, lidar),
            // An end lies anywhere between two beams.
            sigma_m: config.noise_m.hypot(between_m / 12.0_f64.sqrt()),
            width_sigma_m: config.pose_m.hypot(between_m / 6.0_f64.sqrt()),
            is_bare: says == Says::Post,
            weight,
        }
    };
    let ends: Vec<Ends> = telling.iter().map(ends).collect();
    let mut plates = Vec::new();
    let mut first = from;
    for gap in gaps(&ends, config) {
        plates.push((first, telling[gap.start - 1]));
        first = telling[gap.end];
    }
    plates.push((first, to));
    plates
}

/// Runs of long rows, first and last index: the most likely sequence of plate
/// and bare post (Viterbi 1967), where every row that does not fit costs its
/// weight and every edge `edge_cost`.
fn segments(rows: &[Told<'_>], config: &OutlineConfig) -> Vec<(usize, usize)> {
    let mut cost = [0.0, config.edge_cost];
    let mut came_from: Vec<[usize; 2]> = Vec::with_capacity(rows.len());
    for told in rows {
        let misfit = match told.says {
            Says::Plate | Says::PartOfPlate => [1.0, 0.0],
            Says::Post => [0.0, told.weight],
            Says::Nothing => [0.0, 0.0],
        };
        let mut next = [0.0; 2];
        let mut from = [0, 1];
        for state in 0..2 {
            let (stay, change) = (cost[state], cost[1 - state] + config.edge_cost);
            (next[state], from[state]) = if change < stay { (change, 1 - state) } else { (stay, state) };
            next[state] += misfit[state];
        }
        cost = next;
        came_from.push(from);
    }
    let mut state = usize::from(cost[1] + config.edge_cost < cost[0]);
    let mut found = Vec::new();
    let mut end = None;
    for i in (0..rows.len()).rev() {
        if state == 1 && end.is_none() {
            end = Some(i);
        }
        let before = came_from[i][state];
        if state == 1
            && (before == 0 || i == 0)
            && let Some(last) = end.take()
        {
            found.push((i, last));
        }
        state = before;
    }
    found.reverse();
    found
}
