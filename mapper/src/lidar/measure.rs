//! What scans show of the lidar that took them: few users know its beams by heart, and
//! all that is told by how many hits a thing should have hangs on them.

use std::f64::consts::{FRAC_PI_2, PI};
use std::ops::RangeInclusive;

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::place::{self, Place};
use super::{IntensityConfig, LidarConfig, intensity};
use crate::drive::Drive;
use crate::error::Result;
use crate::quantile::quantile;
use crate::scan::LidarScan;

/// How the beams are measured, and from when on they are others than was said.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MeasureConfig {
    /// Whether scans that contradict what is said of the lidar are believed.
    pub is_on: bool,
    /// Scans of a drive that are measured, from its first to its last: its ends may be in
    /// a garage.
    pub scans: usize,
    /// Share of the points below which only strays lie.
    pub below_lowest: f64,
    /// The same of the far ones above the highest beam: it meets something in few directions.
    pub above_highest: f64,
    /// Nearest points that are looked at, metres along the ground: nearer ones are of the
    /// vehicle, and show the place of the beams' apex rather than their directions.
    pub nearest_m: f64,
    /// How high it looks is told by points that are as far, metres along the ground: an
    /// apex that is off by 0.2 m turns them by no more than `higher_by_rad`.
    pub far_m: f64,
    /// Elevations between which beams are counted, radians: from 14 to 4 degrees below
    /// the horizon they meet the ground 7 to 25 m from a car.
    pub band_rad: [f64; 2],
    /// Width of the sectors of the horizon that are counted one by one, radians: so
    /// narrow that a beam is level in it.
    pub sector_rad: f64,
    /// Fewest points of a scan that tell anything: 16 beams give 20,000 a turn.
    pub fewest_points: usize,
    /// Beams, or the points along them, are others than was said where they are so many
    /// times as far apart, or as close: KITTI's scans show them within 8 %.
    pub most_times: f64,
    /// It looks higher than was said where it does by this, radians: three beams of an
    /// HDL-64E. Where it seems to look less high nothing may have been there.
    pub higher_by_rad: f64,
    /// It looks less far down, or farther, by this, radians: the lower half of the beams
    /// of an HDL-64E come from below the apex of the upper, which looks like half of it.
    pub lower_by_rad: f64,
    /// How far away the road is looked at, metres along the ground: beyond it beams graze.
    pub road_m: [f64; 2],
    /// Half the thickness of the road there, metres: it rises and falls.
    pub road_within_m: f64,
    /// Share of the points that are brighter than what is bright: sheeting and glints are
    /// fewer.
    pub bright_share: f64,
    /// The road, or what is bright, is so many times as bright as was said, or as dark,
    /// to another lidar: to KITTI's it is within 1.5 from place to place.
    pub most_times_as_bright: f64,
    /// A lidar to which the road is less than such a share of what is bright is calibrated:
    /// to KITTI's it is half, to others a fifth, for beams graze it.
    pub calibrated_road_share: f64,
}

impl Default for MeasureConfig {
    fn default() -> Self {
        Self {
            is_on: true,
            scans: 3,
            below_lowest: 0.002,
            above_highest: 0.001,
            nearest_m: 1.5,
            far_m: 10.0,
            band_rad: [-0.244, -0.07],
            sector_rad: 0.035,
            fewest_points: 10_000,
            most_times: 1.25,
            higher_by_rad: 0.02,
            lower_by_rad: 0.08,
            road_m: [4.0, 20.0],
            road_within_m: 0.2,
            bright_share: 0.02,
            most_times_as_bright: 1.6,
            calibrated_road_share: 0.4,
        }
    }
}

/// Steps that beams, and the points along them, may have, radians: those of settings.
const STEPS_RAD: RangeInclusive<f64> = 1e-5..=0.2;

/// Points along beams that seem to be so many times as far apart as the beams lie on none:
/// something scatters them, by 2 cm even where they are 5 m away.
const MOST_ALONG: f64 = 8.0;

/// What a scan shows, all in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Shown {
    azimuth_step: f64,
    elevation_step: f64,
    highest: f64,
    lowest: f64,
}

