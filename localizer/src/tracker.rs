//! The localizer over time: a few hypotheses, each an error-state filter, fed
//! with the same images; the one with the most evidence speaks.
//!
//! A start, a wrong lock and a recovery are the same thing here: hypotheses
//! that are tracked side by side until the images tell which is right. They
//! come from the search around a GPS fix (start), around the prediction (lost
//! or not trusted) and from poses beside the best one that explain a frame as
//! well (rivals).

mod anchor;
mod bank;
mod believed;
mod between;
mod clock;
mod coast;
mod constrain;
mod course;
mod health;
mod hypothesis;
mod mean;
mod nearby;
mod outside;
mod region;
mod rivals;
mod search;
mod sight;
mod speak;
mod strangers;
mod sweep;
mod unseen;

pub use bank::BankConfig;
use believed::{Believed, Doubts};
use between::Choice;
use clock::Clock;
pub use clock::ClockConfig;
use course::Course;
pub use health::HealthConfig;
use health::Verdict;
pub use nearby::NearbyConfig;
pub use rivals::RivalConfig;

use common::geometry::{PinholeCamera, Pose};

use crate::Result;
use crate::associate::robust::{Associator, Refined};
use crate::config::Config;
use crate::estimate::PoseEstimate;
use crate::features::Features;
use crate::gps::GpsFix;
use crate::local_map::LocalMap;
use crate::odometry::Odometry;
use crate::preselect::{Lookup, Reach};
use crate::projection::ImageSize;
use crate::start::Search;
use hypothesis::Hypothesis;
use region::Region;
use sight::Sight;
use strangers::Strangers;
use sweep::Sweep;
pub use sweep::SweepConfig;
use unseen::Unseen;
pub use unseen::UnseenConfig;

/// What one frame brings.
#[derive(Debug, Clone, Copy)]
pub struct FrameInput<'a> {
    /// Time of the image, seconds.
    pub time_s: f64,
    /// What the image shows.
    pub features: &'a Features,
    /// A rough position, where there is one for this frame.
    pub gps: Option<&'a GpsFix>,
    /// Mean motion since the frame before, where wheels and gyroscope say it.
    pub odometry: Option<Odometry>,
}

/// The localizer of one drive.
#[derive(Debug)]
pub struct Tracker<'a> {
    map: &'a mut LocalMap,
    config: Config,
    /// Best first, never empty once started.
    bank: Vec<Hypothesis>,
    /// The buffer that the bank is moved to next.
    spare: Vec<Hypothesis>,
    last_time_s: Option<f64>,
    /// Time since the last image that was gone through, seconds.
    since_image_s: f64,
    /// What of it nothing told how fast it went, seconds.
    untold_s: f64,
    /// What of the odometry was not believed.
    doubts: Doubts,
    /// Where the camera must be by GPS and by the last trusted pose.
    region: Region,
    /// What the way from fix to fix says of the heading.
    course: Course,
    /// Where it may have gone while no image came.
    unseen: Unseen,
    /// The search of all roads in reach.
    sweep: Sweep,
    /// How well the times of the images are kept.
    clock: Clock,
    /// By how much the time since the last frame was doubted, s^2.
    time_variance_s2: f64,
    /// Which images are gone through.
    choice: Choice,
    /// What was made of the last frame.
    verdict: Option<Verdict>,
    /// What was seen and is not in the map.
    strangers: Strangers,
    /// Fixes in a row that say that the best hypothesis is elsewhere.
    contradicting_fixes: usize,
    /// Time since the best hypothesis was last followed, seconds.
    unfollowed_s: f64,
    associator: Associator,
    search: Search,
    /// In how many frames it was searched around where it is expected.
    searched_frames: usize,
    sight: Sight,
    /// The rivals of a frame.
    rivals: Vec<Refined>,
    /// The last estimate.
    said: Option<PoseEstimate>,
}

