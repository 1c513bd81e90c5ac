//! What is painted along a line: bins of its length, and their runs.

use std::iter::Sum;
use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

use super::decision::decide;
use super::fords::is_ford;
use super::paint::{Paint, between};
use super::{Chain, LaneConfig};

/// A bin of the length of a line.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Bin {
    /// Station of its middle, metres.
    pub station_m: f64,
    /// Offset of the line there, metres.
    pub offset_m: f64,
    /// Whether the line is painted here, seen or not.
    pub painted: bool,
    /// Whether it is so by the share of clear paint, not of worn paint alone.
    pub clear: bool,
    /// Points of paint on the line's core, and all road points on it.
    pub core: Share,
    /// Whether it is on a mark, by the rhythm of its line, where that has one.
    pub rhythm: Option<bool>,
    /// The same to the left and to the right of the line.
    pub beside: [Share; 2],
    /// Points of paint to its left and to its right where the next bars of a
    /// crossing are.
    pub across: [f64; 2],
    /// Points of paint on the whole width of the line.
    pub bright: f64,
    /// Mean distance of these to the right of the line, metres.
    pub off_m: f64,
    /// Mean contrast of these, standard deviations.
    pub contrast: f64,
    /// Offset about which all these were counted, metres: the line is smoothed
    /// then.
    pub counted_m: f64,
}

/// A mean of values that come one by one.
#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    sum: f64,
    count: f64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1.0;
    }

    fn value(self) -> Option<f64> {
        (self.count > 0.0).then(|| self.sum / self.count)
    }
}

/// Points of paint among road points.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Share {
    /// Points of paint.
    pub bright: f64,
    /// Road points, paint or not.
    pub road: f64,
}

impl Sum for Share {
    fn sum<I: Iterator<Item = Self>>(shares: I) -> Self {
        shares.fold(Self::default(), |sum, s| Self { bright: sum.bright + s.bright, road: sum.road + s.road })
    }
}

impl Share {
    /// Of all points those of paint, from 0 to 1.
    pub fn value(self) -> f64 {
        self.bright / self.road.max(1.0)
    }
}

/// Shares of paint points where a line is painted and where it is bare.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shares {
    /// On painted bins.
    pub painted: f64,
    /// Beside the line, on its clearer side.
    pub bare: f64,
}

/// The bins along a chain, and how clearly its paint differs from what is
/// beside it.
pub fn profile(chain: &Chain, paint: &Paint, config: &LaneConfig) -> (Vec<Bin>, Shares) {
    let mut shares = Shares { painted: config.usual_share, bare: config.least_bare_share };
    let (Some(first), Some(last)) = (chain.lines.first(), chain.lines.last()) else {
        return (Vec::new(), shares);
    };
    let from_m = first.centre_m - config.window_m / 2.0;
    let length_m = last.centre_m + config.window_m / 2.0 - from_m;
    let mut bins: Vec<Bin> = (0..(length_m / config.profile_m).ceil() as usize)
        .map(|i| {
            let station_m = from_m + (i as f64 + 0.5) * config.profile_m;
            Bin { station_m, offset_m: chain.offset_m(station_m), ..Bin::default() }
        })
        .collect();
    // Windows are straight, the line is not quite: what is painted is asked
    // again once the line is where its paint is.
    for half_m in [config.half_line_m, config.half_core_m] {
        for bin in &mut bins {
            fill(bin, paint, half_m, config);
        }
        shares = decide(&mut bins, config);
        let smooth = smoothed(&bins, chain, config);
        for (bin, offset_m) in bins.iter_mut().zip(smooth) {
            if let Some(offset_m) = offset_m {
                bin.off_m += bin.offset_m - offset_m;
                bin.offset_m = offset_m;
            }
        }
    }
    // A worn block breaks a run.
    let worn_m = config.fords.periods_m[1];
    let runs = runs(&bins, config);
    for row in runs.chunk_by(|a, b| (b.start - a.end) as f64 * config.profile_m < worn_m) {
        let (Some(first), Some(last)) = (row.first(), row.last()) else { continue };
        let row = &mut bins[first.start..last.end];
        // What repeats as dashes do is painted and bare more seldom than blocks.
        let has_rhythm = || 2 * row.iter().filter(|bin| bin.rhythm.is_some()).count() > row.len();
        if !has_rhythm() && is_ford(row, paint, config) {
            for bin in row {
                bin.painted = false;
            }
        }
    }
    (bins, shares)
}

