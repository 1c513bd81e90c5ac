//! Two passes over one street are one road, and which road is near.

use common::map::{Road, RoadId};
use nalgebra::{Point3, Vector3};

use super::config::SameRoadConfig;
use crate::fuse::Buckets;
use crate::roads::runs;

/// A place on a path.
struct Sample {
    point: Point3<f64>,
    along: Vector3<f64>,
    station_m: f64,
}

/// Places on a path at most `step_m` apart.
fn samples(path: &[Point3<f64>], step_m: f64) -> Vec<Sample> {
    let mut samples: Vec<Sample> = Vec::new();
    let mut station_m = 0.0;
    for pair in path.windows(2) {
        let way = pair[1] - pair[0];
        let Some(along) = way.try_normalize(1e-6) else { continue };
        let count = (way.norm() / step_m).ceil().clamp(1.0, 1e6);
        if samples.is_empty() {
            samples.push(Sample { point: pair[0], along, station_m });
        }
        for k in 1..=count as usize {
            let share = k as f64 / count;
            let station_m = station_m + way.norm() * share;
            samples.push(Sample { point: pair[0] + way * share, along, station_m });
        }
        station_m += way.norm();
    }
    samples
}

/// The roads of several passes, each street once: the first pass that drove it
/// gives its road, and a later one what it drove beyond.
pub struct Union<'a> {
    config: &'a SameRoadConfig,
    buckets: Buckets,
    known: Vec<Sample>,
    roads: Vec<Road>,
}

impl<'a> Union<'a> {
    /// No road yet.
    pub fn new(config: &'a SameRoadConfig) -> Self {
        let buckets = Buckets::new(config.within_m);
        Self { config, buckets, known: Vec::new(), roads: Vec::new() }
    }

    /// Adds the roads of a pass.
    pub fn add(&mut self, pass: &[Road]) {
        let mut added: Vec<Road> = Vec::new();
        for road in pass {
            let samples = samples(&road.path_map, self.config.step_m);
            let is_new: Vec<bool> = samples.iter().map(|sample| !self.is_known(sample)).collect();
            if is_new.iter().all(|is_new| *is_new) {
                added.push(road.clone());
                continue;
            }
            for run in runs(&is_new) {
                // Up to the neighbours that are known, so that no gap is left.
                let from = &samples[run.start.saturating_sub(1)];
                let to = &samples[run.end.min(samples.len() - 1)];
                if is_new[run.start] && to.station_m - from.station_m >= self.config.shortest_m {
                    added.push(Road { path_map: between(&road.path_map, from, to) });
                }
            }
        }
        for road in &added {
            for sample in samples(&road.path_map, self.config.step_m) {
                self.buckets.add(&sample.point, self.known.len());
                self.known.push(sample);
            }
        }
        self.roads.extend(added);
    }

    fn is_known(&self, sample: &Sample) -> bool {
        let config = self.config;
        let least_cosine = config.angle_rad.cos();
        self.buckets.near(&sample.point, config.within_m).any(|index| {
            let known = &self.known[index];
            let off = sample.point - known.point;
            off.x.hypot(off.z) <= config.within_m
                && off.dot(&known.along).abs() <= config.step_m
                && off.y.abs() <= config.height_m
                && known.along.dot(&sample.along).abs() >= least_cosine
        })
    }

    /// All roads.
    pub fn finish(self) -> Vec<Road> {
        self.roads
    }
}

/// What the roads of a pass add to those of another.
pub fn added_roads(known: &[Road], pass: &[Road], config: &SameRoadConfig) -> Vec<Road> {
    let mut union = Union::new(config);
    union.add(known);
    let before = union.roads.len();
    union.add(pass);
    union.roads.split_off(before)
}

/// The part of a path between two of its samples, with its own vertices.
fn between(path: &[Point3<f64>], from: &Sample, to: &Sample) -> Vec<Point3<f64>> {
    let mut points = vec![from.point];
    let mut station_m = 0.0;
    for pair in path.windows(2) {
        station_m += (pair[1] - pair[0]).norm();
        if station_m > from.station_m + 1e-6 && station_m < to.station_m - 1e-6 {
            points.push(pair[1]);
        }
    }
    points.push(to.point);
    points
}

