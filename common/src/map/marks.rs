//! Marks of dashed lines: between places in the map and lengths along a line.

use nalgebra::Point3;

use super::LaneLine;

impl LaneLine {
    /// Where its marks begin and end, map frame, metres.
    pub fn marks_map(&self) -> impl Iterator<Item = [Point3<f64>; 2]> + '_ {
        let mut walk = Walk::along(&self.points_map);
        self.marks_m.iter().filter_map(move |[from_m, to_m]| Some([walk.at(*from_m)?, walk.at(*to_m)?]))
    }
}

/// Places along a polyline, asked for in ascending order.
struct Walk<'a> {
    points_map: &'a [Point3<f64>],
    /// Length up to the first of `points_map`, metres.
    behind_m: f64,
}

impl<'a> Walk<'a> {
    fn along(points_map: &'a [Point3<f64>]) -> Self {
        Self { points_map, behind_m: 0.0 }
    }

    /// The place at a length from the beginning, metres; before it and beyond
    /// the end straight on.
    fn at(&mut self, length_m: f64) -> Option<Point3<f64>> {
        while let [a, b, rest @ ..] = self.points_map {
            let edge_m = (b - a).norm();
            let share = (length_m - self.behind_m) / edge_m.max(1e-9);
            if share <= 1.0 || rest.is_empty() {
                return Some(a + (b - a) * share);
            }
            self.behind_m += edge_m;
            self.points_map = &self.points_map[1..];
        }
        self.points_map.first().copied()
    }
}

/// Marks as lengths along a polyline (metres from its first vertex; ascending,
/// apart): those of `marks_map`, in either direction, whose middle lies within
/// `within_m` beside it and not beyond its ends. So each mark is of one piece
/// of a line that is cut, and may reach beyond that. Marks that overlap are one
/// that was seen several times, and lies at their mean.
pub fn marks_along(points_map: &[Point3<f64>], marks_map: &[[Point3<f64>; 2]], within_m: f64) -> Vec<[f64; 2]> {
    let along = |[from, to]: &[Point3<f64>; 2]| {
        let middle_m = place_m(points_map, &nalgebra::center(from, to), within_m)?;
        let half_m = 0.5 * (to - from).norm();
        (half_m > 0.0).then_some([middle_m - half_m, middle_m + half_m])
    };
    let mut marks_m: Vec<[f64; 2]> = marks_map.iter().filter_map(along).collect();
    marks_m.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut joined: Vec<([f64; 2], f64)> = Vec::new();
    for mark in marks_m {
        match joined.last_mut() {
            Some((sum, count)) if mark[0] < sum[1] / *count => {
                *sum = [sum[0] + mark[0], sum[1] + mark[1]];
                *count += 1.0;
            }
            _ => joined.push((mark, 1.0)),
        }
    }
    let mut means: Vec<[f64; 2]> = joined.iter().map(|(sum, count)| [sum[0] / count, sum[1] / count]).collect();
    // A mean may reach into what did not overlap the first of its marks.
    means.dedup_by(|next, before| next[0] <= before[1]);
    means
}

