//! The search of all roads that a lost vehicle can have reached.
//!
//! Where it is expected says little once it went on unknown: round which corner, by a
//! gyroscope that was wrong. From then on, until a pose is ok again, the roads within its
//! reach are gone through, one stretch and one direction a frame, as the start goes through
//! those around a rough pose. What fits there is tracked beside all else, and the images
//! decide.

use std::f64::consts::PI;

use common::geometry::PoseParameters;
use nalgebra::{Point3, Vector6};
use serde::{Deserialize, Serialize};

use super::Tracker;
use super::hypothesis::Hypothesis;
use crate::Result;
use crate::estimate::Status;
use crate::filter::State;
use crate::local_map::{PathPlace, RoadKey};
use crate::preselect::Reach;
use crate::start::{Rough, Stance, StartConfig};

/// Settings of the search of all roads in reach.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SweepConfig {
    /// Way since it was known where the vehicle is after which roads are swept once it is
    /// lost, metres: on less, it is not far from where it is expected.
    pub after_m: f64,
    /// No road further from there is swept, metres: within a kilometre a dense town has 20 km
    /// of them, which take some minutes.
    pub farthest_m: f64,
    /// Longest stretch, metres: with a quarter of it more at either end it has about as many
    /// cells as a start may have.
    pub stretch_m: f64,
    /// The best cells of a stretch that are matched in full.
    pub matched_cells: usize,
    /// Cells that are refined.
    pub refined: usize,
    /// Poses that are tracked on.
    pub kept: usize,
}

impl Default for SweepConfig {
    fn default() -> Self {
        Self { after_m: 25.0, farthest_m: 1000.0, stretch_m: 40.0, matched_cells: 100, refined: 12, kept: 4 }
    }
}

/// How far the search of all roads has come.
#[derive(Debug, Clone, Default)]
pub(super) struct Sweep {
    /// Where the vehicle was last known to be, map frame.
    known_map: Option<Point3<f64>>,
    /// How far it may have gone since, metres.
    way_m: f64,
    /// It was lost since, and not ok again.
    is_open: bool,
    /// The stretches that are still to be looked at, the next of them last.
    left: Vec<Stretch>,
    /// How many there were.
    count: usize,
}

/// A stretch of a road.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    road: RoadKey,
    /// Its middle.
    place: PathPlace,
    /// Metres.
    length_m: f64,
    /// Driven against the survey's direction.
    is_against: bool,
}

impl Sweep {
    /// Takes in where the vehicle is, by a fix or by a pose that is trusted.
    pub fn know(&mut self, position_map: Point3<f64>) {
        (self.known_map, self.way_m) = (Some(position_map), 0.0);
        self.left.clear();
    }

    /// Takes in that it went on.
    pub fn drive(&mut self, way_m: f64) {
        self.way_m += way_m;
    }

    /// Takes in what is said of the best pose, and whether all is well with it; says whether
    /// it is trusted. Once it was lost on the way, only one that is ok is: what fits in a
    /// wrong place would speak against the right one.
    pub fn trusts(&mut self, status: Status, is_well: bool, position_map: Point3<f64>, config: &SweepConfig) -> bool {
        self.is_open = status != Status::Ok && (self.is_open || status == Status::Lost && self.way_m > config.after_m);
        let is_trusted = is_well && !self.is_open;
        if is_trusted {
            self.know(position_map);
        }
        is_trusted
    }

    /// The place around which to sweep, and how far, metres; none while the vehicle is
    /// searched where it is expected.
    fn region(&self, config: &SweepConfig) -> Option<(Point3<f64>, f64)> {
        let known_map = self.known_map.filter(|_| self.is_open)?;
        Some((known_map, self.way_m.min(config.farthest_m)))
    }
}

