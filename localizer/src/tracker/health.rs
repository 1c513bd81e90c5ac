//! How far the best hypothesis can be trusted.

use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use super::hypothesis::Hypothesis;
use crate::estimate::{Status, horizontal_sigma_m};

/// Settings of the health tests.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HealthConfig {
    /// A frame supports a pose with at least this, nats: two good matches more
    /// than what should be seen and is not. Where it shows less, and wheels or images
    /// tell how far it went, what was ok goes on as far as its covariance allows.
    pub min_support: f64,
    /// Standard deviation (m), horizontal and of the height, up to which an estimate is
    /// ok: 0.2 keeps 95 % within half a metre.
    pub ok_sigma_m: f64,
    /// Horizontal standard deviation (m) above which it is lost: no lane can
    /// be told any more.
    pub lost_sigma_m: f64,
    /// Frames that a hypothesis must have been tracked for to be ok.
    pub verify_frames: usize,
    /// Frames in a row that a hypothesis must have been the best of all to be
    /// ok: one that takes over contradicts what was said, and one of the two is
    /// wrong.
    pub led_frames: usize,
    /// Frames in a row in which all that ok asks of a frame must hold: a wrong
    /// pose may explain one frame well by chance.
    pub well_frames: usize,
    /// The same for the first ok of all: then nothing else holds it.
    pub well_frames_anew: usize,
    /// The same after it was lost: where it was found again may be wrong, and look
    /// right for half a second.
    pub well_frames_again: usize,
    /// Evidence by which it must lead over every other that is tracked, nats:
    /// 3 is 95 %. A pose that was jumped to must make up for its handicap, too.
    pub ok_lead: f64,
    /// Mean squared whitened residual up to which the matches agree: what it is
    /// where the standard deviations are right.
    pub max_mean_square: f64,
    /// The same for the first ok of all, and after it was lost: right poses have 0.2
    /// and seldom, one frame of fifty, over this. Matches that are all wrong can be
    /// drawn together to 1, too.
    pub max_mean_square_anew: f64,
    /// How far off an ok pose may be if one object, or most of the prediction,
    /// is wrong, metres: what nobody should be off by unwarned.
    pub max_separation_m: f64,
    /// The same if two objects are, metres: there another pose is a rival.
    pub max_separation_of_two_m: f64,
    /// Standard deviations by which the image of an ok frame may move along its way what the
    /// motion predicted: an older image than the last asks for more, braking does not.
    pub max_contradiction_sigmas: f64,
    /// Way over which what should have been seen is remembered, metres.
    pub foreseen_memory_m: f64,
    /// Least share of the poles and signs that should have been seen along it that were,
    /// after it was lost. It is 1 where they are found as often as
    /// [`crate::associate::detection::DetectionConfig`] says. In a wrong place, or with a wrong
    /// map, some fit by chance and hold the pose: about half. This is midway.
    pub least_foreseen_again: f64,
    /// That share for the first ok of all, and besides the share of the posts seen that the
    /// map knows: then nothing else holds it. Right poses have 1.4 or more, wrong ones 0.9, and
    /// the best of many of these 1.15.
    pub least_foreseen_anew: f64,
    /// The same once it was ok: trees, traffic and a map that ages may take half of them.
    pub least_foreseen: f64,
    /// Where the map knows this share of the posts that are seen, it may miss more of what
    /// should be: networks that find half of it find half of the rest. Along generated
    /// streets, cities and bends it knows 0.43 to 0.75 of them, in wrong places 0.1 to 0.36.
    pub enough_known: f64,
    /// Images in a row that show posts, and nothing that the map has there, after which it is
    /// not ok, however well the lines fit: those fit all along a road.
    pub strange_images: usize,
    /// So many posts they must have shown: networks see some where none stand.
    pub most_strange: f64,
    /// And so much of what the map has must be missing in them, landmarks times images: where
    /// it has next to nothing, nothing of it is in view.
    pub most_missing: f64,
    /// A frame holds a pose if what was matched is worth at least this, nats,
    /// whatever was not seen: with a house before half of the landmarks the
    /// rest still holds.
    pub min_worth: f64,
    /// Frames in a row that do not hold it after which it is lost; where wheels or
    /// images tell how far it went, those alone that speak against it.
    pub lost_after_frames: usize,
    /// A frame speaks against it if what should be seen and is not costs more than
    /// this, nats: one landmark may be hidden for as long as the vehicle stands, 3
    /// is 95 %.
    pub most_missed: f64,
    /// It is lost, too, where all in all more than this speaks against it, nats: then it
    /// drives where no road is, or nothing of what it should see is there.
    pub most_against: f64,
    /// Least standard deviation of the region searched then, metres.
    pub search_sigma_m: f64,
    /// Largest standard deviation of the region searched then, metres.
    pub max_search_sigma_m: f64,
    /// Largest standard deviation that is kept of where a lost vehicle may be,
    /// metres: some minutes of driving. Without bound, what roads say of its heading
    /// and of its place would move it by more than they are long.
    pub max_lost_sigma_m: f64,
    /// Least standard deviation of the headings searched then, radians.
    pub search_sigma_rad: f64,
}