impl<'a> Tracker<'a> {
    /// A localizer that knows nothing of its position yet.
    pub fn new(map: &'a mut LocalMap, camera: &PinholeCamera, image: ImageSize, config: &Config) -> Self {
        Self {
            map,
            config: config.clone(),
            bank: Vec::new(),
            spare: Vec::new(),
            last_time_s: None,
            since_image_s: 0.0,
            untold_s: 0.0,
            doubts: Doubts::default(),
            region: Region::default(),
            course: Course::default(),
            unseen: Unseen::default(),
            sweep: Sweep::default(),
            clock: Clock::default(),
            time_variance_s2: 0.0,
            choice: Choice::default(),
            verdict: None,
            strangers: Strangers::default(),
            contradicting_fixes: 0,
            unfollowed_s: f64::INFINITY,
            associator: Associator::default(),
            search: Search::default(),
            searched_frames: 0,
            sight: Sight::new(camera, image, &config.detection.odds),
            rivals: Vec::new(),
            said: None,
        }
    }

    /// What it localizes with.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The time of the last frame that was gone through, seconds.
    pub(crate) fn gone_over_s(&self) -> Option<f64> {
        self.last_time_s
    }

    /// The pose at the next frame; none before the first GPS fix. Times must
    /// ascend: a frame no later than the one before is taken as of its time.
    ///
    /// # Errors
    /// Where the map cannot be read; only a map in memory cannot fail.
    pub fn step(&mut self, input: &FrameInput<'_>) -> Result<Option<&PoseEstimate>> {
        let dt_s = self.last_time_s.map_or(0.0, |last_s| (input.time_s - last_s).max(0.0));
        if self.choice.passes_by(input.time_s, &self.config.clock) && self.said.is_some() {
            return Ok(self.pass_by(dt_s, input));
        }
        self.map.next_frame()?;
        self.last_time_s = Some(self.last_time_s.map_or(input.time_s, |last_s| last_s.max(input.time_s)));
        self.sight.look(input.features);
        let gps = self.fix_for(input);
        let gps = gps.as_ref();
        if self.sight.shows_the_same && dt_s <= 0.0 && gps.is_none() {
            return Ok(self.said.as_ref());
        }
        let rest_s = self.drift(dt_s, input.odometry)?;
        let dt_s = self.moved_on_s(rest_s, input.odometry.as_ref());
        let since_image_s = dt_s + std::mem::take(&mut self.since_image_s);
        self.clock.tick(since_image_s, self.sight.shows_the_same, &self.config.clock);
        self.unfollowed_s += dt_s;
        let believed = self.believed(dt_s, input.odometry);
        self.predict(dt_s, &believed);
        let odometry = believed.shown;
        let untold_s = std::mem::take(&mut self.untold_s);
        let untold_s = if odometry.is_some_and(|shown| shown.tells_speed()) { untold_s } else { untold_s + rest_s };
        self.go_unseen(untold_s, rest_s, odometry.as_ref());
        self.follow_region(dt_s, odometry.as_ref(), gps)?;
        self.observe(dt_s, gps)?;
        if self.sight.shows_nothing() {
            return Ok(self.speak(0.0));
        }
        let was_searched = self.search_if_needed()?;
        self.sweep()?;
        self.prune();
        let nearby = if was_searched { Vec::new() } else { self.search_nearby()? };
        let margin = self.find_rivals()?;
        // What was added now stands behind those that were tracked.
        for hypothesis in nearby {
            self.add(hypothesis);
        }
        Ok(self.speak(margin))
    }

    /// What of a time poses are moved on for, seconds.
    fn moved_on_s(&self, dt_s: f64, odometry: Option<&Odometry>) -> f64 {
        let config = &self.config.unseen;
        dt_s.min(if odometry.is_some() { config.longest_told_s } else { config.longest_untold_s })
    }

