//! Lane lines that several passes saw.
//!
//! Passes cut one painted line at different places, so lines are compared
//! sample by sample: the longest line comes first, and each following one adds
//! its position to the samples that it runs along, and its samples to the map
//! where it runs on alone.

use std::collections::VecDeque;

use common::map::{LaneKind, LaneLine, RoadId, marks_along};
use nalgebra::{Point3, Vector3};

use super::strands::{Strand, strands};
use super::weights::{covariance_m2, vote};
use super::{Buckets, FuseConfig, Sighting};
use crate::lanes::simplify;

/// A place on a lane line and who saw it.
#[derive(Debug, Clone, PartialEq)]
pub struct LaneSample {
    /// Where, map frame, metres: the mean of all passes that saw it.
    pub point_map: Point3<f64>,
    /// The passes that saw it, in no particular order.
    pub passes: Vec<u32>,
}

/// A lane line out of one or more sightings.
#[derive(Debug, Clone, PartialEq)]
pub struct FusedLane {
    /// How it is painted: what most of its length was seen as.
    pub kind: LaneKind,
    /// The road of its first sighting.
    pub road: RoadId,
    /// Its sightings, as indices into the list that was fused.
    pub sightings: Vec<usize>,
    /// Samples along it, by driving order of its first sighting.
    pub samples: Vec<LaneSample>,
    /// Its vertices, where but one pass saw it.
    only: Option<Vec<Point3<f64>>>,
}

impl FusedLane {
    /// Whether but one pass saw it: its sightings follow on each other, and
    /// nothing was changed.
    pub fn is_lone(&self) -> bool {
        self.only.is_some()
    }

    /// Its vertices: as they are where but one pass saw it, else the fused
    /// samples within the tolerance.
    pub fn vertices(&self, config: &FuseConfig) -> Vec<Point3<f64>> {
        self.only.clone().unwrap_or_else(|| simplified(&self.samples, config))
    }

    /// Where the marks that its sightings have begin and end along
    /// `points_map`, its vertices or those of a part of it, metres.
    pub fn marks_m(
        &self,
        points_map: &[Point3<f64>],
        sightings: &[Sighting<LaneLine>],
        config: &FuseConfig,
    ) -> Vec<[f64; 2]> {
        if self.kind != LaneKind::Dashed {
            return Vec::new();
        }
        // In the order of the list, once each: a line may come back to a pass.
        let mut seen = self.sightings.clone();
        seen.sort_unstable();
        seen.dedup();
        let lines = seen.iter().filter_map(|&index| sightings.get(index));
        let marks_map: Vec<[Point3<f64>; 2]> = lines.flat_map(|line| line.landmark.marks_map()).collect();
        marks_along(points_map, &marks_map, config.lane_within_m)
    }

    /// The vertices of a part of its samples.
    pub fn part(&self, samples: std::ops::Range<usize>, config: &FuseConfig) -> Vec<Point3<f64>> {
        if samples == (0..self.samples.len()) {
            return self.vertices(config);
        }
        simplified(self.samples.get(samples).unwrap_or(&[]), config)
    }
}

fn simplified(samples: &[LaneSample], config: &FuseConfig) -> Vec<Point3<f64>> {
    let points: Vec<Point3<f64>> = samples.iter().map(|sample| sample.point_map).collect();
    simplify(&points, config.tolerance_m).into_iter().map(|index| points[index]).collect()
}

/// Makes one line of those that several passes saw: lateral position and
/// height are the means weighted by information, the kind is that of most of
/// the length.
pub fn fuse_lanes(sightings: &[Sighting<LaneLine>], config: &FuseConfig) -> Vec<FusedLane> {
    let mut fusion = Fusion::new(config);
    for strand in &strands(sightings) {
        fusion.add(strand);
    }
    fusion.lines.iter().filter_map(|line| fusion.finish(line)).collect()
}

/// A place on the line that came first there, and what others said of it.
struct Node {
    point: Point3<f64>,
    /// Unit direction of its line.
    along: Vector3<f64>,
    line: usize,
    passes: Vec<u32>,
    weight: f64,
    /// Weighted offsets from `point`, to the right and down, metres.
    right_m: f64,
    down_m: f64,
}

struct Line {
    road: RoadId,
    is_painted: bool,
    nodes: VecDeque<usize>,
    sightings: Vec<usize>,
    votes: Vec<(LaneKind, f64)>,
    /// The vertices of its first strand, if no other adds anything to it.
    only: Option<Vec<Point3<f64>>>,
}

/// A sample of a line that is being added.
struct Probe {
    point: Point3<f64>,
    along: Vector3<f64>,
}