/// The lidar of a drive: as was said, but for what its scans contradict. The drive's notes
/// then say what was taken instead, and its points are put into the order of those beams.
///
/// # Errors
/// Where a scan cannot be read.
pub fn measured(drive: &mut Drive, said: &LidarConfig) -> Result<LidarConfig> {
    let MeasureConfig { is_on, scans, .. } = said.measure;
    // One tells the order of the points.
    let (scans, last) = (if is_on { scans } else { 1 }, drive.frames.len().saturating_sub(1));
    let step = last / scans.saturating_sub(1).max(1);
    let frames: Vec<usize> = drive.frames.iter().copied().step_by(step.max(1)).take(scans).collect();
    drive.put_lidar_at(said.at_m);
    let mut scans: Vec<LidarScan> = frames.iter().map(|frame| drive.read(*frame, 0.0)).collect::<Result<_>>()?;
    let mut lidar = if is_on { with_place(&mut scans, drive, said) } else { *said };
    if is_on && drive.has_single_scans() {
        lidar = with_beams(&scans, drive, &lidar);
    }
    let is_in_order = scans.first().map_or(Ok(true), |scan| drive.put_lidar(&lidar, scan))?;
    if !is_in_order {
        drive.notes.push("the points of the scans are put into the order of the beams".into());
    }
    if are_alike(&scans, said.measure.fewest_points) {
        drive.notes.push(
            "the scans have no intensities, or all alike: lane lines cannot be found, and signs by their shape alone"
                .into(),
        );
        drive.put_full_scale(f32::INFINITY);
    } else if is_on {
        lidar.intensity = intensities(&scans, drive, said);
    } else {
        drive.put_full_scale(lidar.intensity.times_as_bright());
    }
    Ok(lidar)
}

/// The lidar with the place that its scans show, from which these are then seen.
fn with_place(scans: &mut [LidarScan], drive: &mut Drive, said: &LidarConfig) -> LidarConfig {
    let Some(Place { at, shows_beams }) = place::of(scans, said) else { return *said };
    scans.iter_mut().flat_map(|scan| &mut scan.points).for_each(|p| *p -= at);
    let at_m: [f64; 3] = (Vector3::from(said.at_m) + at).into();
    let [x, y, z] = at_m;
    let why =
        if shows_beams { "where its beams meet" } else { "at the usual height over the road, for it shows no beams" };
    drive.notes.push(format!(
        "the origin of the scans is not the lidar: that is taken to be at ({x:.2}, {y:.2}, {z:.2}) m, {why}; say \
         `lidar.at_m` if it is elsewhere"
    ));
    LidarConfig { at_m, apex_m: 0.0, ..*said }
}

/// The lidar with the beams that its scans show.
fn with_beams(scans: &[LidarScan], drive: &mut Drive, said: &LidarConfig) -> LidarConfig {
    let by = |said: &LidarConfig| {
        let shown: Vec<Shown> = scans.iter().filter_map(|scan| Shown::by(&scan.points, said)).collect();
        Shown::middle(&shown)?.against(said)
    };
    let Some(mut lidar) = by(said) else { return *said };
    // Nearly all others than the HDL-64E of KITTI have their beams from their origin.
    let has_other_beams = (lidar.elevation_step_rad - said.elevation_step_rad).abs() > f64::EPSILON;
    if has_other_beams {
        lidar = by(&LidarConfig { apex_m: 0.0, ..*said }).unwrap_or(lidar);
    }
    let [low, high, apart, along] =
        [lidar.lowest_rad, lidar.highest_rad, lidar.elevation_step_rad, lidar.azimuth_step_rad].map(f64::to_degrees);
    drive.notes.push(format!(
        "the scans show another lidar than `[lidar]` says: it looks from {low:.1} to {high:.1} degrees, with beams {apart:.2} \
         degrees apart and a point every {along:.2}; that is taken, unless `lidar.measure.is_on = false`"
    ));
    lidar
}

/// Whether all intensities are one: converters write 0 or 1 where they have none.
fn are_alike(scans: &[LidarScan], fewest_points: usize) -> bool {
    let mut all =
        scans.iter().filter(|scan| scan.reflectance.len() >= fewest_points).flat_map(|scan| &scan.reflectance);
    all.next().is_some_and(|first| all.all(|other| other.to_bits() == first.to_bits()))
}

