//! The rhythm of short dashes that are seen from afar.
//!
//! Bins with a point or two each do not tell where a dash of 1 m ends: the
//! likeliest is a solid line with little paint. But machines paint dashes alike,
//! so paint comes and goes with a period (Schuster 1898), and what all bins at
//! the same place of it have seen together tells its marks from its gaps.

use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::Complex;
use serde::{Deserialize, Serialize};

use super::LaneConfig;
use super::decision::MOST_PAINTED;
use super::fords::STEP;
use super::profile::{Bin, Share, runs};

/// How the rhythm of dashes is told.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RhythmConfig {
    /// Shortest and longest period, metres: from dashes and gaps of 0.75 m on;
    /// longer ones are told bin by bin.
    pub periods_m: [f64; 2],
    /// Length along which a period is the same, metres: fifteen of the commonest
    /// short one, 2 m, while the line and the path beside it hardly bend.
    pub window_m: f64,
    /// Least strength of a period, as a share of the points of paint: dashes as
    /// long as their gaps have 1.3 where all is seen as it is, those of two thirds
    /// of a period 0.8. Solid lines have some 0.2, worn ones 0.6 where scans that
    /// show more and less of them follow each other as evenly.
    pub least_strength: f64,
    /// Least evidence of a period, natural logarithm of odds: chance reaches so
    /// much in one of 20,000, and some ten periods are asked in each window.
    pub least_evidence: f64,
    /// The same of a period that the line has beside: one of 50.
    pub least_known_evidence: f64,
    /// The same of the parts of a window, a quarter of it each, where it is told to
    /// be as its neighbours are: seven to one.
    pub least_part_evidence: f64,
    /// By how much a period may differ from that beside, as a share: a line 10 m
    /// beside a path with a bend of 200 m is so much longer or shorter.
    pub same_period: f64,
    /// Share of the dashes in a window from which on its bins tell them, and no
    /// rhythm is needed: one in five may be worn or hidden.
    pub most_told: f64,
}

impl Default for RhythmConfig {
    fn default() -> Self {
        Self {
            periods_m: [1.5, 4.5],
            window_m: 30.0,
            least_strength: 0.8,
            least_evidence: 10.0,
            least_known_evidence: 4.0,
            least_part_evidence: 2.0,
            same_period: 0.05,
            most_told: 0.8,
        }
    }
}

/// Tells each bin whether it is on a mark where its line has a rhythm that is not
/// told yet, by what the bins at the same place of its period have seen. Whether
/// there is any.
pub fn tell_rhythms(bins: &mut [Bin], config: &LaneConfig) -> bool {
    let mut told: Vec<(usize, bool)> = Vec::new();
    for (part, rhythm) in rhythms(bins, config) {
        let Some(Rhythm { around, period_m }) = rhythm else { continue };
        let pattern = Pattern::new(&bins[around], period_m, config);
        if pattern.fits_better_than_none(&bins[part.clone()], config) {
            told.extend(part.map(|i| (i, pattern.is_mark(&bins[i]))));
        }
    }
    for (i, is_mark) in &told {
        bins[*i].rhythm = Some(*is_mark);
    }
    !told.is_empty()
}

/// A period, metres, and the bins whose paint has it.
struct Rhythm {
    around: Range<usize>,
    period_m: f64,
}

/// The rhythms of consecutive parts of a line, a quarter of a window each. They
/// are sought in what passes for a long run of paint, which is what dashes make
/// that no bin tells; beside them, less evidence tells the same period.
fn rhythms(bins: &[Bin], config: &LaneConfig) -> Vec<(Range<usize>, Option<Rhythm>)> {
    let rhythm = &config.rhythm;
    let half = (rhythm.window_m / config.profile_m / 2.0) as usize;
    let step = (half / 2).max(1);
    let parts: Vec<Range<usize>> = (0..bins.len()).step_by(step).map(|i| i..(i + step).min(bins.len())).collect();
    let around = |part: &Range<usize>| {
        let middle = usize::midpoint(part.start, part.end);
        middle.saturating_sub(half)..(middle + half).min(bins.len())
    };
    let of = |around: Range<usize>, periods_m: [f64; 2], least_evidence: f64| {
        let period_m = period_m(&bins[around.clone()], periods_m, least_evidence, config)?;
        Some(Rhythm { around, period_m })
    };
    let runs = runs(bins, config);
    let in_run = |part: &Range<usize>| {
        let run = runs.iter().find(|run| run.contains(&usize::midpoint(part.start, part.end)))?;
        let is_long = run.len() as f64 * config.profile_m > config.longest_dash_m;
        let around = around(part);
        is_long.then_some(around.start.max(run.start)..around.end.min(run.end))
    };
    let mut found: Vec<Option<Rhythm>> =
        parts.iter().map(|part| of(in_run(part)?, rhythm.periods_m, rhythm.least_evidence)).collect();
    let known = |near_m: f64| [1.0 - rhythm.same_period, 1.0 + rhythm.same_period].map(|share| share * near_m);
    let mut carry_on = |from: usize, to: usize| {
        if let (Some(Rhythm { period_m, .. }), None) = (&found[from], &found[to]) {
            found[to] = of(around(&parts[to]), known(*period_m), rhythm.least_known_evidence);
        }
    };
    (1..parts.len()).for_each(|i| carry_on(i - 1, i));
    (1..parts.len()).rev().for_each(|i| carry_on(i, i - 1));
    parts.into_iter().zip(found).collect()
}

