//! What is a lane line and what is not, on made-up streets.

use common::map::LaneKind;
use nalgebra::Point3;

use super::LanePiece;
use crate::Config;
use crate::build::find_lanes;
use crate::testing::{CAMERA_HEIGHT_M, Street};

/// Paint along map z from a place to another, x a function of z.
fn paint(street: &mut Street, from_to_m: (f64, f64), x: impl Fn(f64) -> f64, is_painted: impl Fn(f64) -> bool) {
    paint_as(street, from_to_m, x, 8.0, is_painted);
}

/// The same with a contrast of its own.
fn paint_as(
    street: &mut Street,
    from_to_m: (f64, f64),
    x: impl Fn(f64) -> f64,
    contrast: f32,
    is_painted: impl Fn(f64) -> bool,
) {
    for i in 0..((from_to_m.1 - from_to_m.0) / 0.04) as i32 {
        let z = from_to_m.0 + f64::from(i) * 0.04;
        if is_painted(z) {
            let wobble = 0.04 * (f64::from(i) * 1.7).sin();
            let scan = (z / 6.0).clamp(0.0, 9.0) as u16;
            street.add(Point3::new(x(z) + wobble, CAMERA_HEIGHT_M, z), scan, 0.5, Some(contrast));
        }
    }
}

/// Paint along map x, from a place to another.
fn paint_across(street: &mut Street, z: f64, from_to_m: (f64, f64)) {
    for i in 0..((from_to_m.1 - from_to_m.0) / 0.04) as i32 {
        let (x, wobble) = (from_to_m.0 + f64::from(i) * 0.04, 0.04 * (f64::from(i) * 1.7).sin());
        street.add(Point3::new(x, CAMERA_HEIGHT_M, z + wobble), (z / 6.0) as u16, 0.5, Some(8.0));
    }
}

fn found(street: Street) -> Vec<LanePiece> {
    let mut pieces = find_lanes(&street.cloud(), &Config::default());
    pieces.sort_by(|a, b| {
        let key = |p: &LanePiece| (p.points_map[0].x.round(), p.points_map[0].z);
        key(a).partial_cmp(&key(b)).unwrap()
    });
    pieces
}

fn length_m(piece: &LanePiece) -> f64 {
    piece.stations_m[piece.stations_m.len() - 1] - piece.stations_m[0]
}

#[test]
fn solid_and_dashed_lines_are_told_apart_and_an_arrow_is_neither() {
    let mut street = Street::new();
    paint(&mut street, (0.0, 60.0), |_| 1.75, |_| true);
    paint(&mut street, (0.0, 60.0), |_| -1.75, |z| z % 12.0 < 4.0);
    // An arrow 5 m long in the middle of the lane.
    for side in [-0.1, 0.0, 0.1] {
        paint(&mut street, (20.0, 25.0), |_| side, |_| true);
    }
    let pieces = found(street);
    let kinds: Vec<LaneKind> = pieces.iter().map(|p| p.kind).collect();
    assert_eq!(kinds, [LaneKind::Dashed, LaneKind::Solid]);
    for (piece, x) in pieces.iter().zip([-1.75, 1.75]) {
        assert!(piece.points_map.len() <= 3, "a straight line needs no more vertices: {:?}", piece.points_map);
        assert!(piece.points_map.iter().all(|p| (p.x - x).abs() < 0.03 && (p.y - CAMERA_HEIGHT_M).abs() < 0.03));
        assert!(length_m(piece) > 50.0, "{}", length_m(piece));
    }
    // Of the first and the last mark only one end is seen, and a solid line has
    // none.
    let marks_map = pieces[0].marks_map();
    assert!((4..=5).contains(&marks_map.len()) && pieces[1].marks_m.is_empty(), "{marks_map:?}");
    for [begin, end] in marks_map {
        let (from_m, to_m) = (begin.z % 12.0, end.z % 12.0);
        assert!(from_m.min(12.0 - from_m) < 0.06 && (to_m - 4.0).abs() < 0.06, "{begin} {end}");
    }
}

#[test]
fn short_dashes_of_which_little_is_seen_are_no_solid_line() {
    let kinds = |config: &Config| {
        let mut street = Street::new();
        // Dashes of 1 m with as long gaps, six hits on each.
        for i in 0..180 {
            let z = f64::from(i / 6 * 2) + (f64::from(i) * 0.618).fract();
            street.add(Point3::new(5.0, CAMERA_HEIGHT_M, z), (z / 6.0) as u16, 0.5, Some(8.0));
        }
        let pieces = find_lanes(&street.cloud(), config);
        assert!(pieces.iter().map(length_m).sum::<f64>() > 50.0, "{pieces:?}");
        pieces.iter().map(|piece| piece.kind).collect::<Vec<LaneKind>>()
    };
    let mut config = Config::default();
    assert_eq!(kinds(&config), [LaneKind::Dashed]);
    // No bin alone tells it.
    config.lanes.rhythm.least_evidence = f64::INFINITY;
    assert_eq!(kinds(&config), [LaneKind::Solid]);
}