fn fill(bin: &mut Bin, paint: &Paint, half_m: f64, config: &LaneConfig) {
    let (from_m, to_m) = (bin.station_m - config.profile_m / 2.0, bin.station_m + config.profile_m / 2.0);
    let offset_m = bin.offset_m;
    let (near_m, far_m) = (config.beside_line_m - config.half_line_m, config.beside_line_m + config.half_line_m);
    // 0 is the core, then to the left and to the right of the line.
    let part = |off_m: f64| {
        let is_beside = (near_m..far_m).contains(&off_m.abs());
        if off_m.abs() <= half_m { Some(0) } else { is_beside.then_some(1 + usize::from(off_m > 0.0)) }
    };
    let mut shares = [Share::default(); 3];
    let [across_from_m, across_to_m] = config.fords.across_m;
    let widest_m = half_m.max(far_m).max(across_to_m).max(config.half_line_m);
    let (mut on, mut off_sum_m, mut contrast_sum) = (0.0_f64, 0.0, 0.0);
    bin.across = [0.0; 2];
    for p in between(&paint.bright, from_m, to_m) {
        let off_m = p.offset_m - offset_m;
        if off_m.abs() > widest_m {
            continue;
        }
        if let Some(k) = part(off_m) {
            shares[k].bright += 1.0;
        }
        if (across_from_m..across_to_m).contains(&off_m.abs()) {
            bin.across[usize::from(off_m > 0.0)] += 1.0;
        }
        if off_m.abs() <= config.half_line_m {
            (on, off_sum_m, contrast_sum) = (on + 1.0, off_sum_m + off_m, contrast_sum + f64::from(p.contrast));
        }
    }
    bin.bright = on;
    bin.rhythm = None;
    bin.off_m = off_sum_m / on.max(1.0);
    bin.contrast = contrast_sum / on.max(1.0);
    for_each_beside(paint, [from_m, to_m], offset_m, half_m.max(far_m), |off_m, _| {
        if let Some(k) = part(off_m) {
            shares[k].road += 1.0;
        }
    });
    [bin.core, bin.beside[0], bin.beside[1]] = shares;
    bin.counted_m = offset_m;
}

/// Calls `each` for the road points between two stations and about so near to an
/// offset, metres: with how far to its right they are, and their height.
fn for_each_beside(
    paint: &Paint,
    [from_m, to_m]: [f64; 2],
    offset_m: f64,
    reach_m: f64,
    mut each: impl FnMut(f64, f32),
) {
    // From within: the cells are many short pieces.
    paint.road.near([from_m, to_m], [offset_m - reach_m, offset_m + reach_m]).for_each(|point| {
        if (from_m..to_m).contains(&f64::from(point.station_m)) {
            each(f64::from(point.offset_m) - offset_m, point.height_m);
        }
    });
}

/// Heights of the road points in strips beside the line in a bin: far and near on
/// its left, near and far on its right.
fn strips(bin: &Bin, paint: &Paint, config: &LaneConfig) -> [Mean; 4] {
    let stations_m = [bin.station_m - config.profile_m / 2.0, bin.station_m + config.profile_m / 2.0];
    let reach_m = config.half_line_m + 2.0 * config.kerb_within_m;
    let mut strips = [Mean::default(); 4];
    for_each_beside(paint, stations_m, bin.counted_m, reach_m, |off_m, height_m| {
        let outwards_m = off_m.abs() - config.half_line_m;
        if outwards_m > 0.0 && outwards_m < 2.0 * config.kerb_within_m {
            let (is_far, is_right) = (outwards_m > config.kerb_within_m, off_m > 0.0);
            let strip = match (is_right, is_far) {
                (false, true) => 0,
                (false, false) => 1,
                (true, false) => 2,
                (true, true) => 3,
            };
            strips[strip].add(f64::from(height_m));
        }
    });
    strips
}

/// Height of the step in the road along a line, metres: by how much the strips
/// on its both sides differ, and by how much more than the crossfall lets them,
/// whichever is less. The median of the bins that were seen on both sides; none
/// where too few were.
pub fn step_m(bins: &[&Bin], paint: &Paint, config: &LaneConfig) -> Option<f64> {
    // From the middle of one near strip to that of the other, over the
    // distance of the middles of near and far ones.
    let reach = (2.0 * config.half_line_m + config.kerb_within_m) / config.kerb_within_m;
    let of_bin = |bin: &&Bin| {
        let [Some(far_left), Some(left), Some(right), Some(far_right)] = strips(bin, paint, config).map(Mean::value)
        else {
            return None;
        };
        let (own, fall) = (right - left, f64::midpoint(far_right - right, left - far_left));
        Some((own, own - reach * fall))
    };
    let (mut own, mut beyond): (Vec<f64>, Vec<f64>) = bins.iter().filter_map(of_bin).unzip();
    if own.is_empty() || (own.len() as f64) * config.profile_m < config.shortest_dash_m {
        return None;
    }
    let middle = own.len() / 2;
    let (own, beyond) = (
        *own.select_nth_unstable_by(middle, f64::total_cmp).1,
        *beyond.select_nth_unstable_by(middle, f64::total_cmp).1,
    );
    (own * beyond > 0.0).then_some(own.abs().min(beyond.abs()))
}

/// Runs of paint without a gap: indices of bins.
pub fn runs(bins: &[Bin], config: &LaneConfig) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for i in (0..bins.len()).filter(|i| bins[*i].painted) {
        match runs.last_mut() {
            Some(run) if ((i - run.end) as f64) * config.profile_m < config.shortest_gap_m => run.end = i + 1,
            _ => runs.push(i..i + 1),
        }
    }
    runs
}

