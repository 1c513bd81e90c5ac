//! Solid or dashed: where a line changes from one to the other.

use std::ops::Range;

use common::map::LaneKind;

use super::LaneConfig;
use super::profile::{Bin, runs};
use super::spacing::{are_dense, are_even};

/// A stretch of a line that is painted in one way: bins from the first of its
/// paint to the first of the next stretch.
pub type Stretch = (LaneKind, Range<usize>);

/// Cuts the bins of a line into stretches that are painted in one way. A run
/// of paint that is longer than any dash is solid; shorter ones are dashes,
/// but for a few next to a solid run, which is worn or partly hidden there.
/// What is neither, like a letter or an arrow, is left out.
pub fn stretches(bins: &[Bin], config: &LaneConfig) -> Vec<Stretch> {
    let runs = runs(bins, config);
    let gap_m = |a: &Range<usize>, b: &Range<usize>| (b.start - a.end) as f64 * config.profile_m;
    runs.chunk_by(|a, b| gap_m(a, b) <= config.longest_gap_m).flat_map(|group| cut(group, bins, config)).collect()
}

/// The stretches of a group of runs that follow each other.
fn cut(group: &[Range<usize>], bins: &[Bin], config: &LaneConfig) -> Vec<Stretch> {
    let solid = are_solid(group, bins, config);
    let goes_on =
        |i: usize| solid[i] == solid[i - 1] && !(solid[i] && is_bare(group[i - 1].end..group[i].start, bins, config));
    let starts: Vec<usize> = (0..group.len()).filter(|i| *i == 0 || !goes_on(*i)).collect();
    let ends = starts.iter().skip(1).copied().chain([group.len()]);
    let parts: Vec<(bool, &[Range<usize>])> =
        starts.iter().zip(ends).map(|(start, end)| (solid[*start], &group[*start..end])).collect();
    let mut stretches: Vec<Stretch> = Vec::new();
    for (i, (is_solid, part)) in parts.iter().enumerate() {
        let (Some(first), Some(last)) = (part.first(), part.last()) else { continue };
        // Few dashes beside a solid run are part of it.
        let after_solid = stretches.last().is_some_and(|(before, range)| {
            *before == LaneKind::Solid && !is_bare(range.end..first.start, bins, config)
        });
        let before_solid = || {
            let next = parts.get(i + 1).and_then(|(_, next)| next.first());
            next.is_some_and(|next| !is_bare(last.end..next.start, bins, config))
        };
        let is_solid = *is_solid || (part.len() < config.fewest_dashes && (after_solid || before_solid()));
        if !is_solid && !are_dashes(part, bins, config) {
            continue;
        }
        let kind = if is_solid { LaneKind::Solid } else { LaneKind::Dashed };
        match stretches.last_mut() {
            Some((LaneKind::Solid, _)) if is_solid && !after_solid => stretches.push((kind, first.start..last.end)),
            Some((before, range)) if *before == kind => range.end = last.end,
            // The dashed one reaches up to the solid one.
            Some((before, range)) => {
                let border = if *before == LaneKind::Dashed { first.start } else { range.end };
                range.end = border;
                stretches.push((kind, border..last.end));
            }
            None => stretches.push((kind, first.start..last.end)),
        }
    }
    for (_, range) in stretches.iter_mut().filter(|(kind, _)| *kind == LaneKind::Solid) {
        *range = without_blots(range.clone(), bins, config);
    }
    stretches
}

/// A solid stretch without the blots before and behind it, behind more bare road
/// than they have paint: stop lines and bars of crossings that it points at.
fn without_blots(stretch: Range<usize>, bins: &[Bin], config: &LaneConfig) -> Range<usize> {
    let bins = &bins[stretch.clone()];
    let runs = runs(bins, config);
    let is_blot = |run: &Range<usize>, gap: Range<usize>| {
        (run.len() as f64) * config.profile_m < config.shortest_dash_m && run.len() < seen(&bins[gap])
    };
    let mut kept = &runs[..];
    while let [first, second, ..] = kept
        && is_blot(first, first.end..second.start)
    {
        kept = &kept[1..];
    }
    while let [rest @ .., last] = kept
        && let Some(before) = rest.last()
        && is_blot(last, before.end..last.start)
    {
        kept = rest;
    }
    let (Some(first), Some(last)) = (kept.first(), kept.last()) else { return stretch };
    stretch.start + first.start..stretch.start + last.end
}

/// In how many bins the road was seen.
fn seen(bins: &[Bin]) -> usize {
    bins.iter().filter(|b| b.core.road > 0.0).count()
}

