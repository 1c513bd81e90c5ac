//! The set of hypotheses that are tracked side by side.

use serde::{Deserialize, Serialize};

use super::Tracker;
use super::hypothesis::Hypothesis;
use super::mean::odds;
use crate::config::Config;
use crate::start::is_alike;

/// Settings of the set of hypotheses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BankConfig {
    /// Evidence of the last frames together from which on nothing else is
    /// searched, nats.
    pub sure_evidence: f64,
    /// With twice that evidence, a lead over all others from which on a young
    /// hypothesis is not searched beside either, nats.
    pub sure_lead: f64,
    /// Hypotheses younger than [`Self::young_frames`] that are kept.
    pub young_capacity: usize,
    /// Older hypotheses that are kept.
    pub capacity: usize,
    /// Age at which a hypothesis is no longer young, frames.
    pub young_frames: usize,
    /// Share of the evidence that is carried to the next frame. The same
    /// landmarks are seen again with the same errors, so frames are not
    /// independent: 0.8 lets about five count.
    pub memory: f64,
    /// Share of a handicap that is carried to the next frame: 0.95 halves it
    /// within 13 frames.
    pub handicap_memory: f64,
    /// By how much a frame must tell two hypotheses apart for it to take the
    /// place of those before, nats. One that fits both as well, a stretch with nothing
    /// but a line along the road, says nothing of which is right, and what was known
    /// of that stays, whatever it says of a third; but for the first frames, until one
    /// was ok.
    pub telling: f64,
    /// The way after which a frame shows landmarks anew, metres: of one nearer to the frame
    /// before less counts once one was ok, for from one place they are seen with the same
    /// errors.
    pub anew_m: f64,
    /// Share that counts of a frame from the same place: some of its noise is its own.
    pub least_anew: f64,
    /// Less evidence than the best by this much is refuted, nats.
    pub prune_margin: f64,
    /// What a hypothesis that was not tracked pays, nats: 5 says that one pose
    /// in 150 is lost.
    pub newcomer_cost: f64,
    /// Time within which that it was lost becomes so probable, seconds: the
    /// motion leads through some that show little. Before, a newcomer pays as a
    /// jump does.
    pub trust_memory_s: f64,
    /// What a jump of the best pose pays at first, nats: 12 says that one pose
    /// in 160,000 does. Where it jumped from goes on to speak against it
    /// ([`Self::most_astray`]).
    pub jump_cost: f64,
    /// Evidence by which the weight falls to 37 % in the mean that is said where
    /// no hypothesis is ok, and in that which is left of two that have come to tell the
    /// same, nats. More than 1, for frames see the same landmarks with the same errors
    /// and count several times.
    pub doubt: f64,
    /// Half the squared Mahalanobis distance from the prediction above which
    /// matches are not believed: 11.2 is 99.9 % for six degrees of freedom.
    pub max_innovation: f64,
    /// What roads, springs and wheels say against a pose in one frame is bounded
    /// by this, nats: some of it may be wrong.
    pub max_surprise: f64,
    /// What the last trusted pose, driven on, and fixes say against a pose is
    /// bounded by this, nats: that pose may have been wrong.
    pub most_astray: f64,
    /// The same where the vehicle went unseen for long, nats: it may have turned anywhere.
    pub most_astray_unseen: f64,
    /// A pose that is trusted contradicts the one that was before, driven on, if
    /// that speaks against it by more than this, nats: 8 is 99.9 % for three
    /// degrees of freedom.
    pub contradiction: f64,
    /// A pose costs nothing up to this distance from the survey's path, metres:
    /// two lanes and a pavement.
    pub road_m: f64,
    /// Beyond, the standard deviation of what a vehicle keeps, metres.
    pub off_road_sigma_m: f64,
    /// Hypotheses nearer than this are the same, metres.
    pub alike_m: f64,
    /// Hypotheses turned by less than this are the same, radians.
    pub alike_rad: f64,
    /// Hypotheses whose speeds differ by less are the same, m/s.
    pub alike_m_s: f64,
    /// Highest speed of the vehicle, m/s.
    pub max_speed_m_s: f64,
    /// Highest speed of the vehicle in reverse, m/s.
    pub max_reverse_m_s: f64,
}

impl Default for BankConfig {
    fn default() -> Self {
        Self {
            sure_evidence: 15.0,
            sure_lead: 10.0,
            young_capacity: 32,
            capacity: 8,
            young_frames: 10,
            memory: 0.8,
            handicap_memory: 0.95,
            telling: 1.0,
            anew_m: 0.5,
            least_anew: 0.2,
            prune_margin: 30.0,
            newcomer_cost: 5.0,
            trust_memory_s: 3.0,
            jump_cost: 12.0,
            doubt: 3.0,
            max_innovation: 11.2,
            max_surprise: 8.0,
            most_astray: 25.0,
            most_astray_unseen: 8.0,
            contradiction: 8.0,
            road_m: 9.0,
            off_road_sigma_m: 2.0,
            alike_m: 0.4,
            alike_rad: 0.015,
            alike_m_s: 2.0,
            max_speed_m_s: 45.0,
            max_reverse_m_s: 3.0,
        }
    }
}

