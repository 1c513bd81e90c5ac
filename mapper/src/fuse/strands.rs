//! Lane lines of one pass, joined where they were cut.
//!
//! A map cuts its lines where one road ends and the next begins. Two passes cut
//! at different places, and pieces would be left over between them: so the
//! cuts are undone before lines are compared.

use std::cmp::Ordering;

use common::map::{LaneKind, LaneLine, RoadId};
use nalgebra::{Matrix3, Point3};

use super::{Buckets, Sighting};

/// Largest distance of two ends at a cut, metres: cuts share their point, to
/// the grid of the file and to where the two roads were moved.
const CUT_M: f64 = 0.1;

/// A line of one pass, out of one or more of its sightings.
#[derive(Debug, Clone)]
pub(super) struct Strand {
    pub pass: u32,
    pub kind: LaneKind,
    /// That of the first sighting.
    pub road: RoadId,
    pub points_map: Vec<Point3<f64>>,
    /// That of the first sighting.
    pub covariance_map_m2: Option<Matrix3<f64>>,
    /// Indices into the list of sightings, in driving order.
    pub sightings: Vec<usize>,
}

/// The strands of all passes, long ones first, then by value.
pub(super) fn strands(sightings: &[Sighting<LaneLine>]) -> Vec<Strand> {
    let is_line = |index: &usize| sightings[*index].landmark.points_map.len() >= 2;
    let mut order: Vec<usize> = (0..sightings.len()).filter(is_line).collect();
    order.sort_by(|&a, &b| {
        let (a, b) = (&sightings[a], &sightings[b]);
        compare(&a.landmark, &b.landmark).then(spread(a.covariance_map_m2).total_cmp(&spread(b.covariance_map_m2)))
    });
    let next = successors(sightings, &order);
    let mut has_before = vec![false; order.len()];
    next.iter().flatten().for_each(|&after| has_before[after] = true);
    let mut strands = Vec::new();
    let mut is_done = vec![false; order.len()];
    // Closed loops have no first line: they begin with the longest.
    let starts = (0..order.len()).filter(|&at| !has_before[at]).chain(0..order.len());
    for start in starts {
        let mut at = Some(start);
        let mut strand: Option<Strand> = None;
        while let Some(line) = at.filter(|&line| !is_done[line]) {
            is_done[line] = true;
            let sighting = &sightings[order[line]];
            let landmark = &sighting.landmark;
            let joined = strand.get_or_insert_with(|| Strand {
                pass: sighting.pass,
                kind: landmark.kind,
                road: landmark.road,
                points_map: landmark.points_map.first().copied().into_iter().collect(),
                covariance_map_m2: sighting.covariance_map_m2,
                sightings: Vec::new(),
            });
            joined.points_map.extend(landmark.points_map.iter().skip(1));
            joined.sightings.push(order[line]);
            at = next[line];
        }
        strands.extend(strand);
    }
    strands.sort_by(|a, b| {
        length_m(&b.points_map)
            .total_cmp(&length_m(&a.points_map))
            .then_with(|| compare_points(&a.points_map, &b.points_map))
            .then(a.kind.cmp(&b.kind))
            .then(spread(a.covariance_map_m2).total_cmp(&spread(b.covariance_map_m2)))
    });
    strands
}

/// For every line the one that begins where it ends.
fn successors(sightings: &[Sighting<LaneLine>], order: &[usize]) -> Vec<Option<usize>> {
    let line = |at: usize| &sightings[order[at]].landmark.points_map;
    let starts: Vec<Point3<f64>> = (0..order.len()).filter_map(|at| line(at).first().copied()).collect();
    let buckets = Buckets::of(1.0, &starts);
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for before in 0..order.len() {
        let Some(end) = line(before).last() else { continue };
        for after in buckets.near(end, CUT_M) {
            let (a, b) = (&sightings[order[before]], &sightings[order[after]]);
            let apart_m = (starts[after] - end).norm();
            if before != after && a.pass == b.pass && a.landmark.kind == b.landmark.kind && apart_m <= CUT_M {
                pairs.push((apart_m, before, after));
            }
        }
    }
    pairs.sort_by(|p, q| p.0.total_cmp(&q.0).then((p.1, p.2).cmp(&(q.1, q.2))));
    let mut next: Vec<Option<usize>> = vec![None; order.len()];
    let mut has_before = vec![false; order.len()];
    for (_, before, after) in pairs {
        if next[before].is_none() && !has_before[after] {
            next[before] = Some(after);
            has_before[after] = true;
        }
    }
    next
}

fn spread(covariance: Option<Matrix3<f64>>) -> f64 {
    covariance.map_or(f64::INFINITY, |p| p.trace())
}

/// Length of a polyline, metres.
pub(crate) fn length_m(points: &[Point3<f64>]) -> f64 {
    points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
}

fn compare_points(a: &[Point3<f64>], b: &[Point3<f64>]) -> Ordering {
    let numbers = |points: &[Point3<f64>]| points.iter().flat_map(|p| [p.x, p.y, p.z]).collect::<Vec<f64>>();
    let (a, b) = (numbers(a), numbers(b));
    let difference = a.iter().zip(&b).map(|(p, q)| p.total_cmp(q)).find(|o| o.is_ne());
    difference.unwrap_or(a.len().cmp(&b.len()))
}

/// Long ones first, then by value.
fn compare(a: &LaneLine, b: &LaneLine) -> Ordering {
    length_m(&b.points_map)
        .total_cmp(&length_m(&a.points_map))
        .then_with(|| compare_points(&a.points_map, &b.points_map))
        .then(a.kind.cmp(&b.kind))
        .then(a.road.cmp(&b.road))
}