/// Whether the road between two runs was seen to have no paint: a solid line
/// ends there, and is not worn or hidden.
fn is_bare(gap: Range<usize>, bins: &[Bin], config: &LaneConfig) -> bool {
    gap.len() as f64 * config.profile_m > config.longest_bare_m
        && seen(&bins[gap.clone()]) as f64 >= config.least_seen_share * gap.len() as f64
}

/// Which runs are solid: the long ones, spots without paint left out. Long ones
/// that were hardly seen may have gaps; they are what the run before them is, or
/// the one after.
fn are_solid(group: &[Range<usize>], bins: &[Bin], config: &LaneConfig) -> Vec<bool> {
    let is_spot = |a: &Range<usize>, b: &Range<usize>| {
        let (gap, shorter) = (b.start - a.end, a.len().min(b.len()));
        (gap as f64) < config.largest_spot_share * (gap + shorter) as f64
    };
    let of_pieces = |pieces: &[Range<usize>]| {
        let (Some(first), Some(last)) = (pieces.first(), pieces.last()) else { return None };
        let run = first.start..last.end;
        // Few beams leave many bins unseen, but no gap between dashes is as short as one bin.
        let has_paint = |i: usize| bins.get(i).is_some_and(|b| b.core.bright > 0.0);
        let seen =
            run.clone().filter(|i| has_paint(*i) || has_paint(i + 1) || has_paint(i.wrapping_sub(1))).count() as f64;
        let is_long = run.len() as f64 * config.profile_m > config.longest_dash_m;
        (!is_long || seen >= config.least_seen_share * run.len() as f64).then_some(is_long)
    };
    let runs = group.chunk_by(|a, b| is_spot(a, b));
    let mut known: Vec<Option<bool>> =
        runs.flat_map(|pieces| std::iter::repeat_n(of_pieces(pieces), pieces.len())).collect();
    let from_before = |known: &mut dyn Iterator<Item = &mut Option<bool>>| {
        let mut last = None;
        for is_solid in known {
            *is_solid = is_solid.or(last);
            last = *is_solid;
        }
    };
    from_before(&mut known.iter_mut());
    from_before(&mut known.iter_mut().rev());
    known.into_iter().map(|is_solid| is_solid.unwrap_or(true)).collect()
}

/// Whether runs of paint are the dashes of a line: enough of them, half of
/// them as long as a dash or repeating as dashes do, not too far apart, and
/// evenly so.
fn are_dashes(part: &[Range<usize>], bins: &[Bin], config: &LaneConfig) -> bool {
    let (Some(first), Some(last)) = (part.first(), part.last()) else { return false };
    let painted = part.iter().map(ExactSizeIterator::len).sum::<usize>() as f64 / (last.end - first.start) as f64;
    let mut lengths: Vec<usize> = part.iter().map(ExactSizeIterator::len).collect();
    lengths.sort_unstable();
    let repeats = || 2 * part.iter().filter(|run| bins[run.start].rhythm.is_some()).count() > part.len();
    part.len() >= config.fewest_dashes
        && (lengths[lengths.len() / 2] as f64 * config.profile_m >= config.shortest_dash_m || repeats())
        && painted >= config.least_painted
        && (are_dense(part, config) || are_even(part, config))
}

#[cfg(test)]
mod tests {
    use super::super::profile::Share;
    use super::*;

    /// Bins of a line: lengths, metres, whether painted, and road points of each.
    fn line(parts: &[(f64, bool, f64)], config: &LaneConfig) -> Vec<Bin> {
        let bins_of = |(length_m, painted, road): &(f64, bool, f64)| {
            let core = Share { bright: if *painted { *road } else { 0.0 }, road: *road };
            vec![Bin { painted: *painted, core, ..Bin::default() }; (length_m / config.profile_m) as usize]
        };
        parts.iter().flat_map(bins_of).collect()
    }

    #[test]
    fn a_solid_line_ends_at_a_bare_road_and_goes_on_where_it_is_worn_or_hidden() {
        let config = LaneConfig::default();
        let length_m = |gap_m: f64, road: f64| {
            let parts =
                [(20.0, true, 4.0), (gap_m, false, road), (2.0, true, 4.0), (0.5, false, 4.0), (2.0, true, 4.0)];
            let stretches = stretches(&line(&parts, &config), &config);
            assert!(stretches.iter().all(|(kind, _)| *kind == LaneKind::Solid));
            stretches.iter().map(|(_, range)| range.len() as f64 * config.profile_m).collect::<Vec<f64>>()
        };
        // A mouth with the blocks of a ford behind it; wear; a parked lorry.
        assert_eq!(length_m(10.0, 4.0), [20.0]);
        assert_eq!(length_m(6.0, 4.0), [30.5]);
        assert_eq!(length_m(10.0, 0.0), [34.5]);
    }

