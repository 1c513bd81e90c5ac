//! Who saw the points of a cloud that was stitched without times.
//!
//! Cut where it lies, a slice of such a cloud holds what was seen of it from near and far, and
//! all of a post is of one place: nothing is seen twice, and nothing as often as a lidar would
//! that passes it. So what stands is dealt to the places that it may have been seen from: to each
//! as much of it as its distance lets a lidar see from there. What lies on the ground is given to
//! the nearest place that sees it, as lane paint is told from the road around it, and where a
//! drive comes by again to the nearest of each pass: the line between two lanes would else lie
//! half in the slices of one and half in those of the other.

use common::geometry::Pose;
use common::kitti::ScanPoint;
use nalgebra::{Point3, Vector3};
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};

use crate::lidar::LidarConfig;

/// Who saw the points of a stitched cloud without times.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[allow(clippy::struct_field_names, reason = "all are metres, and names say the unit")]
pub struct DealConfig {
    /// How far the lidar saw, metres: what is farther is not mapped.
    pub reach_m: f64,
    /// Side of the cells whose lowest point is the ground, metres: wide enough to have one, and
    /// so small that a slope of 20 % rises by less than `lying_m` in them.
    pub cell_m: f32,
    /// What is higher than this over that stands, metres: kerbs and what grows on verges lie.
    pub lying_m: f32,
}

impl Default for DealConfig {
    fn default() -> Self {
        Self { reach_m: 60.0, cell_m: 0.5, lying_m: 0.3 }
    }
}

/// The golden ratio: its multiples, less their whole parts, are spread evenly however many
/// there are.
const GOLDEN: f64 = 1.618_033_988_749_895;
/// Square of the least distance that counts, metres: nearer is the vehicle itself.
const LEAST_RANGE_M2: f64 = 1.0;

/// Deals points to the places of a trajectory.
pub struct Dealer<'a> {
    /// `velodyne_from_map` of each place.
    velodyne_from_map: &'a [Pose],
    /// Where the beams come from in the frame of the scans, metres.
    apex: Point3<f64>,
    /// Least and greatest rise of a beam, per metre.
    rise: [f64; 2],
    config: DealConfig,
}

/// A place as another one sees it.
struct Seer {
    /// Its number.
    place: usize,
    there_from_here: Pose,
    /// Where its beams come from.
    apex: Point3<f64>,
    /// What is up there.
    up: Vector3<f64>,
}

impl Seer {
    /// A point that is dealt to it: the place, and the point in its frame.
    fn given(&self, here: &Point3<f64>, p: &ScanPoint) -> (usize, ScanPoint) {
        let there = self.there_from_here * here;
        (self.place, ScanPoint { x_m: there.x as f32, y_m: there.y as f32, z_m: there.z as f32, ..*p })
    }
}

impl<'a> Dealer<'a> {
    /// Deals to a lidar at these places.
    pub fn new(velodyne_from_map: &'a [Pose], lidar: &LidarConfig, config: DealConfig) -> Self {
        let apex = Point3::from(lidar.at_m) + Vector3::z() * lidar.apex_m;
        Self { velodyne_from_map, apex, rise: [lidar.lowest_rad.tan(), lidar.highest_rad.tan()], config }
    }

    /// Deals the points of the slice of a place, in the frame of its scan: each with the place
    /// that it is dealt to, and in the frame of that.
    pub fn deal(&self, place: usize, points: &[ScanPoint]) -> Vec<(usize, ScanPoint)> {
        let seers = self.around(place);
        let passes: Vec<&[Seer]> = seers.chunk_by(|a, b| b.place == a.place + 1).collect();
        let ground = Ground::under(points, self.config);
        let mut standing = 0_u32;
        let mut shares = Vec::with_capacity(seers.len());
        let mut dealt = Vec::with_capacity(points.len());
        for p in points {
            let here = Point3::new(f64::from(p.x_m), f64::from(p.y_m), f64::from(p.z_m));
            let before = dealt.len();
            if ground.is_lying(p) {
                let nearest = passes.iter().filter_map(|pass| self.nearest(&here, pass));
                dealt.extend(nearest.map(|seer| seer.given(&here, p)));
            } else {
                standing += 1;
                let lot = (f64::from(standing) * GOLDEN).fract();
                dealt.extend(self.by_lot(&here, lot, &seers, &mut shares).map(|seer| seer.given(&here, p)));
            }
            if dealt.len() == before {
                dealt.push((place, *p));
            }
        }
        dealt
    }

