//! Brings maps of one area onto each other.
//!
//! Unknown are small corrections of place and heading every some metres along
//! the roads of each map ([`Field`]). Minimised are, with Cauchy weights on the
//! landmarks,
//!
//! - `p_i - m`: a landmark `p_i` that several maps have, against its unknown
//!   true place `m`, seen from above and in height,
//! - `n . (p - q)`: a place `p` on a lane line across the line of another map
//!   that passes `q` with normal `n`, and its height,
//! - the difference of neighbouring corrections: surveys drift slowly,
//! - the corrections themselves: every map is right within its stated accuracy,
//!   and none is more right than the others.
//!
//! Which landmarks are the same is first voted on, region by region
//! ([`agreeing_pairs`]), then decided by distance, in rounds of smaller and
//! smaller gates.

use std::collections::BTreeMap;

use nalgebra::Point3;

use super::config::{AlignConfig, MergeConfig};
use super::field::{Field, Held, UNKNOWNS};
use super::marks::{Mark, Piece, marks, pieces};
use super::solve::Equations;
use super::source::Source;
use super::votes::{Voter, agreeing_pairs};
use super::witness::Witnesses;
use crate::fuse::{Buckets, NEVER_DOUBLE_M, Place, cluster};

/// Largest distances at which landmarks are paired, metres, round by round.
const GATES_M: [f64; 5] = [1.0, 0.8, 0.6, 0.5, 0.5];
/// Most other maps that a region is voted against, or a place on a lane line is
/// compared with: the work grows with the number of maps, not with its square.
const MOST_OTHERS: usize = 3;
/// How often pairs that were voted for are weighted anew.
const VOTE_ROUNDS: usize = 3;

/// How a map was aligned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// No other map has a landmark or a road near its own: as given.
    Alone,
    /// Aligned with others.
    Aligned,
    /// Others are near, and the same landmarks were not found: as given.
    Unaligned,
}

/// Corrections of all maps.
#[derive(Debug)]
pub struct Alignment {
    /// The corrections.
    pub field: Field,
    /// How each map was aligned.
    pub states: Vec<State>,
    /// How far landmarks of two or more maps lie from their mean, root mean
    /// square in metres, as given; 0 where there are none.
    pub apart_given_m: f64,
    /// The same, aligned.
    pub apart_aligned_m: f64,
}

/// Aligns maps.
pub fn align(sources: &[Source], config: &MergeConfig) -> Alignment {
    let mut takes_part = vec![true; sources.len()];
    let (mut problem, mut shared) = solved(sources, &takes_part, config);
    let mut states = problem.states(sources, &shared, config);
    if states.contains(&State::Unaligned) {
        for (takes_part, state) in takes_part.iter_mut().zip(&states) {
            *takes_part = *state == State::Aligned;
        }
        (problem, shared) = solved(sources, &takes_part, config);
        let again = problem.states(sources, &shared, config);
        for ((state, again), takes_part) in states.iter_mut().zip(again).zip(&takes_part) {
            if *takes_part {
                *state = again;
            }
        }
    }
    let [apart_given_m, apart_aligned_m] = problem.apart_m(&shared);
    Alignment { field: problem.field, states, apart_given_m, apart_aligned_m }
}

/// Landmarks that several maps have, as indices of marks.
type Shared = Vec<Vec<usize>>;

fn solved<'a>(sources: &[Source], takes_part: &[bool], config: &'a MergeConfig) -> (Problem<'a>, Shared) {
    let mut problem = Problem::new(sources, takes_part, &config.align);
    problem.vote();
    for gate_m in GATES_M {
        problem.settle(gate_m);
    }
    let shared = problem.shared(config.fuse.pole_within_m);
    (problem, shared)
}

/// Landmarks of a map that other maps should have, too.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    /// Those beside a road of the others.
    checked: usize,
    /// Of these, those that the others have.
    found: usize,
}

impl Tally {
    fn count(&mut self, is_found: bool) {
        self.checked += 1;
        self.found += usize::from(is_found);
    }

    /// Whether fewer are found than [`AlignConfig::least_shared`] says.
    fn is_low(self, config: &AlignConfig) -> bool {
        (self.found as f64) < config.least_shared * self.checked as f64
    }
}

struct Problem<'a> {
    config: &'a AlignConfig,
    field: Field,
    /// Of the maps that take part.
    marks: Vec<Mark>,
    pieces: Vec<Piece>,
}

