//! Lines of side streets: paint that does not run along the driven path.
//!
//! From a junction some metres of a side street are seen. Straight lines of
//! paint in squares beside the path (Hough 1962) are the axes along which its
//! lines are sought, as those of the driven road are along the path.

use std::collections::{BTreeMap, BTreeSet};

use common::map::LaneKind;
use nalgebra::{Point2, Point3, Vector2};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::paint::is_road;
use super::{LaneConfig, LanePiece, Paint, lines_along};
use crate::cloud::{Cloud, CloudPoint};
use crate::grid::whole;
use crate::path::Path;

/// How the lines of side streets are found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SideConfig {
    /// Nearest place to the driven path, metres: beyond the middle of a broad
    /// lane and half of it. What runs across the road there is a stop line or
    /// part of a crossing.
    pub from_m: f64,
    /// Least angle between a line and the path beside it, radians: borders of
    /// hatched areas and of widening lanes stay below it, side streets join at
    /// 30 degrees and more.
    pub least_angle_rad: f64,
    /// Edge of the cells of which each counts once, metres: half of a bin.
    pub thin_m: f64,
    /// Fewest such cells with paint on an axis: half of the shortest line.
    pub fewest_spots: u16,
    /// Least significance of an axis: cells with paint more than beside it,
    /// over the square root of those.
    pub least_significance: f64,
    /// Most axes in one square: the lines of a street of two lanes.
    pub most_axes: usize,
    /// Farthest line beside its axis, metres: two lanes.
    pub half_width_m: f64,
    /// Shortest line kept, metres: longer than stop lines, arrows and the
    /// markings of parking places. More of one is a solid line: the longest
    /// dashes in towns are 6 m.
    pub shortest_m: f64,
    /// Least mean contrast of its paint, standard deviations: what is seen from
    /// afar only is a line if it is clear. Fresh paint has six and more.
    pub least_contrast: f64,
    /// Least mean contrast of the cells on an axis for lines to be sought along
    /// it, standard deviations: where an axis is as significant as it has to be,
    /// up to two in five of its cells are speckles like those beside it, of 4.2
    /// on average.
    pub least_axis_contrast: f64,
    /// Least share of its length on which paint was seen.
    pub least_painted: f64,
}

impl Default for SideConfig {
    fn default() -> Self {
        Self {
            from_m: 3.0,
            least_angle_rad: 0.5,
            thin_m: 0.25,
            fewest_spots: 16,
            least_significance: 6.0,
            most_axes: 3,
            half_width_m: 7.0,
            shortest_m: 8.0,
            least_contrast: 5.7,
            least_axis_contrast: 5.0,
            least_painted: 0.3,
        }
    }
}

/// A straight line of paint.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Axis {
    /// Amid its paint, map (x, z), metres.
    middle: Point2<f64>,
    /// Unit direction, map (x, z).
    direction: Vector2<f64>,
    /// How many standard deviations more paint is on it than beside it.
    score: f64,
    /// Mean contrast of its paint, standard deviations.
    contrast: f64,
}

/// Where paint lies aside of the path, and how bright it is.
#[derive(Debug, Clone, Copy)]
struct Spot {
    /// Map (x, z), metres.
    at: Point2<f64>,
    /// Standard deviations.
    contrast: f32,
}

impl Axis {
    /// Distances of a point along it and to its side, metres.
    fn place_m(&self, p: &Point2<f64>) -> (f64, f64) {
        let from_middle = p - self.middle;
        (from_middle.dot(&self.direction), from_middle.perp(&self.direction))
    }

    /// Whether another one is found where lines along this one are sought.
    fn covers(&self, other: &Self, config: &LaneConfig) -> bool {
        let (along_m, beside_m) = self.place_m(&other.middle);
        self.direction.perp(&other.direction).abs() < config.largest_angle_rad.sin()
            && along_m.abs() < config.window_m / 2.0
            && beside_m.abs() < config.side.half_width_m - config.apart_m
    }
}