    #[test]
    fn a_solid_line_is_one_where_few_beams_meet_it() {
        let config = LaneConfig::default();
        let kinds = |every: usize| {
            // Its paint, and a dash of what was seen before it begins.
            let mut bins = line(&[(2.0, true, 4.0), (5.0, false, 1.0), (60.0, true, 4.0), (1.0, false, 1.0)], &config);
            let unseen = bins.iter_mut().enumerate().filter(|(i, bin)| *i > 20 && bin.painted && i % every > 0);
            unseen.for_each(|(_, bin)| bin.core = Share::default());
            stretches(&bins, &config).iter().map(|stretch| stretch.0).collect::<Vec<LaneKind>>()
        };
        assert_eq!(kinds(4), [LaneKind::Solid]);
        assert_eq!(kinds(10), []);
    }

    #[test]
    fn dashes_in_pieces_are_dashes_where_much_is_painted() {
        let config = LaneConfig::default();
        let kinds = |lengths_m: &[f64]| {
            let parts: Vec<(f64, bool, f64)> =
                lengths_m.iter().enumerate().map(|(i, length_m)| (*length_m, i % 2 == 0, 4.0)).collect();
            stretches(&line(&parts, &config), &config).iter().map(|stretch| stretch.0).collect::<Vec<LaneKind>>()
        };
        assert_eq!(kinds(&[3.5, 2.25, 2.75, 0.75, 1.25, 0.75, 4.0]), [LaneKind::Dashed]);
        assert_eq!(kinds(&[8.0, 2.0, 8.0, 2.0, 3.0]), [LaneKind::Dashed]);
        // As much of it is painted, and no pattern has such a gap.
        assert_eq!(kinds(&[4.0, 1.5, 5.0, 10.0, 1.75]), []);
        // Bars of two crossings and a stop line.
        assert_eq!(kinds(&[3.5, 12.0, 3.5, 6.5, 1.5]), []);
    }

    #[test]
    fn a_solid_line_has_spots_without_paint_and_dashes_have_gaps() {
        let config = LaneConfig::default();
        let kinds = |dash_m: f64, gap_m: f64| {
            let parts: Vec<(f64, bool, f64)> =
                (0..9).map(|i| (if i % 2 == 0 { dash_m } else { gap_m }, i % 2 == 0, 4.0)).collect();
            stretches(&line(&parts, &config), &config).iter().map(|stretch| stretch.0).collect::<Vec<LaneKind>>()
        };
        assert_eq!(kinds(6.0, 1.0), [LaneKind::Solid]);
        assert_eq!(kinds(8.0, 1.0), [LaneKind::Solid]);
        // The patterns with the shortest gaps, as wide as beams make their marks.
        assert_eq!(kinds(9.5, 2.5), [LaneKind::Dashed]);
        assert_eq!(kinds(3.25, 0.75), [LaneKind::Dashed]);
    }

    #[test]
    fn a_solid_line_does_not_reach_to_the_stop_line_that_it_points_at() {
        let config = LaneConfig::default();
        let ends_m = |blot_m: f64, road: f64| {
            let parts =
                [(blot_m, true, 4.0), (3.5, false, road), (20.0, true, 4.0), (3.5, false, road), (blot_m, true, 4.0)];
            let stretches = stretches(&line(&parts, &config), &config);
            stretches
                .iter()
                .map(|(_, range)| [range.start, range.end].map(|i| i as f64 * config.profile_m))
                .collect::<Vec<[f64; 2]>>()
        };
        assert_eq!(ends_m(0.5, 4.0), [[4.0, 24.0]]);
        // Worn, or behind a vehicle.
        assert_eq!(ends_m(2.0, 4.0), [[0.0, 31.0]]);
        assert_eq!(ends_m(0.5, 0.0), [[0.0, 28.0]]);
    }

    #[test]
    fn two_solid_lines_are_cut_where_the_road_between_them_is_bare() {
        let config = LaneConfig::default();
        let count = |road: f64| {
            stretches(&line(&[(20.0, true, 4.0), (10.0, false, road), (20.0, true, 4.0)], &config), &config).len()
        };
        assert_eq!((count(4.0), count(0.0)), (2, 1));
    }
}
