//! One hypothesis: a filter, the evidence for it, and its last frame.

use common::geometry::local;
use nalgebra::Cholesky;

use super::anchor::Anchor;
use super::bank::BankConfig;
use super::clock::Interval;
use super::health::HealthConfig;
use super::outside::Standing;
use super::region::Region;
use crate::associate::foreseen::Foreseen;
use crate::associate::matching::Scene;
use crate::associate::robust::{Associator, Question, Refined};
use crate::associate::separation::Separation;
use crate::config::Config;
use crate::estimate::{Correspondence, horizontal_sigma_m};
use crate::filter::State;
use crate::gps::GpsConfig;
use crate::odometry::Odometry;
use crate::projection::View;
use crate::solver::Prior;

/// Most speeds on each side of the mean that one of unknown speed is split into.
const MOST_SPLITS: f64 = 50.0;

/// What should be seen where a hypothesis begins counts as along so much of a way, metres:
/// as one frame does in a town.
const FIRST_WAY_M: f64 = 1.0;

/// One belief about where the camera is, and what speaks for it.
#[derive(Debug, Clone)]
pub struct Hypothesis {
    /// Pose and velocity.
    pub state: State,
    /// The same before the last image was looked at.
    predicted: State,
    /// Where it would be without what was seen in the last seconds.
    anchor: Anchor,
    /// What speaks for it: evidence with fading memory less the handicap, nats.
    pub log_weight: f64,
    /// The evidence before this frame.
    pub past_weight: f64,
    /// What the last frame says of its time.
    pub interval: Option<Interval>,
    /// What it has to make up for, because it was not tracked from the start
    /// or jumped, nats. It fades, too, but slowly.
    pub handicap: f64,
    /// What the region speaks against it, nats: the last trusted pose, driven on,
    /// and fixes.
    pub astray: f64,
    /// Frames that it was tracked for.
    pub age_frames: usize,
    /// Frames since it was the same as another.
    pub apart_frames: usize,
    /// Frames in a row that it has been the best.
    pub led_frames: usize,
    /// Frames in a row whose matches did not hold it.
    pub weak_frames: usize,
    /// Wheels or images say how far it went.
    pub is_carried: bool,
    /// The speed is not known yet.
    pub speed_is_unknown: bool,
    /// Where it came from, and whether it is in the map.
    pub standing: Standing,
    /// Support of the last frame, nats.
    pub support: f64,
    /// What the last frame added to the evidence, nats.
    pub evidence: f64,
    /// Mean squared whitened residual of the last frame.
    pub mean_square: f64,
    /// By how much it was ahead of the shifted poses beside it, when these were
    /// last looked at, nats.
    pub margin: Option<f64>,
    /// By how much the pose moves if objects are left out.
    pub separation: Separation,
    /// How far it is from the nearest road, metres.
    pub off_road_m: f64,
    /// What should have been seen along its way, and what of that was: landmarks
    /// times metres, with fading memory.
    pub foreseen: Foreseen,
    /// The same in the last frame alone.
    pub now: Foreseen,
    /// The way since the frame before, metres.
    pub way_m: f64,
    /// Root mean square distance of its matches, pixels.
    pub rms_px: f64,
    /// Solver iterations in the last frame.
    pub iterations: usize,
    /// The solver reached a minimum.
    pub converged: bool,
    /// Its matches.
    pub correspondences: Vec<Correspondence>,
}

impl Hypothesis {
    /// A pose that the search found, with what it is taken to have had in the
    /// frames before, and has to make up for; its speed is that of the region.
    pub fn found(refined: &Refined, region: &State, past_weight: f64, handicap: f64) -> Self {
        let state = region.moved_to(refined.map_from_camera, &refined.covariance);
        let mut hypothesis = Self::blank(state, past_weight, handicap);
        hypothesis.speed_is_unknown = true;
        hypothesis.take(refined, refined.prior_cost);
        hypothesis
    }

