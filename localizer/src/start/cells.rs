//! The poses that a search looks at: a grid around a rough pose, or, where
//! little is known, the stretches of road around it.

use common::geometry::{Pose, PoseParameters};
use nalgebra::{Point3, Vector6};

use super::{Rough, Stance, StartConfig};
use crate::local_map::{LocalMap, PathPlace, RoadKey};

/// A pose to look at.
#[derive(Debug, Clone, Copy)]
pub struct Cell {
    /// What speaks for it before the image does, nats.
    pub prior: f64,
    /// With what the image says, as far as it was asked, nats.
    pub score: f64,
    /// The pose.
    pub pose: Pose,
}

/// The cells of a search.
#[derive(Debug, Clone, Default)]
pub struct Cells {
    /// In no order of merit.
    pub all: Vec<Cell>,
    /// Distance of neighbours, metres.
    pub step_m: f64,
    /// Turn between neighbours, radians.
    pub step_rad: f64,
    /// They lie along roads, and not around the rough pose.
    pub are_on_roads: bool,
}

/// Symmetric offsets `-n step ..= n step` that reach `reach`.
fn offsets(reach: f64, step: f64) -> impl Iterator<Item = f64> + Clone {
    let count = (reach / step).ceil() as i64;
    (-count..=count).map(move |i| i as f64 * step)
}

impl Cells {
    /// A grid of positions and headings around a rough pose, which stands
    /// everywhere on the survey's path as it does where it is.
    pub fn grid(&mut self, rough: &Rough, map: &LocalMap, roads: &[RoadKey], config: &StartConfig) {
        let reach = rough.sigmas * config.reach_sigmas;
        self.lengthen(config, |step_m, step_rad| {
            offsets(reach[0], step_m).count() * offsets(reach[2], step_m).count() * offsets(reach[4], step_rad).count()
        });
        self.all.clear();
        self.are_on_roads = false;
        let centre = PoseParameters::from_pose(&rough.map_from_camera);
        let stance = stance(&centre, map, roads, config);
        let (sin, cos) = centre.yaw_rad.sin_cos();
        for right_m in offsets(reach[0], self.step_m) {
            for forward_m in offsets(reach[2], self.step_m) {
                let here = PoseParameters {
                    x_m: centre.x_m + cos * right_m + sin * forward_m,
                    z_m: centre.z_m - sin * right_m + cos * forward_m,
                    ..centre
                };
                let on_path = stance.zip(near_path(map, roads, &here, config));
                for turn_rad in offsets(reach[4], self.step_rad) {
                    let level = PoseParameters { yaw_rad: centre.yaw_rad + turn_rad, ..here };
                    let pose = on_path.map_or(level, |(stance, place)| stance.on(&place, &level));
                    let off = Vector6::new(right_m, 0.0, forward_m, 0.0, turn_rad, 0.0).component_div(&rough.sigmas);
                    let prior = -0.5 * off.norm_squared();
                    self.all.push(Cell { prior, score: prior, pose: pose.to_pose() });
                }
            }
        }
    }