/// The likeliest of some periods of the paint in bins, metres; none where it has
/// none of them.
fn period_m(bins: &[Bin], [shortest_m, longest_m]: [f64; 2], least_evidence: f64, config: &LaneConfig) -> Option<f64> {
    let length_m = bins.len() as f64 * config.profile_m;
    let all: Share = bins.iter().map(|bin| bin.core).sum();
    let mean = all.value();
    let variance = all.road * mean * (1.0 - mean);
    // As much evidence as there can be with so little paint.
    let most = config.evidence_share * all.bright.powi(2) / variance;
    if length_m < config.longest_dash_m || mean >= 1.0 || most.is_nan() || most <= least_evidence {
        return None;
    }
    let amplitude = |per_m: f64| {
        // Bins are as far apart everywhere: each turns by the same angle.
        let turn = Complex::cis(TAU * per_m * config.profile_m);
        let mut phase = Complex::new(1.0, 0.0);
        let mut sum = Complex::new(0.0, 0.0);
        for bin in bins {
            sum += phase * (bin.core.bright - mean * bin.core.road);
            phase *= turn;
        }
        sum.norm()
    };
    let most_per_m = shortest_m.recip();
    let steps = ((most_per_m - longest_m.recip()) * length_m / STEP) as u32;
    let (per_m, amplitude) = (0..=steps)
        .map(|k| most_per_m - f64::from(k) * STEP / length_m)
        .map(|per_m| (per_m, amplitude(per_m)))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    let is_likely = config.evidence_share * amplitude.powi(2) / variance > least_evidence;
    let is_strong = 2.0 * amplitude > config.rhythm.least_strength * all.bright;
    // Most of its dashes may be told already.
    let is_told = runs(bins, config).len() as f64 > config.rhythm.most_told * per_m * length_m;
    (is_likely && is_strong && !is_told).then(|| per_m.recip())
}

/// Marks and gaps of one period.
struct Pattern<'a> {
    bins: &'a [Bin],
    period_m: f64,
    half_bin_m: f64,
    /// What separates the shares of paint on marks and in gaps.
    border: f64,
}

impl<'a> Pattern<'a> {
    fn new(bins: &'a [Bin], period_m: f64, config: &LaneConfig) -> Self {
        let pattern = Self { bins, period_m, half_bin_m: config.profile_m / 2.0, border: 0.0 };
        let shares = bins.iter().map(|bin| pattern.share(bin));
        let (least, most) = shares.fold((1.0_f64, 0.0_f64), |(least, most), share| (least.min(share), most.max(share)));
        Self { border: f64::midpoint(least, most), ..pattern }
    }

    /// The share of paint that the bins at the same place of the period have seen.
    fn share(&self, bin: &Bin) -> f64 {
        let is_alike = |other: &&Bin| {
            let apart = (other.station_m - bin.station_m) / self.period_m;
            ((apart - apart.round()) * self.period_m).abs() <= self.half_bin_m
        };
        self.bins.iter().filter(is_alike).map(|other| other.core).sum::<Share>().value()
    }

    fn is_mark(&self, bin: &Bin) -> bool {
        self.share(bin) > self.border
    }

    /// Whether some of its bins tell that they have marks and gaps, too, not only
    /// those beside them.
    fn fits_better_than_none(&self, part: &[Bin], config: &LaneConfig) -> bool {
        let (on, off): (Vec<&Bin>, Vec<&Bin>) = part.iter().partition(|bin| self.is_mark(bin));
        let [on, off] = [on, off].map(|bins| bins.iter().map(|bin| bin.core).sum::<Share>());
        let all: Share = [on, off].into_iter().sum();
        // Two shares against one (binomial likelihoods).
        let likelihood = |s: Share| {
            let share = s.value().max(config.least_bare_share / 2.0).min(MOST_PAINTED);
            s.bright * share.ln() + (s.road - s.bright).max(0.0) * (1.0 - share).ln()
        };
        let evidence = config.evidence_share * (likelihood(on) + likelihood(off) - likelihood(all));
        on.value() > off.value() && evidence > config.rhythm.least_part_evidence
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bins with four road points each, of which two in five are points of paint
    /// where `is_paint` says so, and one in fifty elsewhere.
    fn bins(is_paint: impl Fn(f64) -> bool) -> Vec<Bin> {
        let mut state = 1_u64;
        (0..480)
            .map(|i| {
                let station_m = (f64::from(i) + 0.5) * 0.25;
                let mut bright = 0.0;
                for _ in 0..4 {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    let chance = (state >> 40) as f64 / f64::from(1 << 24);
                    bright += f64::from(u8::from(chance < if is_paint(station_m) { 0.4 } else { 0.02 }));
                }
                Bin { station_m, core: Share { bright, road: 4.0 }, painted: true, ..Bin::default() }
            })
            .collect()
    }

    #[test]
    fn dashes_that_no_bin_tells_have_their_period_and_solid_lines_have_none() {
        let config = LaneConfig::default();
        for (dash_m, period_m) in [(1.0, 2.0), (1.5, 3.0), (0.9, 1.7)] {
            let mut dashed = bins(|s| s.rem_euclid(period_m) < dash_m);
            tell_rhythms(&mut dashed, &config);
            let told: Vec<&Bin> = dashed.iter().filter(|b| b.rhythm.is_some()).collect();
            assert!(told.len() > 440, "{} of {period_m}", told.len());
            let is_right = |b: &&&Bin| {
                let from_m = b.station_m.rem_euclid(period_m);
                let is_clear = (from_m - dash_m).abs() > 0.25 && from_m > 0.25 && from_m < period_m - 0.25;
                !is_clear || b.rhythm.unwrap() == (from_m < dash_m)
            };
            assert!(told.iter().filter(is_right).count() as f64 > 0.97 * told.len() as f64);
        }
        let mut solid = bins(|_| true);
        tell_rhythms(&mut solid, &config);
        assert!(solid.iter().all(|b| b.rhythm.is_none()));
    }
}
