//! Pieces of lane lines, and what is left of those that describe one twice.

use common::geometry::distance_from_above_m;
use common::map::LaneKind;
use nalgebra::Point3;

use super::LaneConfig;

/// A lane line, or a piece of one.
#[derive(Debug, Clone, PartialEq)]
pub struct LanePiece {
    /// How it is painted.
    pub kind: LaneKind,
    /// Vertices, map frame, metres.
    pub points_map: Vec<Point3<f64>>,
    /// Stations of the vertices along the driven path, metres, rising.
    pub stations_m: Vec<f64>,
    /// Root mean square lateral distance of the paint from the line, metres.
    pub spread_m: f64,
    /// Stations where each mark of a dashed line begins and ends, metres.
    pub marks_m: Vec<[f64; 2]>,
    /// Mean contrast of its paint, standard deviations.
    pub contrast: f64,
    /// Share of its length on which paint was seen.
    pub painted_share: f64,
}

/// Least distance of a cut from a vertex that is kept, metres.
const VERTEX_APART_M: f64 = 0.1;

impl LanePiece {
    /// Stations of its ends, metres; `None` without vertices.
    pub fn ends_m(&self) -> Option<(f64, f64)> {
        self.stations_m.first().copied().zip(self.stations_m.last().copied())
    }

    /// Length along the path, metres.
    pub fn length_m(&self) -> f64 {
        self.ends_m().map_or(0.0, |(from_m, to_m)| to_m - from_m)
    }

    /// Its place at a station, map frame, metres; `None` beyond its ends.
    pub fn at(&self, station_m: f64) -> Option<Point3<f64>> {
        let (from_m, to_m) = self.ends_m()?;
        if !(from_m..=to_m).contains(&station_m) {
            return None;
        }
        self.straight_on(station_m)
    }

    /// The same; beyond its ends it goes straight on.
    fn straight_on(&self, station_m: f64) -> Option<Point3<f64>> {
        let after = self.stations_m.partition_point(|s| *s <= station_m).clamp(1, self.stations_m.len().max(2) - 1);
        let (start_m, end_m) = (self.stations_m.get(after - 1)?, self.stations_m.get(after)?);
        let (start, end) = (self.points_map.get(after - 1)?, self.points_map.get(after)?);
        Some(start + (end - start) * ((station_m - start_m) / (end_m - start_m).max(1e-9)))
    }

    /// Where its marks begin and end, map frame, metres. Where the one end of the
    /// first or of the last was not seen, the mark reaches beyond the line, which
    /// goes straight on there: by less than half of the mark.
    pub fn marks_map(&self) -> Vec<[Point3<f64>; 2]> {
        let is_on = |mark: &&[f64; 2]| self.at(f64::midpoint(mark[0], mark[1])).is_some();
        let ends_map = |mark: &[f64; 2]| Some([self.straight_on(mark[0])?, self.straight_on(mark[1])?]);
        self.marks_m.iter().filter(is_on).filter_map(ends_map).collect()
    }

    /// Distance of a point from it on the ground plane, metres.
    pub fn distance_m(&self, p: &Point3<f64>) -> f64 {
        distance_from_above_m(p, &self.points_map)
    }

    /// Its part between two stations; `None` where that is shorter than
    /// `shortest_m`.
    pub fn part(&self, from_m: f64, to_m: f64, shortest_m: f64) -> Option<Self> {
        let (first_m, last_m) = self.ends_m()?;
        let (from_m, to_m) = (from_m.max(first_m), to_m.min(last_m));
        if to_m - from_m < shortest_m {
            return None;
        }
        let is_in = |mark: &[f64; 2]| (from_m..to_m).contains(&f64::midpoint(mark[0], mark[1]));
        let marks_m = self.marks_m.iter().copied().filter(is_in).collect();
        let mut part = Self { points_map: vec![self.at(from_m)?], stations_m: vec![from_m], marks_m, ..*self };
        let is_inner = |station_m: f64| station_m > from_m + VERTEX_APART_M && station_m < to_m - VERTEX_APART_M;
        for (station_m, point) in self.stations_m.iter().zip(&self.points_map).filter(|(s, _)| is_inner(**s)) {
            part.stations_m.push(*station_m);
            part.points_map.push(*point);
        }
        part.stations_m.push(to_m);
        part.points_map.push(self.at(to_m)?);
        Some(part)
    }
}

