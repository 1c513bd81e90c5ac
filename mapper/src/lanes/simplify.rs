//! Polylines with no more vertices than a tolerance needs.

use std::cmp::Ordering;

use nalgebra::{Point3, Vector3};

/// Most points that one piece of the polyline replaces: bounds the work on
/// long straight lines.
const LONGEST_PIECE: usize = 160;

/// Indices of the fewest vertices of a polyline that describe it within a
/// tolerance, metres: every point left out is no farther than that from the
/// piece that replaces it (Imai and Iri 1988, by dynamic programming).
pub fn simplify(points: &[Point3<f64>], tolerance_m: f64) -> Vec<usize> {
    if points.len() < 3 {
        return (0..points.len()).collect();
    }
    // Fewest pieces up to each point, then the least sum of squared distances.
    let mut best: Vec<(usize, f64, usize)> = vec![(usize::MAX, 0.0, 0); points.len()];
    best[0] = (0, 0.0, 0);
    for end in 1..points.len() {
        for start in end.saturating_sub(LONGEST_PIECE)..end {
            let (pieces, cost, _) = best[start];
            // More pieces than are needed, or as many that lie farther off
            // already: no use to measure them.
            let most = match pieces.saturating_add(1).cmp(&best[end].0) {
                Ordering::Less => f64::INFINITY,
                Ordering::Equal => best[end].1 - cost,
                Ordering::Greater => continue,
            };
            let Some(own) = squares(&points[start..=end], tolerance_m, most) else { continue };
            let candidate = (pieces + 1, cost + own, start);
            if candidate.0 < best[end].0 || candidate.1 < best[end].1 {
                best[end] = candidate;
            }
        }
    }
    let mut kept = vec![points.len() - 1];
    while let Some(&at) = kept.last().filter(|at| **at > 0) {
        kept.push(best[at].2);
    }
    kept.reverse();
    kept
}

/// Vertices of a polyline that runs amid the places it describes: the least
/// squares of these, each with its station, over those of the continuous
/// lines with the kept stations as knots.
pub fn fitted(places: &[(f64, Point3<f64>)], kept: &[usize]) -> Vec<Point3<f64>> {
    let knots: Vec<(f64, Point3<f64>)> = kept.iter().filter_map(|i| places.get(*i).copied()).collect();
    // The normal equations: each place weighs on the knots to its both sides.
    let mut own = vec![0.0; knots.len()];
    let mut next = vec![0.0; knots.len()];
    let mut right = vec![Vector3::zeros(); knots.len()];
    for (station_m, place) in places {
        let after = knots.partition_point(|k| k.0 <= *station_m).clamp(1, knots.len().max(2) - 1);
        let (Some(a), Some(b)) = (knots.get(after - 1), knots.get(after)) else { continue };
        let share = (station_m - a.0) / (b.0 - a.0).max(1e-9);
        own[after - 1] += (1.0 - share) * (1.0 - share);
        own[after] += share * share;
        next[after - 1] += share * (1.0 - share);
        right[after - 1] += place.coords * (1.0 - share);
        right[after] += place.coords * share;
    }
    // They are tridiagonal (Thomas 1949), and regular: each knot is a place.
    for k in 1..knots.len() {
        let factor = next[k - 1] / own[k - 1];
        own[k] -= factor * next[k - 1];
        right[k] = right[k] - right[k - 1] * factor;
    }
    for k in (0..knots.len()).rev() {
        let known = right.get(k + 1).map_or_else(Vector3::zeros, |after| after * next[k]);
        right[k] = (right[k] - known) / own[k];
    }
    right.into_iter().map(Point3::from).collect()
}

/// Sum of the squared distances of the inner points from the line between the
/// outer ones; none where one is farther off than the tolerance, or where it
/// comes to more than `most`.
fn squares(points: &[Point3<f64>], tolerance_m: f64, most: f64) -> Option<f64> {
    let (a, b) = (points.first()?, points.last()?);
    let along = b - a;
    let length = along.norm_squared().max(1e-12);
    let squared = |p: &Point3<f64>| {
        let d = p - a;
        let share = (d.dot(&along) / length).clamp(0.0, 1.0);
        (d - along * share).norm_squared()
    };
    // Of a bend the middle is farthest off.
    if squared(&points[points.len() / 2]) > tolerance_m * tolerance_m {
        return None;
    }
    let mut sum = 0.0;
    for p in points {
        let off = squared(p);
        sum += off;
        if off > tolerance_m * tolerance_m || sum > most {
            return None;
        }
    }
    Some(sum)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bend() -> Vec<Point3<f64>> {
        (0..100)
            .map(|i| {
                let a = f64::from(i) * 0.01;
                Point3::new(40.0 * (1.0 - a.cos()), 1.6, 40.0 * a.sin())
            })
            .collect()
    }

    #[test]
    fn a_straight_line_needs_two_vertices_and_a_bend_as_many_as_its_sagitta_asks_for() {
        let straight: Vec<_> = (0..50).map(|i| Point3::new(1.0, 1.6, f64::from(i))).collect();
        assert_eq!(simplify(&straight, 0.03), vec![0, 49]);
        // A chord of 3.1 m is 0.03 m off an arc of 40 m: 39.6 m are 13 of them,
        // and no vertex may lie between the points, which are 0.4 m apart.
        assert!(simplify(&bend(), 0.03).len() <= 16);
    }

    #[test]
    fn fitted_vertices_halve_the_error_of_chords() {
        let bend = bend();
        let places: Vec<_> = bend.iter().enumerate().map(|(i, p)| (i as f64 * 0.4, *p)).collect();
        let kept = simplify(&bend, 0.03);
        let on: Vec<_> = kept.iter().map(|i| bend[*i]).collect();
        let error = |vertices: &[Point3<f64>]| {
            let off = |p: &Point3<f64>| {
                vertices
                    .windows(2)
                    .filter_map(|pair| squares(&[pair[0], *p, pair[1]], 1e3, f64::INFINITY))
                    .fold(1e3, f64::min)
            };
            (bend.iter().map(off).sum::<f64>() / bend.len() as f64).sqrt()
        };
        assert!(error(&fitted(&places, &kept)) < 0.5 * error(&on));
        let straight: Vec<_> = (0..50).map(|i| (f64::from(i), Point3::new(1.0, 1.6, f64::from(i)))).collect();
        let ends = fitted(&straight, &[0, 20, 49]);
        assert!(ends.iter().zip([0, 20, 49]).all(|(p, i)| (p - straight[i].1).norm() < 1e-9));
    }

    proptest! {
        #[test]
        fn what_is_left_out_lies_within_the_tolerance(
            offsets in prop::collection::vec(-0.2_f64..0.2, 2..60),
            tolerance_m in 0.01_f64..0.3,
        ) {
            let points: Vec<_> =
                offsets.iter().enumerate().map(|(i, x)| Point3::new(*x, 1.6, i as f64 * 0.5)).collect();
            let kept = simplify(&points, tolerance_m);
            prop_assert_eq!(kept.first(), Some(&0));
            prop_assert_eq!(kept.last(), Some(&(points.len() - 1)));
            for pair in kept.windows(2) {
                prop_assert!(squares(&points[pair[0]..=pair[1]], tolerance_m + 1e-9, f64::INFINITY).is_some());
            }
        }
    }
}
