//! The search for the pose around a rough position: from GPS at the start, or
//! around the last prediction when lost.
//!
//! A grid over position and heading is scored with the same support as every
//! other pose, each cell as uncertain as it is wide. The best cells are
//! refined with the rough position as their prior. Height, pitch and roll come
//! from the survey's path in the map, on which a camera mounted like the
//! survey's stands.

use std::f64::consts::FRAC_PI_2;

use common::geometry::{Pose, PoseParameters, local};
use nalgebra::{Matrix6, Point3, Vector6};
use serde::{Deserialize, Serialize};

use crate::associate::matching::Scene;
use crate::associate::robust::{Associator, Refined, RobustConfig};
use crate::local_map::{LocalMap, PathPlace, RoadKey};
use crate::solver::{Prior, SolverConfig};

/// Settings of the search.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StartConfig {
    /// Distance of the grid's positions, metres: about what the matching can
    /// bridge at a pole 10 m away.
    pub step_m: f64,
    /// Distance of the grid's headings, radians.
    pub step_rad: f64,
    /// The grid reaches this many standard deviations to each side.
    pub reach_sigmas: f64,
    /// Most cells; a larger region is searched with longer steps.
    pub max_cells: usize,
    /// Cells that are refined.
    pub refined: usize,
    /// Hypotheses that are kept.
    pub kept: usize,
    /// Height of the camera above the survey's path, metres: 0 for the
    /// survey's own rig.
    pub height_above_path_m: f64,
    /// Standard deviation of that height, metres: another load, another rig of
    /// the same kind, the lane beside.
    pub height_sigma_m: f64,
    /// Standard deviation of pitch and roll against the survey's path,
    /// radians: mounting, braking, the road's crossfall.
    pub tilt_sigma_rad: f64,
    /// Standard deviation of the heading against the survey's path where the
    /// GPS gives none, radians.
    pub path_heading_sigma_rad: f64,
    /// Further than this from any path its height says nothing, metres.
    pub path_reach_m: f64,
}

impl Default for StartConfig {
    fn default() -> Self {
        Self {
            step_m: 0.75,
            step_rad: 0.035,
            reach_sigmas: 2.5,
            max_cells: 40_000,
            refined: 60,
            kept: 24,
            height_above_path_m: 0.0,
            height_sigma_m: 0.15,
            tilt_sigma_rad: 0.026,
            path_heading_sigma_rad: 0.3,
            path_reach_m: 30.0,
        }
    }
}

/// A rough belief about the pose, in the axes of a level camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rough {
    /// Its mean.
    pub map_from_camera: Pose,
    /// Standard deviations: right, down, forward (m), pitch, yaw, roll (rad).
    pub sigmas: Vector6<f64>,
}

impl Rough {
    /// From a horizontal position and perhaps a heading (radians, about the
    /// down axis), with their standard deviations; the rest from the survey's
    /// path where one is near, else from the position itself.
    pub fn from_fix(
        map: &LocalMap,
        roads: &[RoadKey],
        position_map: &Point3<f64>,
        horizontal_sigma_m: f64,
        heading: Option<(f64, f64)>,
        config: &StartConfig,
    ) -> Self {
        let near = |place: &PathPlace| {
            let off = position_map - place.point_map;
            off.x.hypot(off.z) <= config.path_reach_m
        };
        let place = map.nearest_path(roads, position_map).filter(near);
        let (yaw_rad, yaw_sigma_rad) = heading.unwrap_or_else(|| {
            let along = place.map_or(0.0, |p| p.forward_map.x.atan2(p.forward_map.z));
            (along, if place.is_some() { config.path_heading_sigma_rad } else { FRAC_PI_2 })
        });
        let (y_m, pitch_rad, height_sigma_m) = match place {
            Some(p) => {
                let forward = p.forward_map;
                // Up the slope when driving along the path, down against it.
                let agreement = (yaw_rad - forward.x.atan2(forward.z)).cos();
                let pitch_rad = (-forward.y).clamp(-1.0, 1.0).asin() * agreement;
                (p.point_map.y - config.height_above_path_m, pitch_rad, config.height_sigma_m)
            }
            // GPS heights are two to three times worse than positions.
            None => (position_map.y, 0.0, 2.5 * horizontal_sigma_m),
        };
        let tilt = config.tilt_sigma_rad;
        Self {
            map_from_camera: PoseParameters {
                x_m: position_map.x,
                y_m,
                z_m: position_map.z,
                yaw_rad,
                pitch_rad,
                roll_rad: 0.0,
            }
            .to_pose(),
            sigmas: Vector6::new(horizontal_sigma_m, height_sigma_m, horizontal_sigma_m, tilt, yaw_sigma_rad, tilt),
        }
    }

