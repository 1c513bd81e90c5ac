//! Which sightings are one landmark.

use nalgebra::{Point3, Vector3};

use super::Buckets;

/// Where a pass saw something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Where, map frame, metres.
    pub point_map: Point3<f64>,
    /// By which pass.
    pub pass: u32,
    /// Things of different classes are never one.
    pub class: u32,
}

/// For [`cluster`]: no two places of one pass are one, not even at one point.
pub const NEVER_DOUBLE_M: f64 = f64::NEG_INFINITY;

/// Groups places of different passes that lie within `within_m` of each other,
/// near ones first: average linkage, so that a chain of neighbours does not
/// become one. Places of one pass are one within `double_m` only: nearer than
/// two such things can be. The caller puts the places into an order that is
/// their own; the groups and the places in them keep it.
pub fn cluster(places: &[Place], within_m: f64, double_m: f64) -> Vec<Vec<usize>> {
    let buckets = Buckets::of(within_m, places.iter().map(|place| &place.point_map));
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (a, place) in places.iter().enumerate() {
        for b in buckets.near(&place.point_map, within_m).filter(|&b| b > a) {
            let other = &places[b];
            let distance_m = (place.point_map - other.point_map).norm();
            let reach_m = if place.pass == other.pass { double_m.min(within_m) } else { within_m };
            if place.class == other.class && distance_m <= reach_m {
                pairs.push((distance_m, a, b));
            }
        }
    }
    pairs.sort_by(|p, q| p.0.total_cmp(&q.0).then((p.1, p.2).cmp(&(q.1, q.2))));
    let mut groups = Groups::new(places);
    for (_, a, b) in pairs {
        groups.join(a, b, within_m, double_m);
    }
    groups.finish()
}

/// Groups under their first place; the others point to it.
struct Groups<'a> {
    places: &'a [Place],
    first: Vec<usize>,
    members: Vec<Vec<usize>>,
    sums: Vec<Vector3<f64>>,
}

impl<'a> Groups<'a> {
    fn new(places: &'a [Place]) -> Self {
        Self {
            places,
            first: (0..places.len()).collect(),
            members: (0..places.len()).map(|place| vec![place]).collect(),
            sums: places.iter().map(|place| place.point_map.coords).collect(),
        }
    }

    fn join(&mut self, a: usize, b: usize, within_m: f64, double_m: f64) {
        let (a, b) = (self.first[a].min(self.first[b]), self.first[a].max(self.first[b]));
        let mean = |group: usize| self.sums[group] / self.members[group].len() as f64;
        if a == b || (mean(a) - mean(b)).norm() > within_m {
            return;
        }
        let are_two = |p: &usize, q: &usize| {
            let (p, q) = (&self.places[*p], &self.places[*q]);
            p.pass == q.pass && (p.point_map - q.point_map).norm() > double_m
        };
        if self.members[a].iter().any(|p| self.members[b].iter().any(|q| are_two(p, q))) {
            return;
        }
        let moved = std::mem::take(&mut self.members[b]);
        for &place in &moved {
            self.first[place] = a;
        }
        self.members[a].extend(moved);
        let sum = self.sums[b];
        self.sums[a] += sum;
    }

    fn finish(self) -> Vec<Vec<usize>> {
        let mut groups: Vec<Vec<usize>> = self.members.into_iter().filter(|group| !group.is_empty()).collect();
        for group in &mut groups {
            group.sort_unstable();
        }
        groups
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64, pass: u32) -> Place {
        Place { point_map: Point3::new(x, 0.0, 0.0), pass, class: 0 }
    }

    #[test]
    fn near_ones_of_different_passes_are_one() {
        let places = [at(0.0, 0), at(0.1, 1), at(0.3, 0), at(0.35, 1), at(5.0, 2)];
        assert_eq!(cluster(&places, 0.5, 0.0), [vec![0, 1], vec![2, 3], vec![4]]);
    }

    #[test]
    fn a_chain_of_neighbours_does_not_become_one() {
        let places: Vec<Place> = (0..10).map(|i| at(f64::from(i) * 0.4, i as u32)).collect();
        for group in cluster(&places, 0.5, 0.0) {
            assert!(group.len() <= 3, "{group:?}");
        }
    }

    #[test]
    fn what_one_pass_saw_double_is_one() {
        let places = [at(0.0, 0), at(0.08, 0), at(0.04, 1), at(0.3, 0)];
        assert_eq!(cluster(&places, 0.5, 0.1), [vec![0, 1, 2], vec![3]]);
    }

    #[test]
    fn at_one_point_two_of_one_pass_stay_two_where_none_is_double() {
        let places = [at(0.0, 0), at(0.0, 0), at(0.0, 1)];
        assert_eq!(cluster(&places, 0.5, NEVER_DOUBLE_M), [vec![0, 2], vec![1]]);
    }

    #[test]
    fn classes_and_passes_are_kept_apart() {
        let other = Place { class: 1, ..at(0.0, 1) };
        assert_eq!(cluster(&[at(0.0, 0), other, at(0.1, 0)], 0.5, 0.0).len(), 3);
    }
}