    /// Moves every hypothesis on; those that do not know their speed yet split
    /// into one for each speed that the images could tell apart, and the best
    /// where what moves it is odd: one follows that, the other does not.
    fn predict(&mut self, dt_s: f64, believed: &Believed) {
        std::mem::swap(&mut self.bank, &mut self.spare);
        self.bank.clear();
        let best = self.spare.first().map_or((0.0, 0.0), Hypothesis::spoken);
        let next = self.spare.get(1).map(|next| next.evidence);
        let widest = self.config.bank.told(self.spare.iter().map(|hypothesis| hypothesis.evidence));
        let was_ever_ok = self.verdict.is_some_and(|verdict| verdict.was_ever_ok);
        for (i, mut hypothesis) in self.spare.drain(..).enumerate() {
            // The best is set apart from the next, all others from it. Before anything was
            // trusted, nothing is known that would have to stay.
            let other = if i == 0 { next } else { Some(best.1) }.filter(|_| was_ever_ok);
            let of_pair = |other| self.config.bank.told([hypothesis.evidence, other].into_iter());
            let anew = if was_ever_ok { self.config.bank.anew(hypothesis.way_m) } else { 1.0 };
            let told = anew * other.map_or(widest, of_pair);
            hypothesis.carry(best, told, &self.config.bank);
            let is_doubted = i == 0 && believed.is_odd();
            let sober = is_doubted.then(|| hypothesis.disbelieving(self.config.odometry.disbelief));
            hypothesis.predict(dt_s, believed.shown.as_ref(), &self.config, &mut self.bank);
            if let Some(sober) = sober {
                sober.predict(dt_s, believed.usual.as_ref(), &self.config, &mut self.bank);
            }
        }
        if believed.is_odd() {
            // Nothing but the images tells how far it went.
            self.bank.iter_mut().for_each(|hypothesis| hypothesis.is_carried = false);
        }
        self.time_variance_s2 = self.clock.variance_s2();
    }

    /// Keeps all hypotheses where a vehicle can be `dt_s` after the last frame,
    /// and a fix allows.
    fn constrain(&mut self, dt_s: f64, gps: Option<&GpsFix>) {
        let most_astray = self.most_astray();
        for hypothesis in &mut self.bank {
            hypothesis.constrain_to_path(dt_s, self.map, &self.sight.candidates.roads, &self.config);
            if let Some(fix) = gps.filter(|_| self.config.gps.fuse) {
                hypothesis.constrain_to_fix(fix, &self.config.gps);
            }
            hypothesis.compare(&self.region, most_astray, &self.config.gps);
        }
    }

    /// Selects the landmarks for all hypotheses at once.
    fn select(&mut self, centre: &Pose, reach: &Reach) -> Result<()> {
        let lookup = Lookup {
            map: self.map,
            camera: &self.sight.camera,
            image: self.sight.image,
            config: &self.config.preselect,
        };
        lookup.select(centre, reach, &mut self.sight.candidates)
    }

    /// Reach around the best hypothesis that covers all of them.
    fn bank_reach(&self) -> Option<(Pose, Reach)> {
        let centre = self.bank.first()?.state.map_from_camera;
        let mut reach = Reach { position_m: 0.0, angle_rad: 0.0 };
        for hypothesis in &self.bank {
            let state = &hypothesis.state;
            let own = Reach::of_covariance(&(state.pose_covariance() + state.time_covariance(self.time_variance_s2)));
            let pose = &hypothesis.state.map_from_camera;
            let off_m = (pose.translation.vector - centre.translation.vector).norm();
            reach.position_m = reach.position_m.max(off_m + own.position_m);
            reach.angle_rad = reach.angle_rad.max(pose.rotation.angle_to(&centre.rotation) + own.angle_rad);
        }
        Some((centre, reach))
    }

    fn observe(&mut self, dt_s: f64, gps: Option<&GpsFix>) -> Result<()> {
        let Some((centre, reach)) = self.bank_reach() else { return Ok(()) };
        self.select(&centre, &reach)?;
        self.constrain(dt_s, gps);
        if self.sight.shows_nothing() {
            // A black image says nothing, least of all for empty places.
            self.see_nothing(self.sight.features.is_empty());
            return Ok(());
        }
        let scene = self.sight.scene(&self.config);
        let mut jumps = Vec::new();
        for hypothesis in &mut self.bank {
            if let Some(jump) = hypothesis.observe(&scene, &mut self.associator, self.time_variance_s2, &self.config) {
                jumps.push(Hypothesis::jumped(hypothesis, &jump, self.config.bank.jump_cost));
            }
        }
        for jump in jumps {
            self.add(jump);
        }
        self.level_outside();
        self.sort();
        if let Some(interval) = self.bank.first().and_then(|best| best.interval) {
            self.clock.learn(&interval, &self.config.clock);
        }
        Ok(())
    }

    /// Lets a time pass of which no image tells anything, or none that is new.
    fn see_nothing(&mut self, is_black: bool) {
        self.bank.iter_mut().for_each(|hypothesis| hypothesis.see_nothing(is_black, &self.config.health));
    }
}

#[cfg(test)]
mod tests;
