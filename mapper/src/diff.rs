//! What changed from one map to another.

mod lines;

use std::fmt::Write as _;

use common::config::{Limits, limits};
use common::map::{SemanticMap, SignKind};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use crate::fuse::{NEVER_DOUBLE_M, Place, cluster, length_m};
use crate::merge::{SameRoadConfig, added_roads};
use lines::Lines;

/// When landmarks of two maps are the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DiffConfig {
    /// Up to this distance a landmark is where it was, metres: what two builds
    /// of one drive differ by.
    pub same_m: f64,
    /// Up to this distance it has moved, metres; farther ones are another.
    pub moved_m: f64,
    /// The same for lane lines, metres across: half a lane.
    pub lane_moved_m: f64,
    /// Shortest part of a lane line that counts as added, removed or of another
    /// kind, metres.
    pub shortest_m: f64,
    /// When two paths are one road.
    pub roads: SameRoadConfig,
}

impl Default for DiffConfig {
    fn default() -> Self {
        Self {
            same_m: 0.1,
            moved_m: 1.0,
            lane_moved_m: 1.0,
            shortest_m: 2.0,
            roads: SameRoadConfig { shortest_m: 2.0, ..SameRoadConfig::default() },
        }
    }
}

/// What the numbers of [`DiffConfig`] may be.
pub const LIMITS: &[Limits] = &[
    limits("same_m", 0.0, 100.0),
    limits("*moved_m", 0.0, 100.0),
    limits("shortest_m", 0.0, 1e6),
    limits("roads.step_m", 0.1, 100.0),
    limits("roads.angle_rad", 0.0, 3.2),
    limits("roads.*_m", 0.0, 1000.0),
];

/// How something differs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Change {
    /// In the second map only.
    Added,
    /// In the first map only.
    Removed,
    /// In both, at different places.
    Moved,
    /// In both, of different kinds.
    Kind,
}

/// One difference.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// How it differs.
    pub change: Change,
    /// What: a kind of landmark, or `road`.
    pub what: String,
    /// Where in the second map (for what was removed, in the first): foot,
    /// centroid, or middle, map frame, metres.
    pub at_map_m: [f64; 3],
    /// How far it moved (lines: across), metres; 0 for what did not.
    pub moved_m: f64,
    /// Length of the line or road that was added, removed or moved, or of the
    /// line that is of another kind, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub length_m: Option<f64>,
    /// What it was before, where its kind differs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub was: Option<String>,
}

/// All differences, by kind of change, along map z.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MapDiff {
    /// The differences.
    pub differences: Vec<Difference>,
    /// Poles and signs that are where they were.
    pub same: usize,
    /// Length of the lane lines that are where they were and of the kind that
    /// they were, metres.
    pub same_lanes_m: f64,
}

impl MapDiff {
    /// What changed from `old` to `new`, both in one map frame.
    pub fn of(old: &SemanticMap, new: &SemanticMap, config: &DiffConfig) -> Self {
        let mut diff = Self { differences: Vec::new(), same: 0, same_lanes_m: 0.0 };
        diff.points(&poles(old), &poles(new), config);
        for kind in SignKind::ALL {
            diff.points(&signs(old, kind), &signs(new, kind), config);
        }
        diff.lanes(old, new, config);
        for (change, a, b) in [(Change::Removed, new, old), (Change::Added, old, new)] {
            for road in added_roads(&a.roads, &b.roads, &config.roads) {
                if let Some(at) = road.path_map.get(road.path_map.len() / 2) {
                    diff.add(change, "road", at, 0.0, Some(length_m(&road.path_map)));
                }
            }
        }
        let key = |d: &Difference| (d.change, d.what.clone());
        diff.differences.sort_by(|a, b| {
            let along = a.at_map_m[2].total_cmp(&b.at_map_m[2]).then(a.at_map_m[0].total_cmp(&b.at_map_m[0]));
            key(a).cmp(&key(b)).then(along)
        });
        diff
    }

    /// Whether nothing differs.
    pub fn is_empty(&self) -> bool {
        self.differences.is_empty()
    }

    /// One line for each difference, and one with the counts.
    pub fn text(&self) -> String {
        let mut out = String::new();
        for d in &self.differences {
            let [x, y, z] = d.at_map_m;
            let change = match d.change {
                Change::Added => "added",
                Change::Removed => "removed",
                Change::Moved => "moved",
                Change::Kind => "kind",
            };
            // Writing to a string cannot fail.
            let _ = write!(out, "{change:<8}{:<15} x {x:9.2}  y {y:7.2}  z {z:9.2}", d.what);
            if let Some(length_m) = d.length_m {
                let _ = write!(out, "  {length_m:.1} m long");
            }
            if d.moved_m > 0.0 {
                let _ = write!(out, "  by {:.2} m", d.moved_m);
            }
            if let Some(was) = &d.was {
                let _ = write!(out, "  was {was}");
            }
            out.push('\n');
        }
        let count = |change| self.differences.iter().filter(|d| d.change == change).count();
        let _ = writeln!(
            out,
            "{} added, {} removed, {} moved, {} of another kind; {} poles and signs and {:.0} m of lane lines as they were",
            count(Change::Added),
            count(Change::Removed),
            count(Change::Moved),
            count(Change::Kind),
            self.same,
            self.same_lanes_m
        );
        out
    }