    /// Its covariance in the camera's tangent.
    pub fn covariance(&self) -> Matrix6<f64> {
        Matrix6::from_diagonal(&self.sigmas.component_mul(&self.sigmas))
    }
}

/// Symmetric offsets `-n step ..= n step` that reach `reach`.
fn offsets(reach: f64, step: f64) -> impl Iterator<Item = f64> + Clone {
    let count = (reach / step).ceil() as i64;
    (-count..=count).map(move |i| i as f64 * step)
}

/// Buffers of the search.
#[derive(Debug, Clone, Default)]
pub struct Search {
    cells: Vec<(f64, Pose)>,
}

impl Search {
    /// The best poses around a rough one, best first, no two alike. Its scene
    /// must hold the candidates for the whole region.
    pub fn run(
        &mut self,
        scene: &Scene<'_>,
        rough: &Rough,
        associator: &mut Associator,
        config: &StartConfig,
        robust: &RobustConfig,
        solver: &SolverConfig,
    ) -> Vec<Refined> {
        let (step_m, step_rad) = self.score_cells(scene, rough, associator, config);
        let Some(prior) = Prior::new(rough.map_from_camera, &rough.covariance()) else { return Vec::new() };
        // A cell is known to its own width; the rest as well as the prior is.
        let mut cell_sigmas = rough.sigmas;
        for i in [0, 2] {
            cell_sigmas[i] = cell_sigmas[i].min(0.6 * step_m);
        }
        cell_sigmas[4] = cell_sigmas[4].min(0.6 * step_rad);
        let gate = Matrix6::from_diagonal(&cell_sigmas.component_mul(&cell_sigmas));
        let mut found: Vec<Refined> = Vec::new();
        let mut tried: Vec<Pose> = Vec::new();
        for (_, cell) in &self.cells {
            if tried.len() >= config.refined {
                break;
            }
            // Neighbours of a better cell lead to the same minimum.
            if tried.iter().any(|pose| is_alike(pose, cell, 1.1 * step_m, 1.1 * step_rad)) {
                continue;
            }
            tried.push(*cell);
            let Some(refined) = associator.refine(scene, cell, &gate, &prior, robust, solver) else { continue };
            found.push(refined);
        }
        found.sort_by(|a, b| b.evidence().total_cmp(&a.evidence()));
        let mut distinct: Vec<Refined> = Vec::new();
        for refined in found {
            if distinct.len() >= config.kept {
                break;
            }
            if !distinct.iter().any(|kept| is_alike(&kept.map_from_camera, &refined.map_from_camera, 0.3, 0.01)) {
                distinct.push(refined);
            }
        }
        distinct
    }

    /// Scores all cells, best first; returns the steps that were used.
    fn score_cells(
        &mut self,
        scene: &Scene<'_>,
        rough: &Rough,
        associator: &mut Associator,
        config: &StartConfig,
    ) -> (f64, f64) {
        let reach = rough.sigmas * config.reach_sigmas;
        let (mut step_m, mut step_rad) = (config.step_m, config.step_rad);
        let count = |step_m: f64, step_rad: f64| {
            offsets(reach[0], step_m).count() * offsets(reach[2], step_m).count() * offsets(reach[4], step_rad).count()
        };
        while count(step_m, step_rad) > config.max_cells.max(1) && step_m < 100.0 {
            step_m *= 1.2;
            step_rad *= 1.2;
        }
        let variance = |width: f64, sigma: f64| (width * width / 12.0).min(sigma * sigma);
        let covariance = Matrix6::from_diagonal(&Vector6::new(
            variance(step_m, rough.sigmas[0]),
            rough.sigmas[1].powi(2),
            variance(step_m, rough.sigmas[2]),
            rough.sigmas[3].powi(2),
            variance(step_rad, rough.sigmas[4]),
            rough.sigmas[5].powi(2),
        ));
        self.cells.clear();
        let centre = PoseParameters::from_pose(&rough.map_from_camera);
        let (sin, cos) = centre.yaw_rad.sin_cos();
        for right_m in offsets(reach[0], step_m) {
            for forward_m in offsets(reach[2], step_m) {
                for turn_rad in offsets(reach[4], step_rad) {
                    let pose = PoseParameters {
                        x_m: centre.x_m + cos * right_m + sin * forward_m,
                        z_m: centre.z_m - sin * right_m + cos * forward_m,
                        yaw_rad: centre.yaw_rad + turn_rad,
                        ..centre
                    }
                    .to_pose();
                    let off = Vector6::new(right_m, 0.0, forward_m, 0.0, turn_rad, 0.0).component_div(&rough.sigmas);
                    let support = associator.matcher.run(scene, &pose, &covariance);
                    self.cells.push((support - 0.5 * off.norm_squared(), pose));
                }
            }
        }
        // Stable, so that ties keep the grid's order.
        self.cells.sort_by(|a, b| b.0.total_cmp(&a.0));
        (step_m, step_rad)
    }
}