/// Distance of the samples by which the nearest road is looked for, metres.
const LOOK_STEP_M: f64 = 5.0;
/// How far is looked at first, metres.
const LOOK_M: f64 = 30.0;

/// Finds the road whose path comes nearest, on a map of any size.
pub struct Nearest {
    buckets: Buckets,
    samples: Vec<(Point3<f64>, RoadId)>,
}

impl Nearest {
    /// Indexes roads.
    pub fn new(roads: &[Road]) -> Self {
        let mut nearest = Self { buckets: Buckets::new(LOOK_M), samples: Vec::new() };
        for (id, road) in (0..).map(RoadId).zip(roads) {
            let along = samples(&road.path_map, LOOK_STEP_M).into_iter().map(|sample| sample.point);
            // A path of one vertex has no samples.
            for point in along.chain(road.path_map.first().copied()) {
                nearest.buckets.add(&point, nearest.samples.len());
                nearest.samples.push((point, id));
            }
        }
        nearest
    }

    /// The road nearest to a point (to the places on it that are 5 m apart)
    /// and its distance, metres; none where there is no road.
    pub fn to(&self, point: &Point3<f64>) -> Option<(RoadId, f64)> {
        let distance_m = |index: usize| (self.samples[index].0 - point).norm();
        let first_of = |indices: &mut dyn Iterator<Item = usize>| {
            let found = indices.map(|index| (distance_m(index), self.samples[index].1));
            found.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
        };
        let near = first_of(&mut self.buckets.near(point, LOOK_M)).filter(|found| found.0 <= LOOK_M);
        near.or_else(|| first_of(&mut (0..self.samples.len()))).map(|(distance_m, road)| (road, distance_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn road(x: f64, from: f64, to: f64) -> Road {
        Road { path_map: vec![Point3::new(x, 0.0, from), Point3::new(x, 0.0, to)] }
    }

    fn union(passes: &[Vec<Road>]) -> Vec<Road> {
        let config = SameRoadConfig::default();
        let mut union = Union::new(&config);
        for pass in passes {
            union.add(pass);
        }
        union.finish()
    }

    #[test]
    fn a_second_pass_adds_what_it_drove_beyond() {
        let first = vec![road(0.0, 0.0, 50.0), road(0.0, 50.0, 100.0)];
        // Back on the other lane, and on.
        let second = vec![road(3.5, 90.0, 45.0), road(3.5, 45.0, -40.0)];
        let roads = union(&[first.clone(), second]);
        assert_eq!(roads[..2], first[..]);
        let [rest] = &roads[2..] else { panic!("{roads:?}") };
        assert!((rest.path_map[0].z - 0.0).abs() < 6.0 && (rest.path_map[1].z - -40.0).abs() < 1e-9, "{rest:?}");
    }

    #[test]
    fn crossings_bridges_and_parallel_streets_are_roads_of_their_own() {
        let crossing = Road { path_map: vec![Point3::new(-50.0, 0.0, 30.0), Point3::new(50.0, 0.0, 30.0)] };
        let mut bridge = road(0.0, 0.0, 100.0);
        for point in &mut bridge.path_map {
            point.y -= 5.0;
        }
        let passes = [vec![road(0.0, 0.0, 100.0)], vec![crossing], vec![bridge], vec![road(25.0, 0.0, 100.0)]];
        let roads = union(&passes);
        assert_eq!(roads, passes.concat());
    }

    #[test]
    fn one_pass_keeps_all_its_roads() {
        let pass = vec![road(0.0, 0.0, 50.0), road(3.0, 50.0, 0.0), Road { path_map: vec![Point3::origin()] }];
        assert_eq!(union(std::slice::from_ref(&pass)), pass);
    }

    #[test]
    fn the_nearest_road_is_found_near_and_far() {
        let nearest = Nearest::new(&[road(0.0, 0.0, 50.0), road(40.0, 0.0, 50.0)]);
        assert_eq!(nearest.to(&Point3::new(12.0, 0.0, 20.0)), Some((RoadId(0), 12.0)));
        assert_eq!(nearest.to(&Point3::new(900.0, 0.0, 20.0)).unwrap().0, RoadId(1));
        assert_eq!(Nearest::new(&[]).to(&Point3::origin()), None);
    }
}