/// The intensities that the scans of a drive show, to which it is told how to bring them.
fn intensities(scans: &[LidarScan], drive: &mut Drive, said: &LidarConfig) -> IntensityConfig {
    let reflectances = scans.iter().flat_map(|scan| &scan.reflectance);
    let full = intensity::full_scale(reflectances.copied().fold(0.0, f32::max));
    if full > 1.0 {
        drive.notes.push(format!("an intensity of {full} counts as a reflectance of 1"));
    }
    let shown = intensity::against(scans, full, &said.intensity, &said.measure);
    if let Some(IntensityConfig { road, bright }) = shown {
        drive.notes.push(format!(
            "the scans show other intensities than `[lidar]` says: the road reflects {road:.3} and what is bright {bright:.2}; \
             they are brought to those of KITTI's lidar, unless `lidar.measure.is_on = false`"
        ));
    }
    let intensity = shown.unwrap_or(said.intensity);
    drive.put_full_scale(full * intensity.times_as_bright());
    intensity
}

impl Shown {
    /// What the points of a scan (lidar frame, metres) show; none where these are too few.
    fn by(points: &[Point3<f64>], said: &LidarConfig) -> Option<Self> {
        let config = &said.measure;
        let [low, high] = config.band_rad.map(f64::tan);
        let count = (2.0 * PI / config.sector_rad).ceil() as usize;
        let sector_rad = 2.0 * PI / count as f64;
        let (mut all, mut far) = (Vec::with_capacity(points.len()), Vec::with_capacity(points.len()));
        let mut sectors: Vec<Vec<f64>> = vec![Vec::new(); count];
        for p in points {
            // Metres of a lidar neither overflow nor vanish when squared.
            let level_m = (p.x * p.x + p.y * p.y).sqrt();
            if level_m < config.nearest_m {
                continue;
            }
            let rise = (p.z - said.apex_m) / level_m;
            all.push(rise);
            if level_m >= config.far_m {
                far.push(rise);
            }
            if rise > low && rise < high {
                let sector = ((p.y.atan2(p.x) + PI) / sector_rad) as usize;
                sectors[sector.min(count - 1)].push(rise.atan());
            }
        }
        if all.len() < config.fewest_points {
            return None;
        }
        // What stands close hides the ground, and the vehicle some of the horizon.
        let mut counts: Vec<usize> = sectors.iter().map(Vec::len).filter(|n| *n > 0).collect();
        counts.sort_unstable();
        let full = *counts.get(3 * counts.len() / 4)?;
        let full_sectors = sectors.iter_mut().filter(|sector| 2 * sector.len() >= full);
        let mut steps: Vec<f64> = full_sectors.filter_map(|sector| apart(sector)).collect();
        let elevation_step = quantile(&mut steps, 0.5).filter(|step| STEPS_RAD.contains(step))?;
        let per_radian_2 = full as f64 / (sector_rad * (config.band_rad[1] - config.band_rad[0]));
        let azimuth_step = (per_radian_2 * elevation_step).recip();
        let lies_on_beams = azimuth_step < MOST_ALONG * elevation_step;
        (lies_on_beams && STEPS_RAD.contains(&azimuth_step)).then_some(Self {
            azimuth_step,
            elevation_step,
            highest: quantile(&mut far, 1.0 - config.above_highest).map_or(said.highest_rad, f64::atan),
            lowest: quantile(&mut all, config.below_lowest)?.atan(),
        })
    }

    /// What most scans show; the highest that any of them saw.
    fn middle(shown: &[Self]) -> Option<Self> {
        let of = |value: fn(&Self) -> f64| quantile(&mut shown.iter().map(value).collect::<Vec<_>>(), 0.5);
        Some(Self {
            azimuth_step: of(|s| s.azimuth_step)?,
            elevation_step: of(|s| s.elevation_step)?,
            highest: shown.iter().map(|s| s.highest).reduce(f64::max)?,
            lowest: of(|s| s.lowest)?,
        })
    }

