//! What moves, told by comparing scans: where something stood in one scan and
//! another looks through, there is nothing that belongs into a map.

use nalgebra::{Point2, Point3, Vector2};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::cloud::{Cloud, CloudPoint};
use crate::lidar::LidarConfig;

/// How what stands is told from what has moved.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LookConfig {
    /// Hits this near to its middle are on it, metres.
    pub within_m: f64,
    /// Hits farther than this behind it are not on what it is before, metres.
    pub behind_m: f64,
    /// Largest share of the views that look through where it stands, of those from
    /// where every beam would hit it: what most of them look through has moved.
    pub largest_share: f64,
    /// Fewest beams of a scan through a place that tell that nothing stands there: one
    /// or two may be strays.
    pub fewest_beams: u32,
}

impl Default for LookConfig {
    fn default() -> Self {
        Self { within_m: 0.2, behind_m: 0.7, largest_share: 0.5, fewest_beams: 3 }
    }
}

/// Something that beams hit or pass.
pub(crate) trait Stands: Sync {
    /// The middle of what is seen of it, map (x, z).
    fn middle(&self) -> Point2<f64>;

    /// Half of the width that no beam passes, metres.
    fn radius_m(&self) -> f64;

    /// Distance across the view (map x, z, of unit length) from its axis, of the place
    /// where a beam passes it, metres; none above and below what is seen of it.
    fn beside_m(&self, at: &Point3<f64>, view: Vector2<f64>) -> Option<f64>;
}

/// Sectors of the horizon by which the points of a scan find what they may be on or
/// behind.
pub(crate) const SECTORS: usize = 720;

/// One scan's look at something.
struct Look {
    thing: usize,
    scan: usize,
    /// Direction from the lidar to its middle, map (x, z).
    view: Vector2<f64>,
    distance_m: f64,
}

/// What the points of a scan say of a look.
#[derive(Clone, Copy, Default)]
struct Told {
    /// Points on it.
    on: u32,
    /// Points behind it whose beams went through it.
    through: u32,
}

/// Points that are looked at together: integers are counted, in whatever order.
const PART: usize = 1 << 16;

/// Of what may stand that which does: what most views look through, of those that
/// would have hit it with every beam, has moved.
pub(crate) fn standing<T: Stands>(found: Vec<T>, cloud: &Cloud, config: &LookConfig, lidar: &LidarConfig) -> Vec<T> {
    let shares = looked_through(&found, cloud, config, lidar);
    let kept = found.into_iter().zip(shares).filter(|(_, share)| *share <= config.largest_share);
    kept.map(|(thing, _)| thing).collect()
}

/// For each the share of the views that look through it.
fn looked_through<T: Stands>(found: &[T], cloud: &Cloud, config: &LookConfig, lidar: &LidarConfig) -> Vec<f64> {
    let mut looks: Vec<Look> = Vec::new();
    // By scan and sector: the looks that lie there.
    let mut sectors: Vec<Vec<u32>> = vec![Vec::new(); cloud.sensors.len() * SECTORS];
    for (thing, standing) in found.iter().enumerate() {
        let (middle, radius_m) = (standing.middle(), standing.radius_m());
        for (scan, sensor) in cloud.sensors.iter().enumerate() {
            let off = Vector2::new(middle.x - sensor.at_map.x, middle.y - sensor.at_map.z);
            let distance_m = off.norm();
            let every_beam_hits = distance_m * lidar.azimuth_step_rad <= 2.0 * radius_m;
            let Some(view) = off.try_normalize(config.within_m).filter(|_| every_beam_hits) else { continue };
            let aside = Vector2::new(-view.y, view.x) * (config.within_m.max(radius_m) / distance_m);
            let name = looks.len() as u32;
            let (first, last) = (sector(&(view - aside)), sector(&(view + aside)));
            for k in 0..=(last + SECTORS - first) % SECTORS {
                sectors[scan * SECTORS + (first + k) % SECTORS].push(name);
            }
            looks.push(Look { thing, scan, view, distance_m });
        }
    }
    let count = |told: &mut [Told], p: &CloudPoint| {
        let scan = usize::from(p.scan);
        let sensor = cloud.sensors[scan].at_map;
        let off = Vector2::new(p.position.x - sensor.x, p.position.z - sensor.z);
        for name in &sectors[scan * SECTORS + sector(&off)] {
            let (look, told) = (&looks[*name as usize], &mut told[*name as usize]);
            let along = off.dot(&look.view);
            let behind_m = along - look.distance_m;
            let thing = &found[look.thing];
            let radius_m = thing.radius_m();
            let within_m = config.within_m.max(radius_m);
            if behind_m < -within_m {
                continue;
            }
            // Where its beam passes.
            let at = sensor + (p.position - sensor) * (look.distance_m / along);
            let Some(across_m) = thing.beside_m(&at, look.view) else { continue };
            if behind_m <= within_m {
                told.on += u32::from(across_m <= within_m);
            } else if behind_m > config.behind_m {
                told.through += u32::from(across_m <= radius_m);
            }
        }
    };
    let parts: Vec<Vec<Told>> = cloud
        .points
        .par_chunks(PART)
        .map(|part| {
            let mut told = vec![Told::default(); looks.len()];
            for p in part {
                count(&mut told, p);
            }
            told
        })
        .collect();
    let mut share = vec![(0.0, 0.0); found.len()];
    for (k, look) in looks.iter().enumerate() {
        let (on, through) = parts.iter().fold((0, 0), |sum, part| (sum.0 + part[k].on, sum.1 + part[k].through));
        let weight = cloud.view_weight[look.scan];
        let (all, looked_through) = &mut share[look.thing];
        if on > 0 {
            *all += weight;
        } else if through >= config.fewest_beams {
            *all += weight;
            *looked_through += weight;
        }
    }
    share.into_iter().map(|(all, through)| if all > 0.0 { through / all } else { 0.0 }).collect()
}

/// Sector of the horizon that a direction, map (x, z), falls in. They are even
/// on the square whose corners are on the axes: no angle need be computed.
pub(crate) fn sector(direction: &Vector2<f64>) -> usize {
    let share = direction.y / (direction.x.abs() + direction.y.abs());
    let quarters = if direction.x < 0.0 { 3.0 - share } else { 1.0 + share };
    ((quarters / 4.0 * SECTORS as f64) as usize).min(SECTORS - 1)
}