/// Length along a polyline up to the place nearest to a point, metres; none
/// where that is further than `within_m`, seen from above, or beyond the ends.
fn place_m(points_map: &[Point3<f64>], point: &Point3<f64>, within_m: f64) -> Option<f64> {
    let (mut behind_m, mut nearest) = (0.0, None);
    let mut least_m = within_m;
    let last = points_map.len().saturating_sub(2);
    for (i, ends) in points_map.windows(2).enumerate() {
        let way = ends[1] - ends[0];
        let length_m = way.norm();
        let share = (point - ends[0]).dot(&way) / (length_m * length_m).max(1e-9);
        let is_beyond = (i == 0 && share < 0.0) || (i == last && share > 1.0);
        let share = share.clamp(0.0, 1.0);
        let off = point - (ends[0] + way * share);
        let off_m = off.x.hypot(off.z);
        if !is_beyond && off_m <= least_m {
            (least_m, nearest) = (off_m, Some(behind_m + share * length_m));
        }
        behind_m += length_m;
    }
    nearest
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::map::{LaneKind, RoadId};

    fn line(points_map: Vec<Point3<f64>>, marks_m: Vec<[f64; 2]>) -> LaneLine {
        LaneLine { kind: LaneKind::Dashed, points_map, road: RoadId(0), marks_m }
    }

    proptest! {
        #[test]
        fn marks_come_back_from_their_places(
            turns in prop::collection::vec(-0.3..0.3_f64, 1..8),
            steps in prop::collection::vec((1.0..4.0_f64, 1.0..4.0_f64), 0..8),
        ) {
            let mut points = vec![Point3::new(2.0, 1.6, 5.0)];
            let mut heading = 0.0_f64;
            for turn in turns {
                heading += turn;
                let last = points[points.len() - 1];
                points.push(last + nalgebra::Vector3::new(heading.sin(), 0.02, heading.cos()) * 10.0);
            }
            let length_m = 10.0 * (points.len() - 1) as f64;
            // The first may reach beyond the beginning, where a line was cut.
            let mut at_m = -3.0;
            let marks_m: Vec<[f64; 2]> = steps
                .into_iter()
                .map(|(gap_m, mark_m)| {
                    at_m += gap_m + mark_m;
                    [at_m - mark_m, at_m]
                })
                .filter(|mark| (0.0..length_m).contains(&f64::midpoint(mark[0], mark[1])))
                .collect();
            let lane = line(points, marks_m);
            // The chord of 4 m over a corner of 0.3 rad lies 2 sin(0.15) m beside it,
            // and its ends are at most 0.067 m off along the line.
            let again = marks_along(&lane.points_map, &lane.marks_map().collect::<Vec<_>>(), 0.3);
            prop_assert_eq!(again.len(), lane.marks_m.len());
            for (a, b) in again.iter().flatten().zip(lane.marks_m.iter().flatten()) {
                prop_assert!((a - b).abs() < 0.07, "{} {}", a, b);
            }
        }
    }

    #[test]
    fn marks_seen_twice_are_one_and_those_of_another_line_none() {
        let at = |x: f64, z: f64| Point3::new(x, 1.6, z);
        let line = [at(0.0, 0.0), at(0.0, 50.0)];
        let seen = [
            [at(0.02, 10.0), at(0.02, 13.0)],
            // The other way round.
            [at(-0.02, 13.1), at(-0.02, 10.1)],
            [at(0.0, 19.0), at(0.0, 22.0)],
            [at(3.5, 19.5), at(3.5, 22.5)],
            [at(0.0, 60.0), at(0.0, 63.0)],
        ];
        let marks_m = marks_along(&line, &seen, 0.3);
        assert_eq!(marks_m.len(), 2, "{marks_m:?}");
        assert!((marks_m[0][0] - 10.05).abs() < 1e-9 && (marks_m[0][1] - 13.05).abs() < 1e-9);
    }

    #[test]
    fn marks_of_a_ring_are_counted_from_its_start() {
        let corners = [[0.0, 0.0], [0.0, 10.0], [10.0, 10.0], [10.0, -5.0], [0.0, -5.0]];
        let ring = line(corners.map(|[x, z]| Point3::new(x, 1.6, z)).to_vec(), vec![[2.0, 5.0], [31.0, 34.0]]);
        // The second lies behind the start as its first edge sees it.
        let again = marks_along(&ring.points_map, &ring.marks_map().collect::<Vec<_>>(), 0.3);
        assert_eq!(again.len(), 2, "{again:?}");
        for (a, b) in again.iter().flatten().zip(ring.marks_m.iter().flatten()) {
            assert!((a - b).abs() < 1e-9, "{again:?}");
        }
    }
}
