//! Where the lidar is in the frame of its scans. Many a recording has them in the frame of
//! the vehicle, whose origin is on the road or at an axle: seen from there no beam is one,
//! and the road is no longer below.

use std::f64::consts::PI;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::intensity::road_heights_m;
use super::{LidarConfig, MeasureConfig};
use crate::quantile::quantile;
use crate::scan::LidarScan;

/// How the place is told from scans.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlaceConfig {
    /// Least and largest height of the origin of scans over the road, metres, at which it is
    /// not asked whether it is the lidar's: on the roofs of cars and vans.
    pub usual_m: [f64; 2],
    /// Least and largest height over the road at which beams are looked for elsewhere than in
    /// the origin, metres: up to that of a truck, and so high that the road is not seen
    /// edge-on, as if it were a beam.
    pub heights_m: [f64; 2],
    /// Farthest from the origin along x and y, metres: an axle of a bus is as far from its
    /// front.
    pub farthest_m: [f64; 2],
    /// Nearest points that are looked at, metres along the ground: what is near shows less of
    /// the directions of the beams than of the places that they come from.
    pub nearest_m: f64,
    /// By how many times the beams are sharper from where the lidar is than from
    /// elsewhere: of one without beams they are nowhere by more than a few parts of a hundred.
    pub least_sharper: f64,
    /// A place nearer to the origin than this is no other, metres: all else tells posts and
    /// lines as well from as far off.
    pub least_off_m: f64,
    /// Least height of a lidar over the road, metres: an origin that is lower is none's.
    pub least_height_m: f64,
    /// Height over the road at which a lidar is taken to be that shows no beams and is not in
    /// the origin, metres: on the roof of a car.
    pub assumed_height_m: f64,
}

impl Default for PlaceConfig {
    fn default() -> Self {
        Self {
            usual_m: [1.2, 3.0],
            heights_m: [0.5, 4.5],
            farthest_m: [6.0, 1.5],
            nearest_m: 8.0,
            least_sharper: 1.3,
            least_off_m: 0.4,
            least_height_m: 0.35,
            assumed_height_m: 1.8,
        }
    }
}

/// Sectors of the horizon that are looked at one by one: in one of 10 degrees a beam of a
/// lidar that leans by 2 stays within half of what beams are apart.
const SECTORS: usize = 36;
/// Width of a bin, rise per metre along the ground: an eighth of what the beams of an HDL-64E
/// are apart.
const BIN: f64 = 0.0009;
/// Bins over which points lie evenly where they lie on no beams.
const AROUND: usize = 9;
/// Rises that are looked at.
const RISES: [f64; 2] = [-0.35, 0.3];
const BINS: usize = ((RISES[1] - RISES[0]) / BIN) as usize + 1;
/// Steps of the search upwards, metres: beams are sharp within two of them.
const STEP_UP_M: f64 = 0.05;
/// Steps of the search along x and y, metres, at first and then: beams look level there.
const STEPS_ALONG_M: [f64; 2] = [1.0, 0.25];
/// Most points of a scan that are looked at.
const MOST_POINTS: usize = 30_000;

/// Where the lidar is taken to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// In the frame of its scans, metres.
    pub at: Vector3<f64>,
    /// Whether its beams meet there; else it is at the usual height over the road.
    pub shows_beams: bool,
}

/// Where the lidar is, if not in the origin of its scans, as far as can be told.
pub(super) fn of(scans: &[LidarScan], lidar: &LidarConfig) -> Option<Place> {
    let config = &lidar.place;
    let [lowest_m, highest_m] = config.usual_m;
    let mut roads_m: Vec<f64> = scans.iter().filter_map(|scan| road_m(&scan.points, &lidar.measure)).collect();
    let road_m = quantile(&mut roads_m, 0.5)?;
    if (lowest_m..=highest_m).contains(&-road_m) {
        return None;
    }
    if let Some(at) = apex(scans, road_m, config) {
        // Beams come from the origin of a lidar, or from its apex over it.
        let off_m = (at.z - lidar.apex_m.max(0.0)).max(lidar.apex_m.min(0.0) - at.z);
        return (at.xy().norm().max(off_m) > config.least_off_m).then_some(Place { at, shows_beams: true });
    }
    let at = Vector3::new(0.0, 0.0, road_m + config.assumed_height_m);
    (-road_m < config.least_height_m).then_some(Place { at, shows_beams: false })
}

