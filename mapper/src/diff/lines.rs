//! Lane lines of two maps, compared place by place.

use common::map::SemanticMap;
use nalgebra::{Point3, Vector3};

use super::DiffConfig;
use crate::fuse::Buckets;

/// Distance of the samples of lane lines, metres.
const SAMPLE_M: f64 = 0.5;
/// Longest piece of a line that is kept under its middle, metres.
const PIECE_M: f64 = 4.0;

/// Name of a kind of lines.
type Kind = &'static str;

/// The lane lines of a map, for asking what runs beside a point.
pub(super) struct Lines {
    whole: Vec<(Kind, Vec<Point3<f64>>)>,
    pieces: Vec<(Kind, [Point3<f64>; 2])>,
    buckets: Buckets,
}

/// A line and what the other map has beside it.
pub(super) struct Compared {
    /// What it is.
    pub kind: Kind,
    samples: Vec<Sample>,
}

/// A short piece of a line.
struct Sample {
    middle: Point3<f64>,
    length_m: f64,
    /// The kind of the other map's line beside it, and how far that is, metres.
    beside: Option<(Kind, f64)>,
}

/// A part of a line that has, or has not, a line of the other map beside it.
pub(super) struct Run {
    /// Its middle, map frame, metres.
    pub middle: Point3<f64>,
    /// Its length, metres.
    pub length_m: f64,
    /// The length beside lines of its own kind, metres.
    pub same_kind_m: f64,
    /// Mean distance from the other map's line, metres.
    pub moved_m: Option<f64>,
}

impl Lines {
    /// The lane lines of a map.
    pub fn new(map: &SemanticMap) -> Self {
        let mut lines = Self { whole: Vec::new(), pieces: Vec::new(), buckets: Buckets::new(PIECE_M) };
        for lane in &map.lanes {
            lines.whole.push((lane.kind.name(), lane.points_map.clone()));
            for ends in split(&lane.points_map, PIECE_M).windows(2) {
                lines.buckets.add(&nalgebra::center(&ends[0], &ends[1]), lines.pieces.len());
                lines.pieces.push((lane.kind.name(), [ends[0], ends[1]]));
            }
        }
        lines
    }

    /// The nearest line that runs the same way, and how far it is, metres: one
    /// of the same kind before one of another that is as near as two builds
    /// can tell, for double lines have both.
    fn beside(
        &self,
        kind: Kind,
        point: &Point3<f64>,
        along: &Vector3<f64>,
        config: &DiffConfig,
    ) -> Option<(Kind, f64)> {
        let near = self.buckets.near(point, config.lane_moved_m + 0.5 * PIECE_M);
        let beside = near.filter_map(|index| {
            let (other, [a, b]) = self.pieces[index];
            let way = b - a;
            let share = ((point - a).dot(&way) / way.norm_squared()).clamp(0.0, 1.0);
            let distance_m = (a + way * share - point).norm();
            // Within about 30 degrees.
            let is_parallel = way.normalize().dot(along).abs() > 0.85;
            (distance_m <= config.lane_moved_m && is_parallel).then_some((other, distance_m))
        });
        let off_m = |(other, distance_m): &(Kind, f64)| distance_m + if *other == kind { 0.0 } else { config.same_m };
        beside.min_by(|a, b| off_m(a).total_cmp(&off_m(b)))
    }

    /// Each line, and what the other map has beside it.
    pub fn compared_with<'a>(&'a self, other: &'a Self, config: &'a DiffConfig) -> impl Iterator<Item = Compared> + 'a {
        self.whole.iter().map(|(kind, line)| {
            let sample = |pair: &[Point3<f64>]| {
                let (middle, way) = (nalgebra::center(&pair[0], &pair[1]), pair[1] - pair[0]);
                let beside = other.beside(kind, &middle, &way.normalize(), config);
                Sample { middle, length_m: way.norm(), beside }
            };
            Compared { kind, samples: split(line, SAMPLE_M).windows(2).map(sample).collect() }
        })
    }
}

impl Compared {
    /// Its parts with and without a line beside them.
    pub fn runs(&self) -> impl Iterator<Item = Run> {
        let same = self.samples.chunk_by(|a, b| a.beside.is_some() == b.beside.is_some());
        same.map(|samples| self.run(samples))
    }

    /// Its parts beside a line of another kind, and what that is.
    pub fn runs_of_another_kind(&self) -> impl Iterator<Item = (Run, Kind)> {
        let beside = |sample: &Sample| sample.beside.map(|(kind, _)| kind);
        let same = self.samples.chunk_by(move |a, b| beside(a) == beside(b));
        same.filter_map(move |samples| {
            let was = beside(samples.first()?).filter(|was| *was != self.kind)?;
            Some((self.run(samples), was))
        })
    }

    fn run(&self, samples: &[Sample]) -> Run {
        let distances: Vec<f64> = samples.iter().filter_map(|sample| Some(sample.beside?.1)).collect();
        let is_same = |sample: &&Sample| sample.beside.is_some_and(|(kind, _)| kind == self.kind);
        let length_m = |sample: &Sample| sample.length_m;
        Run {
            middle: samples[samples.len() / 2].middle,
            length_m: samples.iter().map(length_m).sum(),
            same_kind_m: samples.iter().filter(is_same).map(length_m).sum(),
            moved_m: (!distances.is_empty()).then(|| distances.iter().sum::<f64>() / distances.len() as f64),
        }
    }
}

/// The vertices of a line and points between them, at most `step_m` apart;
/// none twice.
fn split(line: &[Point3<f64>], step_m: f64) -> Vec<Point3<f64>> {
    let mut points: Vec<Point3<f64>> = line.first().copied().into_iter().collect();
    for pair in line.windows(2) {
        let way = pair[1] - pair[0];
        if way.norm() > 1e-6 {
            let count = (way.norm() / step_m).ceil().clamp(1.0, 1e6);
            points.extend((1..=count as usize).map(|k| pair[0] + way * (k as f64 / count)));
        }
    }
    points
}
