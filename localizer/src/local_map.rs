//! The map as the localizer sees it: the roads near a position, with their
//! landmarks, whether the map is one file in memory or an atlas of a country,
//! of which only the tiles around the camera are held.
//!
//! An atlas gives the same poses as the map it was cut from: a query answers
//! with the same roads in the same order, for it first reads what is missing.
//! What is read ahead of the camera, one tile a frame, only spreads that work.

mod surroundings;
#[cfg(test)]
mod tests;

use common::map::atlas::{Atlas, Counts};
use common::map::{LaneLine, Numbering, Pole, SemanticMap, Sign};
use nalgebra::{Point3, Vector3};

use crate::Result;
use crate::road_index::{Cells, RoadIndex};
pub use surroundings::{LocalMapConfig, Usage};
use surroundings::{Surroundings, area_of};

/// Nearer than this to the end of a path a place is the end, metres.
const SAME_M: f64 = 1e-6;

/// A road that a query has found. Keys are good until the next frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct RoadKey {
    /// Its number in the whole map: the order of roads.
    number: u32,
    /// The tile that it is in.
    tile: u64,
    /// Its index there.
    road: u32,
}

/// The survey's path near a position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPlace {
    /// The nearest point of the path, map frame, metres: where the survey's
    /// camera was.
    pub point_map: Point3<f64>,
    /// Unit direction in which the survey drove there.
    pub forward_map: Vector3<f64>,
}

impl PathPlace {
    /// How far a position is from it in the plane, metres.
    pub fn distance_m(&self, position_map: &Point3<f64>) -> f64 {
        let off = position_map - self.point_map;
        off.x.hypot(off.z)
    }

    /// Pitch of a level camera there that is headed so, radians: up the slope when
    /// driving along the path, down against it.
    pub fn pitch_rad(&self, yaw_rad: f64) -> f64 {
        let forward = self.forward_map;
        let agreement = (yaw_rad - forward.x.atan2(forward.z)).cos();
        (-forward.y).clamp(-1.0, 1.0).asin() * agreement
    }
}

/// Roads and landmarks that are held in memory together.
#[derive(Debug)]
struct Held {
    /// Where its tile begins in the atlas, bytes; 0 for a map without one.
    tile: u64,
    map: SemanticMap,
    index: RoadIndex,
    /// The number of each road in the whole map.
    road_numbers: Vec<u32>,
    /// The landmarks of the whole map that come before these.
    before: Counts,
}

/// The map around the camera.
#[derive(Debug)]
pub struct LocalMap {
    /// By tile, ascending.
    held: Vec<Held>,
    /// Where the rest is; none where all is held.
    surroundings: Option<Surroundings>,
}

impl LocalMap {
    /// A map that is in memory as a whole.
    pub fn whole(map: SemanticMap) -> Self {
        let road_numbers = (0..map.roads.len() as u32).collect();
        let index = RoadIndex::new(&map);
        Self { held: vec![Held { tile: 0, map, index, road_numbers, before: Counts::default() }], surroundings: None }
    }

    /// The part of an atlas around whatever is asked for.
    pub fn around(atlas: Atlas, config: &LocalMapConfig) -> Self {
        Self { held: Vec::new(), surroundings: Some(Surroundings::new(atlas, *config)) }
    }

    /// Opens a map file or an atlas, as its first bytes say.
    ///
    /// # Errors
    /// As [`common::map::read`] and [`Atlas::open`].
    pub fn open(path: &std::path::Path, config: &LocalMapConfig) -> Result<Self> {
        Ok(if common::map::atlas::is_atlas(path)? {
            Self::around(Atlas::open(path)?, config)
        } else {
            Self::whole(common::map::read(path)?)
        })
    }

    /// Before each frame: drops the tiles that were left behind and reads one
    /// of those ahead.
    ///
    /// # Errors
    /// As [`Atlas::tile`].
    pub fn next_frame(&mut self) -> Result<()> {
        match &mut self.surroundings {
            Some(surroundings) => surroundings.next_frame(&mut self.held),
            None => Ok(()),
        }
    }

    /// Fills `roads` with the stretches that pass within about `reach_m` of
    /// the position (whole cells), in the order of the whole map.
    ///
    /// # Errors
    /// As [`Atlas::tile`].
    pub fn roads_near(&mut self, position_map: &Point3<f64>, reach_m: f64, roads: &mut Vec<RoadKey>) -> Result<()> {
        let mut cells = Cells::around(position_map, reach_m);
        if let Some(surroundings) = &mut self.surroundings {
            cells = Cells::around(position_map, surroundings.reach_m(reach_m));
            surroundings.need(&area_of(&cells), &mut self.held)?;
        }
        roads.clear();
        for held in &self.held {
            let numbered = held.index.roads_in(&cells).filter_map(|road| {
                let number = *held.road_numbers.get(road as usize)?;
                Some(RoadKey { number, tile: held.tile, road })
            });
            roads.extend(numbered);
        }
        roads.sort_unstable();
        roads.dedup();
        Ok(())
    }