/// Offset of the line in each bin: the local line through the painted bins
/// around it; the window widens over gaps. A wide one has room for the bends of
/// the line and of the path that it is measured from, so it may bend; and where
/// the path swings too much for one bend, it is the distance from the chain
/// that is smoothed.
fn smoothed(bins: &[Bin], chain: &Chain, config: &LaneConfig) -> Vec<Option<f64>> {
    let painted: Vec<(f64, f64)> =
        bins.iter().filter(|b| b.painted && b.bright > 0.0).map(|b| (b.station_m, b.offset_m + b.off_m)).collect();
    let from_chain: Vec<(f64, f64)> = painted.iter().map(|(s, offset_m)| (*s, offset_m - chain.offset_m(*s))).collect();
    // As much paint as a solid line has within the window; the window widens
    // over gaps until it is found.
    let fewest = (config.smooth_m * 1.5 / config.profile_m) as usize;
    let at = |station_m: f64| {
        let straight = local_line(&painted, station_m, config.smooth_m, fewest);
        let bent = |w: &f64| {
            let (offset_m, spread_m) = local_bend(&painted, station_m, config.smooth_m * w, fewest)?;
            let (off_m, chain_spread_m) = local_bend(&from_chain, station_m, config.smooth_m * w, fewest)?;
            let is_simple = spread_m <= config.largest_simple_ratio * chain_spread_m;
            Some(if is_simple { offset_m } else { chain.offset_m(station_m) + off_m })
        };
        straight.or_else(|| [2.0, 4.0, 8.0].iter().find_map(bent))
    };
    bins.iter().map(|b| at(b.station_m)).collect()
}

/// Value at `at` of the straight line through the samples `(place, value)`,
/// sorted by place, within `half` of it; none where fewer than `fewest` are
/// near.
pub fn local_line(samples: &[(f64, f64)], at: f64, half: f64, fewest: usize) -> Option<f64> {
    let near = within(samples, at, half, fewest)?;
    let n = near.len() as f64;
    let (mt, mv) = near.iter().fold((0.0, 0.0), |s, p| (s.0 + (p.0 - at) / n, s.1 + p.1 / n));
    let (tt, tv) =
        near.iter().map(|p| (p.0 - at - mt, p.1 - mv)).fold((0.0, 0.0), |s, (t, v)| (s.0 + t * t, s.1 + t * v));
    // One squared window of prior on a level line.
    Some(mv - tv / (tt + half * half) * mt)
}

/// The same of the parabola, by least squares with a unit of prior on its slope
/// and a fifth on its bend, both over the window; and the root mean square
/// distance of the samples from it.
fn local_bend(samples: &[(f64, f64)], at: f64, half: f64, fewest: usize) -> Option<(f64, f64)> {
    let near = within(samples, at, half, fewest)?;
    let mut normal = Matrix3::from_diagonal(&Vector3::new(0.0, 1.0, 0.2));
    let mut right = Vector3::zeros();
    let powers = |place: f64| {
        let t = (place - at) / half;
        Vector3::new(1.0, t, t * t)
    };
    for (place, value) in near {
        let powers = powers(*place);
        normal += powers * powers.transpose();
        right += powers * *value;
    }
    let bend = normal.cholesky()?.solve(&right);
    let squares: f64 = near.iter().map(|(place, value)| (powers(*place).dot(&bend) - value).powi(2)).sum();
    Some((bend.x, (squares / near.len() as f64).sqrt()))
}

/// The samples within `half` of `at`, of a list sorted by place; none where
/// they are fewer than `fewest`.
fn within(samples: &[(f64, f64)], at: f64, half: f64, fewest: usize) -> Option<&[(f64, f64)]> {
    let from = samples.partition_point(|s| s.0 < at - half);
    let to = samples.partition_point(|s| s.0 <= at + half);
    samples.get(from..to).filter(|near| near.len() >= fewest.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wide_window_follows_a_bend_and_bridges_a_gap() {
        // Dashes of 3 m every 9 m on a bend of 300 m.
        let bend = |s: f64| s * s / 600.0;
        let dashes = (0..400).map(|i| f64::from(i) * 0.25 - 50.0).filter(|s| s.rem_euclid(9.0) < 3.0);
        let samples: Vec<(f64, f64)> = dashes.map(|s| (s, bend(s))).collect();
        for at in [-20.0, -4.0, 0.0, 7.0, 16.5] {
            let error_m = |value: Option<f64>| (value.unwrap() - bend(at)).abs();
            assert!(error_m(local_bend(&samples, at, 16.0, 24).map(|bend| bend.0)) < 0.02, "{at}");
            assert!(error_m(local_line(&samples, at, 16.0, 24)) > 0.05, "{at}");
        }
        assert_eq!(local_bend(&samples, 0.0, 16.0, 100), None);
    }
}
