//! Plates on posts that are not retro-reflective from where they were seen:
//! mostly the backs of signs for the other direction.

use common::map::SignKind;

use super::config::SignConfig;
use super::outline::{Plate, plates};
use super::rows::{Axis, Row};
use super::{FoundSign, POST_BELOW_M};
use crate::cloud::Cloud;
use crate::lidar::LidarConfig;

/// The plates among the rows of a post from so high on, metres above ground.
pub fn plates_on(
    rows: &[Row],
    axis: &Axis,
    lowest_m: f64,
    cloud: &Cloud,
    config: &SignConfig,
    lidar: &LidarConfig,
) -> Vec<FoundSign> {
    let all = plates(rows, axis, cloud, &config.outline, lidar);
    let is_plate = |plate: &&Plate| plate.above_ground_m >= lowest_m && is_back(plate, rows, &all, config);
    all.iter().filter(is_plate).map(|p| p.sign(SignKind::TrafficSign)).collect()
}

fn is_back(plate: &Plate, rows: &[Row], all: &[Plate], config: &SignConfig) -> bool {
    let backs = &config.backs;
    let height_m = plate.edges.1 - plate.edges.0;
    let [narrowest, widest] = backs.width_m;
    let lowest = all.iter().map(|p| p.edges.0).fold(f64::INFINITY, f64::min);
    let below = (lowest - POST_BELOW_M)..lowest;
    let widths = |heights: std::ops::Range<f64>, widest_m: f64| {
        let mut widths_m: Vec<f64> =
            rows.iter().filter(|r| heights.contains(&r.height)).map(Row::width_m).filter(|w| *w < widest_m).collect();
        widths_m.sort_by(f64::total_cmp);
        widths_m
    };
    let (post_m, plate_m) = (widths(below, narrowest), widths(plate.edges.0..plate.edges.1, f64::INFINITY));
    // A round mast is as wide from all sides, and turned into a plane wider.
    let stands_out = match (post_m.get(post_m.len() / 2), plate_m.get(plate_m.len() * 4 / 5)) {
        (Some(post_m), Some(plate_m)) => *plate_m >= backs.least_over_post * post_m,
        _ => false,
    };
    height_m >= backs.least_height_m
        && (narrowest..=widest).contains(&plate.width_m)
        && height_m <= backs.largest_aspect * plate.width_m
        && plate.width_m <= backs.largest_aspect * height_m
        && plate.thickness_m <= backs.thickest_m
        && plate.rows >= backs.fewest_rows
        && plate.scans >= backs.fewest_scans
        && plate.agreement >= backs.least_agreement
        && post_m.len() >= backs.fewest_post_rows
        && stands_out
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector2};

    use super::*;
    use crate::signs::rows::row_across;

    /// Whether what is so wide, on a post so wide, passes for the back of a sign.
    fn is_sign(width_m: f64, post_m: f64) -> bool {
        let plate = Plate {
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
            reflectance: 0.4,
            bright_share: 0.0,
        };
        let heights = |from: f64, count: i32| (0..count).map(move |k| from + 0.05 * f64::from(k));
        let rows: Vec<Row> = heights(0.9, 18)
            .map(|height| row_across(0, height, post_m))
            .chain(heights(1.81, 12).map(|height| row_across(0, height, width_m)))
            .collect();
        is_back(&plate, &rows, std::slice::from_ref(&plate), &SignConfig::default())
    }

    #[test]
    fn a_thick_mast_is_no_sign_where_it_is_somewhat_wider_and_a_board_on_it_is() {
        assert!(!is_sign(0.32, 0.22) && is_sign(0.5, 0.22));
        // On a thin post the same width is a sign.
        assert!(is_sign(0.32, 0.06));
    }
}