impl Tracker<'_> {
    /// Looks along the next stretch of road that the vehicle can have reached, where it was
    /// lost and nothing is followed.
    pub(super) fn sweep(&mut self) -> Result<()> {
        let config = self.config.sweep;
        let Some((centre_map, reach_m)) = self.sweep.region(&config) else { return Ok(()) };
        let Some(region) = self.region.searched(&self.config.gps).cloned() else { return Ok(()) };
        if self.verdict.is_some_and(|verdict| verdict.is_followed) || self.has_left_map() {
            return Ok(());
        }
        // What of an atlas is looked at is held.
        let mut roads = Vec::new();
        self.map.roads_near(&centre_map, reach_m, &mut roads)?;
        if self.sweep.left.is_empty() {
            self.plan_sweep(&roads, &region.map_from_camera.translation.vector.into());
        }
        let next = self.sweep.left.pop().filter(|stretch| roads.binary_search(&stretch.road).is_ok());
        let Some(stretch) = next else { return Ok(()) };
        let rough = self.amid(&stretch, &region);
        let start = StartConfig {
            matched_cells: config.matched_cells,
            refined: config.refined,
            kept: config.kept,
            grid_sigma_m: 0.0,
            ..self.config.start
        };
        // Its cells lie along a road, not in a square.
        let reach = Reach { position_m: start.reach_sigmas * rough.sigmas[0], ..rough.reach(&start) };
        let found = self.search_around(&rough, &reach, Some(stretch.road), &start)?;
        // Of all stretches one is right.
        let handicap = self.newcomer_cost() + (self.sweep.count as f64).ln();
        let past_weight = self.bank.first().map_or(0.0, |best| best.past_weight);
        for refined in found {
            let mut found = Hypothesis::found(&refined, &region, past_weight, handicap);
            found.standing.is_from_afar = true;
            self.add(found);
        }
        self.sort();
        Ok(())
    }

    /// Lays out all stretches of these roads, those nearest to where the vehicle is expected
    /// first.
    fn plan_sweep(&mut self, roads: &[RoadKey], expected_map: &Point3<f64>) {
        let mut stretches: Vec<(f64, Stretch)> = Vec::new();
        for &road in roads {
            let path_map = self.map.path(road);
            let road_m = length_m(path_map);
            let count = (road_m / self.config.sweep.stretch_m).ceil().max(1.0);
            for number in 0..count as usize {
                let Some(place) = place_at(path_map, (number as f64 + 0.5) * road_m / count) else { continue };
                let away_m = place.distance_m(expected_map);
                let either =
                    [true, false].map(|is_against| Stretch { road, place, length_m: road_m / count, is_against });
                stretches.extend(either.map(|stretch| (away_m, stretch)));
            }
        }
        // Stable: the same order on every machine.
        stretches.sort_by(|a, b| b.0.total_cmp(&a.0));
        self.sweep.count = stretches.len();
        self.sweep.left.extend(stretches.into_iter().map(|(_, stretch)| stretch));
    }

    /// A rough pose amid a stretch of road, headed along it, with what reaches beyond its
    /// ends; its camera sits as in `region`.
    fn amid(&self, stretch: &Stretch, region: &State) -> Rough {
        let (place, start) = (&stretch.place, &self.config.start);
        let along_rad = place.forward_map.x.atan2(place.forward_map.z);
        let yaw_rad = if stretch.is_against { along_rad + PI } else { along_rad };
        let [x_m, y_m, z_m] = place.point_map.coords.into();
        let level = PoseParameters { x_m, y_m, z_m, yaw_rad, pitch_rad: 0.0, roll_rad: 0.0 };
        // A quarter of it beyond either end, for who drives on before its turn comes again.
        let sigma_m = 0.75 * stretch.length_m / start.reach_sigmas;
        let heading_sigma_rad = self.config.unseen.any_heading_rad / start.reach_sigmas;
        let tilt_rad = start.tilt_sigma_rad;
        Rough {
            map_from_camera: Stance::of_vehicle(region, start).on(place, &level).to_pose(),
            sigmas: Vector6::new(sigma_m, start.height_sigma_m, sigma_m, tilt_rad, heading_sigma_rad, tilt_rad),
        }
    }
}

fn length_m(path_map: &[Point3<f64>]) -> f64 {
    path_map.windows(2).map(|ends| (ends[1] - ends[0]).norm()).sum()
}