impl BankConfig {
    /// How much a frame tells hypotheses apart, by what it says for each, nats:
    /// from 0, nothing, to 1, as where there is but one.
    pub fn told(&self, evidences: impl ExactSizeIterator<Item = f64>) -> f64 {
        if evidences.len() < 2 {
            return 1.0;
        }
        let (least, most) = evidences.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), e| (a.min(e), b.max(e)));
        ((most - least) / self.telling.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
    }

    /// How much counts of a frame that is so far from the one before, metres.
    pub fn anew(&self, way_m: f64) -> f64 {
        (way_m / self.anew_m.max(f64::MIN_POSITIVE)).min(1.0).max(self.least_anew)
    }

    /// How many hypotheses of this age may be kept.
    pub fn capacity(&self, age_frames: usize) -> usize {
        if age_frames < self.young_frames { self.young_capacity } else { self.capacity }
    }
}

impl Hypothesis {
    /// Both tell the same.
    pub fn is_like(&self, other: &Self, bank: &BankConfig) -> bool {
        let faster_m_s = (self.state.velocity[2] - other.state.velocity[2]).abs();
        is_alike(&self.state.map_from_camera, &other.state.map_from_camera, bank.alike_m, bank.alike_rad)
            && if self.speed_is_unknown || other.speed_is_unknown {
                // Who knows its speed covers who does not.
                !self.speed_is_unknown || other.speed_is_unknown
            } else {
                faster_m_s <= bank.alike_m_s
            }
    }

    /// Takes in another that has come to tell the same. Where both were tracked for some
    /// time, either may be right; one that was just split off the other, or found beside it,
    /// knows nothing that the other does not.
    pub fn merge(&mut self, other: &Self, config: &Config) {
        let is_known = |of: &Self| of.apart_frames >= config.health.verify_frames && !of.speed_is_unknown;
        if is_known(self) && is_known(other) {
            // Doubted, the other may seem the more probable, but it is not.
            let odds = odds(other, self, config.bank.doubt).min(1.0);
            self.state.mix(&other.state, odds / (1.0 + odds));
        }
    }

    /// No vehicle goes like this.
    pub fn is_impossible(&self, bank: &BankConfig) -> bool {
        let speed_m_s = self.state.velocity[2];
        !self.speed_is_unknown && !(-bank.max_reverse_m_s..=bank.max_speed_m_s).contains(&speed_m_s)
    }
}

impl Tracker<'_> {
    pub(super) fn sort(&mut self) {
        // Stable: equal evidence keeps the older hypothesis in front.
        self.bank.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
    }

    /// By how much the best hypothesis is ahead of the next, nats.
    pub(super) fn lead(&self) -> f64 {
        // Those that were added since they were sorted stand last.
        let Some((best, others)) = self.bank.split_first() else { return f64::INFINITY };
        let next = others.iter().map(|hypothesis| hypothesis.log_weight).max_by(f64::total_cmp);
        next.map_or(f64::INFINITY, |next| best.log_weight - next)
    }

    /// What may speak against a pose for its distance from where the camera must be, nats.
    pub(super) fn most_astray(&self) -> f64 {
        let bank = &self.config.bank;
        if self.unseen.is_open() { bank.most_astray_unseen } else { bank.most_astray }
    }

    /// Adds a hypothesis unless one like it is tracked already.
    pub(super) fn add(&mut self, mut newcomer: Hypothesis) {
        newcomer.compare(&self.region, self.most_astray(), &self.config.gps);
        if !self.bank.iter().any(|known| known.is_like(&newcomer, &self.config.bank)) {
            self.bank.push(newcomer);
        }
    }

    /// Merges what has become the same and drops what the evidence refutes.
    pub(super) fn prune(&mut self) {
        let mut kept = std::mem::take(&mut self.spare);
        let bank = &self.config.bank;
        let best = self.bank.first().map_or(0.0, |best| best.log_weight);
        for hypothesis in self.bank.drain(..) {
            let refuted = hypothesis.log_weight < best - bank.prune_margin
                || (hypothesis.is_impossible(bank) && !kept.is_empty());
            if refuted {
                continue;
            }
            if let Some(known) = kept.iter_mut().find(|known| known.is_like(&hypothesis, bank)) {
                known.merge(&hypothesis, &self.config);
            } else if kept.len() < bank.capacity(hypothesis.age_frames) {
                kept.push(hypothesis);
            }
        }
        self.spare = std::mem::replace(&mut self.bank, kept);
    }
}