impl<'a> Problem<'a> {
    fn new(sources: &[Source], takes_part: &[bool], config: &'a AlignConfig) -> Self {
        let field = Field::new(sources.iter().map(|source| &source.map), config.node_m);
        let mut marks = marks(sources, &field);
        marks.retain(|mark| takes_part[mark.source]);
        let mut pieces = pieces(sources, &field, config);
        pieces.retain(|piece| takes_part[piece.source]);
        Self { config, field, marks, pieces }
    }

    /// Finds shifts of up to `reach_m` by votes, region by region.
    fn vote(&mut self) {
        let pairs = self.voted_pairs();
        if pairs.is_empty() {
            return;
        }
        for round in 0..VOTE_ROUNDS {
            let mut equations = self.stiffness();
            for (a, b) in &pairs {
                let (a, b) = (&self.marks[*a].held, &self.marks[*b].held);
                let off_m = (self.field.place(a) - self.field.place(b)).norm();
                // At first all count the same; then those that contradict
                // their surroundings less.
                let weight = if round == 0 { 1.0 } else { cauchy(off_m, 2.0 * self.config.landmark_sigma_m) };
                self.tie(&mut equations, a, b, weight * self.information());
            }
            equations.solve(&mut self.field.corrections);
        }
    }

    fn voted_pairs(&self) -> Vec<(usize, usize)> {
        let config = self.config;
        let buckets = Buckets::of(config.window_m, self.marks.iter().map(|mark| &mark.held.point_map));
        let mut pairs = Vec::new();
        let mut last: Option<(usize, Point3<f64>)> = None;
        for (node, centre) in self.field.nodes.iter().enumerate() {
            let source = self.field.source[node];
            // Regions overlap by half.
            if last.is_some_and(|(s, at)| s == source && (at - centre).norm() < config.window_m) {
                continue;
            }
            last = Some((source, *centre));
            let is_near = |mark: &usize| (self.marks[*mark].held.point_map - centre).norm() <= config.window_m;
            let mut near: Vec<usize> = buckets.near(centre, config.window_m).filter(is_near).collect();
            near.sort_unstable();
            // Marks are in the order of their maps.
            let by_source: Vec<&[usize]> =
                near.chunk_by(|a, b| self.marks[*a].source == self.marks[*b].source).collect();
            let of = |group: &[usize]| group.first().map(|mark| self.marks[*mark].source);
            let Some(here) = by_source.iter().find(|group| of(group) == Some(source)) else { continue };
            let mut others: Vec<&&[usize]> = by_source.iter().filter(|group| of(group) != Some(source)).collect();
            others.sort_by_key(|group| std::cmp::Reverse(group.len()));
            let voters = |group: &[usize]| -> Vec<Voter> {
                let voter = |mark: &usize| Voter {
                    point_map: self.marks[*mark].held.point_map,
                    class: self.marks[*mark].class,
                };
                group.iter().map(voter).collect()
            };
            let voters_here = voters(here);
            for there in others.into_iter().take(MOST_OTHERS) {
                let agreeing = agreeing_pairs(&voters_here, &voters(there), config);
                pairs.extend(agreeing.into_iter().map(|(h, t)| (here[h], there[t])));
            }
        }
        pairs
    }

    /// One round: pairs what lies within the gate, and solves.
    fn settle(&mut self, gate_m: f64) {
        let scale_m = self.config.landmark_sigma_m.max(gate_m / 5.0);
        let mut equations = self.stiffness();
        let mut unknowns = self.field.corrections.clone();
        for members in self.shared(gate_m) {
            let places: Vec<Point3<f64>> = members.iter().map(|&m| self.field.place(&self.marks[m].held)).collect();
            let mean = centre(&places);
            let column = unknowns.len();
            unknowns.extend(mean.coords.iter());
            for (member, place) in members.iter().zip(&places) {
                let weight = cauchy((place - mean).norm(), scale_m) * self.information();
                let held = &self.marks[*member].held;
                for axis in 0..3 {
                    let terms = self.terms(held, axis).chain([(column + axis, -1.0)]);
                    equations.add(terms, -held.point_map[axis], weight);
                }
            }
        }
        self.tie_lines(&mut equations, gate_m, scale_m);
        equations.solve(&mut unknowns);
        unknowns.truncate(self.field.corrections.len());
        self.field.corrections = unknowns;
    }