/// Whether two poses lie within these distances.
pub fn is_alike(a: &Pose, b: &Pose, distance_m: f64, angle_rad: f64) -> bool {
    let between = local(a, b);
    between.fixed_rows::<3>(0).norm() <= distance_m && between.fixed_rows::<3>(3).norm() <= angle_rad
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::associate::detection::DetectionConfig;
    use crate::measurement::NoiseConfig;
    use crate::prepare::Prepared;
    use crate::preselect::{Candidates, Lookup, PreselectConfig, Reach};
    use crate::testing::{IMAGE, Recipe, World};

    /// The map with all its roads.
    fn everywhere(world: &World) -> (LocalMap, Vec<RoadKey>) {
        let (mut map, mut roads) = (LocalMap::whole(world.map.clone()), Vec::new());
        map.roads_near(&Point3::origin(), 1e5, &mut roads).unwrap();
        (map, roads)
    }

    #[test]
    fn height_and_slope_come_from_the_path() {
        let world = World::new(Recipe::default());
        let config = StartConfig::default();
        let truth = world.truth[100];
        let mut position = Point3::from(truth.translation.vector);
        let yaw_rad = PoseParameters::from_pose(&truth).yaw_rad;
        position.y += 30.0;
        let (map, roads) = everywhere(&world);
        let rough = |heading| Rough::from_fix(&map, &roads, &position, 1.5, heading, &config);
        let along = rough(Some((yaw_rad, 0.03)));
        let off = local(&truth, &along.map_from_camera);
        assert!(off[1].abs() < 0.1 && off[3].abs() < 0.02, "{off}");
        // Without a heading: that of the survey, less certain.
        let blind = rough(None);
        assert!(local(&truth, &blind.map_from_camera)[4].abs() < 0.1 && blind.sigmas[4] > 0.2);
        // Driven against the survey the slope turns round.
        let against = rough(Some((yaw_rad + std::f64::consts::PI, 0.03)));
        let pitch = |r: &Rough| PoseParameters::from_pose(&r.map_from_camera).pitch_rad;
        assert!((pitch(&along) + pitch(&against)).abs() < 1e-6);
    }

    #[test]
    fn far_from_every_path_the_height_is_that_of_the_fix() {
        let world = World::new(Recipe::default());
        let position = Point3::new(500.0, 12.0, 0.0);
        let (map, roads) = everywhere(&world);
        let rough = Rough::from_fix(&map, &roads, &position, 1.5, None, &StartConfig::default());
        assert!((rough.map_from_camera.translation.y - 12.0).abs() < 1e-9);
        assert!(rough.sigmas[1] > 1.5 && rough.sigmas[4] > 1.0);
    }

    #[test]
    fn the_search_finds_the_pose_metres_and_degrees_off() {
        let world = World::new(Recipe { missed: 0.1, ..Recipe::default() });
        let (mut map, preselect) = (LocalMap::whole(world.map.clone()), PreselectConfig::default());
        let (noise, detection) = (NoiseConfig::default(), DetectionConfig::default());
        for frame in [60, 150] {
            let truth = world.truth[frame];
            let off = Vector6::new(2.5, 0.1, -3.0, 0.01, 0.12, 0.0);
            let sigmas = Vector6::new(3.5, 0.15, 3.5, 0.026, 0.15, 0.026);
            let rough = Rough { map_from_camera: common::geometry::retract(&truth, &off), sigmas };
            let mut candidates = Candidates::default();
            let lookup = Lookup { map: &mut map, camera: &world.camera, image: IMAGE, config: &preselect };
            let reach = Reach { position_m: 12.0, angle_rad: 0.4 };
            lookup.select(&rough.map_from_camera, &reach, &mut candidates).unwrap();
            let mut features = Prepared::default();
            features.fill(&world.features(frame));
            let scene = Scene {
                camera: &world.camera,
                image: IMAGE,
                features: &features,
                candidates: &candidates,
                noise: &noise,
                detection: &detection,
            };
            let run = |scene: &Scene<'_>| {
                Search::default().run(
                    scene,
                    &rough,
                    &mut Associator::default(),
                    &StartConfig::default(),
                    &RobustConfig::default(),
                    &SolverConfig::default(),
                )
            };
            let found = run(&scene);
            let near = |pose: &Pose| local(&truth, pose).fixed_rows::<3>(0).norm() < 0.4;
            assert!(found.iter().take(3).any(|r| near(&r.map_from_camera)), "frame {frame}");
            assert!(found.windows(2).all(|w| w[0].evidence() >= w[1].evidence()));
            assert_eq!(found, run(&scene));
            // With nothing in sight there is nothing but the rough pose.
            let blind = run(&Scene { features: &Prepared::default(), ..scene });
            assert!(blind.iter().all(|r| r.matches == 0));
        }
    }
}
