//! Figures of the paper's own kind, as numbers: correspondences per frame
//! (Fig. 9), the iterations of one optimisation (13), errors by axis (14), the
//! cost around the pose of one frame (15).

use std::fmt::Write as _;

use common::geometry::{PinholeCamera, Pose, Tangent, retract};
use localizer::associate::matching::{Matcher, Scene};
use localizer::associate::odds::UsualOdds;
use localizer::config::Config;
use localizer::estimate::LandmarkId;
use localizer::eval::FrameError;
use localizer::local_map::LocalMap;
use localizer::prepare::Prepared;
use localizer::preselect::{Candidates, Lookup, Reach};
use localizer::residual::{Group, Observation};
use localizer::run::FrameResult;
use localizer::solver::{Problem, SolverConfig, solve};

use crate::trial::Trial;

/// How far the terrain reaches to each side, metres, and its steps.
const TERRAIN_M: f64 = 2.0;
const TERRAIN_STEP_M: f64 = 0.05;
/// Where the optimisation that is looked at starts: right, down, forward (m),
/// pitch, yaw, roll (rad) off the estimate. About what a frame's motion may
/// surprise by.
const START_OFF: [f64; 6] = [0.3, 0.0, 0.5, 0.0, 0.01, 0.0];

/// Fig. 9: features that were seen and that found a landmark, by class.
pub fn correspondences(results: &[FrameResult]) -> String {
    let mut text =
        String::from("frame,poles_seen,lanes_seen,signs_seen,poles_matched,lanes_matched,signs_matched,status\n");
    for result in results {
        let found = &result.estimate.correspondences;
        let count = |of: fn(&LandmarkId) -> bool| found.iter().filter(|pair| of(&pair.landmark)).count();
        let [poles, lanes, signs] = result.features;
        let _ = writeln!(
            text,
            "{},{poles},{lanes},{signs},{},{},{},{}",
            result.frame,
            count(|landmark| matches!(landmark, LandmarkId::Pole(_))),
            count(|landmark| matches!(landmark, LandmarkId::Lane(_))),
            count(|landmark| matches!(landmark, LandmarkId::Sign(_))),
            result.estimate.status
        );
    }
    text
}

/// Fig. 14: errors in the axes of the true camera, with what was claimed.
pub fn errors(results: &[FrameResult], errors: &[FrameError]) -> String {
    let mut text =
        String::from("frame,right_m,down_m,forward_m,angle_rad,sigma_right_m,sigma_down_m,sigma_forward_m,status\n");
    for (result, error) in results.iter().zip(errors) {
        let [right_m, down_m, forward_m, ..] = result.estimate.sigmas();
        let _ = writeln!(
            text,
            "{},{:.4},{:.4},{:.4},{:.5},{right_m:.4},{down_m:.4},{forward_m:.4},{}",
            error.frame,
            error.lateral_m,
            error.vertical_m,
            error.longitudinal_m,
            error.angle_rad,
            result.estimate.status
        );
    }
    text
}

/// What was matched in one frame, as the solver takes it.
#[derive(Debug)]
pub struct Matched {
    camera: PinholeCamera,
    pose: Pose,
    observations: Vec<Observation>,
    groups: Vec<Group>,
    solver: SolverConfig,
}

impl Matched {
    /// Matches what a frame shows at its estimate; none where the drive has no
    /// such frame, or nothing is matched in it.
    ///
    /// # Errors
    /// What the localizer says; a map in memory gives it no reason.
    pub fn new(trial: &Trial, result: &FrameResult) -> localizer::Result<Option<Self>> {
        let Some(seen) = trial.frames.iter().find(|seen| seen.frame == result.frame) else { return Ok(None) };
        let Config { preselect, noise, detection, solver, .. } = &trial.config;
        let pose = result.estimate.map_from_camera;
        let mut map = LocalMap::whole(trial.map.clone());
        let mut candidates = Candidates::default();
        let reach = Reach::of_covariance(&result.estimate.covariance);
        Lookup { map: &mut map, camera: &trial.camera, image: trial.image, config: preselect }.select(
            &pose,
            &reach,
            &mut candidates,
        )?;
        let mut features = Prepared::default();
        features.fill(&seen.features);
        let scene = Scene {
            camera: &trial.camera,
            image: trial.image,
            features: &features,
            candidates: &candidates,
            noise,
            detection,
            odds: UsualOdds::new(&detection.odds),
        };
        let mut matcher = Matcher::default();
        matcher.run(&scene, &pose, &result.estimate.covariance);
        matcher.drop_worthless(scene.detection);
        let (mut observations, mut groups) = (Vec::new(), Vec::new());
        matcher.observations(&mut observations, &mut groups);
        let matched = Self { camera: trial.camera, pose, observations, groups, solver: *solver };
        Ok((!matched.groups.is_empty()).then_some(matched))
    }