    /// Lane lines across, against those of other maps.
    fn tie_lines(&self, equations: &mut Equations, gate_m: f64, scale_m: f64) {
        let reach_m = gate_m.hypot(0.5 * self.config.lane_step_m);
        let middles: Vec<Point3<f64>> = self.pieces.iter().map(|piece| self.field.place(&piece.held)).collect();
        let buckets = Buckets::of(self.config.lane_step_m, &middles);
        for (index, (piece, at)) in self.pieces.iter().zip(&middles).enumerate() {
            let mut beside: Vec<(f64, usize)> = Vec::new();
            for other in buckets.near(at, reach_m) {
                let line = &self.pieces[other];
                let off = at - middles[other];
                let along = line.way.normalize();
                let across_m = (along.z * off.x - along.x * off.z).abs();
                let is_parallel = along.dot(&piece.way.normalize()).abs() > 0.98;
                // A little more than half, so that none falls between two.
                if line.source != piece.source
                    && is_parallel
                    && off.dot(&along).abs() <= 0.55 * line.way.norm()
                    && across_m <= gate_m
                    && off.y.abs() <= gate_m
                {
                    beside.push((across_m, other));
                }
            }
            beside.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let mut compared: Vec<usize> = Vec::new();
            for (across_m, other) in beside {
                let line = &self.pieces[other];
                if compared.len() == MOST_OTHERS || compared.contains(&line.source) {
                    continue;
                }
                compared.push(line.source);
                let weight = cauchy(across_m, scale_m) * self.information();
                self.tie_across(equations, &self.pieces[index].held, line, weight);
            }
        }
    }

    /// `n . (p - q) = 0` for a point and a piece of a line; heights likewise.
    fn tie_across(&self, equations: &mut Equations, held: &Held, line: &Piece, weight: f64) {
        let along = line.way.normalize();
        let (nx, nz) = (along.z, -along.x);
        let across = |held: &Held, sign: f64| {
            let x = self.terms(held, 0).map(|(column, value)| (column, sign * nx * value)).collect::<Vec<_>>();
            let z = self.terms(held, 2).map(|(column, value)| (column, sign * nz * value)).collect::<Vec<_>>();
            x.into_iter().chain(z)
        };
        let off = held.point_map - line.held.point_map;
        equations.add(across(held, 1.0).chain(across(&line.held, -1.0)), -(nx * off.x + nz * off.z), weight);
        // The height of the line beside the point.
        let rise = along.y * off.dot(&along);
        let height = self.terms(held, 1).chain(self.terms(&line.held, 1).map(|(column, value)| (column, -value)));
        equations.add(height, -(off.y - rise), weight);
    }

    /// `p_a - p_b = 0`.
    fn tie(&self, equations: &mut Equations, a: &Held, b: &Held, weight: f64) {
        for axis in 0..3 {
            let minus = self.terms(b, axis).map(|(column, value)| (column, -value));
            let right = b.point_map[axis] - a.point_map[axis];
            equations.add(self.terms(a, axis).chain(minus), right, weight);
        }
    }

    /// How a coordinate of a held point depends on the unknowns.
    fn terms(&self, held: &Held, axis: usize) -> impl Iterator<Item = (usize, f64)> + use<> {
        let [first, second] = held.by.map(|(node, share)| {
            let arm = held.point_map - self.field.nodes[node];
            let turn = [arm.z, 0.0, -arm.x][axis];
            [(node * UNKNOWNS + axis, share), (node * UNKNOWNS + 3, share * turn)]
        });
        first.into_iter().chain(second).filter(|(_, value)| *value != 0.0)
    }

    /// What holds the corrections small and smooth.
    fn stiffness(&self) -> Equations {
        let config = self.config;
        let mut equations = Equations::default();
        let sigma = |axis: usize, shift: f64, turn: f64| if axis < 3 { shift } else { turn };
        for node in 0..self.field.nodes.len() {
            for axis in 0..UNKNOWNS {
                let sigma = sigma(axis, config.frame_sigma_m, config.frame_sigma_rad);
                equations.add([(node * UNKNOWNS + axis, 1.0)], 0.0, sigma.powi(-2));
            }
        }
        for &(a, b, spacings) in &self.field.edges {
            let arm = self.field.nodes[b] - self.field.nodes[a];
            for axis in 0..UNKNOWNS {
                let sigma = sigma(axis, config.drift_sigma_m, config.drift_sigma_rad);
                // A turn of the map shifts the next node, which is no drift.
                let turned = [arm.z, 0.0, -arm.x, 0.0][axis];
                let half = 0.5 * turned;
                let (a, b) = (a * UNKNOWNS, b * UNKNOWNS);
                let turns = [(a + 3, -half), (b + 3, -half)].into_iter().filter(|term| term.1 != 0.0);
                let terms = [(b + axis, 1.0), (a + axis, -1.0)].into_iter().chain(turns);
                equations.add(terms, 0.0, 1.0 / (sigma * sigma * spacings));
            }
        }
        equations
    }

