//! Which passes came near enough to a place to have seen what stands there.

use std::ops::RangeInclusive;

use nalgebra::Point3;

use super::config::WitnessConfig;
use crate::fuse::Buckets;

/// Distance of the samples of a path, metres.
const STEP_M: f64 = 4.0;

/// The paths of passes, for asking who came near.
#[derive(Debug)]
pub struct Witnesses {
    buckets: Buckets,
    samples: Vec<(u32, Point3<f64>)>,
}

impl Witnesses {
    /// Takes the paths (map frame, metres) of passes.
    pub fn new<'a>(paths: impl Iterator<Item = (u32, &'a [Point3<f64>])>) -> Self {
        let mut witnesses = Self { buckets: Buckets::new(10.0), samples: Vec::new() };
        for (pass, path) in paths {
            for pair in path.windows(2) {
                let way = pair[1] - pair[0];
                let count = (way.norm() / STEP_M).ceil().clamp(1.0, 1e6);
                for k in 0..count as usize {
                    witnesses.add(pass, pair[0] + way * (k as f64 / count));
                }
            }
            if let Some(last) = path.last() {
                witnesses.add(pass, *last);
            }
        }
        witnesses
    }

    fn add(&mut self, pass: u32, point: Point3<f64>) {
        self.buckets.add(&point, self.samples.len());
        self.samples.push((pass, point));
    }

    /// The passes whose path comes within `reach_m` of a point seen from
    /// above, and has it within `below_m` below itself (metres; above it:
    /// negative), and how near each comes (metres); ascending by pass.
    pub fn near(&self, point: &Point3<f64>, reach_m: f64, below_m: &RangeInclusive<f64>) -> Vec<(u32, f64)> {
        let all = self.buckets.near(point, reach_m).map(|index| &self.samples[index]);
        let on_level = all.filter(|(_, at)| below_m.contains(&(point.y - at.y)));
        let distances = on_level.map(|(pass, at)| (*pass, (at.x - point.x).hypot(at.z - point.z)));
        let mut passes: Vec<(u32, f64)> = distances.filter(|(_, distance_m)| *distance_m <= reach_m).collect();
        passes.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        passes.dedup_by_key(|(pass, _)| *pass);
        passes
    }

    /// The passes that should have seen a landmark: those that came within
    /// `reach_m`, and those that came as near as one that did see it. `below_m`
    /// is as for [`Self::near`].
    pub fn expected(
        &self,
        point: &Point3<f64>,
        seen: &[u32],
        reach_m: f64,
        below_m: &RangeInclusive<f64>,
        config: &WitnessConfig,
    ) -> Vec<u32> {
        let near = self.near(point, config.farthest_m.max(reach_m), below_m);
        let seers = near.iter().filter(|(pass, _)| seen.contains(pass));
        let nearest_m = seers.map(|(_, distance_m)| *distance_m).reduce(f64::min);
        let reach_m = nearest_m.map_or(reach_m, |nearest_m| reach_m.max(nearest_m + config.as_near_m));
        near.into_iter().filter(|(_, distance_m)| *distance_m <= reach_m).map(|(pass, _)| pass).collect()
    }
}

/// How many of the passes that came near do not see a landmark. `seen` are
/// the passes that do, `near` those that came near.
pub fn missed(seen: &[u32], near: &[u32]) -> usize {
    near.iter().filter(|pass| !seen.contains(pass)).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::merge::Counts;

    #[test]
    fn only_who_came_near_is_a_witness() {
        let along = [Point3::origin(), Point3::new(0.0, 0.0, 100.0)];
        let far = along.map(|p| Point3::new(p.x + 40.0, p.y, p.z));
        let bridge = along.map(|p| Point3::new(p.x, p.y - 8.0, p.z));
        let paths = [(3, &along[..]), (1, &far[..]), (2, &bridge[..]), (0, &along[..])];
        let witnesses = Witnesses::new(paths.into_iter());
        let ground_m = WitnessConfig::default().ground_m();
        let near = |x: f64| witnesses.near(&Point3::new(x, 1.6, 48.0), 15.0, &ground_m);
        assert_eq!(near(5.0), [(0, 5.0), (3, 5.0)]);
        assert_eq!(near(35.0), [(1, 5.0)]);
        assert!(witnesses.near(&Point3::new(5.0, 1.6, 130.0), 15.0, &ground_m).is_empty());
    }

    #[test]
    fn who_passes_below_a_bridge_or_over_it_sees_nothing_of_the_other_road() {
        let config = WitnessConfig::default();
        let along = [Point3::origin(), Point3::new(0.0, 0.0, 100.0)];
        let bridge = along.map(|p| Point3::new(p.x, p.y - 5.5, p.z));
        let witnesses = Witnesses::new([(0, &along[..]), (1, &bridge[..])].into_iter());
        let near = |y: f64, below_m| witnesses.near(&Point3::new(5.0, y, 48.0), 15.0, &below_m);
        assert_eq!(near(1.65, config.ground_m()), [(0, 5.0)]);
        assert_eq!(near(1.65 - 5.5, config.ground_m()), [(1, 5.0)]);
        // A bank beside the lower road.
        assert_eq!(near(-1.5, config.ground_m()).first(), Some(&(0, 5.0)));
        // A sign over the lower road is not on the ground.
        assert_eq!(near(-4.0, config.signs_m()).first(), Some(&(0, 5.0)));
    }

    #[test]
    fn who_came_as_near_as_one_that_saw_it_should_have() {
        let along = |x: f64| [Point3::new(x, 0.0, 0.0), Point3::new(x, 0.0, 100.0)];
        let paths = [along(0.0), along(0.5), along(-5.0), along(60.0)];
        let witnesses = Witnesses::new((0..).zip(paths.iter().map(|path| &path[..])));
        let config = WitnessConfig::default();
        let expected = |x: f64, seen: &[u32]| {
            witnesses.expected(&Point3::new(x, 1.6, 48.0), seen, 15.0, &config.ground_m(), &config)
        };
        assert_eq!(expected(20.0, &[0]), [0, 1]);
        assert_eq!(expected(20.0, &[2]), [0, 1, 2]);
        assert_eq!(expected(8.0, &[0]), [0, 1, 2]);
        assert_eq!(expected(8.0, &[3]), [0, 1, 2]);
    }

    #[test]
    fn what_most_no_longer_see_goes_and_a_tie_stays() {
        let stays = |seen: &[u32], near: &[u32]| Counts::default().count(1.0, seen.len(), missed(seen, near));
        assert!(stays(&[0], &[0, 1]));
        assert!(!stays(&[0], &[0, 1, 2]));
        assert!(stays(&[0, 1], &[0, 1, 2, 3]));
        assert!(stays(&[0], &[]));
    }
}