/// The height of the road near the vehicle, metres in the frame of a scan.
fn road_m(points: &[Point3<f64>], config: &MeasureConfig) -> Option<f64> {
    road_heights_m(points, config, HIGHEST_ROAD_M).map(|heights_m| f64::midpoint(*heights_m.start(), *heights_m.end()))
}

/// A road lies no higher than so over the origin of scans, metres.
const HIGHEST_ROAD_M: f64 = 2.0;

/// Where the beams of scans meet, metres in their frame; none where they are nowhere sharp.
fn apex(scans: &[LidarScan], road_m: f64, config: &PlaceConfig) -> Option<Vector3<f64>> {
    let scans: Vec<Vec<Seen>> = scans.iter().map(|scan| Seen::of(&scan.points)).collect();
    let heights_m = config.heights_m.map(|height_m| road_m + height_m);
    let [far_x_m, far_y_m] = config.farthest_m;
    let sharpness_of = |places: Vec<Vector3<f64>>| -> Vec<(f64, Vector3<f64>)> {
        places.into_par_iter().map(|at| (sharpness(&scans, &at, config.nearest_m), at)).collect()
    };
    let sharpest = |of: &[(f64, Vector3<f64>)]| of.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0));
    let upwards = |x: f64, y: f64| steps(heights_m, STEP_UP_M).map(move |z| Vector3::new(x, y, z));
    let [coarse_m, fine_m] = STEPS_ALONG_M;

    let ahead = steps([-far_x_m, far_x_m], coarse_m);
    // The origin may be that of a small robot's lidar.
    let origin = (-road_m >= config.least_height_m).then(Vector3::zeros);
    let all = sharpness_of(ahead.flat_map(|x| upwards(x, 0.0)).chain(origin).collect());
    let elsewhere = quantile(&mut all.iter().map(|(sharpness, _)| *sharpness).collect::<Vec<_>>(), 0.5)?;
    let (_, first) = sharpest(&all)?;
    let around = steps([first.x - coarse_m, first.x + coarse_m], fine_m)
        .flat_map(|x| steps([-far_y_m, far_y_m], fine_m).map(move |y| Vector3::new(x, y, first.z)));
    let (_, beside) = sharpest(&sharpness_of(around.collect()))?;
    // The height of the origin is none of the steps.
    let over = upwards(beside.x, beside.y).chain([beside]);
    let (most, at) = sharpest(&sharpness_of(over.collect()))?;
    (most > config.least_sharper * elsewhere).then_some(at)
}

/// Values from one to another.
fn steps([from, to]: [f64; 2], step: f64) -> impl Iterator<Item = f64> {
    let count = ((to - from) / step).max(0.0).round() as usize;
    (0..=count).map(move |i| from + step * i as f64)
}

/// A point of a scan, metres, and the sector of the horizon that it is in.
#[derive(Debug, Clone, Copy)]
struct Seen {
    at: Point3<f64>,
    sector: usize,
}

impl Seen {
    fn of(points: &[Point3<f64>]) -> Vec<Self> {
        let every = points.len().div_ceil(MOST_POINTS).max(1);
        let sector = |p: &Point3<f64>| ((p.y.atan2(p.x) / (2.0 * PI) + 0.5) * SECTORS as f64) as usize % SECTORS;
        points.iter().step_by(every).map(|p| Self { at: *p, sector: sector(p) }).collect()
    }
}

