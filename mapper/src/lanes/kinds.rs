//! Solid or dashed: where a line changes from one to the other.

use std::ops::Range;

use common::map::LaneKind;

use super::LaneConfig;
use super::profile::{Bin, runs};

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
    let parts: Vec<(bool, &[Range<usize>])> = {
        let mut start = 0;
        solid
            .chunk_by(|a, b| a == b)
            .map(|part| {
                start += part.len();
                (part[0], &group[start - part.len()..start])
            })
            .collect()
    };
    // Few dashes beside a solid run are part of it.
    let has_solid = solid.contains(&true);
    let mut stretches: Vec<Stretch> = Vec::new();
    for (is_solid, part) in parts {
        let (Some(first), Some(last)) = (part.first(), part.last()) else { continue };
        let is_solid = is_solid || (has_solid && part.len() < config.fewest_dashes);
        if !is_solid && !are_dashes(part, config) {
            continue;
        }
        let kind = if is_solid { LaneKind::Solid } else { LaneKind::Dashed };
        match stretches.last_mut() {
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
    stretches
}

/// Which runs are solid: the long ones. Long ones that were hardly seen may
/// have gaps; they are what the run before them is, or the one after.
fn are_solid(group: &[Range<usize>], bins: &[Bin], config: &LaneConfig) -> Vec<bool> {
    let mut known: Vec<Option<bool>> = group
        .iter()
        .map(|run| {
            let seen = bins[run.clone()].iter().filter(|b| b.core.bright > 0.0).count() as f64;
            let is_long = run.len() as f64 * config.profile_m > config.longest_dash_m;
            (!is_long || seen >= config.least_seen_share * run.len() as f64).then_some(is_long)
        })
        .collect();
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
/// them as long as a dash, and not too far apart.
fn are_dashes(part: &[Range<usize>], config: &LaneConfig) -> bool {
    let (Some(first), Some(last)) = (part.first(), part.last()) else { return false };
    let painted: usize = part.iter().map(ExactSizeIterator::len).sum();
    let mut lengths: Vec<usize> = part.iter().map(ExactSizeIterator::len).collect();
    lengths.sort_unstable();
    part.len() >= config.fewest_dashes
        && lengths[lengths.len() / 2] as f64 * config.profile_m >= config.shortest_dash_m
        && painted as f64 >= config.least_painted * (last.end - first.start) as f64
}