    /// Poses on the roads within reach of a rough pose, headed along them: a
    /// vehicle that was lost for a while has stayed on the road.
    pub fn roads(&mut self, rough: &Rough, map: &LocalMap, roads: &[RoadKey], config: &StartConfig) {
        let sigma_m = rough.sigmas[0].max(rough.sigmas[2]);
        let reach_m = config.reach_sigmas * sigma_m;
        let known = PoseParameters::from_pose(&rough.map_from_camera);
        let centre = Point3::new(known.x_m, known.y_m, known.z_m);
        let stance = stance(&known, map, roads, config).unwrap_or_else(|| Stance::of_survey(config));
        // Headings far from the rough one are as improbable as it is sure.
        let heading_sigma_rad = rough.sigmas[4].max(config.path_heading_sigma_rad);
        let length_m: f64 = roads.iter().map(|&road| length_within_m(map.path(road), &centre, reach_m)).sum();
        let (width_m, turn_rad) = (config.road_half_width_m, config.road_turn_rad);
        self.lengthen(config, |step_m, step_rad| {
            let stations = (length_m / step_m).ceil() as usize;
            stations * offsets(width_m, step_m).count() * offsets(turn_rad, step_rad).count()
        });
        self.all.clear();
        self.are_on_roads = true;
        for &road in roads {
            for place in stations(map.path(road), self.step_m) {
                let off_m = place.distance_m(&centre);
                if off_m > reach_m {
                    continue;
                }
                let along_rad = place.forward_map.x.atan2(place.forward_map.z);
                // Either way.
                for heading_rad in [along_rad, along_rad + std::f64::consts::PI] {
                    let turned = wrapped(heading_rad - known.yaw_rad) / heading_sigma_rad;
                    if turned.abs() > config.reach_sigmas {
                        continue;
                    }
                    let prior = -0.5 * ((off_m / sigma_m).powi(2) + turned * turned);
                    let (sin, cos) = heading_rad.sin_cos();
                    for right_m in offsets(width_m, self.step_m) {
                        for turn_rad in offsets(turn_rad, self.step_rad) {
                            let headed = PoseParameters {
                                x_m: place.point_map.x + cos * right_m,
                                z_m: place.point_map.z - sin * right_m,
                                yaw_rad: heading_rad + turn_rad,
                                ..known
                            };
                            let pose = stance.on(&place, &headed);
                            self.all.push(Cell { prior, score: prior, pose: pose.to_pose() });
                        }
                    }
                }
            }
        }
    }

    /// The longest steps that need no more cells than are allowed.
    fn lengthen(&mut self, config: &StartConfig, count: impl Fn(f64, f64) -> usize) {
        (self.step_m, self.step_rad) = (config.step_m, config.step_rad);
        while count(self.step_m, self.step_rad) > config.max_cells.max(1) && self.step_m < 100.0 {
            self.step_m *= 1.2;
            self.step_rad *= 1.2;
        }
    }

    /// How far the true pose of a cell may be from it, standard deviations of
    /// a pose known as roughly.
    pub fn sigmas(&self, rough: &Rough) -> Vector6<f64> {
        // An even distribution over a step has its 12th part as variance.
        let of_step = 12.0_f64.sqrt().recip();
        let mut sigmas = rough.sigmas;
        for i in [0, 2] {
            sigmas[i] = sigmas[i].min(of_step * self.step_m);
        }
        sigmas[4] = sigmas[4].min(of_step * self.step_rad);
        sigmas
    }
}

/// The place of the survey's path beside a pose, where that is near.
fn near_path(map: &LocalMap, roads: &[RoadKey], at: &PoseParameters, config: &StartConfig) -> Option<PathPlace> {
    map.path_within(roads, &Point3::new(at.x_m, at.y_m, at.z_m), config.path_reach_m)
}

/// How a pose stands on the path beside it, where that is near.
fn stance(at: &PoseParameters, map: &LocalMap, roads: &[RoadKey], config: &StartConfig) -> Option<Stance> {
    near_path(map, roads, at, config).map(|place| Stance::of(at, &place))
}

/// An angle in -pi..pi.
pub(crate) fn wrapped(angle_rad: f64) -> f64 {
    angle_rad.sin().atan2(angle_rad.cos())
}

/// Length of the edges of a path that begin within reach, metres.
fn length_within_m(path_map: &[Point3<f64>], centre: &Point3<f64>, reach_m: f64) -> f64 {
    let near = |p: &Point3<f64>| (p.x - centre.x).hypot(p.z - centre.z) <= reach_m;
    let edges = path_map.windows(2).filter(|ends| ends.iter().any(near));
    // Of a long edge no more counts than fits into the reach.
    edges.map(|ends| (ends[1] - ends[0]).norm().min(2.0 * reach_m)).sum()
}