    /// The places within reach of one, itself among them.
    fn around(&self, place: usize) -> Vec<Seer> {
        let map_from_here = self.velodyne_from_map[place].inverse();
        let seer = |(place, there_from_map): (usize, &Pose)| {
            let there_from_here = there_from_map * map_from_here;
            let here_from_there = there_from_here.inverse();
            let is_near = here_from_there.translation.vector.norm() <= self.config.reach_m;
            let (apex, up) = (here_from_there * self.apex, here_from_there * Vector3::z());
            is_near.then_some(Seer { place, there_from_here, apex, up })
        };
        self.velodyne_from_map.iter().enumerate().filter_map(seer).collect()
    }

    /// Square of the distance to a point from where it may have been seen, metres; none from
    /// elsewhere.
    fn seen_from(&self, seer: &Seer, here: &Point3<f64>) -> Option<f64> {
        let ray = here - seer.apex;
        let (range_m2, up_m) = (ray.norm_squared(), ray.dot(&seer.up));
        let level_m = (range_m2 - up_m * up_m).max(0.0).sqrt();
        let [least, most] = self.rise;
        let is_in_view = (least * level_m..=most * level_m).contains(&up_m);
        (is_in_view && range_m2 <= self.config.reach_m.powi(2)).then_some(range_m2)
    }

    /// The nearest place that sees a point.
    fn nearest<'s>(&self, here: &Point3<f64>, seers: &'s [Seer]) -> Option<&'s Seer> {
        let seen = seers.iter().filter_map(|seer| Some((seer, self.seen_from(seer, here)?)));
        seen.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(seer, _)| seer)
    }

    /// The place that a point is dealt to by a lot from 0 to 1; none where no place can have
    /// seen it. `shares` is scratch.
    fn by_lot<'s>(
        &self,
        here: &Point3<f64>,
        lot: f64,
        seers: &'s [Seer],
        shares: &mut Vec<(usize, f64)>,
    ) -> Option<&'s Seer> {
        shares.clear();
        let mut sum = 0.0;
        for (k, seer) in seers.iter().enumerate() {
            if let Some(range_m2) = self.seen_from(seer, here) {
                // So many of its points are on a surface of one size.
                sum += range_m2.max(LEAST_RANGE_M2).recip();
                shares.push((k, sum));
            }
        }
        let chosen = shares.iter().find(|(_, up_to)| lot * sum < *up_to).or(shares.last());
        chosen.map(|(k, _)| &seers[*k])
    }
}

/// The lowest point of each cell of a slice.
pub struct Ground {
    lowest_m: FxHashMap<(i32, i32), f32>,
    config: DealConfig,
}

impl Ground {
    /// Of a slice, in the frame of its scan.
    pub fn under(points: &[ScanPoint], config: DealConfig) -> Self {
        let mut ground = Self { lowest_m: FxHashMap::default(), config };
        for p in points {
            let lowest_m = ground.lowest_m.entry(ground.cell(p)).or_insert(p.z_m);
            *lowest_m = lowest_m.min(p.z_m);
        }
        ground
    }

    fn cell(&self, p: &ScanPoint) -> (i32, i32) {
        ((p.x_m / self.config.cell_m).floor() as i32, (p.y_m / self.config.cell_m).floor() as i32)
    }

    /// Whether a point of it lies on the ground.
    pub fn is_lying(&self, p: &ScanPoint) -> bool {
        self.lowest_m.get(&self.cell(p)).is_some_and(|lowest_m| p.z_m - lowest_m <= self.config.lying_m)
    }
}

#[cfg(test)]
mod tests {
    use common::geometry::Pose;

    use super::*;

    /// Places 6 m apart along x, 1.7 m over the road, and the slice of the third: a post of
    /// 3 m, 4 m aside, on a road.
    fn places() -> Vec<Pose> {
        (0..8).map(|i| Pose::translation(-6.0 * f64::from(i), 0.0, 0.0)).collect()
    }

