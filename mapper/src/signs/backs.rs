//! Plates on posts that are not retro-reflective from where they were seen:
//! mostly the backs of signs for the other direction.

use common::map::SignKind;
use nalgebra::{Point3, Vector2};

use super::config::{BackConfig, LightConfig, SignConfig};
use super::outline::plates;
use super::plate::Plate;
use super::rows::{Axis, Row};
use super::views::Views;
use super::{FoundSign, POST_BELOW_M};

/// What is known of a post before it is asked what hangs on it.
#[derive(Debug, Clone, Copy)]
pub struct Known {
    /// It carries a sign: another one is told from less then.
    pub carries_sign: bool,
    /// It is hidden but for what hangs on it.
    pub is_hidden: bool,
}

/// The plates among the rows of a post from so high on, metres above ground.
pub fn plates_on(
    rows: &[Row],
    axis: &Axis,
    lowest_m: f64,
    known: Known,
    views: &Views<'_>,
    config: &SignConfig,
) -> Vec<FoundSign> {
    let all = plates(rows, axis, views, &config.outline);
    let found = |known: Known| -> Vec<FoundSign> {
        let is_plate = |p: &&Plate| {
            p.above_ground_m >= lowest_m
                && (is_housing(p, &config.lights) || aside_m(p, axis) <= config.backs.largest_aside * p.width_m)
                && is_back(p, rows, &all, known, config)
        };
        all.iter().filter(is_plate).map(|p| sign(p, &config.lights)).collect()
    };
    let sure = found(known);
    if known.carries_sign || sure.is_empty() { sure } else { found(Known { carries_sign: true, ..known }) }
}

/// How far the middle of a plate is to the side of its post, metres.
fn aside_m(plate: &Plate, axis: &Axis) -> f64 {
    let off = Vector2::new(plate.centroid.x, plate.centroid.z) - axis.at(-plate.centroid.y).coords;
    plate.normal.perp(&off).abs()
}

/// Whether it is the housing of a light: dark and narrow. The backs of signs are bare
/// metal.
fn is_housing(plate: &Plate, lights: &LightConfig) -> bool {
    plate.reflectance.is_some_and(|r| r <= lights.darkest) && plate.width_m <= lights.width_m[1]
}

/// What a plate on a post is. Upper edges of lights are seldom seen.
fn sign(plate: &Plate, lights: &LightConfig) -> FoundSign {
    if !is_housing(plate, lights) {
        return plate.sign(SignKind::TrafficSign);
    }
    let (low, high) = plate.edges;
    let height_m = lights.usual_heights_m[1].max(high - low);
    FoundSign {
        centroid: Point3::new(plate.centroid.x, -(low + 0.5 * height_m), plate.centroid.z),
        size_m: plate.width_m.hypot(height_m),
        ..plate.sign(SignKind::TrafficLight)
    }
}

fn is_back(plate: &Plate, rows: &[Row], all: &[Plate], known: Known, config: &SignConfig) -> bool {
    let backs = &config.backs;
    let height_m = plate.edges.1 - plate.edges.0;
    let [narrowest, widest] = backs.width_m;
    let lowest = all.iter().map(|p| p.edges.0).fold(f64::INFINITY, f64::min);
    let below = (lowest - POST_BELOW_M)..lowest;
    let widths = |heights: std::ops::Range<f64>, widest_m: f64| {
        let mut widths_m: Vec<f64> =
            rows.iter().filter(|r| heights.contains(&r.height_m)).map(Row::width_m).filter(|w| *w < widest_m).collect();
        widths_m.sort_by(f64::total_cmp);
        widths_m
    };
    let (post_m, plate_m) = (widths(below, narrowest), widths(plate.edges.0..plate.edges.1, f64::INFINITY));
    // A round mast is as wide from all sides, and turned into a plane wider.
    let stands_out = || match (post_m.get(post_m.len() / 2), plate_m.get(plate_m.len() * 4 / 5)) {
        (Some(post_m), Some(plate_m)) => *plate_m >= backs.least_over_post * post_m,
        _ => false,
    };
    let fewest_rows = if known.carries_sign { backs.fewest_rows_beside } else { backs.fewest_rows };
    height_m >= backs.least_height_m
        && (narrowest..=widest).contains(&plate.width_m)
        && height_m <= backs.largest_aspect * plate.width_m
        && plate.width_m <= backs.largest_aspect * height_m
        && plate.thickness_m <= backs.thickest_m
        && plate.rows >= fewest_rows
        && plate.scans >= backs.fewest_scans
        && plate.agreement >= backs.least_agreement
        && (known.is_hidden || shows_alone(plate, config) || (post_m.len() >= backs.fewest_post_rows && stands_out()))
}