/// The pieces of all lines without what runs along that of a longer line:
/// chains that fork or overlap describe the same paint, and the border of a
/// hatched area ends with it while the line beside it goes on. What is left of
/// a piece is one where it is as long as a line has to be.
pub fn without_doubles(lines: Vec<Vec<LanePiece>>, config: &LaneConfig) -> Vec<LanePiece> {
    let mut lines: Vec<(f64, Vec<LanePiece>)> =
        lines.into_iter().map(|pieces| (pieces.iter().map(LanePiece::length_m).sum(), pieces)).collect();
    // Stable: of equals the first.
    lines.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<LanePiece> = Vec::new();
    for piece in lines.into_iter().flat_map(|(_, pieces)| pieces) {
        let Some((from_m, to_m)) = piece.ends_m() else { continue };
        let is_known = |station_m: f64| {
            let is_near = |there: Point3<f64>| {
                piece.at(station_m).is_some_and(|here| (here.x - there.x).hypot(here.z - there.z) < config.apart_m)
            };
            kept.iter().filter_map(|other| other.at(station_m)).any(is_near)
        };
        let steps = ((to_m - from_m) / config.bin_m).ceil().max(1.0) as usize;
        let stations: Vec<(f64, bool)> = (0..=steps)
            .map(|i| from_m + (to_m - from_m) * (i as f64 / steps as f64))
            .map(|station_m| (station_m, is_known(station_m)))
            .collect();
        if stations.iter().all(|(_, is_known)| !is_known) {
            kept.push(piece);
            continue;
        }
        let rest: Vec<LanePiece> = stations
            .chunk_by(|a, b| a.1 == b.1)
            .filter(|run| run.first().is_some_and(|(_, is_known)| !is_known))
            .filter_map(|run| piece.part(run.first()?.0, run.last()?.0, config.shortest_m))
            .collect();
        kept.extend(rest);
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A straight piece from one station to another, its offset at both.
    fn piece(from_to_m: (f64, f64), x: (f64, f64)) -> LanePiece {
        LanePiece {
            kind: LaneKind::Solid,
            points_map: vec![Point3::new(x.0, 1.6, from_to_m.0), Point3::new(x.1, 1.6, from_to_m.1)],
            stations_m: vec![from_to_m.0, from_to_m.1],
            spread_m: 0.0,
            marks_m: Vec::new(),
            contrast: 6.0,
            painted_share: 1.0,
        }
    }

    #[test]
    fn a_part_begins_and_ends_where_it_is_cut() {
        let mut whole = piece((0.0, 20.0), (1.0, 3.0));
        whole.stations_m.insert(1, 10.0);
        whole.points_map.insert(1, Point3::new(1.0, 1.6, 10.0));
        let part = whole.part(5.0, 15.0, 2.0).unwrap();
        assert_eq!(part.stations_m, [5.0, 10.0, 15.0]);
        assert!((part.points_map[2] - Point3::new(2.0, 1.6, 15.0)).norm() < 1e-9);
        assert_eq!(whole.part(f64::NEG_INFINITY, f64::INFINITY, 2.0), Some(whole.clone()));
        assert_eq!(whole.part(19.0, 40.0, 2.0), None);
    }

    #[test]
    fn a_branch_begins_where_it_leaves_its_line_and_a_double_is_none() {
        let config = LaneConfig::default();
        let line = piece((0.0, 60.0), (1.0, 1.0));
        let branch = piece((20.0, 60.0), (1.0, 4.0));
        let double = piece((10.0, 50.0), (1.1, 1.1));
        let neighbour = piece((0.0, 50.0), (4.5, 4.5));
        let lines = [double, branch, neighbour.clone(), line.clone()].map(|piece| vec![piece]);
        let kept = without_doubles(lines.to_vec(), &config);
        assert_eq!((kept.len(), &kept[0], &kept[1]), (3, &line, &neighbour));
        let apart_m = kept[2].points_map[0].x - 1.0;
        assert!((config.apart_m..config.apart_m + 0.1).contains(&apart_m), "{kept:?}");
    }
}