/// The lines of a stitched cloud that do not run along its path, nor along one
/// of the lines that do.
pub fn find_side_lines(cloud: &Cloud, known: &[LanePiece], config: &LaneConfig) -> Vec<LanePiece> {
    let own = LaneConfig {
        half_width_m: config.side.half_width_m,
        shortest_m: config.side.shortest_m,
        longest_dash_m: config.longest_dash_m.min(config.side.shortest_m),
        // Of a street that was not driven on little is seen: what stands or
        // rises beside a line counts against it however bright it is.
        least_walled_contrast: f64::INFINITY,
        ..config.clone()
    };
    let mut searched: Vec<Axis> = Vec::new();
    for axis in axes(&spots(cloud, known, config), cloud, config) {
        if axis.contrast >= config.side.least_axis_contrast && !searched.iter().any(|other| other.covers(&axis, config))
        {
            searched.push(axis);
        }
    }
    let along = |axis: &Axis| {
        let reach = axis.direction * config.window_m;
        let end = |at: Point2<f64>| Point3::new(at.x, 0.0, at.y);
        let path = Path::new(&[end(axis.middle - reach), end(axis.middle + reach)], 0.0);
        let mut pieces = lines_along(&path, &Paint::beside(cloud, &path, &own), cloud, &own);
        // What lies beyond is looked at on one of its sides alone.
        let is_within = |p: &Point3<f64>| axis.place_m(&Point2::new(p.x, p.z)).1.abs() < own.half_width_m;
        pieces.retain(|piece| piece.points_map.iter().all(is_within));
        pieces
    };
    let found: Vec<Vec<LanePiece>> = searched.par_iter().map(along).collect();
    let mut lines: Vec<LanePiece> = Vec::new();
    for piece in found.iter().flatten() {
        let is_free = |p: &Point3<f64>| known.iter().chain(&lines).all(|line| line.distance_m(p) >= config.apart_m);
        let free = part_aside(piece, cloud, &is_free, config);
        lines.extend(free);
    }
    lines
}

/// The longest part of a line that lies aside of the path and where it is free;
/// none where that is too short, or runs along the path.
fn part_aside(
    piece: &LanePiece,
    cloud: &Cloud,
    is_free: &dyn Fn(&Point3<f64>) -> bool,
    config: &LaneConfig,
) -> Option<LanePiece> {
    if piece.contrast < config.side.least_contrast || piece.painted_share < config.side.least_painted {
        return None;
    }
    let (from_m, to_m) = piece.ends_m()?;
    let steps = ((to_m - from_m) / config.bin_m).ceil().max(1.0) as usize;
    let stations: Vec<(f64, bool)> = (0..=steps)
        .map(|i| from_m + (to_m - from_m) * (i as f64 / steps as f64))
        .map(|station_m| {
            let is_aside = |p: Point3<f64>| cloud.place(&p).offset_m.abs() >= config.side.from_m && is_free(&p);
            (station_m, piece.at(station_m).is_some_and(is_aside))
        })
        .collect();
    let longest = stations.chunk_by(|a, b| a.1 == b.1).filter(|run| run[0].1).max_by_key(|run| run.len())?;
    let shortest_m = if piece.kind == LaneKind::Dashed { config.shortest_dashed_m } else { config.side.shortest_m };
    let part = piece.part(longest.first()?.0, longest.last()?.0, shortest_m)?;
    let (first, last) = (part.points_map.first()?, part.points_map.last()?);
    let along = Vector2::new(last.x - first.x, last.z - first.z).try_normalize(1e-9)?;
    let path = cloud.place(&nalgebra::center(first, last)).direction;
    (along.perp(&path).abs() >= config.side.least_angle_rad.sin()).then_some(part)
}

/// Where paint lies aside of the path and of the lines along it, each cell of
/// the plane once.
fn spots(cloud: &Cloud, known: &[LanePiece], config: &LaneConfig) -> Vec<Spot> {
    let spot = |p: &CloudPoint| {
        let contrast = p.contrast.filter(|contrast| *contrast >= config.least_contrast && is_road(p, config))?;
        let place = cloud.place(&p.position);
        let is_known = |piece: &LanePiece| {
            let on_line = piece.at(place.station_m);
            on_line.is_some_and(|q| (q.x - p.position.x).hypot(q.z - p.position.z) < config.apart_m)
        };
        let is_aside = place.offset_m.abs() >= config.side.from_m && !known.iter().any(is_known);
        is_aside.then_some(Spot { at: Point2::new(p.position.x, p.position.z), contrast })
    };
    let mut spots: Vec<Spot> = cloud.points.par_iter().filter_map(spot).collect();
    let cell = |spot: &Spot| spot.at.coords.map(|v| (v / config.side.thin_m).floor() as i64).data.0[0];
    // Stable: of each cell the first in the order of the scans.
    spots.sort_by_key(cell);
    spots.dedup_by_key(|spot| cell(spot));
    spots
}