    fn add(&mut self, change: Change, what: &str, at: &Point3<f64>, moved_m: f64, length_m: Option<f64>) {
        let (what, at_map_m) = (what.to_owned(), (*at).into());
        self.differences.push(Difference { change, what, at_map_m, moved_m, length_m, was: None });
    }

    fn add_kind(&mut self, what: &str, was: &str, at: &Point3<f64>, length_m: Option<f64>) {
        self.add(Change::Kind, what, at, 0.0, length_m);
        if let Some(last) = self.differences.last_mut() {
            last.was = Some(was.to_owned());
        }
    }

    fn points(&mut self, old: &[Point], new: &[Point], config: &DiffConfig) {
        let place = |pass| move |point: &Point| Place { point_map: point.1, pass, class: 0 };
        let places: Vec<Place> = old.iter().map(place(0)).chain(new.iter().map(place(1))).collect();
        let all: Vec<&Point> = old.iter().chain(new).collect();
        for pair in cluster(&places, config.moved_m, NEVER_DOUBLE_M) {
            match pair[..] {
                [only] if only < old.len() => self.add(Change::Removed, all[only].0, &all[only].1, 0.0, None),
                [only] => self.add(Change::Added, all[only].0, &all[only].1, 0.0, None),
                [before, after] => {
                    let (before, after) = (all[before], all[after]);
                    let moved_m = (after.1 - before.1).norm();
                    if moved_m > config.same_m {
                        self.add(Change::Moved, after.0, &after.1, moved_m, None);
                    }
                    if before.0 != after.0 {
                        self.add_kind(after.0, before.0, &after.1, None);
                    }
                    self.same += usize::from(moved_m <= config.same_m && before.0 == after.0);
                }
                _ => {}
            }
        }
    }

    fn lanes(&mut self, old: &SemanticMap, new: &SemanticMap, config: &DiffConfig) {
        let (in_old, in_new) = (Lines::new(old), Lines::new(new));
        for line in in_old.compared_with(&in_new, config) {
            for run in line.runs() {
                if run.moved_m.is_none() && run.length_m >= config.shortest_m {
                    self.add(Change::Removed, line.kind, &run.middle, 0.0, Some(run.length_m));
                }
            }
        }
        for line in in_new.compared_with(&in_old, config) {
            for run in line.runs() {
                match run.moved_m {
                    None if run.length_m >= config.shortest_m => {
                        self.add(Change::Added, line.kind, &run.middle, 0.0, Some(run.length_m));
                    }
                    Some(moved_m) if moved_m > config.same_m => {
                        self.add(Change::Moved, line.kind, &run.middle, moved_m, Some(run.length_m));
                    }
                    Some(_) => self.same_lanes_m += run.same_kind_m,
                    None => {}
                }
            }
            for (run, was) in line.runs_of_another_kind() {
                if run.length_m >= config.shortest_m {
                    self.add_kind(line.kind, was, &run.middle, Some(run.length_m));
                }
            }
        }
    }
}

