//! What stays of a fused lane line, cut where its road ends.

use std::ops::Range;

use common::map::{LaneLine, RoadId};
use nalgebra::Point3;

use super::config::MergeConfig;
use super::report::Counts;
use super::witness::{Witnesses, missed};
use crate::fuse::{FusedLane, Sighting, length_m};
use crate::roads::runs;

/// By what a line is judged and cut.
pub struct Rules<'a> {
    /// Who came near.
    pub witnesses: &'a Witnesses,
    /// All settings.
    pub config: &'a MergeConfig,
    /// The road nearest to a point.
    pub road_of: &'a dyn Fn(&Point3<f64>) -> RoadId,
}

/// The parts of a fused line that most of the passes that came near have, each
/// on one road.
///
/// `sightings` are those that were fused.
pub fn line_parts(
    lane: &FusedLane,
    sightings: &[Sighting<LaneLine>],
    rules: &Rules,
    counts: &mut Counts,
) -> Vec<LaneLine> {
    let config = rules.config;
    let mut keep = Vec::with_capacity(lane.samples.len());
    let step_m = mean_step_m(lane);
    let (witness, ground_m) = (&config.witness, config.witness.ground_m());
    for sample in &lane.samples {
        let (point_map, seen) = (&sample.point_map, &sample.passes);
        let near = rules.witnesses.expected(point_map, seen, witness.lane_m, &ground_m, witness);
        keep.push(counts.count(step_m, sample.passes.len(), missed(&sample.passes, &near)));
    }
    let gap = (witness.shortest_gap_m / step_m.max(1e-3)) as usize;
    close(&mut keep, gap);
    if lane.is_lone() && keep.iter().all(|keep| *keep) {
        // It was cut when its map was built.
        return lane
            .sightings
            .iter()
            .map(|&index| on_nearest_road(&sightings[index].landmark, rules.road_of))
            .collect();
    }
    let mut parts = Vec::new();
    for run in runs(&keep).into_iter().filter(|run| keep[run.start]) {
        for (road, part) in by_road(lane, &run, step_m, rules) {
            let points_map = lane.part(part, &config.fuse);
            if points_map.len() >= 2 && length_m(&points_map) >= config.fuse.shortest_piece_m {
                let marks_m = lane.marks_m(&points_map, sightings, &config.fuse);
                parts.push(LaneLine { kind: lane.kind, points_map, road, marks_m });
            }
        }
    }
    parts
}

fn mean_step_m(lane: &FusedLane) -> f64 {
    let points: Vec<Point3<f64>> = lane.samples.iter().map(|sample| sample.point_map).collect();
    length_m(&points) / points.len().max(1) as f64
}

/// Closes gaps of up to `gap` samples between samples that are kept.
fn close(keep: &mut [bool], gap: usize) {
    for run in runs(keep) {
        if run.len() <= gap && run.start > 0 && run.end < keep.len() {
            keep[run].fill(true);
        }
    }
}

/// A line on the road that is nearest to its middle.
pub fn on_nearest_road(line: &LaneLine, road_of: &dyn Fn(&Point3<f64>) -> RoadId) -> LaneLine {
    let middle = line.points_map.get(line.points_map.len() / 2);
    let before = line.points_map.get((line.points_map.len() / 2).saturating_sub(1));
    let centre = middle.zip(before).map(|(a, b)| nalgebra::center(a, b));
    LaneLine { road: centre.map_or(line.road, |centre| road_of(&centre)), ..line.clone() }
}

/// Cuts a run of samples, `step_m` apart, where another road is nearer.
fn by_road(lane: &FusedLane, run: &Range<usize>, step_m: f64, rules: &Rules) -> Vec<(RoadId, Range<usize>)> {
    let road_at = |index: usize| (rules.road_of)(&lane.samples[index].point_map);
    let roads: Vec<RoadId> = run.clone().map(road_at).collect();
    let least = (rules.config.fuse.shortest_piece_m / step_m.max(1e-3)).ceil() as usize + 1;
    let mut parts: Vec<(RoadId, Range<usize>)> = Vec::new();
    for same in runs(&roads) {
        let (road, range) = (roads[same.start], run.start + same.start..run.start + same.end);
        match parts.last_mut() {
            // Short parts go with the one before.
            Some(last) if range.len() < least || last.0 == road => last.1.end = range.end,
            // Parts share the sample at which they are cut.
            Some(last) => {
                let from = last.1.end - 1;
                parts.push((road, from..range.end));
            }
            None => parts.push((road, range)),
        }
    }
    parts
}