/// The axes in all squares as long as a window, most significant first.
fn axes(spots: &[Spot], cloud: &Cloud, config: &LaneConfig) -> Vec<Axis> {
    // They overlap by half: each axis is well within one.
    let edge_m = config.window_m / 2.0;
    let mut quarters: BTreeMap<(i64, i64), Vec<Spot>> = BTreeMap::new();
    for spot in spots {
        let quarter = ((spot.at.x / edge_m).floor() as i64, (spot.at.y / edge_m).floor() as i64);
        quarters.entry(quarter).or_default().push(*spot);
    }
    let squares: BTreeSet<(i64, i64)> =
        quarters.keys().flat_map(|(i, k)| [(*i, *k), (i - 1, *k), (*i, k - 1), (i - 1, k - 1)]).collect();
    let squares: Vec<(i64, i64)> = squares.into_iter().collect();
    let in_square = |(i, k): &(i64, i64)| {
        let mut here: Vec<Spot> = [(*i, *k), (i + 1, *k), (*i, k + 1), (i + 1, k + 1)]
            .iter()
            .filter_map(|quarter| quarters.get(quarter))
            .flatten()
            .copied()
            .collect();
        let middle = Point2::new((i + 1) as f64 * edge_m, (k + 1) as f64 * edge_m);
        let path = cloud.place(&Point3::new(middle.x, 0.0, middle.y)).direction;
        let mut axes: Vec<Axis> = Vec::new();
        while let Some(axis) =
            (axes.len() < config.side.most_axes).then(|| best_axis(&here, &middle, &path, config)).flatten()
        {
            here.retain(|spot| axis.place_m(&spot.at).1.abs() > config.apart_m);
            axes.push(axis);
        }
        axes
    };
    let mut axes: Vec<Axis> = squares.par_iter().flat_map_iter(in_square).collect();
    // Stable: of equals the first.
    axes.sort_by(|a, b| b.score.total_cmp(&a.score));
    axes
}