    /// Where so many iterations from a pose come to: cost (half the robust sum
    /// of squares, without any prior) and pose.
    fn after(&self, iterations: usize, start: &Pose) -> (f64, Pose) {
        let problem = Problem { camera: &self.camera, observations: &self.observations, prior: None };
        let config = SolverConfig { max_iterations: iterations, ..self.solver };
        let solution = solve(&problem, &mut self.groups.clone(), &config, start);
        (solution.cost, solution.map_from_camera)
    }

    /// Fig. 15: the cost at poses shifted to the right and forward.
    pub fn terrain(&self) -> String {
        let mut text = String::from("right_m,forward_m,cost\n");
        let reach = (TERRAIN_M / TERRAIN_STEP_M).round() as i32;
        for (right, forward) in (-reach..=reach).flat_map(|right| (-reach..=reach).map(move |ahead| (right, ahead))) {
            let (right_m, forward_m) = (f64::from(right) * TERRAIN_STEP_M, f64::from(forward) * TERRAIN_STEP_M);
            let shifted = retract(&self.pose, &Tangent::new(right_m, 0.0, forward_m, 0.0, 0.0, 0.0));
            let _ = writeln!(text, "{right_m:.2},{forward_m:.2},{:.4}", self.after(0, &shifted).0);
        }
        text
    }

    /// Fig. 13: the cost after each iteration, from a pose beside the estimate,
    /// and how far from the estimate it is.
    pub fn iterations(&self) -> String {
        let start = retract(&self.pose, &Tangent::from_row_slice(&START_OFF));
        let mut text = String::from("iteration,cost,off_m,off_rad\n");
        for iteration in 0..=self.solver.max_iterations {
            let (cost, pose) = self.after(iteration, &start);
            let error = FrameError::new(0, &self.pose, &pose);
            let _ = writeln!(text, "{iteration},{cost:.6},{:.6},{:.6}", error.position_m(), error.angle_rad);
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::made_up::clean;
    use localizer::projection::View;
    use nalgebra::{Point3, Vector2};

    /// Three posts and a board, seen exactly from the pose.
    fn matched() -> Matched {
        let trial = clean();
        let pose = trial.truth[5];
        let view = View::new(&trial.camera, &pose);
        let mut observations = Vec::new();
        for at in [[-4.0, 0.0, 20.0], [6.0, 1.0, 25.0], [3.0, -2.0, 22.0], [-2.0, -3.0, 18.0]] {
            let point = Point3::from(at);
            let (pixel, _) = view.project(&point).unwrap();
            for normal in [Vector2::x(), Vector2::y()] {
                observations.push(Observation::on_line(point, normal, &pixel, 1.0));
            }
        }
        let groups = (0..4).map(|i| Group::new(2 * i, 2 * i + 2)).collect();
        Matched { camera: trial.camera, pose, observations, groups, solver: SolverConfig::default() }
    }

    fn rows(text: &str) -> Vec<Vec<f64>> {
        text.lines().skip(1).map(|row| row.split(',').map(|value| value.parse().unwrap()).collect()).collect()
    }

    #[test]
    fn the_terrain_is_lowest_at_the_pose_and_reaches_two_metres() {
        let rows = rows(&matched().terrain());
        assert_eq!(rows.len(), 81 * 81);
        let lowest = rows.iter().min_by(|a, b| a[2].total_cmp(&b[2])).unwrap();
        assert!(lowest[0].abs() < 1e-9 && lowest[1].abs() < 1e-9 && lowest[2] < 1e-6);
        assert!(rows.iter().all(|row| row[0].abs() <= 2.0 && row[1].abs() <= 2.0));
    }

    #[test]
    fn the_cost_falls_with_each_iteration_until_the_pose_is_found() {
        let rows = rows(&matched().iterations());
        assert!(rows.windows(2).all(|pair| pair[1][1] <= pair[0][1] + 1e-9));
        assert!(rows[0][1] > 10.0 && (rows[0][2] - 0.34_f64.sqrt()).abs() < 0.01);
        assert!(rows.last().unwrap()[1] < 1e-6 && rows.last().unwrap()[2] < 1e-3);
    }
}
