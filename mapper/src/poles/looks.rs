//! What moves, told by comparing scans: where something stood in one scan and
//! another looks through, there is no pole.

use std::f64::consts::PI;

use nalgebra::{Point3, Vector2};

use super::{FittedPole, PoleConfig};
use crate::cloud::Cloud;
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
    /// Points on it.
    on: u32,
    /// Points behind it whose beams went through it.
    through: u32,
}

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
    let mut sectors: Vec<Vec<u32>> = vec![Vec::new(); cloud.sensor_map.len() * SECTORS];
    for (pole, fitted) in poles.iter().enumerate() {
        let middle = nalgebra::center(&fitted.foot, &fitted.top);
        for (scan, sensor) in cloud.sensor_map.iter().enumerate() {
            let off = Vector2::new(middle.x - sensor.x, middle.z - sensor.z);
            let distance_m = off.norm();
            let every_beam_hits = distance_m * lidar.azimuth_step_rad <= 2.0 * fitted.radius_m;
            let Some(view) = off.try_normalize(config.core_radius_m).filter(|_| every_beam_hits) else { continue };
            let half_rad = (config.core_radius_m / distance_m).atan();
            let azimuth = view.y.atan2(view.x);
            let name = looks.len() as u32;
            let (first, last) = (sector_floor(azimuth - half_rad), sector_floor(azimuth + half_rad));
            for sector in first..=last {
                sectors[scan * SECTORS + sector.rem_euclid(SECTORS as i64) as usize].push(name);
            }
            looks.push(Look { pole, scan, view, distance_m, on: 0, through: 0 });
        }
    }
    for p in &cloud.points {
        let scan = usize::from(p.scan);
        let sensor = cloud.sensor_map[scan];
        let off = Vector2::new(p.position.x - sensor.x, p.position.z - sensor.z);
        let sector = sector_floor(off.y.atan2(off.x)).rem_euclid(SECTORS as i64) as usize;
        for name in &sectors[scan * SECTORS + sector] {
            let look = &mut looks[*name as usize];
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
                look.on += u32::from(across_m <= config.core_radius_m);
            } else if behind_m > config.ring_outer_m {
                look.through += u32::from(across_m <= pole.radius_m);
            }
        }
    }
    let mut share = vec![(0.0, 0.0); poles.len()];
    for look in &looks {
        let weight = cloud.view_weight[look.scan];
        let (all, through) = &mut share[look.pole];
        if look.on > 0 {
            *all += weight;
        } else if look.through >= config.fewest_beams_through {
            *all += weight;
            *through += weight;
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
    let axis = pole.foot + (pole.top - pole.foot) * (up_m / length_m);
    Some(Vector2::new(at.x - axis.x, at.z - axis.z).perp(&view).abs())
}

fn sector_floor(azimuth_rad: f64) -> i64 {
    (azimuth_rad / (2.0 * PI) * SECTORS as f64).floor() as i64
}
