//! Where a map is, and which road is near.

use nalgebra::Point3;

use super::{RoadId, SemanticMap};
use crate::geometry::distance_to_polyline;

/// An axis-aligned box in the map frame, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates.
    pub min_map: Point3<f64>,
    /// Largest coordinates.
    pub max_map: Point3<f64>,
}

impl SemanticMap {
    /// The box around all landmarks and roads; none for an empty map.
    pub fn bounds(&self) -> Option<Bounds> {
        self.bounds_with(self.poles.iter().map(|pole| &pole.top_map))
    }

    /// The same with other tops of its poles.
    pub(super) fn bounds_with<'a>(&'a self, tops_map: impl Iterator<Item = &'a Point3<f64>>) -> Option<Bounds> {
        let roads = self.roads.iter().flat_map(|road| &road.path_map);
        let feet = self.poles.iter().map(|pole| &pole.foot_map);
        let signs = self.signs.iter().map(|sign| &sign.centroid_map);
        let lanes = self.lanes.iter().flat_map(|lane| &lane.points_map);
        let mut points = roads.chain(feet).chain(tops_map).chain(signs).chain(lanes);
        let first = *points.next()?;
        Some(points.fold(Bounds { min_map: first, max_map: first }, |bounds, point| Bounds {
            min_map: bounds.min_map.inf(point),
            max_map: bounds.max_map.sup(point),
        }))
    }

    /// The road whose path comes nearest to a point (map frame, metres), the
    /// first of them where several do; none where the map has no road.
    pub fn nearest_road(&self, point_map: &Point3<f64>) -> Option<RoadId> {
        let mut nearest = None;
        let mut nearest_m = f64::INFINITY;
        for (id, road) in (0..).zip(&self.roads) {
            let distance_m = distance_to_polyline(point_map, &road.path_map);
            if distance_m < nearest_m {
                (nearest, nearest_m) = (Some(RoadId(id)), distance_m);
            }
        }
        nearest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::Road;

    #[test]
    fn the_nearest_road_is_nearest_to_its_path_and_not_to_its_vertices() {
        let road = |points: &[[f64; 3]]| Road { path_map: points.iter().map(|&p| Point3::from(p)).collect() };
        let mut map = SemanticMap::default();
        assert_eq!(map.nearest_road(&Point3::origin()), None);
        map.roads = vec![road(&[]), road(&[[0.0, 0.0, 0.0], [0.0, 0.0, 100.0]]), road(&[[10.0, 0.0, 50.0]])];
        assert_eq!(map.nearest_road(&Point3::new(4.0, 0.0, 50.0)), Some(RoadId(1)));
        assert_eq!(map.nearest_road(&Point3::new(8.0, 0.0, 50.0)), Some(RoadId(2)));
        let bounds = map.bounds().unwrap();
        assert_eq!((bounds.min_map, bounds.max_map), (Point3::origin(), Point3::new(10.0, 0.0, 100.0)));
    }
}