    fn slice() -> Vec<ScanPoint> {
        let point = |x_m: f32, y_m: f32, z_m: f32| ScanPoint { x_m, y_m, z_m, reflectance: 0.5 };
        let post = (0..600_u16).map(|i| point(0.0, 4.0, -1.7 + f32::from(i) * 0.005));
        let road = (0..400_u16).map(|i| point(f32::from(i % 20) * 0.3 - 3.0, f32::from(i / 20) * 0.3 - 3.0, -1.7));
        post.chain(road).collect()
    }

    #[test]
    fn what_stands_is_dealt_by_distance_and_what_lies_is_of_the_nearest() {
        let (places, slice) = (places(), slice());
        let dealt = Dealer::new(&places, &LidarConfig::default(), DealConfig::default()).deal(2, &slice);
        assert_eq!(dealt.len(), slice.len());
        for ((to, there), here) in dealt.iter().zip(&slice) {
            // It is where it was.
            assert!((there.x_m + 6.0 * *to as f32 - (here.x_m + 12.0)).abs() < 1e-4, "{there:?}");
            assert_eq!((there.y_m, there.z_m), (here.y_m, here.z_m));
            // What lies is of the nearest place that looks down on it, which is not right under it.
            assert!(here.z_m > -1.398 || (3.9..10.0).contains(&there.x_m.hypot(there.y_m)), "{there:?}");
        }
        // All places see it from 0.4 m up to the height of the nearest one's highest beam.
        let lidar = LidarConfig::default();
        let in_view = |p: &ScanPoint| p.z_m > -1.3 && f64::from(p.z_m) < lidar.apex_m + 4.0 * lidar.highest_rad.tan();
        let of = |place: usize| dealt.iter().filter(|(to, p)| *to == place && in_view(p)).count() as f64;
        let all: f64 = (0..8).map(of).sum();
        let share = |place: usize| (16.0 + 36.0 * (place as f64 - 2.0).powi(2)).recip();
        let shares: f64 = (0..8).map(share).sum();
        for place in 0..8 {
            let (is, expected) = (of(place) / all, share(place) / shares);
            assert!((is - expected).abs() < 0.05, "{place}: {is} for {expected}");
        }
        // What is over its beams is of those who look up to it from farther away.
        assert!(!dealt.iter().any(|(to, p)| *to == 2 && (0.4..1.2).contains(&p.z_m)), "over the beams");
    }

    #[test]
    fn who_is_out_of_reach_gets_nothing_and_nobody_sees_what_none_can() {
        let places = places();
        let config = DealConfig { reach_m: 8.0, ..DealConfig::default() };
        let dealer = Dealer::new(&places, &LidarConfig::default(), config);
        assert!(dealer.deal(2, &slice()).iter().all(|(to, _)| (1..=3).contains(to)));
        // A ceiling over a road.
        let at = |z_m: f32| ScanPoint { x_m: 0.1, y_m: 0.1, z_m, reflectance: 0.5 };
        let dealt = dealer.deal(2, &[at(-1.7), at(6.0)]);
        assert!([1, 3].contains(&dealt[0].0), "{dealt:?}");
        assert_eq!(dealt[1..], [(2, at(6.0))]);
    }

    #[test]
    fn each_pass_gets_what_lies_and_both_share_what_stands() {
        // There, on by more than it sees, and the same way again in the next lane.
        let lane = |y_m: f64| (0..8).map(move |i| Pose::translation(-6.0 * f64::from(i), y_m, 0.0));
        let away = (1..4).map(|i| Pose::translation(-42.0 - 40.0 * f64::from(i), 0.0, 0.0));
        let places: Vec<Pose> = lane(0.0).chain(away).chain(lane(3.5)).collect();
        let dealt = Dealer::new(&places, &LidarConfig::default(), DealConfig::default()).deal(2, &slice());
        let of = |stands: bool, passes: std::ops::RangeInclusive<usize>| {
            dealt.iter().filter(|(to, p)| passes.contains(to) && (p.z_m > -1.398) == stands).count()
        };
        let lying = slice().iter().filter(|p| p.z_m < -1.398).count();
        assert_eq!((of(false, 0..=7), of(false, 11..=18)), (lying, lying));
        let (first, second) = (of(true, 0..=10), of(true, 11..=18));
        assert_eq!(first + second + lying, slice().len());
        // The post is nearer to the first lane.
        assert!(second > 50 && first > second, "{first}, {second}");
    }
}
