//! Drives of one area become one map.
//!
//! [`merge()`] reads: align the maps, [`fuse`](crate::fuse) what several of them
//! have, drop what most of those that came near do not have, and join their
//! roads.
//!
//! **Frame.** All maps have to be in one map frame up to the errors of their
//! surveys: up to about 2 m and a degree. Maps of drives with frames of their
//! own (each in the camera of its first frame) have to be brought into one
//! before.
//!
//! **Order.** The merged map depends on the *set* of its [`Sources`] only: not
//! on their order, and not on the steps in which they were merged.

mod align;
mod config;
mod field;
mod known;
mod lines;
mod marks;
mod report;
mod roads;
mod solve;
mod source;
#[cfg(test)]
mod tests;
mod votes;
mod witness;

use std::ops::RangeInclusive;

use common::map::{MAX_NOTE_BYTES, Pole, Road, RoadId, SemanticMap, Sign};
use nalgebra::Point3;

pub use align::State;
pub use config::{AlignConfig, LIMITS, MergeConfig, SameRoadConfig, WitnessConfig};
pub use report::{Counts, MergeReport, SourceReport};
pub use roads::{Nearest, added_roads};
pub use source::{Added, Source, Sources, frame_beside, path_beside};

use crate::fuse::{Fused, Sighting, fuse_lanes, fuse_poles, fuse_signs, length_m, sightings};
use align::{Alignment, align};
use lines::{Rules, line_parts, on_nearest_road};
use roads::Union;
use witness::{Witnesses, missed};

/// A merged map and how it came about.
#[derive(Debug, Clone)]
pub struct Merged {
    /// The map.
    pub map: SemanticMap,
    /// What was done.
    pub report: MergeReport,
}

/// Merges maps, given in the order of their [`Sources`].
pub fn merge(sources: &[Source], config: &MergeConfig) -> Merged {
    let alignment = align(sources, config);
    let moved: Vec<SemanticMap> = (0..sources.len()).map(|index| moved(sources, &alignment, index)).collect();
    let takes_part = |index: &usize| alignment.states[*index] != State::Unaligned;
    let passes: Vec<usize> = (0..sources.len()).filter(takes_part).collect();

    let paths = passes.iter().flat_map(|&pass| moved[pass].roads.iter().map(move |r| (pass as u32, &r.path_map[..])));
    let witnesses = Witnesses::new(paths);
    let mut report = MergeReport {
        sources: (0..sources.len()).map(|index| source_report(sources, &moved, &alignment, index)).collect(),
        quantum_m: sources.iter().map(|source| source.quantum_m).fold(f64::INFINITY, f64::min),
        mixed_quanta: sources.windows(2).any(|pair| pair[0].quantum_m.to_bits() != pair[1].quantum_m.to_bits()),
        apart_given_m: alignment.apart_given_m,
        apart_aligned_m: alignment.apart_aligned_m,
        poles: Counts::default(),
        signs: Counts::default(),
        lanes_m: Counts::default(),
        roads_given: sources.iter().map(|source| source.map.roads.len()).sum(),
        roads: 0,
    };
    let mut map = SemanticMap {
        frame_note: note(sources),
        roads: joined_roads(sources, &moved, &alignment, config),
        ..SemanticMap::default()
    };
    report.roads = map.roads.len();
    let nearest = Nearest::new(&map.roads);
    let road_of = |point: &Point3<f64>| nearest.to(point).map_or(RoadId(0), |found| found.0);

    let (ground_m, signs_m) = (config.witness.ground_m(), config.witness.signs_m());
    // What turns a map turns its covariances by a degree at most.
    let poles = all(&passes, |pass| sightings(moved[pass].poles.clone(), pass as u32, &sources[pass].known.poles));
    let fused = fuse_poles(&poles, &config.fuse);
    let kept = stay(fused, &poles, |p| p.foot_map, &witnesses, &ground_m, &config.witness, &mut report.poles);
    map.poles.extend(kept.into_iter().map(|pole| Pole { road: road_of(&pole.foot_map), ..pole }));

    let signs = all(&passes, |pass| sightings(moved[pass].signs.clone(), pass as u32, &sources[pass].known.signs));
    let fused = fuse_signs(&signs, &config.fuse);
    let kept = stay(fused, &signs, |s| s.centroid_map, &witnesses, &signs_m, &config.witness, &mut report.signs);
    map.signs.extend(kept.into_iter().map(|sign| Sign { road: road_of(&sign.centroid_map), ..sign }));

    let lanes = all(&passes, |pass| sightings(moved[pass].lanes.clone(), pass as u32, &[]));
    report.lanes_m.given = lanes.iter().map(|lane| length_m(&lane.landmark.points_map)).sum();
    let rules = Rules { witnesses: &witnesses, config, road_of: &road_of };
    for lane in fuse_lanes(&lanes, &config.fuse) {
        map.lanes.extend(line_parts(&lane, &lanes, &rules, &mut report.lanes_m));
    }
    for index in (0..sources.len()).filter(|index| !takes_part(index)) {
        add_as_given(&mut map, &sources[index].map, &road_of, &mut report);
    }
    Merged { map, report }
}

