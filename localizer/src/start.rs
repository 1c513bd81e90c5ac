//! The search for the pose around a rough position: from GPS at the start, or
//! around the last prediction when lost.
//!
//! A grid over position and heading is scored with the same support as every
//! other pose, each cell as uncertain as it is wide. The best cells are
//! refined with the rough position as their prior. Height, pitch and roll come
//! from the survey's path in the map, on which a camera mounted like the
//! survey's stands.

mod cells;
mod field;
mod rough;

use common::geometry::{Pose, local};
use nalgebra::{Matrix6, Vector6};
use serde::{Deserialize, Serialize};

use crate::associate::matching::Scene;
use crate::associate::robust::{Associator, Question, Refined};
use crate::config::Config;
use crate::local_map::{LocalMap, RoadKey};
use crate::solver::Prior;
pub(crate) use cells::wrapped;
use cells::{Cell, Cells};
use field::Field;
pub use rough::{Rough, Stance, keep_on_road};

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
    /// Most cells; a larger region is searched with longer steps. A cell costs
    /// about 2 microseconds.
    pub max_cells: usize,
    /// The best cells that are matched in full, 20 times as costly.
    pub matched_cells: usize,
    /// Up to this horizontal standard deviation (m) a grid around the rough
    /// position is searched, above it the roads around it: a GPS fix may lie
    /// beside the road, a vehicle that was lost for a while does not.
    pub grid_sigma_m: f64,
    /// The search along roads reaches this far to each side of the survey's
    /// path, metres: two lanes.
    pub road_half_width_m: f64,
    /// Standard deviation of a vehicle's heading against the road's, radians,
    /// where the images say nothing.
    pub road_heading_sigma_rad: f64,
    /// The search along roads reaches this far to each side of the survey's
    /// heading, radians: a change of lanes.
    pub road_turn_rad: f64,
    /// Depths at which cells are asked for lane lines, metres: near enough to
    /// tell lanes apart, far enough to be in the image.
    pub lane_depths_m: [f64; 3],
    /// What network and optics bend a lane line by, pixels.
    pub lane_sigma_px: f64,
    /// Nothing nearer is asked for, metres: there a cell is wider than the image.
    pub nearest_m: f64,
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
    /// Other heights above that at which a camera is sought that was never found, metres:
    /// those of a robot, a van and a bus. What is found follows 0.5 m of height by itself.
    pub other_heights_m: [f64; 3],
    /// In every so manieth frame of such a search.
    pub other_heights_every: usize,
    /// After so many frames of it no more: by then it is the map that does not fit, and
    /// whatever is tried for long fits somewhere by chance.
    pub other_heights_until: usize,
    /// What a pose of such a height pays, nats.
    pub other_height_cost: f64,
    /// Standard deviation of the survey's path in height along a road, metres:
    /// its tolerance, springs.
    pub road_height_sigma_m: f64,
    /// How much the road falls to the side (share): beside the path the height
    /// is as much less sure.
    pub crossfall: f64,
    /// Frames over which the height is off by the same: some seconds. So many
    /// together say it once.
    pub height_frames: f64,
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
            max_cells: 20_000,
            matched_cells: 400,
            grid_sigma_m: 4.0,
            road_half_width_m: 6.0,
            road_heading_sigma_rad: 0.35,
            road_turn_rad: 0.14,
            lane_depths_m: [8.0, 13.0, 20.0],
            lane_sigma_px: 5.0,
            nearest_m: 2.0,
            refined: 60,
            kept: 24,
            height_above_path_m: 0.0,
            other_heights_m: [-0.9, 0.9, 1.6],
            other_heights_every: 4,
            other_heights_until: 40,
            other_height_cost: 3.0,
            height_sigma_m: 0.15,
            road_height_sigma_m: 0.06,
            crossfall: 0.025,
            height_frames: 8.0,
            tilt_sigma_rad: 0.026,
            path_heading_sigma_rad: 0.3,
            path_reach_m: 30.0,
        }
    }
}

/// Buffers of the search.
#[derive(Debug, Clone, Default)]
pub struct Search {
    cells: Cells,
    field: Field,
}

impl Search {
    /// Looks around a rough pose: at a grid where it is known to some metres,
    /// else along the roads.
    pub fn lay_out(&mut self, rough: &Rough, map: &LocalMap, roads: &[RoadKey], config: &StartConfig) {
        let sigma_m = rough.sigmas[0].max(rough.sigmas[2]);
        self.cells.all.clear();
        if sigma_m > config.grid_sigma_m {
            self.cells.roads(rough, map, roads, config);
        }
        if self.cells.all.is_empty() {
            self.cells.grid(rough, map, roads, config);
        }
    }