/// The most significant axis among spots around a middle; `path` is the
/// direction that it does not have.
fn best_axis(spots: &[Spot], middle: &Point2<f64>, path: &Vector2<f64>, config: &LaneConfig) -> Option<Axis> {
    let side = &config.side;
    if spots.len() < usize::from(side.fewest_spots) {
        return None;
    }
    // Two cells are as wide as a line; a step turns its ends by one.
    let cell_m = config.half_line_m;
    let steps = (std::f64::consts::PI * config.window_m / 2.0 / cell_m).ceil().max(1.0) as usize;
    let reach_m = config.window_m * std::f64::consts::FRAC_1_SQRT_2;
    let beside = (config.beside_line_m / cell_m).ceil() as usize;
    let mut votes = vec![0_u16; (2.0 * reach_m / cell_m) as usize + 2 * beside + 3];
    let from_middle: Vec<Vector2<f64>> = spots.iter().map(|spot| spot.at - middle).collect();
    let mut best: Option<(f64, Vector2<f64>, f64)> = None;
    for step in 0..steps {
        let angle_rad = std::f64::consts::PI * step as f64 / steps as f64;
        let direction = Vector2::new(angle_rad.sin(), angle_rad.cos());
        if direction.perp(path).abs() < side.least_angle_rad.sin() {
            continue;
        }
        votes.fill(0);
        for off_m in from_middle.iter().map(|p| p.perp(&direction)) {
            if let Some(count) = votes.get_mut(whole((off_m + reach_m) / cell_m) + beside) {
                *count = count.saturating_add(1);
            }
        }
        // Most directions have too few in every cell.
        let most = votes.iter().copied().max().unwrap_or(0);
        if most.saturating_mul(2) < side.fewest_spots {
            continue;
        }
        let pair = |c: usize| f64::from(votes[c]) + f64::from(votes[c + 1]);
        for c in beside..votes.len() - beside - 1 {
            // Most cells have too few, whatever is beside them.
            if votes[c].saturating_add(votes[c + 1]) < side.fewest_spots {
                continue;
            }
            let (on, sides) = (pair(c), f64::midpoint(pair(c - beside), pair(c + beside)));
            let score = (on - sides) / (sides + 1.0).sqrt();
            let is_line = on - sides >= f64::from(side.fewest_spots) && score >= side.least_significance;
            if is_line && best.is_none_or(|(most, ..)| score > most) {
                best = Some((score, direction, (c - beside + 1) as f64 * cell_m - reach_m));
            }
        }
    }
    let (score, direction, off_m) = best?;
    let is_on = |spot: &&Spot| ((spot.at - middle).perp(&direction) - off_m).abs() <= cell_m;
    let on = spots.iter().filter(is_on);
    let (count, sum, contrast) = on.fold((0.0, Vector2::zeros(), 0.0), |s, spot| {
        (s.0 + 1.0, s.1 + spot.at.coords, s.2 + f64::from(spot.contrast))
    });
    let count = f64::max(count, 1.0);
    Some(Axis { middle: Point2::from(sum / count), direction, score, contrast: contrast / count })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Config;
    use crate::build::find_lanes;
    use crate::testing::{CAMERA_HEIGHT_M, Street};

    /// A street with a line along it and paint from one place of map (x, z) to
    /// another.
    fn sides(from_to: [(f64, f64); 2], is_painted: impl Fn(f64) -> bool) -> Vec<LanePiece> {
        let mut street = Street::new();
        for i in 0..1500_i32 {
            let z = f64::from(i) * 0.04;
            let wobble = 0.04 * (f64::from(i) * 1.7).sin();
            street.add(Point3::new(1.75 + wobble, CAMERA_HEIGHT_M, z), (z / 6.0) as u16, 0.5, Some(8.0));
        }
        let [from, to] = from_to.map(|(x, z)| Point3::new(x, CAMERA_HEIGHT_M, z));
        let way = to - from;
        let left = nalgebra::Vector3::new(-way.z, 0.0, way.x).normalize();
        for i in 0..(way.norm() / 0.04) as i32 {
            let along_m = f64::from(i) * 0.04;
            let at = from + way * (along_m / way.norm()) + left * (0.04 * (f64::from(i) * 1.7).sin());
            if is_painted(along_m) {
                street.add(at, (at.z / 6.0) as u16, 0.5, Some(8.0));
            }
        }
        let (cloud, config) = (street.cloud(), Config::default());
        let lanes = find_lanes(&cloud, &config);
        assert!(!lanes.is_empty());
        find_side_lines(&cloud, &lanes, &config.lanes)
    }

    #[test]
    fn the_line_of_a_side_street_is_found_whatever_its_angle() {
        for (from, to) in [((5.0, 30.0), (15.5, 30.0)), ((-5.0, 20.0), (-15.0, 29.0)), ((-4.5, 40.0), (-12.0, 29.0))] {
            let found = sides([from, to], |_| true);
            assert_eq!(found.len(), 1, "{found:?}");
            let piece = &found[0];
            let [from, to] = [from, to].map(|(x, z)| Point3::new(x, CAMERA_HEIGHT_M, z));
            assert!(piece.distance_m(&from) < 0.6 && piece.distance_m(&to) < 0.6, "{piece:?}");
            assert!(piece.distance_m(&nalgebra::center(&from, &to)) < 0.03 && piece.kind == LaneKind::Solid);
        }
    }

    #[test]
    fn what_crosses_the_road_or_is_short_or_a_branch_of_its_lines_is_none() {
        // The border of a crossing, a parking place, dashes, a hatched area's border.
        assert!(sides([(-7.0, 30.0), (7.0, 30.0)], |_| true).is_empty());
        assert!(sides([(5.0, 30.0), (10.5, 30.0)], |_| true).is_empty());
        assert!(sides([(5.0, 30.0), (15.0, 30.0)], |along_m| along_m % 4.0 < 2.0).is_empty());
        assert!(sides([(4.0, 10.0), (12.0, 35.0)], |_| true).is_empty());
    }
}
