//! A plate as its rows outline it: where it is, how large, and which way it looks.

use nalgebra::{Matrix2, Point3, SymmetricEigen, Vector2};

use super::config::OutlineConfig;
use super::rows::{Axis, Row};
use super::told::{Says, Told};
use super::views::Views;
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
    /// Share of the rows between its edges that are long, each by what it counts.
    pub agreement: f64,
    /// Median reflectance of its rows from where the lidar reports reflectances; none
    /// where it was not seen from there.
    pub reflectance: Option<f32>,
    /// Share of retro-reflective rows among those that see its front from where
    /// the lidar reports reflectances.
    pub bright_share: f64,
}

/// Normal of the plane that the rows lie in and their thickness across it
/// (metres, one standard deviation), by what each row spreads about its own
/// middle: range errors that a beam has as a whole drop out.
pub(super) fn plane(rows: &[&Row]) -> Option<(Vector2<f64>, f64)> {
    let scatter: Matrix2<f64> = rows.iter().map(|r| r.scatter).sum();
    let hits: usize = rows.iter().map(|r| r.hits.len() - 1).sum();
    let eigen = SymmetricEigen::new(scatter);
    let least = eigen.eigenvalues.imin();
    (hits > 0).then(|| {
        (eigen.eigenvectors.column(least).into_owned(), (eigen.eigenvalues[least].max(0.0) / hits as f64).sqrt())
    })
}

/// The plate that rows outline, first and last of them; none where no row is long.
pub(super) fn plate(
    rows: &[Told<'_>],
    (from, to): (usize, usize),
    axis: &Axis,
    views: &Views<'_>,
    config: &OutlineConfig,
) -> Option<Plate> {
    let of = |what: &dyn Fn(Says) -> bool| -> Vec<&Row> {
        rows[from..=to].iter().filter(|t| what(t.says)).map(|t| t.row).collect()
    };
    let long = of(&|s| s == Says::Plate);
    let on = of(&Says::is_plate);
    let (normal, thickness_m) = plane(&long)?;
    let (lowest, highest) = (on.first()?, on.last()?);
    let across = Vector2::new(-normal.y, normal.x);
    let origin = axis.at(highest.height_m).coords;
    let width = |r: &Row| width_m(r, &normal, config, views.lidar);
    // The widest rows, as a disc is narrower above and below.
    let mut widths: Vec<f64> = long.iter().map(|r| width(r)).collect();
    widths.sort_by(f64::total_cmp);
    let width_m = *widths.get(widths.len() * 4 / 5)?;
    // A row's ends are as exact as its hits are dense.
    let weighted = |share: f64, value: &dyn Fn(&Row) -> f64| {
        weighted_quantile(long.iter().map(|r| (value(r), r.range_m.powi(2).recip())).collect(), share)
    };
    // What hides a side of a plate from some scans does not from others.
    let end_m = |side: f64| {
        let half_m = |r: &Row| 0.5 * r.width_m() / cosine(r, &normal);
        weighted(LONGEST, &|r| side * (r.middle.coords - origin).dot(&across) + half_m(r))
    };
    let aside_m = (end_m(1.0)? - end_m(-1.0)?) / 2.0;
    let before_m = weighted(0.5, &|r| (r.middle.coords - origin).dot(&normal))?;

    let scans = lowest_of_scans(on.iter().copied());
    let step_m = |r: &Row| r.range_m * views.lidar.elevation_step_rad;
    let place = origin + across * aside_m + normal * before_m;
    // Where leaves are before it no beam tells of a plate.
    let shown = |r: &Row| {
        let heights = (highest.height_m, views.ceiling(r).min(highest.height_m + MARGIN_M));
        1.0 - views.hidden_share(r.scan, &place.into(), MIDDLE * width_m * cosine(r, &normal), heights)
    };
    let reaches_above = |r: &&&Row| views.ceiling(r) > highest.height_m + 0.5 * step_m(r);
    let above: f64 = scans.iter().filter(reaches_above).map(|r| shown(r) / step_m(r)).sum();
    let below: f64 = scans.iter().map(|r| step_m(r).recip()).sum();
    let is_post = |t: &&Told<'_>| t.says == Says::Post && t.weight >= config.least_telling;
    let next = |told: Option<&Told<'_>>, edge: f64| told.map_or(f64::INFINITY, |t| (t.row.height_m - edge).abs());
    let bottom = Edge::new(below, next(rows[..from].iter().rev().find(is_post), lowest.height_m));
    let top = Edge::new(above, next(rows[to + 1..].iter().find(is_post), highest.height_m));
    let low = lowest.height_m - bottom.beyond_m;
    let top_is_open = top.sigma_m > config.open_m;
    let high = upper_end(highest.height_m, &top, low, width_m, config);
    let top_sigma_m = top.sigma_m.min(config.open_m);
    let middle = f64::midpoint(low, high);
    let count = long.len() as f64;
    let noise_m = (config.noise_m.powi(2) / count + config.pose_m.powi(2)).sqrt();
    let near = |r: &&&Row| r.range_m <= config.bright_within_m;
    let mut reflectances: Vec<f32> = long.iter().filter(near).map(|r| r.reflectance).collect();
    reflectances.sort_by(f32::total_cmp);
    // Bright rows see the front, and if none is bright all rows see the back.
    let is_bright = |r: &&&Row| r.brightest >= config.bright;
    let to_bright: f64 = -on.iter().filter(is_bright).map(|r| r.view.dot(&normal)).sum::<f64>();
    let to_front =
        if on.iter().any(|r| is_bright(&r)) { to_bright } else { on.iter().map(|r| r.view.dot(&normal)).sum::<f64>() };
    let normal = if to_front < 0.0 { -normal } else { normal };
    let front = || on.iter().filter(near).filter(|r| r.view.dot(&normal) < 0.0);
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
        agreement: agreement(&rows[from..=to]),
        reflectance: reflectances.get(reflectances.len() / 2).copied(),
        bright_share,
    })
}