impl Default for HealthConfig {
    fn default() -> Self {
        Self {
            min_support: 6.0,
            ok_sigma_m: 0.2,
            lost_sigma_m: 1.0,
            verify_frames: 5,
            led_frames: 8,
            well_frames: 2,
            well_frames_anew: 3,
            well_frames_again: 5,
            ok_lead: 3.0,
            max_mean_square: 1.0,
            max_mean_square_anew: 0.7,
            max_separation_m: 0.5,
            max_separation_of_two_m: 0.7,
            max_contradiction_sigmas: 3.0,
            foreseen_memory_m: 100.0,
            least_foreseen_again: 0.75,
            least_foreseen_anew: 1.2,
            least_foreseen: 0.5,
            enough_known: 0.45,
            strange_images: 4,
            most_strange: 20.0,
            most_missing: 8.0,
            min_worth: 6.0,
            lost_after_frames: 8,
            most_missed: 3.0,
            most_against: 20.0,
            search_sigma_m: 1.5,
            max_search_sigma_m: 30.0,
            max_lost_sigma_m: 300.0,
            search_sigma_rad: 0.03,
        }
    }
}

/// What is made of the best hypothesis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Verdict {
    /// What is said of it.
    pub status: Status,
    /// It is followed: nothing is searched around it. Less than to be called ok:
    /// who searches too much finds what is wrong.
    pub is_followed: bool,
    /// Frames in a row in which nothing spoke against it.
    pub well_frames: usize,
    /// It was ok since it was last lost.
    pub was_ok: bool,
    /// It was ok at some time.
    pub was_ever_ok: bool,
}

impl Verdict {
    /// What is said of one that is lost from here on.
    pub fn lost(self) -> Self {
        Self { status: Status::Lost, is_followed: false, well_frames: 0, was_ok: false, ..self }
    }
}

/// What else speaks for or against the best hypothesis.
#[derive(Debug, Clone, Copy)]
pub struct Context {
    /// Its evidence over the next one that is tracked, nats.
    pub lead: f64,
    /// Its support over the best pose beside it, nats.
    pub margin: f64,
    /// By how many standard deviations the image contradicts how it moved, along its way.
    pub contradiction_sigmas: f64,
    /// The covariance of its pose for the time of the image not being known.
    pub late: Matrix6<f64>,
    /// It is an old image again.
    pub shows_the_same: bool,
    /// All that stands there is strange to the map.
    pub is_strange: bool,
    /// Fixes say that it is elsewhere.
    pub is_contradicted: bool,
}

/// Judges the best hypothesis; `before` was said of the frame before.
pub fn judge(best: &Hypothesis, context: &Context, before: Option<Verdict>, health: &HealthConfig) -> Verdict {
    let was_lost = before.is_some_and(|verdict| verdict.status == Status::Lost);
    let was_ever_ok = before.is_some_and(|verdict| verdict.was_ever_ok);
    let covariance = best.state.pose_covariance();
    let sigma_m = horizontal_sigma_m(&covariance);
    // Outside the map nothing tells the height.
    let position_sigma_m = sigma_m.max(covariance[(1, 1)].max(0.0).sqrt());
    let verified = best.age_frames >= health.verify_frames;
    let is_refuted = best.weak_frames >= health.lost_after_frames || best.log_weight < -health.most_against;
    if sigma_m > health.lost_sigma_m || is_refuted || (was_lost && !verified) {
        return Verdict { status: Status::Lost, is_followed: false, well_frames: 0, was_ok: false, was_ever_ok };
    }
    if let Some(before) = before.filter(|_| context.shows_the_same) {
        // It takes nothing from what was trusted, and adds nothing.
        return Verdict { status: before.status.max(Status::Degraded), ..before };
    }
    // What was right before a jump in time, say, tells nothing of the place after it.
    let is_elsewhere = context.is_strange || context.is_contradicted;
    let was_ok = before.is_some_and(|verdict| verdict.was_ok) && !is_elsewhere;
    // Where there is little to see, what was trusted goes as far as its motion is known.
    let is_ok_still = before.is_some_and(|verdict| verdict.status == Status::Ok)
        && best.support < health.min_support
        && best.goes_on(health);
    let is_followed = verified
        && !is_elsewhere
        && position_sigma_m <= health.ok_sigma_m
        && (is_ok_still || best.support >= health.min_support && context.margin >= 0.0)
        && best.mean_square <= health.max_mean_square
        && best.separation.one_m <= health.max_separation_m
        && context.lead >= health.ok_lead + best.handicap;
    let foreseen = &best.foreseen;
    let is_foreseen = match (was_ok, was_ever_ok) {
        (true, _) => foreseen.share() >= health.least_foreseen,
        (false, true) => foreseen.share() >= health.least_foreseen_again,
        (false, false) => foreseen.agreement(health.enough_known) >= health.least_foreseen_anew,
    };
    let is_well = is_followed
        && (was_ok || best.mean_square <= health.max_mean_square_anew)
        && best.separation.two_m <= health.max_separation_of_two_m
        && context.contradiction_sigmas <= health.max_contradiction_sigmas
        && horizontal_sigma_m(&(covariance + context.late)) <= health.ok_sigma_m;
    let well_frames = if is_well { before.map_or(0, |verdict| verdict.well_frames) + 1 } else { 0 };
    let asked_frames = match (was_ok, was_ever_ok) {
        (true, _) => health.well_frames,
        (false, true) => health.well_frames_again,
        (false, false) => health.well_frames_anew,
    };
    let is_ok = is_well
        && well_frames >= asked_frames
        && best.led_frames >= health.led_frames
        && (is_foreseen || best.foreseen.known_share() >= health.enough_known);
    let status = if is_ok { Status::Ok } else { Status::Degraded };
    Verdict { status, is_followed, well_frames, was_ok: was_ok || is_ok, was_ever_ok: was_ever_ok || is_ok }
}