/// Name of the kind, and place.
type Point = (&'static str, Point3<f64>);

fn poles(map: &SemanticMap) -> Vec<Point> {
    map.poles.iter().map(|pole| (pole.kind.name(), pole.foot_map)).collect()
}

fn signs(map: &SemanticMap, kind: SignKind) -> Vec<Point> {
    let of_kind = map.signs.iter().filter(|sign| sign.kind == kind);
    of_kind.map(|sign| (kind.name(), sign.centroid_map)).collect()
}

#[cfg(test)]
mod tests {
    use common::map::{LaneKind, LaneLine, Pole, PoleKind, Road, RoadId, Sign};

    use super::*;

    fn map() -> SemanticMap {
        let pole = |z: f64| Pole {
            kind: PoleKind::SignPost,
            foot_map: Point3::new(5.0, 1.6, z),
            top_map: Point3::new(5.0, -1.0, z),
            road: RoadId(0),
        };
        let sign = |kind, z: f64| Sign { kind, centroid_map: Point3::new(5.0, -1.0, z), size_m: 0.6, road: RoadId(0) };
        SemanticMap {
            frame_note: String::new(),
            roads: vec![Road { path_map: vec![Point3::origin(), Point3::new(0.0, 0.0, 100.0)] }],
            poles: [10.0, 20.0, 30.0].map(pole).to_vec(),
            signs: vec![sign(SignKind::TrafficSign, 10.0), sign(SignKind::TrafficLight, 20.0)],
            lanes: vec![LaneLine {
                kind: LaneKind::Solid,
                points_map: vec![Point3::new(1.5, 1.6, 0.0), Point3::new(1.5, 1.6, 100.0)],
                road: RoadId(0),
                marks_m: Vec::new(),
            }],
        }
    }

    fn changes(new: &SemanticMap) -> Vec<(Change, String, f64)> {
        let diff = MapDiff::of(&map(), new, &DiffConfig::default());
        diff.differences.into_iter().map(|d| (d.change, d.what, (d.moved_m * 100.0).round() / 100.0)).collect()
    }

    #[test]
    fn a_map_does_not_differ_from_itself() {
        let diff = MapDiff::of(&map(), &map(), &DiffConfig::default());
        assert!(diff.is_empty());
        assert_eq!(diff.same, 5);
        assert!((diff.same_lanes_m - 100.0).abs() < 1e-9);
    }

    #[test]
    fn each_change_is_one_difference() {
        let mut new = map();
        new.poles[0].foot_map.x += 0.3;
        new.poles[1].kind = PoleKind::LampPost;
        new.poles.remove(2);
        new.signs[0].centroid_map.z += 30.0;
        let expected = [
            (Change::Added, "traffic-sign".into(), 0.0),
            (Change::Removed, "sign-post".into(), 0.0),
            (Change::Removed, "traffic-sign".into(), 0.0),
            (Change::Moved, "sign-post".into(), 0.3),
            (Change::Kind, "lamp-post".into(), 0.0),
        ];
        assert_eq!(changes(&new), expected);
        let back = MapDiff::of(&new, &map(), &DiffConfig::default());
        assert_eq!(back.differences.iter().filter(|d| d.change == Change::Added).count(), 2);
    }

    #[test]
    fn lines_are_compared_by_length_and_across() {
        let mut new = map();
        new.lanes[0].points_map[1].z = 60.0;
        let diff = MapDiff::of(&map(), &new, &DiffConfig::default());
        assert_eq!(diff.differences.len(), 1, "{}", diff.text());
        // The end of a line is beside what follows it for as far as it may move.
        assert!((diff.differences[0].length_m.unwrap() - 40.0).abs() < 1.6, "{}", diff.text());
        let mut new = map();
        for point in &mut new.lanes[0].points_map {
            point.x += 0.4;
        }
        assert_eq!(changes(&new), [(Change::Moved, "solid-line".into(), 0.4)]);
        new.lanes[0].points_map.reverse();
        assert_eq!(changes(&new), [(Change::Moved, "solid-line".into(), 0.4)]);
    }

    #[test]
    fn a_line_of_another_kind_is_a_difference_for_as_far_as_it_is() {
        let mut new = map();
        new.lanes[0].kind = LaneKind::Dashed;
        let diff = MapDiff::of(&map(), &new, &DiffConfig::default());
        assert_eq!(changes(&new), [(Change::Kind, "dashed-line".into(), 0.0)]);
        assert!(diff.text().contains("100.0 m long  was solid-line"), "{}", diff.text());
        assert!(diff.same_lanes_m.abs() < 1e-9);
        // Solid again from 30 m on.
        new.lanes.push(map().lanes[0].clone());
        new.lanes[0].points_map[1].z = 30.0;
        new.lanes[1].points_map[0].z = 30.0;
        let diff = MapDiff::of(&map(), &new, &DiffConfig::default());
        assert_eq!(changes(&new), [(Change::Kind, "dashed-line".into(), 0.0)]);
        assert!((diff.differences[0].length_m.unwrap() - 30.0).abs() < 1.0, "{}", diff.text());
        assert!((diff.same_lanes_m - 70.0).abs() < 1.0);
    }

    #[test]
    fn the_lines_of_a_double_line_are_told_apart_by_their_kinds() {
        let mut old = map();
        old.lanes.push(old.lanes[0].clone());
        old.lanes[1].kind = LaneKind::Dashed;
        old.lanes[1].points_map.iter_mut().for_each(|point| point.x += 0.15);
        let mut new = old.clone();
        new.lanes.iter_mut().flat_map(|lane| &mut lane.points_map).for_each(|point| point.x += 0.09);
        let diff = MapDiff::of(&old, &new, &DiffConfig::default());
        assert!(diff.is_empty(), "{}", diff.text());
    }

    #[test]
    fn a_road_that_is_driven_beyond_is_added() {
        let mut new = map();
        new.roads[0].path_map[1].z = 150.0;
        let diff = MapDiff::of(&map(), &new, &DiffConfig::default());
        assert_eq!((diff.differences.len(), diff.differences[0].what.as_str()), (1, "road"), "{}", diff.text());
        assert!(MapDiff::of(&SemanticMap::default(), &SemanticMap::default(), &DiffConfig::default()).is_empty());
    }
}