/// What a map that could not be aligned has.
fn add_as_given(
    map: &mut SemanticMap,
    given: &SemanticMap,
    road_of: &impl Fn(&Point3<f64>) -> RoadId,
    report: &mut MergeReport,
) {
    map.poles.extend(given.poles.iter().map(|pole| Pole { road: road_of(&pole.foot_map), ..*pole }));
    map.signs.extend(given.signs.iter().map(|sign| Sign { road: road_of(&sign.centroid_map), ..*sign }));
    map.lanes.extend(given.lanes.iter().map(|lane| on_nearest_road(lane, road_of)));
    let lanes_m: f64 = given.lanes.iter().map(|lane| length_m(&lane.points_map)).sum();
    let amounts = [given.poles.len() as f64, given.signs.len() as f64, lanes_m];
    for (counts, amount) in [&mut report.poles, &mut report.signs, &mut report.lanes_m].into_iter().zip(amounts) {
        counts.given += amount;
        counts.single += amount;
    }
}

fn all<T, S: Iterator<Item = Sighting<T>>>(passes: &[usize], of: impl Fn(usize) -> S) -> Vec<Sighting<T>> {
    passes.iter().flat_map(|pass| of(*pass)).collect()
}

/// The landmarks that most of the passes that came near have.
fn stay<T>(
    fused: Vec<Fused<T>>,
    sightings: &[Sighting<T>],
    place: impl Fn(&T) -> Point3<f64>,
    witnesses: &Witnesses,
    below_m: &RangeInclusive<f64>,
    config: &WitnessConfig,
    counts: &mut Counts,
) -> Vec<T> {
    counts.given += sightings.len() as f64;
    let stays = |fused: Fused<T>| {
        let mut seen: Vec<u32> = fused.sightings.iter().map(|&sighting| sightings[sighting].pass).collect();
        seen.sort_unstable();
        seen.dedup();
        let near = witnesses.expected(&place(&fused.landmark), &seen, config.point_m, below_m, config);
        counts.count(1.0, seen.len(), missed(&seen, &near)).then_some(fused.landmark)
    };
    fused.into_iter().filter_map(stays).collect()
}

/// A map with its corrections.
fn moved(sources: &[Source], alignment: &Alignment, index: usize) -> SemanticMap {
    let mut map = sources[index].map.clone();
    if alignment.states[index] != State::Aligned {
        return map;
    }
    let field = &alignment.field;
    for pole in &mut map.poles {
        if let Some(held) = field.hold(index, pole.road, &pole.foot_map) {
            (pole.foot_map, pole.top_map) = (field.place(&held), field.place_with(&held, &pole.top_map));
        }
    }
    let place = |road: RoadId, point: &mut Point3<f64>| {
        if let Some(held) = field.hold(index, road, point) {
            *point = field.place(&held);
        }
    };
    for sign in &mut map.signs {
        place(sign.road, &mut sign.centroid_map);
    }
    for lane in &mut map.lanes {
        for point in &mut lane.points_map {
            place(lane.road, point);
        }
    }
    for (id, road) in (0..).map(RoadId).zip(&mut map.roads) {
        for point in &mut road.path_map {
            place(id, point);
        }
    }
    map
}

/// The roads of all maps, longest drive first, so that few roads are cut.
fn joined_roads(sources: &[Source], moved: &[SemanticMap], alignment: &Alignment, config: &MergeConfig) -> Vec<Road> {
    // Lengths as given: they do not depend on the other maps.
    let drive_m =
        |index: &usize| -> f64 { sources[*index].map.roads.iter().map(|road| length_m(&road.path_map)).sum() };
    let mut order: Vec<usize> = (0..moved.len()).collect();
    order.sort_by(|a, b| {
        let is_given = |index: &usize| alignment.states[*index] == State::Unaligned;
        is_given(a).cmp(&is_given(b)).then(drive_m(b).total_cmp(&drive_m(a))).then(a.cmp(b))
    });
    let mut union = Union::new(&config.roads);
    for index in order {
        union.add(&moved[index].roads);
    }
    union.finish()
}

fn source_report(sources: &[Source], moved: &[SemanticMap], alignment: &Alignment, index: usize) -> SourceReport {
    let given = &sources[index].map;
    let pairs = given.poles.iter().zip(&moved[index].poles);
    let squares: Vec<f64> = pairs.map(|(a, b)| (a.foot_map - b.foot_map).norm_squared()).collect();
    SourceReport {
        crc32c: format!("{:08x}", sources[index].crc32c),
        frame_note: given.frame_note.clone(),
        state: alignment.states[index].name(),
        moved_rms_m: (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt(),
    }
}

/// The notes of all maps, as far as there is room for them.
fn note(sources: &[Source]) -> String {
    let mut notes: Vec<&str> = sources.iter().map(|source| source.map.frame_note.as_str()).collect();
    notes.sort_unstable();
    notes.dedup();
    let all = notes.join(", ");
    if all.len() <= MAX_NOTE_BYTES {
        return all;
    }
    let more = format!(" and {} more", notes.len() - 1);
    let room = MAX_NOTE_BYTES.saturating_sub(more.len());
    let mut first = notes.first().copied().unwrap_or_default();
    while first.len() > room {
        let mut letters = first.chars();
        letters.next_back();
        first = letters.as_str();
    }
    format!("{first}{more}")
}
