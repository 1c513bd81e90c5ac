//! Which bins of a line are painted: clear paint first, then the worn.

use super::LaneConfig;
use super::fords::forget_bars;
use super::profile::{Bin, Share, Shares, runs};
use super::rhythm::tell_rhythms;

/// Largest share of paint that is believed: a bare point or two say something
/// then, too.
pub const MOST_PAINTED: f64 = 0.9;

/// Rounds of estimating the share of paint points and what is painted.
const ROUNDS: usize = 3;

/// Decides what is painted: the likeliest sequence of painted and bare bins
/// (Viterbi 1967), and the share of paint points that it is told by.
pub fn decide(bins: &mut [Bin], config: &LaneConfig) -> Shares {
    let side = |k: usize| bins.iter().map(|b| b.beside[k]).sum::<Share>().value();
    let bare = side(0).min(side(1)).max(config.least_bare_share).min(0.5);
    let mut shares = Shares { painted: config.usual_share.max(2.0 * bare), bare };
    let mut share = settle(bins, &mut shares, config);
    add_worn(bins, shares, config);
    if tell_rhythms(bins, config) {
        share = settle(bins, &mut shares, config);
        add_worn(bins, shares, config);
    }
    forget_bars(bins, config);
    forget_unseen(bins, config);
    // A run that is shorter than a dash, or of a point or two, is no paint.
    for run in runs(bins, config) {
        let points: f64 = bins[run.clone()].iter().map(|b| b.core.bright).sum();
        let is_stray = points < config.fewest_blot_points && bins[run.clone()].iter().all(|b| b.rhythm.is_none());
        if (run.len() as f64) * config.profile_m < config.shortest_blot_m || is_stray {
            bins[run].iter_mut().for_each(|b| b.painted = false);
        }
    }
    Shares { painted: share, bare }
}

/// Estimates what is painted and the share of paint points there in turns, from
/// the share in `shares` on: the share, which in `shares` is kept where it is
/// believed.
fn settle(bins: &mut [Bin], shares: &mut Shares, config: &LaneConfig) -> f64 {
    let least = f64::max(config.least_bright_share / 2.0, 2.0 * shares.bare).min(MOST_PAINTED);
    let mut share = 0.0;
    for _ in 0..ROUNDS {
        likeliest(bins, &[shares.painted], shares.bare, config);
        share = bins.iter().filter(|b| b.painted).map(|b| b.core).sum::<Share>().value();
        shares.painted = share.clamp(least, MOST_PAINTED);
    }
    share
}

/// Adds worn paint: what tells a line from a texture is its clear paint, that was
/// decided before.
fn add_worn(bins: &mut [Bin], shares: Shares, config: &LaneConfig) {
    let worn = (config.worn_share * shares.painted).max(config.least_worn_ratio * shares.bare);
    for bin in bins.iter_mut() {
        bin.clear = bin.painted;
    }
    if worn >= shares.painted {
        return;
    }
    likeliest(bins, &[shares.painted, worn], shares.bare, config);
    for run in runs(bins, config) {
        let is_long = run.len() as f64 * config.profile_m > config.longest_dash_m;
        if is_long && clear_share(bins[run.clone()].iter()) < config.least_clear_share {
            bins[run].iter_mut().for_each(|b| b.painted = b.clear);
        }
    }
}

/// Share of clear paint among painted bins.
pub fn clear_share<'a>(bins: impl Iterator<Item = &'a Bin>) -> f64 {
    let (clear, worn): (Vec<&Bin>, Vec<&Bin>) = bins.filter(|b| b.painted).partition(|b| b.clear);
    clear.len() as f64 / (clear.len() + worn.len()).max(1) as f64
}

