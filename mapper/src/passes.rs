//! Landmarks of all windows of a drive, each once: windows overlap, and a
//! drive may come back to a place.

use common::map::{LaneLine, Pole, RoadId, SemanticMap, Sign};
use nalgebra::Point3;

use crate::evidence::PointCovariances;
use crate::fuse::{FuseConfig, FusedLane, Sighting, fuse_lanes, fuse_poles, fuse_signs, sightings};
use crate::roads::runs;

/// What the windows of a drive have found. Each window counts as a pass, for
/// within one its landmarks were told apart.
#[derive(Debug, Default)]
pub struct Passes {
    poles: Vec<Sighting<Pole>>,
    signs: Vec<Sighting<Sign>>,
    lanes: Vec<Sighting<LaneLine>>,
}

impl Passes {
    /// Adds what a window has found, and how well its poles and signs are
    /// known.
    pub fn add(
        &mut self,
        window: u32,
        known: &PointCovariances,
        poles: Vec<Pole>,
        signs: Vec<Sign>,
        lanes: Vec<LaneLine>,
    ) {
        self.poles.extend(sightings(poles, window, &known.poles));
        self.signs.extend(sightings(signs, window, &known.signs));
        self.lanes.extend(sightings(lanes, window, &[]));
    }

    /// Puts each landmark into the map once.
    pub fn join(self, map: &mut SemanticMap, config: &FuseConfig) {
        map.poles = fuse_poles(&self.poles, config).into_iter().map(|f| f.landmark).collect();
        map.signs = fuse_signs(&self.signs, config).into_iter().map(|f| f.landmark).collect();
        let lanes = fuse_lanes(&self.lanes, config);
        map.lanes = lanes.iter().flat_map(|line| by_road(line, &self.lanes, map, config)).collect();
    }
}

/// A line that several passes drew, cut where another road is nearer: passes
/// cut it at places of their own.
fn by_road(
    line: &FusedLane,
    sightings: &[Sighting<LaneLine>],
    map: &SemanticMap,
    config: &FuseConfig,
) -> Vec<LaneLine> {
    let piece = |points_map: Vec<Point3<f64>>, road| {
        let marks_m = line.marks_m(&points_map, sightings, config);
        LaneLine { kind: line.kind, points_map, road, marks_m }
    };
    let whole = |road| piece(line.vertices(config), road);
    if line.sightings.len() < 2 {
        return vec![whole(line.road)];
    }
    let roads: Vec<RoadId> = line.samples.iter().map(|s| map.nearest_road(&s.point_map).unwrap_or(line.road)).collect();
    let mut cuts: Vec<(usize, RoadId)> = Vec::new();
    for run in runs(&roads) {
        // Where a line ends shortly behind a cut, it is not worth the vertices.
        let is_short = run.len() as f64 * config.lane_step_m < config.shortest_piece_m;
        let road = roads[run.start];
        if cuts.last().is_none_or(|(_, last)| *last != road) && !is_short {
            cuts.push((run.start, road));
        }
    }
    let Some(first) = cuts.first_mut() else { return vec![whole(line.road)] };
    first.0 = 0;
    let ends = cuts.iter().skip(1).map(|(start, _)| *start).chain([roads.len().saturating_sub(1)]);
    cuts.iter()
        .zip(ends)
        // Pieces share the sample at which they meet: no gap.
        .map(|(&(from, road), to)| piece(line.part(from..to + 1, config), road))
        .filter(|piece| piece.points_map.len() >= 2)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::map::{LaneKind, PoleKind, Road};
    use nalgebra::Matrix3;

    fn two_roads() -> SemanticMap {
        let road = |from: f64, to: f64| Road { path_map: vec![Point3::new(0.0, 0.0, from), Point3::new(0.0, 0.0, to)] };
        SemanticMap { roads: vec![road(0.0, 50.0), road(50.0, 100.0)], ..SemanticMap::default() }
    }

    fn lane(x: f64, from: f64, to: f64, road: u32) -> LaneLine {
        LaneLine {
            kind: LaneKind::Solid,
            points_map: vec![Point3::new(x, 1.6, from), Point3::new(x, 1.6, to)],
            road: RoadId(road),
            marks_m: Vec::new(),
        }
    }

    fn pole(x: f64, z: f64) -> Pole {
        let foot_map = Point3::new(x, 1.6, z);
        let top_map = Point3::new(x, -1.4, z);
        Pole { kind: PoleKind::SignPost, foot_map, top_map, road: RoadId(0) }
    }

    /// The same standard deviation for all poles of a window.
    fn known(sigma_m: f64, poles: usize) -> PointCovariances {
        let poles = vec![Matrix3::identity() * sigma_m * sigma_m; poles];
        PointCovariances { poles, signs: Vec::new() }
    }

    #[test]
    fn what_two_passes_found_is_in_the_map_once() {
        let mut passes = Passes::default();
        passes.add(
            0,
            &known(0.2, 2),
            vec![pole(4.0, 10.0), pole(4.0, 10.4)],
            Vec::new(),
            vec![lane(-2.0, 0.0, 50.0, 0)],
        );
        passes.add(1, &known(0.02, 1), vec![pole(5.0, 60.0)], Vec::new(), vec![lane(-2.0, 50.0, 100.0, 1)]);
        passes.add(2, &known(0.02, 1), vec![pole(4.02, 10.02)], Vec::new(), vec![lane(-1.96, 20.0, 80.0, 0)]);
        let mut map = two_roads();
        passes.join(&mut map, &FuseConfig::default());
        assert_eq!(map.poles.len(), 3, "two of one window are two, {:?}", map.poles);
        // It is where the window saw it that knows it ten times as well.
        assert!(map.poles.iter().any(|pole| (pole.foot_map - Point3::new(4.02, 1.6, 10.02)).norm() < 2e-3));
        let length_m: f64 =
            map.lanes.iter().map(|l| (l.points_map[l.points_map.len() - 1] - l.points_map[0]).norm()).sum();
        assert!((length_m - 100.0).abs() < 1.0, "{:?}", map.lanes);
        for line in &map.lanes {
            let middle = nalgebra::center(&line.points_map[0], &line.points_map[line.points_map.len() - 1]);
            assert_eq!(map.nearest_road(&middle), Some(line.road));
        }
    }
}
