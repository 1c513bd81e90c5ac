//! Where the map ends and the vehicle goes on.
//!
//! A pose outside explains nothing of what is seen, for nothing of it is in the map, and any
//! pose before the end of the map explains the lane lines. So who is known to have left it
//! is not compared with those: what is seen out there says nothing of where it is, and it is
//! followed by its motion alone until it may be back.

use nalgebra::Point3;

use super::Tracker;
use super::hypothesis::Hypothesis;
use crate::config::Config;
use crate::estimate::horizontal_sigma_m;
use crate::filter::State;
use crate::local_map::{LocalMap, RoadKey};

/// What a hypothesis is, by where it came from and where it is now.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Standing {
    /// It was ok, or moved on from what was.
    pub was_ok: bool,
    /// It was found along all roads that it may be on, and has not been ok since.
    pub is_from_afar: bool,
    /// It surely went on where the map ends.
    pub has_left_map: bool,
}

/// Whether a place so far ahead of a camera, metres, surely lies in front of an end of the
/// map: further than the camera may be off.
pub(super) fn is_beyond_map(state: &State, ahead_m: f64, map: &LocalMap, roads: &[RoadKey], config: &Config) -> bool {
    let pose = &state.map_from_camera;
    let place_map = pose * Point3::new(0.0, 0.0, ahead_m);
    let least_m = config.start.reach_sigmas * horizontal_sigma_m(&state.pose_covariance());
    map.beyond_end_m(roads, &place_map, config.bank.road_m).is_some_and(|beyond_m| beyond_m > least_m)
}

impl Tracker<'_> {
    /// Whether the best hypothesis has left the map, and no fixes say that it is elsewhere:
    /// nothing is searched in the map then.
    pub(super) fn has_left_map(&self) -> bool {
        self.bank.first().is_some_and(|best| best.standing.has_left_map) && !self.is_contradicted()
    }

    /// Lets the last frame say as much for those that have left the map as for whatever it
    /// says the most for.
    pub(super) fn level_outside(&mut self) {
        if !self.bank.iter().any(|hypothesis| hypothesis.standing.has_left_map) {
            return;
        }
        let most = self.bank.iter().map(|hypothesis| hypothesis.evidence).fold(f64::NEG_INFINITY, f64::max);
        let outside = self.bank.iter_mut().filter(|hypothesis| hypothesis.standing.has_left_map);
        outside.for_each(|hypothesis: &mut Hypothesis| {
            hypothesis.evidence = most;
            hypothesis.weigh();
        });
    }
}