fn right_of(along: &Vector3<f64>) -> Vector3<f64> {
    // Seen from above, y down.
    Vector3::new(along.z, 0.0, -along.x).try_normalize(1e-9).unwrap_or_else(Vector3::x)
}

/// Samples of a polyline at most `step_m` apart, both ends among them.
fn probes(points: &[Point3<f64>], step_m: f64) -> Vec<Probe> {
    let mut probes: Vec<Probe> = Vec::new();
    for pair in points.windows(2) {
        let way = pair[1] - pair[0];
        let Some(along) = way.try_normalize(1e-9) else { continue };
        let count = (way.norm() / step_m).ceil().clamp(1.0, 1e6);
        if probes.is_empty() {
            probes.push(Probe { point: pair[0], along });
        }
        probes.extend((1..=count as usize).map(|i| Probe { point: pair[0] + way * (i as f64 / count), along }));
    }
    probes
}

struct Fusion<'a> {
    config: &'a FuseConfig,
    nodes: Vec<Node>,
    lines: Vec<Line>,
    buckets: Buckets,
}

impl<'a> Fusion<'a> {
    fn new(config: &'a FuseConfig) -> Self {
        Self { config, nodes: Vec::new(), lines: Vec::new(), buckets: Buckets::new(2.0 * config.lane_step_m) }
    }

    fn add(&mut self, strand: &Strand) {
        let step_m = self.config.lane_step_m.max(0.05);
        let probes = probes(&strand.points_map, step_m);
        let matched = self.matches(&probes, strand);
        // One line after the other, the one it runs along best first: so it
        // does not jump to and fro between the two lines of a double one.
        let mut scores: Vec<(usize, f64)> = Vec::new();
        for (line, score) in matched.iter().flatten().map(|m| (m.line, m.score)) {
            match scores.iter_mut().find(|s| s.0 == line) {
                Some(known) => known.1 += score,
                None => scores.push((line, score)),
            }
        }
        scores.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let mut claimed: Vec<Option<usize>> = vec![None; probes.len()];
        for (line, _) in scores {
            for (slot, matches) in claimed.iter_mut().zip(&matched) {
                if slot.is_none() && matches.iter().any(|m| m.line == line) {
                    *slot = Some(line);
                }
            }
        }
        let weight = 3.0 / covariance_m2(strand.covariance_map_m2.as_ref(), self.config).trace();
        for ((probe, slot), matches) in probes.iter().zip(&claimed).zip(&matched) {
            for m in matches.iter().filter(|m| Some(m.line) == *slot) {
                self.contribute(m.node, probe, strand.pass, weight);
            }
        }
        for line in claimed.iter().flatten() {
            let line = &mut self.lines[*line];
            line.votes.push((strand.kind, weight));
            if !line.sightings.ends_with(&strand.sightings) {
                line.sightings.extend(&strand.sightings);
                line.only = None;
            }
        }
        self.add_rest(strand, &probes, &claimed, weight);
    }

    /// For every probe the nodes that it may be another sighting of: paint is no kerb.
    fn matches(&self, probes: &[Probe], strand: &Strand) -> Vec<Vec<Match>> {
        let config = self.config;
        // A node is spoken for by the probes up to half a step before and
        // behind it; a little more, so that none is left between them.
        let reach_m = 0.6 * config.lane_step_m;
        let least_cosine = config.lane_angle_rad.cos();
        let mut found = Vec::with_capacity(probes.len());
        for probe in probes {
            let mut matches: Vec<Match> = Vec::new();
            for node in self.buckets.near(&probe.point, reach_m.hypot(config.lane_within_m)) {
                let Node { point, along, line, passes, .. } = &self.nodes[node];
                let off = probe.point - point;
                let lateral_m = off.dot(&right_of(along)).abs();
                if off.dot(along).abs() <= reach_m
                    && lateral_m <= config.lane_within_m
                    && off.y.abs() <= config.lane_height_m
                    && along.dot(&probe.along).abs() >= least_cosine
                    && !passes.contains(&strand.pass)
                    && self.lines[*line].is_painted == strand.kind.is_painted()
                {
                    matches.push(Match { node, line: *line, score: config.lane_within_m - lateral_m });
                }
            }
            found.push(matches);
        }
        found
    }

    fn contribute(&mut self, node: usize, probe: &Probe, pass: u32, weight: f64) {
        let node = &mut self.nodes[node];
        if node.passes.contains(&pass) {
            return;
        }
        // Where the line through the probe passes the node.
        let at = probe.point + probe.along * (node.point - probe.point).dot(&probe.along);
        let off = at - node.point;
        node.passes.push(pass);
        node.weight += weight;
        node.right_m += weight * off.dot(&right_of(&node.along));
        node.down_m += weight * off.y;
    }

