//! Points of a stitched cloud in an order in which a lidar may have taken them.
//!
//! Lane paint is told by comparing a point with those around it on its beam, and clouds from
//! archives are stored in tiles, along curves that fill space, or by lot. Where points have times
//! these tell their order, or at least the turn of the lidar in which each was taken, and in a turn
//! the beams can be [followed](Steps::followed). Where nothing is left of the scans, points are put
//! into strips across the way, which all lane lines along it cross.

use common::geometry::{Pose, interpolate};
use common::kitti::ScanPoint;
use nalgebra::{Point3, Vector2};

use super::beams::Steps;
use super::deal::Ground;
use crate::scan::position;

/// Share of a turn of the lidar whose points are looked at together: so small that it holds
/// no point of the next one.
const SHARE_OF_TURN: f64 = 0.75;

/// From one place to the next nearer than this, metres, nothing tells where the way leads.
const LEAST_WAY_M: f32 = 0.5;

/// Where the lidar was at which time.
#[derive(Debug)]
pub struct Tour {
    /// Seconds, ascending.
    pub times_s: Vec<f64>,
    /// `map_from_velodyne` at each.
    pub map_from_velodyne: Vec<Pose>,
}

impl Tour {
    /// `map_from_velodyne` at a time, seconds; beyond its ends that of the end.
    fn at(&self, time_s: f64) -> Option<Pose> {
        let after = self.times_s.partition_point(|t| *t < time_s);
        let Some(before) = after.checked_sub(1) else { return self.map_from_velodyne.first().copied() };
        let a = self.map_from_velodyne.get(before)?;
        let Some(b) = self.map_from_velodyne.get(after) else { return Some(*a) };
        let (from_s, to_s) = (self.times_s[before], self.times_s[after]);
        Some(interpolate(a, b, (time_s - from_s) / (to_s - from_s)))
    }
}

/// A slice of a cloud, and what is known of its points.
pub struct Slice<'a> {
    /// In the frame of the lidar at its place.
    points: &'a [ScanPoint],
    /// Time of each point, seconds; empty where they have none.
    times_s: &'a [f64],
    /// `map_from_velodyne` at its place.
    map_from_here: Pose,
    /// Where the way leads, lidar frame (x, y), of unit length.
    ahead: Vector2<f32>,
}

impl<'a> Slice<'a> {
    /// Of one of several places, by its number; `velodyne_from_map` of each.
    pub fn new(points: &'a [ScanPoint], times_s: &'a [f64], velodyne_from_map: &[Pose], number: usize) -> Self {
        let here_from_map = velodyne_from_map[number];
        let seen = |place: usize| {
            let there = velodyne_from_map.get(place)?.inverse().translation.vector;
            let there = here_from_map * Point3::from(there);
            Vector2::new(there.x as f32, there.y as f32).try_normalize(LEAST_WAY_M)
        };
        let behind = || seen(number.checked_sub(1)?).map(|behind| -behind);
        let ahead = seen(number + 1).or_else(behind).unwrap_or_else(Vector2::x);
        Self { points, times_s, map_from_here: here_from_map.inverse(), ahead }
    }

    /// Its points as their times order them; none where these leave them in no order in which a
    /// lidar may have taken them. `tour` and the duration of a turn (seconds) say from where those
    /// of a turn were seen.
    pub fn by_time(&self, steps: Steps, tour: Option<(&Tour, f64)>) -> Option<Vec<ScanPoint>> {
        if self.times_s.len() != self.points.len() || self.points.is_empty() {
            return None;
        }
        let time_s = |i: &usize| self.times_s[*i];
        let mut order: Vec<usize> = (0..self.points.len()).collect();
        // Stable: points of one time stay as they are.
        order.sort_by(|a, b| time_s(a).total_cmp(&time_s(b)));
        let ordered = self.ordered(&order);
        if steps.are_as_taken(&ordered) {
            return Some(ordered);
        }
        let (tour, turn_s) = tour?;
        let mut by_turn = Vec::with_capacity(order.len());
        let mut rest = &order[..];
        while let Some(first) = rest.first() {
            let end_s = time_s(first) + SHARE_OF_TURN * turn_s;
            let (turn, later) = rest.split_at(rest.partition_point(|i| time_s(i) < end_s).max(1));
            let seen = self.seen_by(tour, turn)?;
            by_turn.extend(steps.followed(&seen).into_iter().map(|k| turn[k]));
            rest = later;
        }
        let ordered = self.ordered(&by_turn);
        steps.are_as_taken(&ordered).then_some(ordered)
    }

    /// Some of its points as the lidar saw them from where it was then.
    fn seen_by(&self, tour: &Tour, places: &[usize]) -> Option<Vec<ScanPoint>> {
        let mut there: Option<(f64, Pose)> = None;
        let seen = |i: &usize| {
            let (p, time_s) = (&self.points[*i], self.times_s[*i]);
            let there_from_here = match there.filter(|(t, _)| t.to_bits() == time_s.to_bits()) {
                Some((_, pose)) => pose,
                None => tour.at(time_s)?.inverse() * self.map_from_here,
            };
            there = Some((time_s, there_from_here));
            let seen: Point3<f64> = there_from_here * position(p);
            Some(ScanPoint { x_m: seen.x as f32, y_m: seen.y as f32, z_m: seen.z as f32, ..*p })
        };
        places.iter().map(seen).collect()
    }

    /// Its points that lie on the ground in strips across the way, `strip_m` wide, each from the
    /// right to the left; then those that stand, which would interrupt them, as they are seen
    /// from its place.
    pub fn in_strips(&self, steps: Steps, strip_m: f32, ground: &Ground) -> Vec<ScanPoint> {
        let (lying, standing): (Vec<ScanPoint>, Vec<ScanPoint>) = self.points.iter().partition(|p| ground.is_lying(p));
        let key = |p: &ScanPoint| {
            let at = Vector2::new(p.x_m, p.y_m);
            ((at.dot(&self.ahead) / strip_m).floor() as i32, self.ahead.perp(&at))
        };
        let mut across: Vec<_> = lying.iter().map(key).zip(&lying).collect();
        across.sort_by(|((a_strip, a_m), _), ((b_strip, b_m), _)| a_strip.cmp(b_strip).then(a_m.total_cmp(b_m)));
        let standing = steps.as_cut(&standing).into_iter().map(|i| standing[i]);
        across.into_iter().map(|(_, p)| *p).chain(standing).collect()
    }

    fn ordered(&self, order: &[usize]) -> Vec<ScanPoint> {
        order.iter().map(|i| self.points[*i]).collect()
    }
}