    /// The numbers of the landmarks of the whole map.
    pub fn numbering(&self) -> Numbering {
        let whole = || self.held.first().map_or(Numbering::new(0, 0, 0), |held| Numbering::of(&held.map));
        self.surroundings.as_ref().map_or_else(whole, Surroundings::numbering)
    }

    fn held(&self, key: RoadKey) -> Option<&Held> {
        let at = self.held.binary_search_by_key(&key.tile, |held| held.tile).ok()?;
        self.held.get(at)
    }

    /// The survey's path along a road, map frame, metres.
    pub fn path(&self, key: RoadKey) -> &[Point3<f64>] {
        self.held(key).and_then(|held| held.map.roads.get(key.road as usize)).map_or(&[], |road| &road.path_map)
    }

    /// Poles of a road, each with its number in the whole map.
    pub fn poles(&self, key: RoadKey) -> impl Iterator<Item = (usize, &Pole)> {
        self.held(key).into_iter().flat_map(move |held| {
            let before = held.before.poles as usize;
            held.index.poles(key.road).iter().filter_map(move |&i| Some((before + i, held.map.poles.get(i)?)))
        })
    }

    /// Signs of a road, each with its number in the whole map.
    pub fn signs(&self, key: RoadKey) -> impl Iterator<Item = (usize, &Sign)> {
        self.held(key).into_iter().flat_map(move |held| {
            let before = held.before.signs as usize;
            held.index.signs(key.road).iter().filter_map(move |&i| Some((before + i, held.map.signs.get(i)?)))
        })
    }

    /// Lane lines of a road, each with its number in the whole map.
    pub fn lanes(&self, key: RoadKey) -> impl Iterator<Item = (usize, &LaneLine)> {
        self.held(key).into_iter().flat_map(move |held| {
            let before = held.before.lanes as usize;
            held.index.lanes(key.road).iter().filter_map(move |&i| Some((before + i, held.map.lanes.get(i)?)))
        })
    }

    /// The place on the paths of `roads` that is nearest to a position in the
    /// horizontal plane; none where no path has two distinct points.
    pub fn nearest_path(&self, roads: &[RoadKey], position_map: &Point3<f64>) -> Option<PathPlace> {
        let mut best: Option<(f64, Point3<f64>, Vector3<f64>)> = None;
        for ends in roads.iter().flat_map(|&road| self.path(road).windows(2)) {
            let along = ends[1] - ends[0];
            let length2 = along.x * along.x + along.z * along.z;
            if length2.is_nan() || length2 <= 1e-12 {
                continue;
            }
            let to = position_map - ends[0];
            let fraction = ((to.x * along.x + to.z * along.z) / length2).clamp(0.0, 1.0);
            let point_map = ends[0] + along * fraction;
            let off = position_map - point_map;
            let distance2 = off.x * off.x + off.z * off.z;
            if best.as_ref().is_none_or(|(least, ..)| distance2 < *least) {
                best = Some((distance2, point_map, along));
            }
        }
        best.map(|(_, point_map, along)| PathPlace { point_map, forward_map: along.normalize() })
    }

    /// The same, where it is no further than `reach_m` away.
    pub fn path_within(&self, roads: &[RoadKey], position_map: &Point3<f64>, reach_m: f64) -> Option<PathPlace> {
        self.nearest_path(roads, position_map).filter(|place| place.distance_m(position_map) <= reach_m)
    }

    /// How far a position lies beyond an end of the map, metres: in front of the end of a road
    /// that is the nearest place of all `roads`, and from which no other goes on within
    /// `joins_m`. None where it lies on a road, or beside one.
    pub fn beyond_end_m(&self, roads: &[RoadKey], position_map: &Point3<f64>, joins_m: f64) -> Option<f64> {
        let mut nearest: Option<(f64, RoadKey, Point3<f64>)> = None;
        for &road in roads {
            let place = self.nearest_path(&[road], position_map);
            let Some((off_m, place)) = place.map(|place| (place.distance_m(position_map), place)) else { continue };
            if nearest.as_ref().is_none_or(|(least_m, ..)| off_m < *least_m) {
                nearest = Some((off_m, road, place.point_map));
            }
        }
        let (_, road, end_map) = nearest?;
        let path_map = self.path(road);
        let outward = match path_map {
            [first, second, ..] if (first - end_map).norm() < SAME_M => first - second,
            [.., second, last] if (last - end_map).norm() < SAME_M => last - second,
            _ => return None,
        };
        let mut others = roads.iter().filter(|other| **other != road);
        if others.any(|&other| self.path_within(&[other], &end_map, joins_m).is_some()) {
            return None;
        }
        let ahead_m = (position_map - end_map).xz().dot(&outward.xz()) / outward.xz().norm();
        (ahead_m > 0.0).then_some(ahead_m)
    }

    /// What was read of an atlas; none for a map that is held as a whole.
    pub fn usage(&self) -> Option<Usage> {
        self.surroundings.as_ref().map(Surroundings::usage)
    }
}
