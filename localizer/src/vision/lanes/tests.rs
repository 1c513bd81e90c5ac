use common::geometry::ImageLine;

use super::*;
use crate::vision::config::Ground;
use crate::vision::synthetic::{bar, draw, empty};

fn lanes(maps: &ProbabilityMaps) -> Vec<LaneFeature> {
    extract(maps, &LaneConfig::default())
}

fn off(lane: &LaneFeature, a: (f64, f64), b: (f64, f64)) -> f64 {
    let line = ImageLine::through(&Point2::new(a.0, a.1), &Point2::new(b.0, b.1)).unwrap();
    lane.points_px.iter().map(|p| line.signed_distance_px(p).abs()).fold(0.0, f64::max)
}

#[test]
fn one_lane_runs_through_its_dashes() {
    // A dashed line in perspective: 3 m dashes, 6 m gaps, from 6 to 18 m.
    let (horizon, vanishing, scale) = (80.0, 190.0, 900.0);
    let at = |z: f64| (vanishing + 1.0 * scale / z, horizon + scale / z);
    let mut maps = empty();
    for z in [6.0, 15.0] {
        draw(&mut maps, Class::Lane, bar(at(z + 3.0), at(z), 6.0 * 6.0 / z));
    }
    let [lane] = &lanes(&maps)[..] else { panic!("{:?}", lanes(&maps)) };
    assert!(off(lane, at(18.0), at(6.0)) < 1.0);
    assert!(lane.line.lower_px.y > 225.0 && lane.line.upper_px.y < 135.0, "{:?}", lane.line);
    assert!(lane.points_px.windows(2).all(|pair| pair[0].y < pair[1].y));
}

#[test]
fn flat_and_steep_lines_have_their_centres() {
    for (a, b) in [((60.0, 120.0), (340.0, 165.0)), ((330.0, 90.0), (90.0, 210.0)), ((200.0, 80.0), (215.0, 220.0))] {
        let mut maps = empty();
        draw(&mut maps, Class::Lane, bar(a, b, 7.0));
        let [lane] = &lanes(&maps)[..] else { panic!("{a:?} {:?}", lanes(&maps)) };
        let line = lane.line.line().unwrap();
        let tilt = line.direction().perp(&(Point2::new(b.0, b.1) - Point2::new(a.0, a.1)).normalize()).abs();
        assert!(
            tilt < 0.002 && line.signed_distance_px(&Point2::new(0.5 * (a.0 + b.0), 0.5 * (a.1 + b.1))).abs() < 0.1
        );
        assert!((lane.line.width_px - 7.0).abs() < 0.7, "{:?}", lane.line);
    }
}

#[test]
fn lines_that_merge_or_cross_stay_two() {
    for (a, b) in [
        (((200.0, 80.0), (120.0, 220.0)), ((200.0, 80.0), (300.0, 220.0))),
        (((120.0, 80.0), (280.0, 220.0)), ((280.0, 80.0), (120.0, 220.0))),
    ] {
        let mut maps = empty();
        draw(&mut maps, Class::Lane, bar(a.0, a.1, 6.0));
        draw(&mut maps, Class::Lane, bar(b.0, b.1, 6.0));
        let found = lanes(&maps);
        assert_eq!(found.len(), 2, "{:?}", found.iter().map(|l| l.line).collect::<Vec<_>>());
        for (from, to) in [a, b] {
            let line = ImageLine::through(&Point2::new(from.0, from.1), &Point2::new(to.0, to.1)).unwrap();
            let along = |lane: &LaneFeature| lane.line.line().unwrap().direction().dot(&line.direction()).abs();
            let lane = found.iter().max_by(|x, y| along(x).total_cmp(&along(y))).unwrap();
            assert!(off(lane, from, to) < 4.0 && lane.line.length_px() > 110.0, "{:?}", lane.line);
        }
    }
}

#[test]
fn a_kerb_that_bends_away_is_not_joined() {
    let mut maps = empty();
    draw(&mut maps, Class::Lane, bar((100.0, 80.0), (200.0, 130.0), 6.0));
    draw(&mut maps, Class::Lane, bar((220.0, 142.0), (300.0, 222.0), 6.0));
    assert_eq!(lanes(&maps).len(), 2);
}

#[test]
fn stop_lines_and_arrow_heads_are_no_lanes() {
    let mut maps = empty();
    draw(&mut maps, Class::Lane, bar((60.0, 200.0), (340.0, 203.0), 8.0));
    draw(&mut maps, Class::Lane, bar((200.0, 100.0), (210.0, 120.0), 14.0));
    assert!(lanes(&maps).is_empty(), "{:?}", lanes(&maps));
}

#[test]
fn the_line_is_fitted_where_the_ground_is_5_to_20_m_ahead() {
    // Straight up to row 120, then bent.
    let mut maps = empty();
    draw(&mut maps, Class::Lane, bar((140.0, 225.0), (200.0, 120.0), 6.0));
    draw(&mut maps, Class::Lane, bar((200.0, 120.0), (245.0, 82.0), 6.0));
    let ground = Ground { horizon_px: 60.0, focal_px: 700.0, camera_height_m: 1.65 };
    let config = LaneConfig { ground: Some(ground), max_bend_deg: 20.0, ..LaneConfig::default() };
    let [lane] = &extract(&maps, &config)[..] else { panic!() };
    assert!((lane.line.upper_px.y - 120.0).abs() < 3.0, "{:?}", lane.line);
    assert!(lane.points_px[0].y < 90.0);
    assert!(lane.line.offset_sigma_px < 1.1);
}