    /// The best poses of those laid out around a rough one, best first, no two
    /// alike. The scene must hold the candidates for the whole region. `start` takes
    /// the place of what `config` says of starts.
    pub fn run(
        &mut self,
        scene: &Scene<'_>,
        rough: &Rough,
        associator: &mut Associator,
        start: &StartConfig,
        config: &Config,
    ) -> Vec<Refined> {
        let sigmas = self.cells.sigmas(rough);
        self.score(scene, &sigmas, associator, start);
        let (step_m, step_rad) = (self.cells.step_m, self.cells.step_rad);
        let covariance = rough.covariance();
        let Some(prior) = Prior::new(rough.map_from_camera, &covariance) else { return Vec::new() };
        // Twice as wide as for the score: neighbours are not refined.
        let mut gate_sigmas = sigmas;
        for i in [0, 2, 4] {
            gate_sigmas[i] = (2.0 * sigmas[i]).min(rough.sigmas[i]);
        }
        let gate_of = |sigmas: &Vector6<f64>| Matrix6::from_diagonal(&sigmas.component_mul(sigmas));
        let gate = gate_of(&gate_sigmas);
        let question = Question { scene, gate_covariance: &gate, prior: &prior, config };
        let mut found: Vec<Refined> = Vec::new();
        let mut tried: Vec<Pose> = Vec::new();
        for cell in &self.cells.all {
            if tried.len() >= start.refined {
                break;
            }
            // Neighbours of a better cell lead to the same minimum.
            if tried.iter().any(|pose| is_alike(pose, &cell.pose, 1.1 * step_m, 1.1 * step_rad)) {
                continue;
            }
            tried.push(cell.pose);
            if !self.cells.are_on_roads {
                found.extend(associator.refine(&question, &cell.pose));
                continue;
            }
            // The rough pose's axes say nothing round the next corner: the
            // prior is the cell with its share of what the rough pose allows.
            let near = gate_of(&(gate_sigmas * 2.0));
            let refined = Prior::new(cell.pose, &near)
                .and_then(|prior| associator.refine(&Question { prior: &prior, ..question }, &cell.pose));
            let share_ln = 0.5 * (near.determinant().ln() - covariance.determinant().ln());
            found.extend(refined.map(|refined| Refined {
                prior_cost: refined.prior_cost - cell.prior,
                occam: refined.occam + share_ln.min(0.0),
                ..refined
            }));
        }
        found.sort_by(|a, b| b.evidence().total_cmp(&a.evidence()));
        let mut distinct: Vec<Refined> = Vec::new();
        for refined in found {
            if distinct.len() >= start.kept {
                break;
            }
            if !distinct.iter().any(|kept| is_alike(&kept.map_from_camera, &refined.map_from_camera, 0.3, 0.01)) {
                distinct.push(refined);
            }
        }
        distinct
    }

    /// Scores the cells, best first: all by the cheap score, the best of them
    /// by the full matching; only these are left.
    fn score(&mut self, scene: &Scene<'_>, sigmas: &Vector6<f64>, associator: &mut Associator, config: &StartConfig) {
        let cells = &mut self.cells.all;
        // Stable, so that ties keep the order of the cells.
        let sort = |cells: &mut Vec<Cell>| cells.sort_by(|a, b| b.score.total_cmp(&a.score));
        if cells.len() > config.matched_cells {
            self.field.fill(scene);
            for cell in cells.iter_mut() {
                cell.score = cell.prior + self.field.score(scene, &cell.pose, sigmas, config);
            }
            sort(cells);
            cells.truncate(config.matched_cells);
        }
        let covariance = Matrix6::from_diagonal(&sigmas.component_mul(sigmas));
        for cell in cells.iter_mut() {
            cell.score = cell.prior + associator.matcher.support(scene, &cell.pose, &covariance);
        }
        sort(cells);
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
    use crate::associate::odds::UsualOdds;
    use crate::measurement::NoiseConfig;
    use crate::prepare::Prepared;
    use crate::preselect::{Candidates, Lookup, PreselectConfig, Reach};
    use crate::testing::{IMAGE, Recipe, World};

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
                odds: UsualOdds::default(),
            };
            let (map, roads) = world.local_map();
            let run = |scene: &Scene<'_>| {
                let mut search = Search::default();
                search.lay_out(&rough, &map, &roads, &StartConfig::default());
                search.run(scene, &rough, &mut Associator::default(), &StartConfig::default(), &Config::default())
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