/// Places every `step_m` along a path.
fn stations(path_map: &[Point3<f64>], step_m: f64) -> impl Iterator<Item = PathPlace> {
    path_map.windows(2).flat_map(move |ends| {
        let along = ends[1] - ends[0];
        let length_m = along.norm();
        let count = (length_m / step_m).ceil().max(1.0) as usize;
        let forward_map = along / length_m.max(1e-9);
        (0..count).map(move |i| PathPlace { point_map: ends[0] + along * (i as f64 / count as f64), forward_map })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Recipe, World};
    use common::geometry::{local, retract};

    /// A survey's pose, of a camera that stands 0.3 m higher, and nods and leans.
    fn on_another_rig(pose: &Pose) -> Pose {
        retract(pose, &Vector6::new(0.0, -0.3, 0.0, 0.04, 0.0, -0.03))
    }

    #[test]
    fn cells_stand_on_the_road_as_the_rough_pose_does() {
        let world = World::new(Recipe::default());
        let (map, roads) = world.local_map();
        let config = StartConfig::default();
        let mut cells = Cells::default();
        for (sigma_m, ahead) in [(3.5, 6), (12.0, 25)] {
            let sigmas = Vector6::new(sigma_m, 0.15, sigma_m, 0.026, 0.1, 0.026);
            // Where it is steepest.
            let rough = Rough { map_from_camera: on_another_rig(&world.truth[120]), sigmas };
            if sigma_m > config.grid_sigma_m {
                cells.roads(&rough, &map, &roads, &config);
            } else {
                cells.grid(&rough, &map, &roads, &config);
            }
            let truth = on_another_rig(&world.truth[120 + ahead]);
            let off = |cell: &Cell| local(&truth, &cell.pose);
            let is_beside = |off: &Vector6<f64>| {
                let away_m = off[0].hypot(off[2]);
                away_m < cells.step_m && off[4].abs() < cells.step_rad
            };
            let beside: Vec<_> = cells.all.iter().map(off).filter(is_beside).collect();
            assert!(!beside.is_empty(), "{ahead} m ahead");
            for off in beside {
                assert!(off[1].abs() < 0.08 && off[3].abs() < 0.015 && off[5].abs() < 0.015, "{ahead} m ahead: {off}");
            }
        }
    }

    #[test]
    fn the_road_ahead_is_searched_far_with_few_cells() {
        let world = World::new(Recipe::default());
        let (map, roads) = world.local_map();
        let config = StartConfig::default();
        let sigmas = Vector6::new(12.0, 0.15, 12.0, 0.026, 0.2, 0.026);
        let rough = Rough { map_from_camera: world.truth[100], sigmas };
        let mut cells = Cells::default();
        cells.roads(&rough, &map, &roads, &config);
        assert!(!cells.all.is_empty() && cells.all.len() <= 2 * config.max_cells);
        // 25 m further there is a cell beside the truth.
        let ahead = &world.truth[100 + 25];
        let near = |cell: &Cell| {
            let off = local(ahead, &cell.pose);
            off.fixed_rows::<3>(0).norm() < cells.step_m && off.fixed_rows::<3>(3).norm() < 0.1
        };
        assert!(cells.all.iter().any(near));
    }

    #[test]
    fn a_grid_is_symmetric_about_the_rough_pose_and_no_larger_than_allowed() {
        let world = World::new(Recipe::default());
        let config = StartConfig { max_cells: 500, ..StartConfig::default() };
        let sigmas = Vector6::new(3.0, 0.15, 3.0, 0.026, 0.2, 0.026);
        let rough = Rough { map_from_camera: world.truth[100], sigmas };
        let mut cells = Cells::default();
        let (map, roads) = world.local_map();
        cells.grid(&rough, &map, &roads, &config);
        assert!(cells.all.len() <= 500 && cells.step_m > config.step_m);
        let best = cells.all.iter().max_by(|a, b| a.prior.total_cmp(&b.prior)).unwrap();
        assert!(local(&rough.map_from_camera, &best.pose).norm() < 1e-9);
    }
}