    /// A rival of `best`. Either the motion changed since the frame before by
    /// so much, and it pays what that costs; or the rival was beside it all
    /// along, moves as it does, and pays for a jump.
    pub fn beside(best: &Self, rival: &Refined, jump_cost: f64) -> Self {
        Self::aside(best, rival, rival.prior_cost, jump_cost)
    }

    /// What [`Self::observe`] returned: it was asked from where `best` was expected, so
    /// what it pays for the motion is all that it pays for its distance.
    pub fn jumped(best: &Self, jump: &Refined, jump_cost: f64) -> Self {
        Self::aside(best, jump, 0.0, jump_cost)
    }

    fn aside(best: &Self, rival: &Refined, surprise: f64, jump_cost: f64) -> Self {
        let off = local(&best.predicted.map_from_camera, &rival.map_from_camera);
        let turning = Cholesky::new(best.predicted.pose_covariance()).map(|factor| 0.5 * off.dot(&factor.solve(&off)));
        let (state, handicap) = if let Some(turning) = turning.filter(|cost| *cost < jump_cost) {
            let mut turned = best.predicted.clone();
            turned.update(&rival.map_from_camera, &rival.covariance);
            (turned, best.handicap + turning)
        } else {
            // What the best has to make up for speaks for those beside it.
            (best.state.moved_to(rival.map_from_camera, &rival.covariance), best.handicap.max(jump_cost))
        };
        let mut hypothesis = Self::blank(state, best.past_weight, handicap);
        hypothesis.speed_is_unknown = best.speed_is_unknown;
        hypothesis.standing.is_from_afar = best.standing.is_from_afar;
        hypothesis.take(rival, surprise);
        // A wrong time looks like a jump, too.
        hypothesis.interval = best.knows_its_speed().then(|| Interval::new(&best.predicted, rival));
        hypothesis
    }

    fn blank(state: State, past_weight: f64, handicap: f64) -> Self {
        Self {
            predicted: state.clone(),
            state,
            anchor: Anchor::default(),
            log_weight: past_weight - handicap,
            past_weight,
            interval: None,
            handicap,
            astray: 0.0,
            age_frames: 0,
            apart_frames: 0,
            led_frames: 0,
            weak_frames: 0,
            is_carried: false,
            speed_is_unknown: false,
            standing: Standing::default(),
            support: 0.0,
            evidence: 0.0,
            mean_square: 0.0,
            margin: None,
            separation: Separation::default(),
            off_road_m: 0.0,
            foreseen: Foreseen::default(),
            now: Foreseen::default(),
            way_m: FIRST_WAY_M,
            rms_px: 0.0,
            iterations: 0,
            converged: false,
            correspondences: Vec::new(),
        }
    }

    fn take(&mut self, refined: &Refined, surprise: f64) {
        self.support = refined.support;
        self.mean_square = refined.mean_square;
        self.rms_px = refined.rms_px;
        self.iterations = refined.iterations;
        self.converged = refined.converged;
        self.now = refined.foreseen;
        self.foreseen.add(&self.now, self.way_m);
        self.evidence = refined.support + refined.occam - surprise;
        self.weigh();
    }

    /// In its first frame the speed of one that was just found is a guess.
    pub fn knows_its_speed(&self) -> bool {
        self.age_frames >= 2
    }

    /// Sums up what speaks for it.
    pub(super) fn weigh(&mut self) {
        self.log_weight = self.past_weight + self.evidence - self.handicap - self.astray;
    }

    /// Takes in how far it lies from where the camera must be, no more than `most` nats.
    pub fn compare(&mut self, region: &Region, most: f64, gps: &GpsConfig) {
        let astray = region.against(&self.state, gps, most);
        self.log_weight += self.astray - astray;
        self.astray = astray;
    }

    /// What speaks for it: in the frames before the last, and in the last, nats.
    pub fn spoken(&self) -> (f64, f64) {
        (self.past_weight, self.evidence)
    }