/// How many times as often two points of a sector have one rise, seen from a place, as if
/// they were spread over the rises around it: 1 where they lie on no beams.
fn sharpness(scans: &[Vec<Seen>], from: &Vector3<f64>, nearest_m: f64) -> f64 {
    let (mut pairs, mut spread_pairs) = (0.0, 0.0);
    let mut counts = vec![0_u32; SECTORS * BINS];
    for scan in scans {
        counts.fill(0);
        for seen in scan {
            let [x, y, z] = (seen.at.coords - from).into();
            let level_2 = x * x + y * y;
            if level_2 < nearest_m * nearest_m {
                continue;
            }
            let bin = (z / level_2.sqrt() - RISES[0]) / BIN;
            if bin >= 0.0 && bin < BINS as f64 {
                counts[seen.sector * BINS + bin as usize] += 1;
            }
        }
        for counts in counts.chunks_exact(BINS) {
            pairs += counts.iter().map(|n| f64::from(n * n.saturating_sub(1))).sum::<f64>();
            let around = |counts: &[u32]| f64::from(counts.iter().sum::<u32>());
            let squares: f64 = counts.windows(AROUND).map(|counts| around(counts) * (around(counts) - 1.0)).sum();
            spread_pairs += squares / (AROUND * AROUND) as f64;
        }
    }
    if spread_pairs > 0.0 { pairs / spread_pairs } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A scan from 1.7 m over a level road between walls 9 m to the left and 14 m to the
    /// right, by 40 beams, in the frame of the lidar.
    fn street() -> Vec<Point3<f64>> {
        let hit = |beam: i32, i: i32| {
            let ((sin, cos), rise) = ((f64::from(i) * 0.004).sin_cos(), -0.25 + 0.0073 * f64::from(beam));
            let wall_m = if sin > 0.0 { 9.0 / sin } else { -14.0 / sin };
            let level_m = if rise < 0.0 { wall_m.min(-1.7 / rise) } else { wall_m }.min(60.0);
            Point3::new(level_m * cos, level_m * sin, level_m * rise)
        };
        (0..40).flat_map(|beam| (1..1570).map(move |i| hit(beam, i))).collect()
    }

    fn place_in(points: Vec<Point3<f64>>) -> Option<Place> {
        of(&[LidarScan { points, ..LidarScan::default() }], &LidarConfig { apex_m: 0.0, ..LidarConfig::default() })
    }

    #[test]
    fn scans_of_the_lidars_own_frame_are_left_alone() {
        assert_eq!((place_in(street()), place_in(Vec::new())), (None, None));
        // On a small robot.
        let low = street().into_iter().map(|p| p * (0.6 / 1.7)).collect();
        assert_eq!(place_in(low), None);
    }

    #[test]
    fn without_beams_the_lidar_is_taken_to_be_on_the_roof() {
        // Strewn over the road and the walls, as evenly as irrational steps do.
        let part = |i: i32, step: f64| (f64::from(i) * step).fract();
        let strewn = |i: i32| {
            let (along, other) = (80.0 * part(i, 0.754_877_666_246_692_8) - 40.0, part(i, 0.569_840_290_998_053_2));
            match i % 4 {
                0 => Point3::new(along, 9.0, 6.0 * other),
                1 => Point3::new(along, -14.0, 6.0 * other),
                _ => Point3::new(along, 23.0 * other - 14.0, 0.04 * part(i, 0.618_033_988_749_895)),
            }
        };
        let place = place_in((0..60_000).map(strewn).collect()).unwrap();
        assert!(!place.shows_beams && (place.at.z - 1.8).abs() < 0.25 && place.at.x.abs() < 1e-9, "{place:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8))]
        #[test]
        fn beams_meet_where_the_lidar_is(x in -2.0_f64..4.0, y in -0.8_f64..0.8, above_road_m in -0.3_f64..0.5) {
            let at = Vector3::new(x, y, 1.7 + above_road_m);
            let place = place_in(street().into_iter().map(|p| p + at).collect()).unwrap();
            let off = place.at - at;
            prop_assert!(place.shows_beams && off.z.abs() < 0.1 && off.xy().norm() < 0.6, "{place:?} {at:?}");
        }
    }
}