#[test]
fn a_line_that_changes_from_solid_to_dashed_is_cut_there_and_has_no_hole() {
    let mut street = Street::new();
    paint(&mut street, (0.0, 60.0), |_| 1.75, |z| z < 24.0 || z % 6.0 < 3.0);
    let pieces = found(street);
    let kinds: Vec<LaneKind> = pieces.iter().map(|p| p.kind).collect();
    assert_eq!(kinds, [LaneKind::Solid, LaneKind::Dashed]);
    let (end, start) = (pieces[0].points_map.last().unwrap().z, pieces[1].points_map[0].z);
    // The first dash touches the solid line.
    assert!((end - 27.0).abs() < 1.0 && (end - start).abs() < 0.6, "{end} {start}");
}

#[test]
fn a_dashed_line_that_swings_beside_the_path_is_found_up_to_its_last_dash() {
    let mut street = Street::new();
    let x = |z: f64| 1.75 + 0.15 * (z / 8.0).sin();
    paint(&mut street, (0.0, 60.0), x, |z| z % 10.0 < 2.0);
    let pieces = found(street);
    assert_eq!(pieces.len(), 1, "{pieces:?}");
    let (start_m, end_m) = (pieces[0].points_map[0].z, pieces[0].points_map.last().unwrap().z);
    assert!(pieces[0].kind == LaneKind::Dashed && start_m < 1.0 && end_m > 51.0, "{start_m} {end_m}");
    assert!(pieces[0].points_map.iter().all(|p| (p.x - x(p.z)).abs() < 0.08), "{pieces:?}");
}

#[test]
fn the_bars_of_a_crossing_are_no_part_of_the_lines_that_end_before_and_behind_it() {
    let mut street = Street::new();
    paint(&mut street, (0.0, 24.0), |_| 1.75, |_| true);
    paint(&mut street, (40.0, 60.0), |_| 1.75, |_| true);
    for (bar, side) in (-4..=4).flat_map(|bar| [-0.2, 0.0, 0.2].map(|side| (f64::from(bar), side))) {
        paint(&mut street, (27.0, 30.0), |_| 1.75 + bar + side, |_| true);
    }
    let pieces = found(street);
    assert_eq!(pieces.len(), 2, "{pieces:?}");
    let (end_m, start_m) = (pieces[0].points_map.last().unwrap().z, pieces[1].points_map[0].z);
    assert!(end_m < 24.5 && start_m > 39.5, "{end_m} {start_m}");
}

#[test]
fn block_markings_across_a_side_street_are_no_line_and_prolong_none() {
    let mut street = Street::new();
    paint(&mut street, (0.0, 60.0), |_| 1.75, |z| z < 24.0 || ((28.0..42.0).contains(&z) && z % 0.9 < 0.5));
    paint(&mut street, (20.0, 40.0), |_| 5.0, |z| z % 0.7 < 0.4);
    let pieces = found(street);
    assert!(pieces.len() == 1 && pieces[0].points_map.iter().all(|p| p.z < 24.5 && p.x < 2.0), "{pieces:?}");
}

#[test]
fn the_border_of_a_hatched_area_is_a_line_and_its_stripes_bend_neither_it_nor_the_line_beside_it() {
    let mut street = Street::new();
    paint(&mut street, (0.0, 60.0), |_| 1.75, |_| true);
    paint(&mut street, (10.0, 50.0), |z| 2.0 + 0.06 * (z - 10.0), |_| true);
    for k in 0..18 {
        let z = 12.0 + f64::from(k) * 2.0;
        for thick in [0.0, 0.15, 0.3, 0.45] {
            paint_across(&mut street, z + thick, (2.0, 2.0 + 0.06 * (z - 10.0)));
        }
    }
    let pieces = found(street);
    let lies_on =
        |piece: &LanePiece, x: &dyn Fn(f64) -> f64| piece.points_map.iter().all(|p| (p.x - x(p.z)).abs() < 0.1);
    let (lines, borders): (Vec<&LanePiece>, Vec<&LanePiece>) = pieces.iter().partition(|p| lies_on(p, &|_| 1.75));
    assert!(lines.len() == 1 && length_m(lines[0]) > 55.0, "{pieces:?}");
    assert!(borders.iter().all(|piece| lies_on(piece, &|z| 2.0 + 0.06 * (z - 10.0))), "{pieces:?}");
}

