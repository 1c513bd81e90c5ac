//! Plates along a post: where its rows are long, and how far that reaches.

use nalgebra::{Matrix2, Point3, SymmetricEigen, Vector2};

use super::config::OutlineConfig;
use super::rows::{Axis, Row};
use super::stacked::{Ends, gaps};
use super::told::{Says, Told, doubt, each};
use crate::cloud::Cloud;
use crate::lidar::LidarConfig;

/// A plate or a box on an axis.
#[derive(Debug, Clone)]
pub struct Plate {
    /// Its middle, map frame, metres.
    pub centroid: Point3<f64>,
    /// One standard deviation of the middle across, in height, and along the
    /// normal, metres.
    pub sigma_m: [f64; 3],
    /// Lower and upper edge along -y of the map, metres.
    pub edges: (f64, f64),
    /// Lower edge above ground, metres.
    pub above_ground_m: f64,
    /// Width, metres.
    pub width_m: f64,
    /// Largest distance of two of its points, metres.
    pub size_m: f64,
    /// Unit normal in the plane (x, z), towards those who see its front or, where
    /// it was seen from behind only, away from those who saw it.
    pub normal: Vector2<f64>,
    /// Thickness within single rows, metres, one standard deviation.
    pub thickness_m: f64,
    /// Whether its upper edge lies above what any scan could see.
    pub top_is_open: bool,
    /// Long rows on it.
    pub rows: usize,
    /// Scans with long rows on it.
    pub scans: usize,
    /// Hits of its long rows.
    pub hits: usize,
    /// Share of the rows between its edges that are long.
    pub agreement: f64,
    /// Median reflectance of its rows.
    pub reflectance: f32,
    /// Share of retro-reflective rows among those that see its front from where
    /// the lidar reports reflectances.
    pub bright_share: f64,
}

/// The axis with the radius of its bare post: where plates hang on it, what
/// was fitted to it is wider. A third of the rows at least are narrow.
pub fn bare(axis: &Axis, rows: &[Row], config: &OutlineConfig) -> Axis {
    let mut widths: Vec<f64> = rows.iter().map(|r| r.width_m() - config.beam_rad * r.range_m).collect();
    widths.sort_by(f64::total_cmp);
    let narrow_m = widths.get(widths.len() / 3).map_or(0.0, |w| w.max(0.0));
    Axis { radius_m: axis.radius_m.min(0.5 * narrow_m), ..*axis }
}

/// The plates among the rows of an axis, from below.
pub fn plates(rows: &[Row], axis: &Axis, cloud: &Cloud, config: &OutlineConfig, lidar: &LidarConfig) -> Vec<Plate> {
    let axis = &bare(axis, rows, config);
    let mut told = each(rows, axis, config);
    for (from, to) in joined(segments(&told, config), &told) {
        doubt(&mut told[from..=to], config);
    }
    segments(&told, config)
        .into_iter()
        .flat_map(|(from, to)| {
            // Edge-on a plate is as narrow as its post: rows that look along it
            // say nothing, and without them the plate may be two.
            let (low, high) = (told[from].row.height, told[to].row.height);
            let long = told[from..=to].iter().filter(|t| t.says == Says::Plate).map(|t| t.row);
            let Some((normal, _)) = plane(&long.collect::<Vec<_>>()) else { return Vec::new() };
            let facing: Vec<Told<'_>> = told
                .iter()
                .filter(|t| t.row.height >= low - MARGIN_M && t.row.height <= high + MARGIN_M)
                .filter(|t| t.row.view.dot(&normal).abs() >= config.least_cosine)
                .copied()
                .collect();
            segments(&facing, config)
                .into_iter()
                // Its neighbours reach into the margin.
                .filter(|s| (low..=high).contains(&f64::midpoint(facing[s.0].row.height, facing[s.1].row.height)))
                .flat_map(|s| each_plate(&facing, s, &normal, config, lidar))
                .flat_map(|s| unbroken(&facing, s, cloud, config, lidar))
                .filter_map(|s| plate(&facing, s, axis, cloud, config, lidar))
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
            Some(last) if told[from].row.height - told[last.1].row.height < MARGIN_M => last.1 = to,
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
    cloud: &Cloud,
    config: &OutlineConfig,
    lidar: &LidarConfig,
) -> Vec<(usize, usize)> {
    let on: Vec<usize> = (from..=to).filter(|&i| rows[i].says.is_plate()).collect();
    let scans = lowest_of_scans(on.iter().map(|&i| rows[i].row));
    let beams = |low: f64, high: f64| -> f64 {
        let of_scan = |row: &&Row| {
            (high.min(ceiling(row, cloud, lidar)) - low).max(0.0) / (row.range_m * lidar.elevation_step_rad)
        };
        scans.iter().map(of_scan).sum()
    };
    let mut parts = Vec::new();
    let mut first = from;
    for pair in on.windows(2) {
        if beams(rows[pair[0]].row.height, rows[pair[1]].row.height) > config.most_missed {
            parts.push((first, pair[0]));
            first = pair[1];
        }
    }
    parts.push((first, to));
    parts
}

/// The first, and so the lowest, row of each scan.
fn lowest_of_scans<'a>(rows: impl Iterator<Item = &'a Row>) -> Vec<&'a Row> {
    let mut lowest: Vec<&Row> = rows.collect();
    lowest.sort_by_key(|row| row.scan);
    lowest.dedup_by_key(|row| row.scan);
    lowest
}