    /// Carries what speaks for it to the next frame. Of what sets it apart from what
    /// is [`Self::spoken`] for the best, the last frame takes the place of as much as
    /// it `told` (see [`BankConfig::told`]).
    pub fn carry(&mut self, (past, last): (f64, f64), told: f64, bank: &BankConfig) {
        let renewed = |past: f64, last: f64| (past + last) * bank.memory;
        let ahead = self.past_weight - past;
        let ahead = ahead + told * (renewed(ahead, self.evidence - last) - ahead);
        self.past_weight = renewed(past, last) + ahead;
        self.handicap *= bank.handicap_memory.powf(told);
    }

    /// The same, which does not follow what is believed, and pays for it, nats.
    pub fn disbelieving(&self, cost: f64) -> Self {
        Self { handicap: self.handicap + cost, apart_frames: 0, ..self.clone() }
    }

    /// Begins anew, with what speaks for it beyond this, nats.
    pub fn forget(&mut self, past: f64) {
        self.past_weight -= past;
        (self.age_frames, self.led_frames) = (0, 0);
        self.standing = Standing { was_ok: false, has_left_map: false, ..self.standing };
        self.foreseen = Foreseen::default();
    }

    /// Moves on by `dt_s` into `out`: once, or once for each speed while the
    /// speed is unknown. Wheels, where there are any, say how fast it is.
    pub fn predict(mut self, dt_s: f64, odometry: Option<&Odometry>, config: &Config, out: &mut Vec<Self>) {
        self.age_frames += 1;
        self.apart_frames += 1;
        self.interval = None;
        self.now = Foreseen::default();
        let way_m = self.state.velocity.fixed_rows::<3>(0).norm() * dt_s;
        self.foreseen.fade((-way_m / config.health.foreseen_memory_m).exp());
        self.way_m = way_m;
        let is_told = odometry.is_some_and(Odometry::tells_speed);
        if !self.speed_is_unknown || dt_s <= 0.0 || is_told {
            self.speed_is_unknown &= !is_told;
            let was = (is_told && self.knows_its_speed()).then_some(&self.state);
            self.anchor.drive(was, dt_s, odometry, config);
            self.state = self.state.driven(dt_s, odometry, &config.motion, &config.odometry);
            self.is_carried = is_told;
            out.push(self);
            return;
        }
        // Steps that the association bridges, over the speeds that may be.
        let sigma_m_s = self.state.covariance[(8, 8)].max(0.0).sqrt();
        // After a gap of minutes no number of them would do.
        let coarsest_m_s = config.start.reach_sigmas * sigma_m_s / MOST_SPLITS;
        let step_m_s = (config.start.step_m / dt_s).max(coarsest_m_s);
        let reach = (config.start.reach_sigmas * sigma_m_s / step_m_s - 0.5).ceil().max(0.0) as i32;
        let speeds: Vec<f64> = (-reach..=reach)
            .map(|i| self.state.velocity[2] + f64::from(i) * step_m_s)
            .filter(|speed| reach == 0 || (-0.5 * step_m_s..=config.bank.max_speed_m_s).contains(speed))
            .collect();
        for &speed_m_s in &speeds {
            let mut split = Self { apart_frames: 0, ..self.clone() };
            let off = (speed_m_s - self.state.velocity[2]) / sigma_m_s.max(1e-9);
            // The prior of the speed, and that one of the splits is right.
            split.past_weight -= 0.5 * off * off + ((2 * reach + 1) as f64).ln();
            split.state.velocity[2] = speed_m_s;
            let known = (0.6 * step_m_s).min(sigma_m_s) / sigma_m_s.max(1e-9);
            split.state.sharpen(8, known);
            let mounting = (speed_m_s.abs() * config.motion.mounting_sigma_rad).max(0.3);
            for i in [6, 7] {
                let excess = (split.state.covariance[(i, i)].max(1e-12).sqrt() / mounting).max(1.0);
                split.state.sharpen(i, 1.0 / excess);
            }
            split.state = split.state.driven(dt_s, odometry, &config.motion, &config.odometry);
            split.speed_is_unknown = false;
            out.push(split);
        }
    }

