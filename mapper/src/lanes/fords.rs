//! What is painted across the mouths of streets and prolongs lines: bars of
//! crossings, and the block markings of fords, which are painted and bare several
//! times on the length of one dash.

use serde::{Deserialize, Serialize};

use super::LaneConfig;
use super::paint::{Paint, between};
use super::profile::Bin;

/// How what crosses the road is told from lane lines.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FordConfig {
    /// Shortest and longest period of block markings, metres: blocks of 0.3 to
    /// 0.6 m, gaps of 0.2 to 0.6 m.
    pub periods_m: [f64; 2],
    /// Length of the cells in which paint is told from gaps, metres: half of the
    /// shortest gap.
    pub cell_m: f64,
    /// Share of the cells that have to be seen: rings of one scan lie as far
    /// apart as blocks, and show what is there as if it were blocks.
    pub least_seen_share: f64,
    /// Lengths of the rows that are asked, metres: a ford is as wide as a side
    /// street with its corners. Shorter ones are dashes, of which too few cells
    /// are seen.
    pub lengths_m: [f64; 2],
    /// Strength of the strongest period, as a share of the points of paint of a
    /// row, from which on it consists of blocks: those of 0.5 m with gaps of
    /// 0.2 m have 0.7, solid lines some 0.2.
    pub largest_periodic_share: f64,
    /// Where beside a line the next bars of a crossing are, metres: bars and
    /// their gaps are half a metre wide each.
    pub across_m: [f64; 2],
    /// Density of paint there, on both sides, as a share of that on the line,
    /// from which on what looks like a dash is such a bar: bars fill half of
    /// it, and of their paint every second point stands out; one neighbour is
    /// another line, or an arrow.
    pub largest_across_share: f64,
    /// Half of the shortest bars of crossings, metres.
    pub half_bar_m: f64,
    /// Fewest points of paint on each side of a bar: a few are grains.
    pub fewest_across: f64,
    /// Share of the paint of a line that may look like bars: more of what runs over
    /// the two crossings of a junction does, and of what runs through a hatched
    /// area; of lines beside which either begins less than a sixth.
    pub largest_barred_share: f64,
}

impl Default for FordConfig {
    fn default() -> Self {
        Self {
            periods_m: [0.5, 1.25],
            cell_m: 0.1,
            least_seen_share: 0.7,
            lengths_m: [7.0, 30.0],
            largest_periodic_share: 0.55,
            across_m: [0.35, 1.35],
            largest_across_share: 0.15,
            half_bar_m: 1.0,
            fewest_across: 6.0,
            largest_barred_share: 0.25,
        }
    }
}

/// Periods that are tried are so much of one apart over the length of a run: a
/// resolution, not a choice.
pub const STEP: f64 = 0.25;

/// Whether a row of paint consists of blocks: its share of paint, cell by cell,
/// repeats with a period (Schuster 1898).
pub fn is_ford(row: &[Bin], paint: &Paint, config: &LaneConfig) -> bool {
    let length_m = row.len() as f64 * config.profile_m;
    let fords = &config.fords;
    if !(fords.lengths_m[0]..fords.lengths_m[1]).contains(&length_m) {
        return false;
    }
    let shares = shares(row, paint, config);
    if (shares.len() as f64) * fords.cell_m < fords.least_seen_share * length_m {
        return false;
    }
    let sum: f64 = shares.iter().map(|(_, share)| share).sum();
    let mean = sum / shares.len().max(1) as f64;
    let strength = |per_m: f64| {
        let (re, im) = shares.iter().fold((0.0, 0.0), |(re, im), (station_m, share)| {
            let (sin, cos) = (std::f64::consts::TAU * per_m * station_m).sin_cos();
            (re + (share - mean) * cos, im + (share - mean) * sin)
        });
        2.0 * re.hypot(im)
    };
    let [most_per_m, least_per_m] = fords.periods_m.map(f64::recip);
    let steps = ((most_per_m - least_per_m) * length_m / STEP) as u32;
    (0..=steps)
        .map(|k| most_per_m - f64::from(k) * STEP / length_m)
        .any(|per_m| strength(per_m) > fords.largest_periodic_share * sum)
}

/// Share of paint among the road points on the core of a row, in the cells of
/// its length that were seen: station, metres, and share.
fn shares(row: &[Bin], paint: &Paint, config: &LaneConfig) -> Vec<(f64, f64)> {
    let Some(start_m) = row.first().map(|bin| bin.station_m - config.profile_m / 2.0) else { return Vec::new() };
    let cell_m = config.fords.cell_m;
    let mut cells = vec![(0.0, 0.0); (row.len() as f64 * config.profile_m / cell_m).ceil() as usize + 1];
    let cell = |station_m: f64| ((station_m - start_m) / cell_m).max(0.0) as usize;
    for bin in row {
        let (from_m, to_m) = (bin.station_m - config.profile_m / 2.0, bin.station_m + config.profile_m / 2.0);
        let is_core = |offset_m: f64| (offset_m - bin.offset_m).abs() <= config.half_core_m;
        for p in between(&paint.bright, from_m, to_m).iter().filter(|p| is_core(p.offset_m)) {
            cells.iter_mut().skip(cell(p.station_m)).take(1).for_each(|c| c.0 += 1.0);
        }
        for p in paint.road.near([from_m, to_m], [bin.offset_m - config.half_core_m, bin.offset_m + config.half_core_m])
        {
            let station_m = f64::from(p.station_m);
            if (from_m..to_m).contains(&station_m) && is_core(f64::from(p.offset_m)) {
                cells.iter_mut().skip(cell(station_m)).take(1).for_each(|c| c.1 += 1.0);
            }
        }
    }
    let middle_m = |i: usize| start_m + (i as f64 + 0.5) * cell_m;
    let seen = cells.iter().enumerate().filter(|(_, (_, road))| *road > 0.0);
    seen.map(|(i, (bright, road))| (middle_m(i), f64::min(bright / road, 1.0))).collect()
}

