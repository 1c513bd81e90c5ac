//! Distances from straight stretches and from lines of them.

use nalgebra::{Point, Point2, Point3};

/// Distance of a point from the straight stretch between two others, in their
/// unit; where these are one point, from that.
pub fn distance_to_segment<const D: usize>(p: &Point<f64, D>, [a, b]: [&Point<f64, D>; 2]) -> f64 {
    let way = b - a;
    let share = ((p - a).dot(&way) / way.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    (a + way * share - p).norm()
}

/// Distance of a point from a polyline; infinite where that has no vertex.
pub fn distance_to_polyline<const D: usize>(p: &Point<f64, D>, line: &[Point<f64, D>]) -> f64 {
    match line {
        [only] => (only - p).norm(),
        _ => line.windows(2).map(|ends| distance_to_segment(p, [&ends[0], &ends[1]])).fold(f64::INFINITY, f64::min),
    }
}

/// The same on the ground plane of the map, metres, whatever their heights.
pub fn distance_from_above_m(p_map: &Point3<f64>, line_map: &[Point3<f64>]) -> f64 {
    let p = above(p_map);
    let from_side = |ends: &[Point3<f64>]| distance_to_segment(&p, [&above(&ends[0]), &above(&ends[1])]);
    line_map.windows(2).map(from_side).fold(f64::INFINITY, f64::min)
}

/// Where a point of the map frame is, seen from above: (x, z), metres.
pub fn above(p_map: &Point3<f64>) -> Point2<f64> {
    Point2::new(p_map.x, p_map.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_is_as_far_from_a_line_as_from_its_nearest_place() {
        let line = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [4.0, 4.0]].map(Point2::from);
        // Beside a stretch, in the corner, beyond the end, before the beginning.
        for (at, expected) in [([2.0, 1.5], 1.5), ([5.0, -1.0], 2.0_f64.sqrt()), ([4.0, 6.0], 2.0), ([-3.0, 4.0], 5.0)]
        {
            let distance = distance_to_polyline(&Point2::from(at), &line);
            assert!((distance - expected).abs() < 1e-12, "{at:?}: {distance}");
        }
        assert!((distance_to_polyline(&Point2::origin(), &line[2..3]) - 32.0_f64.sqrt()).abs() < 1e-12);
        assert!(distance_to_polyline(&Point2::origin(), &[]).is_infinite());
        assert_eq!(above(&Point3::new(1.0, 2.0, 3.0)), Point2::new(1.0, 3.0));
        let slope = [[0.0, 0.0, 0.0], [0.0, -5.0, 10.0]].map(Point3::from);
        assert!((distance_from_above_m(&Point3::new(2.0, 1.0, 9.0), &slope) - 2.0).abs() < 1e-12);
    }
}