/// The share of rows that say that there is a plate, each by what it counts: those
/// from where leaves hide it say little.
fn agreement(rows: &[Told<'_>]) -> f64 {
    let plate = rows.iter().filter(|t| t.says.is_plate()).count() as f64;
    let against: f64 = rows.iter().filter(|t| t.says == Says::Post).map(|t| t.weight).sum();
    plate / (plate + against).max(1.0)
}

/// Cosine between the view of a row and the normal of its plate, as far as ends of rows
/// that look along the plate tell anything.
pub(super) fn cosine(row: &Row, normal: &Vector2<f64>) -> f64 {
    row.view.dot(normal).abs().max(0.3)
}

/// How wide a plate with this normal is at a row, metres.
pub(super) fn width_m(row: &Row, normal: &Vector2<f64>, config: &OutlineConfig, lidar: &LidarConfig) -> f64 {
    row.width_m() / cosine(row, normal) + (lidar.azimuth_step_rad - config.beam_rad) * row.range_m
}

/// The diagonal of a board, the diameter of what is narrower above or below.
fn size_m(rows: &[&Row], width_m: f64, (low, high): (f64, f64)) -> f64 {
    let height_m = high - low;
    let at_end = |r: &&&Row| (r.height_m - low).min(high - r.height_m) < ROUND_END * height_m;
    let ends: Vec<f64> = rows.iter().filter(at_end).map(|r| r.width_m()).collect();
    let is_round = !ends.is_empty() && ends.iter().sum::<f64>() / (ends.len() as f64) < ROUND_SHARE * width_m;
    if is_round { width_m.max(height_m) } else { width_m.hypot(height_m) }
}

/// The upper and lower sixth of a disc are on average six tenths as wide as it is.
const ROUND_END: f64 = 1.0 / 6.0;
const ROUND_SHARE: f64 = 0.72;

/// Rows and beams this far beyond a plate tell where it ends, metres.
pub(super) const MARGIN_M: f64 = 0.3;

/// Beams tell of an edge that would meet the middle of a plate, so far to both sides
/// over its width: a disc is narrower above.
const MIDDLE: f64 = 0.3;

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

/// The value that a share of the weight lies below.
fn weighted_quantile(mut values: Vec<(f64, f64)>, share: f64) -> Option<f64> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let below = share * values.iter().map(|v| v.1).sum::<f64>();
    let mut sum = 0.0;
    values.into_iter().find_map(|(value, weight)| {
        sum += weight;
        (sum >= below).then_some(value)
    })
}

/// Share of the rows that end nearer to the middle of a plate than it does: of the
/// others leaves lengthen some.
const LONGEST: f64 = 0.9;

/// The first, and so the lowest, row of each scan.
pub(super) fn lowest_of_scans<'a>(rows: impl Iterator<Item = &'a Row>) -> Vec<&'a Row> {
    let mut lowest: Vec<&Row> = rows.collect();
    lowest.sort_by_key(|row| row.scan);
    lowest.dedup_by_key(|row| row.scan);
    lowest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signs::rows::row_across;

    #[test]
    fn rows_that_leaves_hide_count_little_against_a_plate() {
        let row = row_across(0, 2.0, 0.5);
        let told = |says: Says, weight: f64| Told { row: &row, says, hidden: 0.0, weight };
        let with = |weight: f64| {
            let plate = [told(Says::Plate, 1.0), told(Says::PartOfPlate, 1.0), told(Says::Nothing, 1.0)];
            agreement(&[plate.as_slice(), &[told(Says::Post, weight)]].concat())
        };
        assert!((with(1.0) - 2.0 / 3.0).abs() < 1e-9 && (with(0.25) - 2.0 / 2.25).abs() < 1e-9);
    }

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
