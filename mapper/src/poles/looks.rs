//! What moves, told by comparing scans: where something stood in one scan and
//! another looks through, there is no pole.

use nalgebra::{Point2, Point3, Vector2};
use rayon::prelude::*;

use super::{FittedPole, PoleConfig};
use crate::cloud::{Cloud, CloudPoint};
use crate::lidar::LidarConfig;

/// Sectors of the horizon by which the points of a scan find the poles that
/// they may be on or behind.
const SECTORS: usize = 720;

/// One scan's look at a pole.
struct Look {
    pole: usize,
    scan: usize,
    /// Direction from the lidar to the middle of what is seen of it, map (x, z).
    view: Vector2<f64>,
    distance_m: f64,
}

/// What the points of a scan say of a look.
#[derive(Clone, Copy, Default)]
struct Told {
    /// Points on the pole.
    on: u32,
    /// Points behind it whose beams went through it.
    through: u32,
}

/// Points that are looked at together: integers are counted, in whatever order.
const PART: usize = 1 << 16;

/// For each pole the share of the views that looked through it, of all that
/// would have hit it with every beam.
pub(super) fn looked_through(
    cloud: &Cloud,
    poles: &[&FittedPole],
    config: &PoleConfig,
    lidar: &LidarConfig,
) -> Vec<f64> {
    let mut looks: Vec<Look> = Vec::new();
    // By scan and sector: the looks that lie there.
    let mut sectors: Vec<Vec<u32>> = vec![Vec::new(); cloud.sensors.len() * SECTORS];
    for (pole, fitted) in poles.iter().enumerate() {
        let middle = nalgebra::center(&fitted.foot, &fitted.top);
        for (scan, sensor) in cloud.sensors.iter().enumerate() {
            let off = Vector2::new(middle.x - sensor.at_map.x, middle.z - sensor.at_map.z);
            let distance_m = off.norm();
            let every_beam_hits = distance_m * lidar.azimuth_step_rad <= 2.0 * fitted.radius_m;
            let Some(view) = off.try_normalize(config.core_radius_m).filter(|_| every_beam_hits) else { continue };
            let aside = Vector2::new(-view.y, view.x) * (config.core_radius_m / distance_m);
            let name = looks.len() as u32;
            let (first, last) = (sector(&(view - aside)), sector(&(view + aside)));
            for k in 0..=(last + SECTORS - first) % SECTORS {
                sectors[scan * SECTORS + (first + k) % SECTORS].push(name);
            }
            looks.push(Look { pole, scan, view, distance_m });
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
            if behind_m < -config.core_radius_m {
                continue;
            }
            // Where its beam passes the pole.
            let at = sensor + (p.position - sensor) * (look.distance_m / along);
            let pole = poles[look.pole];
            let Some(across_m) = beside_m(pole, &at, look.view) else { continue };
            if behind_m <= config.core_radius_m {
                told.on += u32::from(across_m <= config.core_radius_m);
            } else if behind_m > config.ring_outer_m {
                told.through += u32::from(across_m <= pole.radius_m);
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
    let mut share = vec![(0.0, 0.0); poles.len()];
    for (k, look) in looks.iter().enumerate() {
        let (on, through) = parts.iter().fold((0, 0), |sum, part| (sum.0 + part[k].on, sum.1 + part[k].through));
        let weight = cloud.view_weight[look.scan];
        let (all, looked_through) = &mut share[look.pole];
        if on > 0 {
            *all += weight;
        } else if through >= config.fewest_beams_through {
            *all += weight;
            *looked_through += weight;
        }
    }
    share.into_iter().map(|(all, through)| if all > 0.0 { through / all } else { 0.0 }).collect()
}

/// Distance across the view from the axis of a pole, metres; none above and
/// below what is seen of it.
fn beside_m(pole: &FittedPole, at: &Point3<f64>, view: Vector2<f64>) -> Option<f64> {
    let length_m = pole.foot.y - pole.top.y;
    let up_m = pole.foot.y - at.y;
    if length_m <= 0.0 || up_m < pole.foot_height_m.max(0.2 * length_m) || up_m > length_m {
        return None;
    }
    Some((Point2::new(at.x, at.z) - pole.at_height_of(at)).perp(&view).abs())
}

/// Sector of the horizon that a direction, map (x, z), falls in. They are even
/// on the square whose corners are on the axes: no angle need be computed.
fn sector(direction: &Vector2<f64>) -> usize {
    let share = direction.y / (direction.x.abs() + direction.y.abs());
    let quarters = if direction.x < 0.0 { 3.0 - share } else { 1.0 + share };
    ((quarters / 4.0 * SECTORS as f64) as usize).min(SECTORS - 1)
}