    /// What was said, but for what this contradicts; none where that is nothing.
    fn against(&self, said: &LidarConfig) -> Option<LidarConfig> {
        let (config, mut lidar) = (&said.measure, *said);
        let is_other = |shown: f64, said: f64| (shown / said).ln().abs() > config.most_times.ln();
        if is_other(self.elevation_step, said.elevation_step_rad) || is_other(self.azimuth_step, said.azimuth_step_rad)
        {
            (lidar.elevation_step_rad, lidar.azimuth_step_rad) = (self.elevation_step, self.azimuth_step);
        }
        if self.highest > said.highest_rad + config.higher_by_rad {
            lidar.highest_rad = self.highest.min(FRAC_PI_2);
        }
        if (self.lowest - said.lowest_rad).abs() > config.lower_by_rad {
            lidar.lowest_rad = self.lowest;
        }
        (lidar != *said).then_some(lidar)
    }
}

/// How far apart the beams are whose elevations these are, in any order, radians: half of the
/// way from the lowest to the highest is in gaps that are no wider. Those between the
/// points of one beam are many, and no way at all.
fn apart(elevations: &mut [f64]) -> Option<f64> {
    elevations.sort_by(f64::total_cmp);
    let way = elevations.last()? - elevations.first()?;
    let mut gaps: Vec<f64> = elevations.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_by(f64::total_cmp);
    let mut gone = 0.0;
    gaps.into_iter().find(|gap| {
        gone += gap;
        2.0 * gone >= way
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A scan from 1.7 m over level ground in a round court of 20 m, by beams from one
    /// elevation to another, in the order of the beams.
    fn court((lowest, highest): (f64, f64), elevation_step: f64, azimuth_step: f64) -> Vec<Point3<f64>> {
        let beams = ((highest - lowest) / elevation_step).round() as usize;
        let around = (2.0 * PI / azimuth_step) as usize;
        let hit = |beam: usize, i: usize| {
            let rise = (lowest + elevation_step * beam as f64).tan();
            let level_m = if rise < 0.0 { (-1.7 / rise).min(20.0) } else { 20.0 };
            let (sin, cos) = (azimuth_step * i as f64).sin_cos();
            Point3::new(level_m * cos, level_m * sin, level_m * rise)
        };
        (0..=beams).flat_map(|beam| (0..around).map(move |i| hit(beam, i))).collect()
    }

    /// What is said of a lidar whose beams come from its origin.
    fn said() -> LidarConfig {
        LidarConfig { apex_m: 0.0, ..LidarConfig::default() }
    }

    fn taken(points: &[Point3<f64>]) -> Option<LidarConfig> {
        Shown::middle(&[Shown::by(points, &said())?])?.against(&said())
    }

    #[test]
    fn the_lidar_that_is_said_stays_as_it_is_said() {
        let said = said();
        let points = court((said.lowest_rad, said.highest_rad), said.elevation_step_rad, said.azimuth_step_rad);
        assert!(Shown::by(&points, &said).is_some() && taken(&points).is_none());
        // On an open road nothing is as high as it looks.
        let open: Vec<Point3<f64>> = points.into_iter().filter(|p| p.z < 0.0).collect();
        assert!(taken(&open).is_none());
        assert!(taken(&[]).is_none() && taken(&vec![Point3::new(9.0, 0.0, -1.0); 20_000]).is_none());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn another_lidar_is_measured_in_any_order_of_its_points(
            elevation_step in 0.01_f64..0.035, azimuth_step in 0.0015_f64..0.006, up_deg in 8.0_f64..25.0, turn in 0_usize..5000,
        ) {
            let mut points = court((-0.3, up_deg.to_radians()), elevation_step, azimuth_step);
            let turn = turn % points.len();
            points.rotate_left(turn);
            let lidar = taken(&points).unwrap();
            prop_assert!((lidar.elevation_step_rad / elevation_step).ln().abs() < 0.05, "{lidar:?}");
            // Half a beam more or less may lie between the elevations that are counted.
            prop_assert!((lidar.azimuth_step_rad / azimuth_step).ln().abs() < 0.25, "{lidar:?}");
            prop_assert!((lidar.highest_rad - up_deg.to_radians()).abs() < elevation_step);
            prop_assert!((lidar.lowest_rad + 0.3).abs() < 0.01);
        }
    }
}