/// Paint that nobody saw: where nothing tells, the likeliest is what was there
/// before. It stands over short stretches between two points of paint only.
fn forget_unseen(bins: &mut [Bin], config: &LaneConfig) {
    let most = (config.longest_unseen_m / config.profile_m) as usize;
    let mut start = 0;
    for i in 0..=bins.len() {
        let is_seen = bins.get(i).is_none_or(|b| b.core.bright > 0.0 || b.rhythm.is_some() || !b.painted);
        if is_seen {
            let unseen = start..i;
            let at_end = |b: Option<&Bin>| b.is_none_or(|b| !b.painted);
            let before = start.checked_sub(1).and_then(|k| bins.get(k));
            if unseen.len() > most || at_end(before) || at_end(bins.get(i)) {
                bins[unseen].iter_mut().for_each(|b| b.painted = false);
            }
            start = i + 1;
        }
    }
}

/// Sets which bins are painted, by the likeliest sequence (Viterbi 1967) of bare
/// bins and of bins with each of some shares of paint. Each change costs the
/// same: so a worn mark is one, but a gap between two marks is none of theirs.
fn likeliest(bins: &mut [Bin], painted: &[f64], bare: f64, config: &LaneConfig) {
    let odds: Vec<[f64; 2]> =
        painted.iter().map(|share| [(share / bare).ln(), ((1.0 - share) / (1.0 - bare)).ln()]).collect();
    // Points of one ring on one dash are no independent witnesses, and no bin
    // says more than it may: of the shares the likelier one is so all the same.
    let evidence = |b: &Bin, all: &mut [f64]| {
        if let Some(is_mark) = b.rhythm {
            all.fill(if is_mark { config.most_evidence } else { -config.most_evidence });
            return;
        }
        for (own, [more, less]) in all.iter_mut().zip(&odds) {
            *own = (b.core.bright * more + (b.core.road - b.core.bright).max(0.0) * less) * config.evidence_share;
        }
        let most = all.iter().fold(config.most_evidence, |most, own| most.max(own.abs()));
        for own in all {
            *own *= config.most_evidence / most;
        }
    };
    let mut told = vec![0.0; odds.len()];
    // State 0 is bare. For each bin and state the one from which the best way
    // to it comes; of equals the state itself, then the first.
    let mut scores = vec![0.0_f64; odds.len() + 1];
    let best = |scores: &[f64]| (1..scores.len()).fold(0, |best, k| if scores[k] > scores[best] { k } else { best });
    let mut from: Vec<usize> = Vec::with_capacity(bins.len() * scores.len());
    for bin in bins.iter() {
        evidence(bin, &mut told);
        let top = best(&scores);
        let changed = scores[top] - config.change_cost;
        for (state, score) in scores.iter_mut().enumerate() {
            let is_changed = changed > *score;
            from.push(if is_changed { top } else { state });
            *score = score.max(changed) + state.checked_sub(1).map_or(0.0, |k| told[k]);
        }
    }
    let mut state = best(&scores);
    for (bin, from) in bins.iter_mut().zip(from.chunks(scores.len())).rev() {
        bin.painted = state > 0;
        state = from[state];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_worn_mark_is_one_and_the_gaps_between_marks_are_none() {
        let config = LaneConfig::default();
        let bins_of = |bright: f64| vec![Bin { core: Share { bright, road: 16.0 }, ..Bin::default() }; 12];
        let [gap, mark, worn] = [0.0, 6.0, 2.0].map(bins_of);
        let mut bins = [&gap[..], &mark, &gap, &worn, &gap, &mark, &gap].concat();
        let painted = |bins: &[Bin]| {
            let count = |part: &[Bin]| part.iter().filter(|b| b.painted).count();
            bins.chunks(12).map(count).collect::<Vec<usize>>()
        };
        likeliest(&mut bins, &[0.4], 0.02, &config);
        assert_eq!(painted(&bins), [0, 12, 0, 0, 0, 12, 0]);
        likeliest(&mut bins, &[0.4, 0.24], 0.02, &config);
        assert_eq!(painted(&bins), [0, 12, 0, 12, 0, 12, 0]);
    }
}