#[test]
fn a_line_goes_straight_on_where_the_border_of_a_hatched_area_leaves_it() {
    let mut street = Street::new();
    paint(&mut street, (0.0, 60.0), |_| -1.75, |_| true);
    paint(&mut street, (15.0, 58.0), |z| -1.75 - 0.07 * (z - 15.0), |_| true);
    for k in 0..19 {
        let z = 18.0 + f64::from(k) * 2.0;
        for thick in [0.0, 0.15, 0.3, 0.45] {
            paint_across(&mut street, z + thick, (-1.75 - 0.07 * (z - 15.0), -1.75));
        }
    }
    let pieces = found(street);
    let is_straight = |piece: &&LanePiece| piece.points_map.iter().all(|p| (p.x + 1.75).abs() < 0.06);
    let straight: Vec<&LanePiece> = pieces.iter().filter(is_straight).collect();
    assert!(straight.len() == 1 && length_m(straight[0]) > 55.0, "{pieces:?}");
}

#[test]
fn a_line_goes_on_where_a_border_runs_beside_it_and_hides_it_here_and_there() {
    let mut street = Street::new();
    paint(&mut street, (0.0, 60.0), |_| -1.65, |z| !(23.0..28.0).contains(&z) && !(33.0..36.0).contains(&z));
    paint(&mut street, (18.0, 50.0), |_| -1.9, |_| true);
    for k in 0..16 {
        let z = 19.0 + f64::from(k) * 2.0;
        for thick in [0.0, 0.15, 0.3, 0.45] {
            paint_across(&mut street, z + thick, (-2.4 - 0.06 * (z - 18.0), -1.9));
        }
    }
    // The far ends of the stripes make a line of their own.
    let near: Vec<LanePiece> = found(street).into_iter().filter(|p| p.points_map[0].x > -2.2).collect();
    assert!(near.len() == 1 && length_m(&near[0]) > 55.0, "{near:?}");
    assert!(near[0].points_map.iter().all(|p| (p.x + 1.65).abs() < 0.05), "{near:?}");
}

#[test]
fn a_ragged_strip_before_a_wall_is_no_line_and_symbols_on_both_sides_of_one_do_not_matter() {
    for (has_wall, lines) in [(true, 0), (false, 1)] {
        let mut street = Street::new();
        paint(&mut street, (0.0, 60.0), |_| 5.0, |_| true);
        for x in [4.68, 5.32] {
            paint(&mut street, (0.0, 60.0), |_| x, |z| z % 1.25 < 0.1);
        }
        if has_wall {
            street.add_wall(5.3, 0.0..60.0, 1.5);
        }
        assert_eq!(found(street).len(), lines, "{has_wall}");
    }
}

#[test]
fn what_shines_along_a_kerb_is_no_line_and_paint_along_it_is() {
    for (contrast, lines) in [(4.5, 0), (8.0, 1)] {
        let mut street = Street::new();
        paint_as(&mut street, (0.0, 60.0), |_| 5.0, contrast, |_| true);
        for i in 0..12_000_i32 {
            // The pavement, 8 cm higher than the road.
            let (x, z) = (5.1 + (f64::from(i) * 0.618_034).fract(), (f64::from(i) * 0.414_214).fract() * 60.0);
            street.add(Point3::new(x, CAMERA_HEIGHT_M - 0.08, z), (z / 6.0) as u16, 0.3, Some(0.0));
        }
        let found = found(street);
        assert_eq!(found.iter().filter(|line| line.kind.is_painted()).count(), lines, "{contrast}");
        assert_eq!(found.iter().filter(|line| line.kind == LaneKind::Kerb).count(), 1 - lines, "{contrast}");
    }
}

#[test]
fn a_stop_line_is_no_lane_line() {
    let mut street = Street::new();
    paint_across(&mut street, 45.0, (-6.0, 6.0));
    assert!(found(street).is_empty());
}

#[test]
fn a_bright_strip_before_a_wall_is_no_line_and_paint_before_it_is() {
    for (contrast, lines) in [(4.5, 0), (8.0, 1)] {
        let mut street = Street::new();
        paint_as(&mut street, (0.0, 60.0), |_| 5.0, contrast, |_| true);
        street.add_wall(5.3, 0.0..60.0, 1.5);
        assert_eq!(found(street).len(), lines, "{contrast}");
    }
}

#[test]
fn what_is_bright_here_and_there_like_grass_is_no_line() {
    let mut street = Street::new();
    for i in 0..12_000_i32 {
        // Two irrational steps: even over the strip, in no order.
        let (x, z) = ((f64::from(i) * 0.618_034).fract() * 4.0 + 3.0, (f64::from(i) * 0.414_214).fract() * 60.0);
        let contrast = if i % 8 == 0 { 4.0 } else { 0.0 };
        street.add(Point3::new(x, CAMERA_HEIGHT_M, z), (z / 6.0) as u16, 0.4, Some(contrast));
    }
    assert!(found(street).is_empty());
}