    fn information(&self) -> f64 {
        self.config.landmark_sigma_m.powi(-2)
    }

    /// Landmarks that two or more maps have, within a gate.
    fn shared(&self, within_m: f64) -> Shared {
        let place = |mark: &Mark| Place {
            point_map: self.field.place(&mark.held),
            pass: mark.source as u32,
            class: mark.class,
        };
        let places: Vec<Place> = self.marks.iter().map(place).collect();
        cluster(&places, within_m, NEVER_DOUBLE_M).into_iter().filter(|members| members.len() > 1).collect()
    }

    fn states(&self, sources: &[Source], shared: &Shared, config: &MergeConfig) -> Vec<State> {
        let paths = sources.iter().enumerate().flat_map(|(source, Source { map, .. })| {
            map.roads.iter().map(move |road| (source as u32, &road.path_map[..]))
        });
        let witnesses = Witnesses::new(paths);
        let mut with: Vec<Vec<usize>> = vec![Vec::new(); self.marks.len()];
        for members in shared {
            for &mark in members {
                with[mark] = members.iter().map(|&member| self.marks[member].source).collect();
            }
        }
        let mut with_any = vec![Tally::default(); sources.len()];
        let mut with_one: BTreeMap<(usize, usize), Tally> = BTreeMap::new();
        for (mark, with) in self.marks.iter().zip(&with) {
            let below_m = if mark.is_pole() { config.witness.ground_m() } else { config.witness.signs_m() };
            let near = witnesses.near(&mark.held.point_map, config.witness.point_m, &below_m);
            let mut others = near.iter().map(|(pass, _)| *pass as usize).filter(|pass| *pass != mark.source).peekable();
            if others.peek().is_some() {
                with_any[mark.source].count(!with.is_empty());
            }
            others.for_each(|other| with_one.entry((mark.source, other)).or_default().count(with.contains(&other)));
        }
        // A map that fits nowhere, beside most of it, must not make one that fits another unaligned.
        let fits_one = |source: usize| {
            let mut ones = with_one.range((source, 0)..(source + 1, 0));
            ones.any(|(_, tally)| tally.found >= self.config.fewest_votes && !tally.is_low(self.config))
        };
        let state = |(source, tally): (usize, Tally)| {
            if tally.checked == 0 {
                State::Alone
            } else if tally.checked >= self.config.fewest_checked && tally.is_low(self.config) && !fits_one(source) {
                State::Unaligned
            } else {
                State::Aligned
            }
        };
        with_any.into_iter().enumerate().map(state).collect()
    }

    fn apart_m(&self, shared: &Shared) -> [f64; 2] {
        let rms = |place: &dyn Fn(&Held) -> Point3<f64>| {
            let (mut sum, mut count) = (0.0, 0);
            for members in shared {
                let places: Vec<Point3<f64>> = members.iter().map(|&mark| place(&self.marks[mark].held)).collect();
                let mean = centre(&places);
                sum += places.iter().map(|p| (p.x - mean.x).powi(2) + (p.z - mean.z).powi(2)).sum::<f64>();
                count += places.len();
            }
            if count == 0 { 0.0 } else { (sum / f64::from(count as u32)).sqrt() }
        };
        [rms(&|held| held.point_map), rms(&|held| self.field.place(held))]
    }
}

fn centre(points: &[Point3<f64>]) -> Point3<f64> {
    Point3::from(points.iter().map(|p| p.coords).sum::<nalgebra::Vector3<f64>>() / points.len().max(1) as f64)
}

/// Weight of a residual of so many metres.
fn cauchy(off_m: f64, scale_m: f64) -> f64 {
    1.0 / (1.0 + (off_m / scale_m).powi(2))
}
