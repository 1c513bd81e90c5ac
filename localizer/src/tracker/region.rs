//! The region in which the camera is by GPS and by the last trusted pose,
//! whatever is tracked: where it is searched for.

use common::geometry::{Tangent, local};
use nalgebra::{Matrix6, Point3, Vector6};

use super::{FrameInput, Tracker};
use crate::Result;
use crate::config::Config;
use crate::filter::State;
use crate::gps::GpsFix;
use crate::start::{Rough, keep_on_road};

impl Tracker<'_> {
    /// Keeps the region up in which the camera is, whatever is tracked.
    pub(super) fn follow_region(&mut self, dt_s: f64, input: &FrameInput<'_>) -> Result<()> {
        if let Some(region) = &mut self.region {
            *region = region.driven(dt_s, input.odometry.as_ref(), &self.config.motion, &self.config.odometry);
            let position = Point3::from(region.map_from_camera.translation.vector);
            let place = self.map.nearest_path(&self.sight.candidates.roads, &position);
            if let Some(place) = place {
                keep_on_road(region, &place, &self.config.start);
            }
        }
        let Some(fix) = input.gps else { return Ok(()) };
        let rough = self.rough_from(fix)?;
        let is_refused = self.region.as_ref().is_some_and(|region| fix.offset(region, &self.config.gps).is_none());
        self.refused_fixes = if is_refused { self.refused_fixes + 1 } else { 0 };
        if is_refused && self.refused_fixes < self.config.gps.believed_after {
            return Ok(());
        }
        match &mut self.region {
            Some(region) if !is_refused => {
                let off = local(&region.map_from_camera, &rough.map_from_camera);
                for component in [0, 2, 4] {
                    region.measure(component, off[component], rough.sigmas[component]);
                }
            }
            _ => self.region = Some(unknown_speed(&rough, &self.config)),
        }
        Ok(())
    }

    fn rough_from(&mut self, fix: &GpsFix) -> Result<Rough> {
        let reach_m = self.config.start.path_reach_m;
        self.map.roads_near(&fix.position_map, reach_m, &mut self.sight.candidates.roads)?;
        Ok(Rough::from_fix(
            self.map,
            &self.sight.candidates.roads,
            &fix.position_map,
            fix.horizontal_sigma_m,
            fix.heading,
            &self.config.start,
        ))
    }
}

/// The state of a camera of which only a rough pose is known.
fn unknown_speed(rough: &Rough, config: &Config) -> State {
    let bank = &config.bank;
    // Forward at any speed up to the highest; little of it sideways.
    let (mean_m_s, sigma_m_s) = (bank.max_speed_m_s / 3.0, bank.max_speed_m_s / 3.0);
    let side_m_s = mean_m_s * config.motion.mounting_sigma_rad;
    let sigmas = Vector6::new(side_m_s, side_m_s, sigma_m_s, 0.05, 0.3, 0.05);
    let velocity = Tangent::new(0.0, 0.0, mean_m_s, 0.0, 0.0, 0.0);
    let covariance = Matrix6::from_diagonal(&sigmas.component_mul(&sigmas));
    State::new(rough.map_from_camera, &rough.covariance(), velocity, &covariance, &config.motion, &config.odometry)
}

/// The region of a state, at least as wide as is worth a search.
pub(super) fn rough_of(region: &State, config: &Config) -> Rough {
    let own = region.pose_covariance();
    let (health, start) = (&config.health, &config.start);
    let least = Vector6::new(
        health.search_sigma_m,
        start.height_sigma_m,
        health.search_sigma_m,
        start.tilt_sigma_rad,
        health.search_sigma_rad,
        start.tilt_sigma_rad,
    );
    let sigmas = Vector6::from_fn(|i, _| {
        let most = if i < 3 { health.max_search_sigma_m } else { 1.0 };
        own[(i, i)].max(0.0).sqrt().min(most).max(least[i])
    });
    Rough { map_from_camera: region.map_from_camera, sigmas }
}