    /// What no line claims: it prolongs the line that claims what is beside
    /// it, or is a line of its own.
    fn add_rest(&mut self, strand: &Strand, probes: &[Probe], claimed: &[Option<usize>], weight: f64) {
        let mut start = 0;
        for run in claimed.chunk_by(|a, b| a.is_none() == b.is_none()) {
            let (from, to) = (start, start + run.len());
            start = to;
            let part = &probes[from..to];
            let (Some(first), Some(last)) = (part.first(), part.last()) else { continue };
            let is_whole = part.len() == probes.len();
            let is_short = (last.point - first.point).norm() < self.config.shortest_piece_m;
            if run[0].is_some() || (is_short && !is_whole) {
                continue;
            }
            let before = from.checked_sub(1).and_then(|i| claimed[i]);
            let after = claimed.get(to).copied().flatten();
            let kind = strand.kind;
            let same_kind = |line: &usize| self.lines[*line].votes.first().is_some_and(|vote| vote.0 == kind);
            let ends = [(before, first.point), (after, last.point)];
            let prolonged = ends.into_iter().find_map(|(line, point)| {
                line.filter(same_kind).and_then(|line| Some((line, self.end(line, &point)?)))
            });
            let (line, at_back) = prolonged.unwrap_or_else(|| {
                let nodes = VecDeque::new();
                let only = is_whole.then(|| strand.points_map.clone());
                let (road, sightings) = (strand.road, strand.sightings.clone());
                let is_painted = kind.is_painted();
                self.lines.push(Line { nodes, road, is_painted, sightings, votes: Vec::new(), only });
                (self.lines.len() - 1, true)
            });
            // From the known end outwards.
            let outwards = self
                .end_point(line, at_back)
                .is_none_or(|end| (end - first.point).norm_squared() <= (end - last.point).norm_squared());
            let mut ordered: Vec<&Probe> = part.iter().collect();
            if !outwards {
                ordered.reverse();
            }
            for probe in ordered {
                self.grow(line, at_back, outwards == at_back, probe, strand.pass, weight);
                self.lines[line].votes.push((kind, weight));
            }
        }
    }

    /// Which end of a line (its back?) is within two and a half steps of a point.
    fn end(&self, line: usize, point: &Point3<f64>) -> Option<bool> {
        let near = |end: Option<Point3<f64>>| end.is_some_and(|e| (e - point).norm() <= 2.5 * self.config.lane_step_m);
        if near(self.end_point(line, true)) { Some(true) } else { near(self.end_point(line, false)).then_some(false) }
    }

    fn end_point(&self, line: usize, at_back: bool) -> Option<Point3<f64>> {
        let nodes = &self.lines[line].nodes;
        let end = if at_back { nodes.back() } else { nodes.front() };
        end.map(|&node| self.nodes[node].point)
    }

    /// Adds a node to an end of a line.
    fn grow(&mut self, line: usize, at_back: bool, is_forward: bool, probe: &Probe, pass: u32, weight: f64) {
        let along = if is_forward { probe.along } else { -probe.along };
        let node = self.nodes.len();
        self.buckets.add(&probe.point, node);
        self.nodes.push(Node {
            point: probe.point,
            along,
            line,
            passes: vec![pass],
            weight,
            right_m: 0.0,
            down_m: 0.0,
        });
        let nodes = &mut self.lines[line].nodes;
        if at_back { nodes.push_back(node) } else { nodes.push_front(node) }
    }

    fn finish(&self, line: &Line) -> Option<FusedLane> {
        let nodes: Vec<&Node> = line.nodes.iter().map(|&node| &self.nodes[node]).collect();
        let half = (self.config.blend_m / self.config.lane_step_m.max(0.05)).round().min(1e3) as usize;
        let samples = (0..nodes.len()).map(|at| {
            // The mean correction over some metres: no step where a pass ends.
            let near = &nodes[at.saturating_sub(half)..(at + half + 1).min(nodes.len())];
            let mean = |of: fn(&Node) -> f64| near.iter().map(|n| of(n) / n.weight).sum::<f64>() / near.len() as f64;
            let node = nodes[at];
            let moved = right_of(&node.along) * mean(|n| n.right_m) + Vector3::y() * mean(|n| n.down_m);
            LaneSample { point_map: node.point + moved, passes: node.passes.clone() }
        });
        let kind = vote(line.votes.iter().copied())?;
        Some(FusedLane {
            kind,
            road: line.road,
            sightings: line.sightings.clone(),
            samples: samples.collect(),
            only: line.only.clone(),
        })
    }
}

/// One node that a probe may see again; the better, the higher the score.
struct Match {
    node: usize,
    line: usize,
    score: f64,
}

#[cfg(test)]
mod tests;