/// Unpaints the bars of crossings: what has as dense paint on its both sides as
/// they have, and far denser than where the line itself runs.
pub fn forget_bars(bins: &mut [Bin], config: &LaneConfig) {
    let painted = (0..bins.len()).filter(|i| bins[*i].painted);
    let painted: Vec<(usize, f64)> = painted.map(|i| (i, across(bins, i, config))).collect();
    let mut sorted: Vec<f64> = painted.iter().map(|(_, across)| *across).collect();
    sorted.sort_by(f64::total_cmp);
    let usual = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let is_bar = |(i, across): &(usize, f64)| {
        *across > config.least_share_ratio * usual && looks_like_bar(bins, *i, *across, config)
    };
    let bars: Vec<usize> = painted.iter().filter(|bar| is_bar(bar)).map(|(i, _)| *i).collect();
    for i in bars {
        bins[i].painted = false;
    }
}

/// Share of the painted bins that look like bars of a crossing. Where most of what
/// passes for a line does, none of it stands out as one.
pub fn barred_share(bins: &[Bin], config: &LaneConfig) -> f64 {
    let painted: Vec<usize> = (0..bins.len()).filter(|i| bins[*i].painted && bins[*i].bright > 0.0).collect();
    let barred = painted.iter().filter(|i| looks_like_bar(bins, **i, across(bins, **i, config), config)).count();
    barred as f64 / painted.len().max(1) as f64
}

/// Whether the paint of a bin has as dense paint on its both sides as the bars of
/// crossings have; given is what is [`across`].
fn looks_like_bar(bins: &[Bin], i: usize, across: f64, config: &LaneConfig) -> bool {
    let fords = &config.fords;
    let own = around(bins, i, config).iter().map(|b| b.bright).sum::<f64>() / (2.0 * config.half_line_m);
    let [from_m, to_m] = fords.across_m;
    across >= fords.fewest_across && across / (to_m - from_m) > fords.largest_across_share * own
}

/// Points of paint around a bin where the next bars would be, on the side that has
/// fewer.
fn across(bins: &[Bin], i: usize, config: &LaneConfig) -> f64 {
    let around = around(bins, i, config);
    let [left, right] = [0, 1].map(|k| around.iter().map(|b| b.across[k]).sum::<f64>());
    left.min(right)
}

/// The bins around one, as far as the shortest bars reach.
fn around<'a>(bins: &'a [Bin], i: usize, config: &LaneConfig) -> &'a [Bin] {
    let half = (config.fords.half_bar_m / config.profile_m) as usize;
    &bins[i.saturating_sub(half)..(i + half + 1).min(bins.len())]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bins of dashes of 3 m every 12 m, the given ones of them with paint on both
    /// sides or on one.
    fn dashes(both: std::ops::Range<usize>, one: std::ops::Range<usize>) -> Vec<Bin> {
        let bin = |i: usize| {
            let painted = i % 48 < 12;
            let across = match i / 48 {
                k if painted && both.contains(&k) => [4.0; 2],
                k if painted && one.contains(&k) => [4.0, 0.0],
                _ => [0.0; 2],
            };
            Bin { painted, bright: if painted { 5.0 } else { 0.0 }, across, ..Bin::default() }
        };
        (0..240).map(bin).collect()
    }

    #[test]
    fn what_runs_over_crossings_consists_of_bars_and_what_runs_beside_arrows_does_not() {
        let config = LaneConfig::default();
        let barred = |bins: &[Bin]| (barred_share(bins, &config) * 5.0).round() as usize;
        assert_eq!([0, 1, 3, 5].map(|count| barred(&dashes(0..count, 0..0))), [0, 1, 3, 5]);
        assert_eq!(barred(&dashes(0..0, 0..5)), 0);
    }

    #[test]
    fn one_bar_on_a_line_is_no_paint_of_it_and_where_all_are_none_stands_out() {
        let config = LaneConfig::default();
        let left = |mut bins: Vec<Bin>| {
            forget_bars(&mut bins, &config);
            bins.chunks(48).map(|dash| dash.iter().any(|b| b.painted)).collect::<Vec<bool>>()
        };
        assert_eq!(left(dashes(2..3, 0..2)), [true, true, false, true, true]);
        assert_eq!(left(dashes(0..5, 0..0)), [true; 5]);
    }
}