/// Height up to which the scan of a row sees there, along -y of the map, metres.
fn ceiling(row: &Row, cloud: &Cloud, lidar: &LidarConfig) -> f64 {
    cloud.sensors[usize::from(row.scan)].view_along(&row.view, row.range_m, lidar).ceiling(lidar)
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
        let Told { row, says, weight } = rows[i];
        let (cosine, between_m) = (row.view.dot(normal), lidar.azimuth_step_rad * row.range_m);
        // From behind, left is right.
        let to_plate = cosine.signum() / cosine.abs().max(0.3);
        Ends {
            height: row.height,
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

/// Rows this far beyond a plate tell where it ends, metres.
const MARGIN_M: f64 = 0.3;

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

/// Normal of the plane that the rows lie in and their thickness across it
/// (metres, one standard deviation), by what each row spreads about its own
/// middle: range errors that a beam has as a whole drop out.
fn plane(rows: &[&Row]) -> Option<(Vector2<f64>, f64)> {
    let scatter: Matrix2<f64> = rows.iter().map(|r| r.scatter).sum();
    let hits: usize = rows.iter().map(|r| r.hits.len() - 1).sum();
    let eigen = SymmetricEigen::new(scatter);
    let least = eigen.eigenvalues.imin();
    (hits > 0).then(|| {
        (eigen.eigenvectors.column(least).into_owned(), (eigen.eigenvalues[least].max(0.0) / hits as f64).sqrt())
    })
}

fn plate(
    rows: &[Told<'_>],
    (from, to): (usize, usize),
    axis: &Axis,
    cloud: &Cloud,
    config: &OutlineConfig,
    lidar: &LidarConfig,
) -> Option<Plate> {
    let of = |what: &dyn Fn(Says) -> bool| -> Vec<&Row> {
        rows[from..=to].iter().filter(|t| what(t.says)).map(|t| t.row).collect()
    };
    let long = of(&|s| s == Says::Plate);
    let on = of(&Says::is_plate);
    let (normal, thickness_m) = plane(&long)?;
    let (lowest, highest) = (on.first()?, on.last()?);
    let across = Vector2::new(-normal.y, normal.x);
    let origin = axis.at(highest.height).coords;
    let width = |r: &Row| width_m(r, &normal, config, lidar);
    // The widest rows, as a disc is narrower above and below.
    let mut widths: Vec<f64> = long.iter().map(|r| width(r)).collect();
    widths.sort_by(f64::total_cmp);
    let width_m = *widths.get(widths.len() * 4 / 5)?;
    let weighted = |value: &dyn Fn(&Row) -> f64| {
        // A row's ends are as exact as its hits are dense. One that is much
        // shorter than others may be hidden on one side.
        let whole = long.iter().filter(|r| width(r) >= config.least_whole_share * width_m);
        weighted_median(whole.map(|r| (value(r), r.range_m.powi(2).recip())).collect())
    };
    let aside_m = weighted(&|r| (r.middle.coords - origin).dot(&across))?;
    let before_m = weighted(&|r| (r.middle.coords - origin).dot(&normal))?;

    let scans = lowest_of_scans(on.iter().copied());
    let beams = |reaches: &dyn Fn(&Row, f64) -> bool| -> f64 {
        scans
            .iter()
            .map(|r| (r, r.range_m * lidar.elevation_step_rad))
            .filter(|(r, step)| reaches(r, *step))
            .map(|(_, step)| step.recip())
            .sum()
    };
    let above = beams(&|r, step| ceiling(r, cloud, lidar) > highest.height + 0.5 * step);
    let below = beams(&|_, _| true);
    let is_post = |t: &&Told<'_>| t.says == Says::Post;
    let next = |told: Option<&Told<'_>>, edge: f64| told.map_or(f64::INFINITY, |t| (t.row.height - edge).abs());
    let bottom = Edge::new(below, next(rows[..from].iter().rev().find(is_post), lowest.height));
    let top = Edge::new(above, next(rows[to + 1..].iter().find(is_post), highest.height));
    let low = lowest.height - bottom.beyond_m;
    let top_is_open = top.sigma_m > config.open_m;
    let high = upper_end(highest.height, &top, low, width_m, config);
    let top_sigma_m = top.sigma_m.min(config.open_m);
    let middle = f64::midpoint(low, high);
    let place = origin + across * aside_m + normal * before_m;
    let count = long.len() as f64;
    let noise_m = (config.noise_m.powi(2) / count + config.pose_m.powi(2)).sqrt();
    let mut reflectances: Vec<f32> = long.iter().map(|r| r.reflectance).collect();
    reflectances.sort_by(f32::total_cmp);
    // Bright rows see the front, and if none is bright all rows see the back.
    let is_bright = |r: &&&Row| r.brightest >= config.bright;
    let to_bright: f64 = -on.iter().filter(is_bright).map(|r| r.view.dot(&normal)).sum::<f64>();
    let to_front =
        if on.iter().any(|r| is_bright(&r)) { to_bright } else { on.iter().map(|r| r.view.dot(&normal)).sum::<f64>() };
    let normal = if to_front < 0.0 { -normal } else { normal };
    let front = || on.iter().filter(|r| r.view.dot(&normal) < 0.0 && r.range_m <= config.bright_within_m);
    let bright_share = front().filter(is_bright).count() as f64 / front().count().max(1) as f64;
    Some(Plate {
        centroid: Point3::new(place.x, -middle, place.y),
        sigma_m: [noise_m, (0.25 * (bottom.sigma_m.powi(2) + top_sigma_m.powi(2)) + noise_m.powi(2)).sqrt(), noise_m],
        edges: (low, high),
        above_ground_m: lowest.above_ground_m - bottom.beyond_m,
        width_m,
        size_m: size_m(&long, width_m, (low, high)),
        normal,
        thickness_m,
        top_is_open,
        rows: long.len(),
        scans: scans.len(),
        hits: on.iter().map(|r| r.hits.len()).sum(),
        agreement: on.len() as f64 / of(&|s| s != Says::Nothing).len().max(1) as f64,
        reflectance: reflectances[reflectances.len() / 2],
        bright_share,
    })
}

/// How wide a plate with this normal is at a row, metres.
fn width_m(row: &Row, normal: &Vector2<f64>, config: &OutlineConfig, lidar: &LidarConfig) -> f64 {
    row.width_m() / row.view.dot(normal).abs().max(0.3) + (lidar.azimuth_step_rad - config.beam_rad) * row.range_m
}

/// The diagonal of a board, the diameter of what is narrower above or below.
fn size_m(rows: &[&Row], width_m: f64, (low, high): (f64, f64)) -> f64 {
    let height_m = high - low;
    let at_end = |r: &&&Row| (r.height - low).min(high - r.height) < ROUND_END * height_m;
    let ends: Vec<f64> = rows.iter().filter(at_end).map(|r| r.width_m()).collect();
    let is_round = !ends.is_empty() && ends.iter().sum::<f64>() / (ends.len() as f64) < ROUND_SHARE * width_m;
    if is_round { width_m.max(height_m) } else { width_m.hypot(height_m) }
}

/// The upper and lower sixth of a disc are on average six tenths as wide as it is.
const ROUND_END: f64 = 1.0 / 6.0;
const ROUND_SHARE: f64 = 0.72;

/// How far an edge lies beyond the last row on the plate.
struct Edge {
    beyond_m: f64,
    sigma_m: f64,
}

impl Edge {
    /// Beams fall on a plate at arbitrary heights, `per_m` of them per metre in
    /// all scans together: the outermost lies `1 / per_m` from the edge on
    /// average (exponentially distributed, so that is its deviation, too), and
    /// not beyond the next row that misses the plate.
    fn new(per_m: f64, next_m: f64) -> Self {
        let mean_m = if per_m > 0.0 { per_m.recip() } else { f64::INFINITY };
        let beyond_m = mean_m.min(0.5 * next_m);
        let beyond_m = if beyond_m.is_finite() { beyond_m } else { 0.0 };
        Self { beyond_m, sigma_m: mean_m.min(next_m / 12.0_f64.sqrt()) }
    }
}

/// Height of the upper end of a plate over its highest row. Where no beam tells,
/// it is as high as discs, squares and triangles are, as much as it is wide: one
/// beam that may have missed it tells of no more.
fn upper_end(highest: f64, top: &Edge, low: f64, width_m: f64, config: &OutlineConfig) -> f64 {
    if top.sigma_m > config.open_m {
        highest.max(low + width_m.min(config.widest_like_high_m))
    } else {
        highest + top.beyond_m
    }
}

/// The value that half of the weight lies below.
fn weighted_median(mut values: Vec<(f64, f64)>) -> Option<f64> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = values.iter().map(|v| v.1).sum::<f64>() / 2.0;
    let mut sum = 0.0;
    values.into_iter().find_map(|(value, weight)| {
        sum += weight;
        (sum >= half).then_some(value)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plate_that_ends_out_of_sight_is_as_high_as_it_is_wide_or_as_it_is_seen() {
        let config = OutlineConfig::default();
        // From 2.0 m on, 0.6 m wide, metres over any level.
        let end = |highest: f64, beams_per_m: f64| {
            upper_end(highest, &Edge::new(beams_per_m, f64::INFINITY), 2.0, 0.6, &config)
        };
        // Many beams passed above it, one may have, none did.
        assert!((end(2.3, 50.0) - 2.32).abs() < 1e-9);
        assert!((end(2.3, 2.5) - 2.6).abs() < 1e-9 && (end(2.3, 0.0) - 2.6).abs() < 1e-9);
        assert!((end(2.9, 2.5) - 2.9).abs() < 1e-9);
    }
}
