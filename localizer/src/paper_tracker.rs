//! The paper's localizer over time: GPS for the first two frames, constant
//! velocity after, each frame by [`crate::associate::paper`].

use common::geometry::{PinholeCamera, Pose, local, retract};

use crate::Result;
use crate::associate::paper::{PaperScene, associate_and_localize};
use crate::config::Config;
use crate::estimate::{PoseEstimate, Status};
use crate::local_map::LocalMap;
use crate::prepare::Prepared;
use crate::preselect::{Candidates, Lookup, PreselectConfig, Reach};
use crate::projection::ImageSize;
use crate::start::Rough;
use crate::tracker::FrameInput;

/// The paper's localizer of one drive.
#[derive(Debug)]
pub struct PaperTracker<'a> {
    map: &'a mut LocalMap,
    camera: PinholeCamera,
    image: ImageSize,
    config: Config,
    /// The last two poses, the later one first.
    past: Vec<Pose>,
    frames: u64,
    prepared: Prepared,
    candidates: Candidates,
}

impl<'a> PaperTracker<'a> {
    /// A localizer that knows nothing of its position yet.
    pub fn new(map: &'a mut LocalMap, camera: &PinholeCamera, image: ImageSize, config: &Config) -> Self {
        let mut config = config.clone();
        // Lane lines 5 to 20 m ahead, whatever the default method uses.
        let paper = PreselectConfig { lane_near_m: 5.0, lane_far_m: 20.0, ..config.preselect };
        config.preselect = paper;
        Self {
            map,
            camera: *camera,
            image,
            config,
            past: Vec::new(),
            frames: 0,
            prepared: Prepared::default(),
            candidates: Candidates::default(),
        }
    }

    /// The pose at the next frame; none before the first GPS fix.
    ///
    /// # Errors
    /// Where the map cannot be read; only a map in memory cannot fail.
    pub fn step(&mut self, input: &FrameInput<'_>) -> Result<Option<PoseEstimate>> {
        self.map.next_frame()?;
        self.prepared.fill(input.features);
        let is_start = self.past.len() < 2;
        let Some(predicted) = self.predict(input)? else { return Ok(None) };
        let lookup = Lookup { map: self.map, camera: &self.camera, image: self.image, config: &self.config.preselect };
        let paper = if is_start { self.config.paper.at_start() } else { self.config.paper };
        // D5 says how far from the prediction the pose may be.
        let reach = Reach { position_m: paper.d5_m, angle_rad: 0.1 };
        lookup.select(&predicted, &reach, &mut self.candidates)?;
        let scene = PaperScene {
            camera: &self.camera,
            features: &self.prepared,
            candidates: &self.candidates,
            noise: &self.config.noise,
        };
        let result = associate_and_localize(&scene, &predicted, self.frames, &paper);
        self.frames += 1;
        self.past.insert(0, result.map_from_camera);
        self.past.truncate(2);
        Ok(Some(PoseEstimate {
            map_from_camera: result.map_from_camera,
            covariance: result.covariance,
            correspondences: result.correspondences,
            residual_rms_px: result.mean_residual_px,
            iterations: result.iterations,
            converged: result.accepted,
            // A small mean residual is all that the paper asks for, and wrong poses have it,
            // too: nothing here verifies any, so none is called ok.
            status: Status::Degraded,
            support: 0.0,
            margin: 0.0,
            time_sigma_s: 0.0,
        }))
    }

    /// The GPS fix for the first two frames, then `2 p1 - p2`.
    fn predict(&mut self, input: &FrameInput<'_>) -> Result<Option<Pose>> {
        if let [last, before] = self.past[..] {
            // Through the tangent, so that the rotation stays one.
            return Ok(Some(retract(&last, &local(&before, &last))));
        }
        let Some(fix) = input.gps else { return Ok(self.past.first().copied()) };
        self.map.roads_near(&fix.position_map, self.config.start.path_reach_m, &mut self.candidates.roads)?;
        let rough = Rough::from_fix(
            self.map,
            &self.candidates.roads,
            &fix.position_map,
            fix.horizontal_sigma_m,
            fix.heading,
            &self.config.start,
        );
        Ok(Some(rough.map_from_camera))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gps::{GpsConfig, simulate};
    use crate::testing::{IMAGE, Recipe, World, time_s};

    #[test]
    fn a_clear_street_is_followed_from_good_fixes() {
        let world = World::new(Recipe { missed: 0.1, false_poles: 1, length_m: 120.0, ..Recipe::default() });
        let mut map = LocalMap::whole(world.map.clone());
        let gps = GpsConfig { horizontal_sigma_m: 0.1, heading_sigma_deg: 0.2, ..GpsConfig::default() };
        let fixes = simulate(&world.truth[..2], &gps, 4);
        let mut tracker = PaperTracker::new(&mut map, &world.camera, IMAGE, &Config::default());
        let mut squares = Vec::new();
        for frame in 0..world.truth.len() {
            let features = world.features(frame);
            let input =
                FrameInput { time_s: time_s(frame), features: &features, gps: fixes.get(frame), odometry: None };
            let estimate = tracker.step(&input).unwrap().unwrap();
            // Right or not, nobody knows it.
            assert_eq!(estimate.status, Status::Degraded);
            squares.push(local(&world.truth[frame], &estimate.map_from_camera).fixed_rows::<3>(0).norm_squared());
        }
        let rms_m = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        assert!(rms_m < 0.5, "{rms_m} m");
    }

    #[test]
    fn without_a_fix_there_is_no_pose_and_without_features_the_prediction() {
        let world = World::new(Recipe { length_m: 40.0, ..Recipe::default() });
        let mut map = LocalMap::whole(world.map.clone());
        let mut tracker = PaperTracker::new(&mut map, &world.camera, IMAGE, &Config::default());
        let blank = crate::features::Features::default();
        assert!(
            tracker.step(&FrameInput { time_s: 0.0, features: &blank, gps: None, odometry: None }).unwrap().is_none()
        );
        let fix = crate::gps::GpsFix::from_pose(&world.truth[0], &GpsConfig::default());
        let estimate = tracker
            .step(&FrameInput { time_s: 0.0, features: &blank, gps: Some(&fix), odometry: None })
            .unwrap()
            .unwrap();
        assert_eq!(estimate.status, Status::Degraded);
        assert!(estimate.correspondences.is_empty());
    }
}
