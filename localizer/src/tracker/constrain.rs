//! What a pose keeps to, whatever is seen: roads, and fixes.

use common::geometry::PoseParameters;
use nalgebra::Point3;

use super::hypothesis::Hypothesis;
use super::outside::is_beyond_map;
use crate::config::Config;
use crate::gps::{GpsConfig, GpsFix};
use crate::local_map::{LocalMap, RoadKey};
use crate::start::keep_on_road;

impl Hypothesis {
    /// Keeps height, pitch and roll from wandering off where the images do not
    /// fix them: the survey's path tells the height, but no better for being
    /// said in every frame, and what springs returned to in the `dt_s` since
    /// the last.
    pub fn constrain_to_path(&mut self, dt_s: f64, map: &LocalMap, roads: &[RoadKey], config: &Config) {
        let start = &config.start;
        let position = Point3::from(self.state.map_from_camera.translation.vector);
        let Some(place) = map.nearest_path(roads, &position) else { return };
        self.off_road_m = place.distance_m(&position);
        // It leaves it once nothing is left to see.
        self.standing.has_left_map =
            self.standing.was_ok && is_beyond_map(&self.state, config.rivals.lever_m, map, roads, config);
        if self.standing.has_left_map && is_beyond_map(&self.state, 0.0, map, roads, config) {
            return;
        }
        keep_on_road(&mut self.state, &place, start);
        if self.off_road_m > start.path_reach_m {
            return;
        }
        let own = PoseParameters::from_pose(&self.state.map_from_camera);
        let height_m = place.point_map.y - start.height_above_path_m;
        // What the road is off by stays the same for some frames.
        let crossfall_m = start.crossfall * self.off_road_m;
        let height_sigma_m = start.road_height_sigma_m.hypot(crossfall_m) * start.height_frames.sqrt();
        self.state.measure_height(height_m - own.y_m, height_sigma_m);
        self.state.spring_back(dt_s, [place.pitch_rad(own.yaw_rad) - own.pitch_rad, -own.roll_rad], &config.motion);
    }

    /// Keeps the position from wandering off further than a fix can be wrong.
    pub fn constrain_to_fix(&mut self, fix: &GpsFix, config: &GpsConfig) {
        let Some([right_m, _]) = fix.offset(&self.state, config) else { return };
        self.state.constrain(0, right_m, fix.horizontal_sigma_m);
        // What that says of the way along, too, is not said again.
        let Some([_, forward_m]) = fix.offset(&self.state, config) else { return };
        self.state.constrain(2, forward_m, fix.horizontal_sigma_m);
    }
}
