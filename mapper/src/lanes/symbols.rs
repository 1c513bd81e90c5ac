//! What is painted within lanes along them: arrows and letters, one behind the
//! other.

use common::map::LaneKind;
use nalgebra::Vector2;

use super::{LaneConfig, LanePiece};

/// The pieces without dashes that border no lane, for lines run so near on both
/// their sides that none fits in between: arrows or letters in the middle of a
/// lane. The shortest ones come first: what is none bears no witness against the
/// next one.
pub fn without_symbols(pieces: Vec<LanePiece>, config: &LaneConfig) -> Vec<LanePiece> {
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    // Stable: of equals the last, which was found last.
    order.sort_by(|a, b| pieces[*a].length_m().total_cmp(&pieces[*b].length_m()).then(b.cmp(a)));
    let mut is_symbol = vec![false; pieces.len()];
    for k in order {
        let piece = &pieces[k];
        if piece.kind == LaneKind::Dashed {
            let lines = pieces.iter().enumerate().filter(|(i, _)| *i != k && !is_symbol[*i]).map(|(_, line)| line);
            let lines: Vec<&LanePiece> = lines.collect();
            is_symbol[k] = enclosed_share(piece, &lines, config) >= config.least_enclosed_share;
        }
    }
    pieces.into_iter().zip(is_symbol).filter(|(_, is_symbol)| !is_symbol).map(|(piece, _)| piece).collect()
}

/// Share of the length of a piece on which lines run on both its sides, nearer
/// than the narrowest lane is wide, but farther off than the other one of a
/// double line.
fn enclosed_share(piece: &LanePiece, lines: &[&LanePiece], config: &LaneConfig) -> f64 {
    let Some((from_m, to_m)) = piece.ends_m() else { return 0.0 };
    let steps = ((to_m - from_m) / config.bin_m).ceil().max(1.0) as usize;
    let is_enclosed = |i: &usize| {
        let station_m = |i: usize| from_m + (to_m - from_m) * (i as f64 / steps as f64);
        let (Some(here), Some(next)) = (piece.at(station_m(*i)), piece.at(station_m(i + 1))) else { return false };
        let along = Vector2::new(next.x - here.x, next.z - here.z);
        let mut is_beside = [false; 2];
        for there in lines.iter().filter_map(|line| line.at(station_m(*i))) {
            let off = Vector2::new(there.x - here.x, there.z - here.z);
            if (config.apart_m..config.narrowest_lane_m).contains(&off.norm()) {
                is_beside[usize::from(along.perp(&off) > 0.0)] = true;
            }
        }
        is_beside == [true; 2]
    };
    (0..steps).filter(is_enclosed).count() as f64 / steps as f64
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// A straight line along 60 m, its offset at both ends.
    fn line(kind: LaneKind, x: [f64; 2]) -> LanePiece {
        LanePiece {
            kind,
            points_map: vec![Point3::new(x[0], 1.6, 0.0), Point3::new(x[1], 1.6, 60.0)],
            stations_m: vec![0.0, 60.0],
            spread_m: 0.0,
            marks_m: Vec::new(),
            contrast: 6.0,
            painted_share: 1.0,
        }
    }

    #[test]
    fn dashes_with_no_lane_on_either_side_are_symbols() {
        let config = LaneConfig::default();
        let lane = [line(LaneKind::Solid, [0.0; 2]), line(LaneKind::Solid, [3.2; 2])];
        let with = |piece: LanePiece| without_symbols([&lane[..], &[piece][..]].concat(), &config).len();
        // Arrows in the middle of a lane.
        assert_eq!(with(line(LaneKind::Dashed, [1.6; 2])), 2);
        // The border of an opening hatched area.
        assert_eq!(with(line(LaneKind::Solid, [0.6, 2.9])), 3);
        // Between a lane for cycles and one for parking; the other one of a double
        // line; dashes beside a lane as narrow as any.
        assert_eq!(with(line(LaneKind::Solid, [1.6; 2])), 3);
        assert_eq!(with(line(LaneKind::Dashed, [0.25; 2])), 3);
        assert_eq!(with(line(LaneKind::Dashed, [5.9; 2])), 3);
    }

    #[test]
    fn a_symbol_bears_no_witness_against_a_line() {
        let config = LaneConfig::default();
        // Dashes in the middle of a lane of 3.2 m, and a dashed line beyond which
        // another lane lies: shorter symbols go first.
        let mut arrows = line(LaneKind::Dashed, [1.6; 2]);
        (arrows.stations_m[1], arrows.points_map[1].z) = (30.0, 30.0);
        let lines = [0.0, 3.2, 5.0].map(|x| line(LaneKind::Dashed, [x; 2]));
        let kept = without_symbols([&lines[..], &[arrows][..]].concat(), &config);
        assert_eq!(kept, lines);
    }
}