/// The place so far along a path, metres; none beyond its end.
fn place_at(path_map: &[Point3<f64>], along_m: f64) -> Option<PathPlace> {
    let mut rest_m = along_m;
    for ends in path_map.windows(2) {
        let along = ends[1] - ends[0];
        let length_m = along.norm();
        if length_m > 0.0 && rest_m <= length_m {
            return Some(PathPlace { point_map: ends[0] + along * (rest_m / length_m), forward_map: along / length_m });
        }
        rest_m -= length_m;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::local_map::LocalMap;
    use crate::testing::{IMAGE, Recipe, World};

    #[test]
    fn who_was_lost_on_the_way_is_known_again_only_once_it_is_ok() {
        let (config, here) = (SweepConfig::default(), Point3::new(30.0, 0.0, 40.0));
        let mut sweep = Sweep::default();
        sweep.know(Point3::origin());
        // Nearer than that it is where it is expected, lost or not.
        sweep.drive(config.after_m);
        assert!(!sweep.trusts(Status::Lost, false, here, &config) && sweep.region(&config).is_none());
        sweep.drive(1.0);
        assert!(!sweep.trusts(Status::Degraded, false, here, &config) && sweep.region(&config).is_none());
        assert!(!sweep.trusts(Status::Lost, false, here, &config));
        assert_eq!(sweep.region(&config), Some((Point3::origin(), config.after_m + 1.0)));
        // What looks well for a frame is not where it is known to be.
        assert!(!sweep.trusts(Status::Degraded, true, here, &config) && sweep.region(&config).is_some());
        sweep.drive(1e6);
        assert_eq!(sweep.region(&config), Some((Point3::origin(), config.farthest_m)));
        assert!(sweep.trusts(Status::Ok, true, here, &config) && sweep.region(&config).is_none());
        assert!(sweep.trusts(Status::Degraded, true, here, &config));
        sweep.drive(1e6);
        sweep.trusts(Status::Lost, false, here, &config);
        assert_eq!(sweep.region(&config), Some((here, config.farthest_m)));
    }

    #[test]
    fn all_roads_are_gone_through_from_the_expected_place_on_each_way_once() {
        let world = World::new(Recipe::default());
        let (mut map, mut roads) = (LocalMap::whole(world.map.clone()), Vec::new());
        map.roads_near(&Point3::origin(), 1e4, &mut roads).unwrap();
        let mut tracker = Tracker::new(&mut map, &world.camera, IMAGE, &Config::default());
        let expected_map = Point3::from(world.truth[100].translation.vector);
        tracker.plan_sweep(&roads, &expected_map);
        let away_m: Vec<f64> =
            tracker.sweep.left.iter().rev().map(|stretch| stretch.place.distance_m(&expected_map)).collect();
        assert!(away_m.is_sorted() && away_m[0] < 0.5 * SweepConfig::default().stretch_m, "{away_m:?}");
        let against = tracker.sweep.left.iter().filter(|stretch| stretch.is_against).count();
        assert!(2 * against == away_m.len() && tracker.sweep.count == away_m.len());
        let along_m: f64 = tracker.sweep.left.iter().map(|stretch| 0.5 * stretch.length_m).sum();
        let roads_m: f64 = roads.iter().map(|road| length_m(tracker.map.path(*road))).sum();
        assert!((along_m - roads_m).abs() < 1e-6 && roads_m > 350.0, "{along_m} of {roads_m} m");
        assert!(tracker.sweep.left.iter().all(|stretch| stretch.length_m <= SweepConfig::default().stretch_m));
    }

    #[test]
    fn a_place_lies_as_far_along_its_path_as_it_says() {
        let path_map = [[0.0, 0.0], [0.0, 0.0], [0.0, 10.0], [5.0, 10.0]].map(|[x, z]| Point3::new(x, 0.0, z));
        for (along_m, x, z) in [(0.0, 0.0, 0.0), (4.0, 0.0, 4.0), (12.0, 2.0, 10.0), (15.0, 5.0, 10.0)] {
            let place = place_at(&path_map, along_m).unwrap();
            assert!((place.point_map - Point3::new(x, 0.0, z)).norm() < 1e-9 && place.forward_map.norm() > 0.99);
        }
        assert!(place_at(&path_map, 15.1).is_none() && place_at(&path_map[..1], 0.0).is_none());
    }
}