    /// A frame did not hold it: that says nothing against who knows how far it
    /// went and misses little that should be seen.
    fn weaken(&mut self, health: &HealthConfig) {
        self.weak_frames += usize::from(!self.goes_on(health));
    }

    /// Whether a frame that shows little leaves it where it is known to have gone, and
    /// misses little that should be seen.
    pub fn goes_on(&self, health: &HealthConfig) -> bool {
        self.is_carried && -self.support <= health.most_missed
    }

    /// Lets a frame pass that shows nothing, or nothing new: the prediction stands.
    pub fn see_nothing(&mut self, is_black: bool, health: &HealthConfig) {
        self.correspondences.clear();
        self.separation = Separation::default();
        (self.support, self.evidence, self.mean_square, self.rms_px) = (0.0, 0.0, 0.0, 0.0);
        (self.iterations, self.converged) = (0, false);
        self.weigh();
        if is_black {
            self.weaken(health);
        }
    }

    /// Associates and localizes in the scene, and weighs the result. Matches
    /// that are not worth the motion that they ask for are not believed: then
    /// the prediction stands, and the pose they ask for is returned, to be
    /// tracked as a jump. The time of the scene is doubted by `time_variance_s2`: of
    /// one that tells nothing, nothing of that stays, for times that are off do not add up.
    pub fn observe(
        &mut self,
        scene: &Scene<'_>,
        associator: &mut Associator,
        time_variance_s2: f64,
        config: &Config,
    ) -> Option<Refined> {
        self.correspondences.clear();
        let predicted = self.state.map_from_camera;
        self.predicted.clone_from(&self.state);
        self.predicted.doubt_time(time_variance_s2);
        let covariance = self.predicted.pose_covariance();
        // Who is fast is not lost because it is not known when the image was taken.
        if horizontal_sigma_m(&self.state.pose_covariance()) > config.health.lost_sigma_m {
            // So far it was nowhere: what is found now is as good as found anew.
            (self.age_frames, self.led_frames) = (0, 0);
        }
        let prior = Prior::new(predicted, &covariance)?;
        let question = Question { scene, gate_covariance: &covariance, prior: &prior, config };
        let refined = associator.refine_predicted(&question)?;
        let beyond = (self.off_road_m - config.bank.road_m).max(0.0) / config.bank.off_road_sigma_m;
        let off_road = (0.5 * beyond * beyond).min(config.bank.max_surprise);
        let off_road = if self.standing.has_left_map { 0.0 } else { off_road };
        let unlikely = off_road + self.state.surprise.min(config.bank.max_surprise);
        if refined.gain < 0.0 || refined.prior_cost > config.bank.max_innovation {
            self.mean_square = 0.0;
            self.separation = Separation::default();
            self.rms_px = 0.0;
            self.iterations = refined.iterations;
            self.converged = refined.converged;
            self.support = refined.support - refined.worth;
            self.evidence = self.support - unlikely;
            self.weigh();
            self.weaken(&config.health);
            return (refined.matches > 0).then_some(refined);
        }
        self.take(&refined, refined.prior_cost + unlikely);
        self.interval = self.knows_its_speed().then(|| Interval::new(&self.predicted, &refined));
        self.state.doubt_time(time_variance_s2);
        self.state.update(&refined.map_from_camera, &refined.covariance);
        if refined.worth >= config.health.min_worth {
            self.weak_frames = 0;
        } else {
            self.weaken(&config.health);
        }
        self.separation = associator.balance.separation(
            &associator.matcher.matches,
            &View::new(scene.camera, &refined.map_from_camera),
            &refined.map_from_camera,
            (&prior, self.anchor.prior(time_variance_s2).as_ref()),
            &config.separation,
            &config.solver,
        );
        associator.correspondences(scene, &refined.map_from_camera, &config.solver, &mut self.correspondences);
        None
    }
}