/// Whether it can be nothing but a plate, wherever its post is: a hedge may reach up
/// to its lower edge.
fn shows_alone(plate: &Plate, config: &SignConfig) -> bool {
    let SignConfig { outline, backs: BackConfig { alone, .. }, .. } = config;
    let aspect = (plate.edges.1 - plate.edges.0) / plate.width_m;
    plate.rows >= alone.fewest_rows
        && plate.scans >= alone.fewest_scans
        && plate.agreement >= alone.least_agreement
        && aspect.ln().abs() <= NINE_IN_TEN * outline.aspect_spread
}

/// Standard deviations within which nine in ten of what is normal lie.
const NINE_IN_TEN: f64 = 1.645;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signs::rows::row_across;

    /// A board so wide from 1.8 to 2.4 m above the ground.
    fn board(width_m: f64) -> Plate {
        Plate {
            centroid: Point3::new(0.0, -2.1, 0.0),
            sigma_m: [0.02; 3],
            edges: (1.8, 2.4),
            above_ground_m: 1.8,
            width_m,
            size_m: width_m.hypot(0.6),
            normal: Vector2::y(),
            thickness_m: 0.01,
            top_is_open: false,
            rows: 12,
            scans: 3,
            hits: 60,
            agreement: 1.0,
            reflectance: Some(0.4),
            bright_share: 0.0,
        }
    }

    /// Whether a board passes for the back of a sign on a post so wide.
    fn is_sign(plate: &Plate, post_m: f64, known: Known) -> bool {
        let heights = |from: f64, count: i32| (0..count).map(move |k| from + 0.05 * f64::from(k));
        let rows: Vec<Row> = heights(0.9, 18)
            .map(|height| row_across(0, height, post_m))
            .chain(heights(1.81, 12).map(|height| row_across(0, height, plate.width_m)))
            .collect();
        is_back(plate, &rows, std::slice::from_ref(plate), known, &SignConfig::default())
    }

    const UNKNOWN: Known = Known { carries_sign: false, is_hidden: false };

    #[test]
    fn a_thick_mast_is_no_sign_where_it_is_somewhat_wider_and_a_board_on_it_is() {
        let is_sign = |width_m: f64, post_m: f64| is_sign(&board(width_m), post_m, UNKNOWN);
        assert!(!is_sign(0.32, 0.22) && is_sign(0.5, 0.22));
        // On a thin post the same width is a sign.
        assert!(is_sign(0.32, 0.06));
    }

    #[test]
    fn a_whole_board_needs_no_post_below_it_and_what_leaves_may_be_does() {
        let whole = Plate { rows: 18, scans: 6, agreement: 1.0, ..board(0.6) };
        let is_sign = |plate: &Plate| is_back(plate, &[], std::slice::from_ref(plate), UNKNOWN, &SignConfig::default());
        assert!(is_sign(&whole));
        // Seen by few, with gaps, and as high as a trunk is.
        let others = [
            Plate { rows: 12, ..whole.clone() },
            Plate { scans: 4, ..whole.clone() },
            Plate { agreement: 0.95, ..whole.clone() },
            Plate { width_m: 0.32, ..whole },
        ];
        assert!(!others.iter().any(is_sign));
    }

    #[test]
    fn the_post_of_a_sign_is_behind_its_middle() {
        let axis = |x: f64| Axis::through(&Point3::new(x, -1.0, 0.0), 0.04);
        assert!((aside_m(&board(0.6), &axis(0.2)) - 0.2).abs() < 1e-9);
        // In front of it and behind it is not beside it.
        let before = Plate { normal: Vector2::x(), ..board(0.6) };
        assert!(aside_m(&before, &axis(0.2)) < 1e-9);
    }

    #[test]
    fn beside_a_sign_another_one_is_told_from_less() {
        let seldom_seen = Plate { rows: 4, agreement: 0.75, ..board(0.5) };
        assert!(!is_sign(&seldom_seen, 0.06, UNKNOWN));
        assert!(is_sign(&seldom_seen, 0.06, Known { carries_sign: true, ..UNKNOWN }));
    }

    #[test]
    fn a_board_of_which_leaves_cut_every_fourth_row_is_a_sign_and_of_every_third_none() {
        let is_sign = |agreement: f64| is_sign(&Plate { agreement, ..board(0.5) }, 0.06, UNKNOWN);
        assert!(is_sign(0.75) && !is_sign(0.66));
    }

    #[test]
    fn what_is_dark_and_narrow_is_a_light_and_ends_above_what_is_seen() {
        let lights = LightConfig::default();
        let kind =
            |width_m: f64, reflectance: Option<f32>| sign(&Plate { reflectance, ..board(width_m) }, &lights).kind;
        assert_eq!(kind(0.32, Some(0.05)), SignKind::TrafficLight);
        // Bare metal, what was seen from afar only, and what is wider than any housing.
        let others = [kind(0.32, Some(0.4)), kind(0.32, None), kind(0.6, Some(0.05))];
        assert_eq!(others, [SignKind::TrafficSign; 3]);
        let light = sign(&Plate { reflectance: Some(0.05), ..board(0.32) }, &lights);
        assert!((light.centroid.y + 1.8 + 0.45).abs() < 1e-9, "{light:?}");
    }
}
