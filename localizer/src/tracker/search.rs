//! Searches around where the vehicle is expected.

use super::hypothesis::Hypothesis;
use super::{Tracker, region};
use crate::Result;
use crate::associate::robust::Refined;
use crate::filter::State;
use crate::local_map::RoadKey;
use crate::preselect::Reach;
use crate::start::{Rough, StartConfig};

impl Tracker<'_> {
    /// Searches the region while nothing is tracked that the last frames
    /// speak for; says whether it did.
    pub(super) fn search_if_needed(&mut self) -> Result<bool> {
        let bank = &self.config.bank;
        let lead = self.lead();
        let sure = self.bank.first().is_some_and(|best| {
            let verified = best.age_frames >= self.config.health.verify_frames;
            // Two frames may be enough where nothing else comes near.
            let alone = best.age_frames >= 1 && lead >= bank.sure_lead;
            (verified && best.log_weight >= bank.sure_evidence)
                || (alone && best.log_weight >= 2.0 * bank.sure_evidence)
        });
        if (sure && !self.is_contradicted()) || self.sight.shows_nothing() || self.has_left_map() {
            return Ok(false);
        }
        let regions = [self.region.searched(&self.config.gps), self.region.searched_turned(&self.config.gps)];
        let regions = regions.map(Option::<&_>::cloned);
        let Some(region) = &regions[0] else { return Ok(false) };
        let position = region.map_from_camera.translation.vector.into();
        self.map.roads_near(&position, self.config.start.path_reach_m, &mut self.sight.candidates.roads)?;
        let start = self.config.start;
        let handicap = if self.bank.is_empty() { 0.0 } else { self.newcomer_cost() };
        // What is hidden from the best was hidden from the others, too.
        let past_weight = self.bank.first().map_or(0.0, |best| best.past_weight.min(0.0));
        self.searched_frames += 1;
        let others: &[f64] = if self.tries_other_heights() { &start.other_heights_m } else { &[] };
        let others = others.iter().map(|&higher_m| (higher_m, start.other_height_cost));
        let heights: Vec<(f64, f64)> = std::iter::once((0.0, 0.0)).chain(others).collect();
        let roads = &self.sight.candidates.roads;
        let roughs = regions
            .map(|region| region.map(|region| (region::rough_of(&region, self.map, roads, &self.config), region)));
        for (rough, region) in roughs.iter().flatten() {
            let is_from_afar = rough.sigmas[0].max(rough.sigmas[2]) > start.grid_sigma_m;
            for &(higher_m, cost) in &heights {
                let (region, rough) = (raised(region, higher_m), rough.raised(higher_m));
                for refined in self.search_around(&rough, &rough.reach(&start), None, &start)? {
                    let mut found = Hypothesis::found(&refined, &region, past_weight, handicap + cost);
                    found.standing.is_from_afar = is_from_afar;
                    self.add(found);
                }
            }
        }
        self.sort();
        Ok(true)
    }

    /// The poses that fit best around a rough one with what is seen within `reach`; where that
    /// says little along this road alone, or along all that are near.
    pub(super) fn search_around(
        &mut self,
        rough: &Rough,
        reach: &Reach,
        road: Option<RoadKey>,
        start: &StartConfig,
    ) -> Result<Vec<Refined>> {
        self.select(&rough.map_from_camera, reach)?;
        let roads = if road.is_some() { road.as_slice() } else { &self.sight.candidates.roads };
        self.search.lay_out(rough, self.map, roads, start);
        let scene = self.sight.scene(&self.config);
        Ok(self.search.run(&scene, rough, &mut self.associator, start, &self.config))
    }

    /// What a pose that the search finds beside those that are tracked pays,
    /// nats: as much as a jump where one was just trusted, for that does not get
    /// lost within some frames.
    pub(super) fn newcomer_cost(&self) -> f64 {
        let bank = &self.config.bank;
        let trusted = (-self.unfollowed_s / bank.trust_memory_s.max(f64::MIN_POSITIVE)).exp();
        bank.newcomer_cost + (bank.jump_cost - bank.newcomer_cost) * trusted
    }

    /// Whether a camera of another height is sought, too: now and then in the first seconds
    /// of a search in which none of the survey's height was ok.
    fn tries_other_heights(&self) -> bool {
        let start = &self.config.start;
        !self.verdict.is_some_and(|verdict| verdict.was_ever_ok)
            && self.searched_frames <= start.other_heights_until
            && self.searched_frames.is_multiple_of(start.other_heights_every)
    }
}

/// The belief of a camera that sits so much higher, metres.
fn raised(region: &State, higher_m: f64) -> State {
    State { higher_m: region.higher_m + higher_m, ..region.clone() }
}
