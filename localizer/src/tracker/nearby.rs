//! The search around a best hypothesis that is not trusted.
//!
//! What drew the pose aside (wrong matches in a few frames that showed little)
//! also holds it there: from a pose that is a metre and three degrees off, or
//! tilted, the matching does not find back by itself. So some metres around it
//! are searched as at the start, level as the road is.

use common::geometry::{Pose, PoseParameters};
use nalgebra::{Point3, Vector6};
use serde::{Deserialize, Serialize};

use super::Tracker;
use super::hypothesis::Hypothesis;
use crate::Result;
use crate::start::{Rough, StartConfig};

/// Settings of the search around a pose that is not trusted. Its steps and how
/// many standard deviations it reaches are those of the start.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NearbyConfig {
    /// It is searched in every so many frames: it costs as much as some frames,
    /// and a pose that went astray stays there.
    pub every_frames: usize,
    /// Least standard deviation to the sides, metres: with 2.5 of them to the
    /// edge of the lane.
    pub right_sigma_m: f64,
    /// Least standard deviation along the road, metres: as far as a drift got
    /// before it was noticed.
    pub forward_sigma_m: f64,
    /// Least standard deviation of the heading, radians.
    pub yaw_sigma_rad: f64,
    /// Least standard deviation of the height, metres.
    pub height_sigma_m: f64,
    /// The best cells that are matched in full.
    pub matched_cells: usize,
    /// Cells that are refined.
    pub refined: usize,
    /// Poses that may be tracked on.
    pub kept: usize,
}

impl Default for NearbyConfig {
    fn default() -> Self {
        Self {
            every_frames: 3,
            right_sigma_m: 0.5,
            forward_sigma_m: 1.0,
            yaw_sigma_rad: 0.04,
            height_sigma_m: 0.1,
            matched_cells: 12,
            refined: 3,
            kept: 2,
        }
    }
}

impl Tracker<'_> {
    /// The poses around the best hypothesis for which this frame says about as
    /// much; none while that is trusted, or too young for it: then a search has
    /// just looked around it.
    pub(super) fn search_nearby(&mut self) -> Result<Vec<Hypothesis>> {
        let (config, youngest) = (&self.config.nearby, self.config.health.verify_frames);
        let is_due = |best: &&Hypothesis| {
            let is_followed = self.verdict.is_some_and(|verdict| verdict.is_followed) || best.standing.has_left_map;
            let is_asked = !is_followed && best.age_frames >= youngest;
            is_asked && best.age_frames.is_multiple_of(config.every_frames.max(1))
        };
        let Some(best) = self.bank.first().filter(is_due).cloned() else { return Ok(Vec::new()) };
        let start = StartConfig {
            matched_cells: config.matched_cells,
            refined: config.refined,
            kept: config.kept,
            ..self.config.start
        };
        let rough = self.level_around(&best);
        let found = self.search_around(&rough, &rough.reach(&start), None, &start)?;
        let least = best.evidence - self.config.rivals.spawn_margin;
        let found = found.iter().filter(|refined| refined.evidence() > least);
        Ok(found.map(|refined| Hypothesis::beside(&best, refined, self.config.bank.jump_cost)).collect())
    }

    /// The region around a hypothesis, on the level of the road.
    fn level_around(&self, best: &Hypothesis) -> Rough {
        let (config, start) = (&self.config.nearby, &self.config.start);
        let pose = best.state.map_from_camera;
        let covariance = best.state.pose_covariance();
        let sigma = |component: usize, least: f64| covariance[(component, component)].max(0.0).sqrt().max(least);
        let yaw = (PoseParameters::from_pose(&pose).yaw_rad, sigma(4, config.yaw_sigma_rad));
        let here = Point3::from(pose.translation.vector);
        let mut rough = Rough::from_fix(self.map, &self.sight.candidates.roads, &here, 0.0, Some(yaw), start);
        // As high as it is, and as askew as this camera sits on its vehicle.
        let [pitch_rad, roll_rad] = best.state.rest_rad;
        let level = PoseParameters::from_pose(&rough.map_from_camera);
        let seated =
            PoseParameters { pitch_rad: level.pitch_rad + pitch_rad, roll_rad: level.roll_rad + roll_rad, ..level };
        rough.map_from_camera = Pose { translation: pose.translation, ..seated.to_pose() };
        rough.sigmas = Vector6::new(
            sigma(0, config.right_sigma_m),
            sigma(1, config.height_sigma_m),
            sigma(2, config.forward_sigma_m),
            start.tilt_sigma_rad,
            yaw.1,
            start.tilt_sigma_rad,
        );
        rough
    }
}
