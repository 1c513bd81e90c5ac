//! What single scans can see of a plate: up to where their beams reach, and what
//! hides it from them.

use nalgebra::{Point2, Vector2};
use rayon::prelude::*;

use super::rows::Row;
use crate::cloud::Cloud;
use crate::lidar::LidarConfig;
use crate::looks::{LookConfig, SECTORS, sector};

/// A stitched cloud with the hits of its scans by direction.
pub struct Views<'a> {
    /// The cloud.
    pub cloud: &'a Cloud,
    /// The lidar that its scans are of.
    pub lidar: &'a LidarConfig,
    /// Hits nearer than this to a plate may be on it, metres.
    within_m: f64,
    /// Scan and sector of the horizon of each hit that may hide a plate, and which it
    /// is of the points of the cloud; ascending.
    hits: Vec<(u32, u32)>,
}

/// What is lower above the ground hides no plate, metres: beams rise from the lidar to
/// most plates, and on a slope they fall little.
const LOWEST_M: f32 = 1.0;

impl<'a> Views<'a> {
    /// The views of a cloud.
    pub fn new(cloud: &'a Cloud, config: &LookConfig, lidar: &'a LidarConfig) -> Self {
        let direction = |i: usize| {
            let p = &cloud.points[i];
            let sensor = cloud.sensors[usize::from(p.scan)].at_map;
            let off = Vector2::new(p.position.x - sensor.x, p.position.z - sensor.z);
            (key(p.scan, sector(&off)), i as u32)
        };
        let is_high = |i: &usize| cloud.points[*i].height_m > LOWEST_M;
        let mut hits: Vec<(u32, u32)> =
            (0..cloud.points.len()).into_par_iter().filter(is_high).map(direction).collect();
        hits.par_sort_unstable();
        Self { cloud, lidar, within_m: config.within_m, hits }
    }

    /// Height up to which the scan of a row sees there, along -y of the map, metres.
    pub fn ceiling(&self, row: &Row) -> f64 {
        let sensor = &self.cloud.sensors[usize::from(row.scan)];
        sensor.view_along(&row.view, row.range_m, self.lidar).ceiling(self.lidar)
    }

    /// Share of the beams of a scan that something nearer takes, of those that would
    /// meet a plate at map (x, z) so far to both sides and between two heights (along
    /// -y of the map), metres.
    pub fn hidden_share(&self, scan: u16, at: &Point2<f64>, half_m: f64, (low, high): (f64, f64)) -> f64 {
        let mut eye = self.cloud.sensors[usize::from(scan)].at_map;
        eye.y -= self.lidar.apex_m;
        let off = Vector2::new(at.x - eye.x, at.y - eye.z);
        let distance_m = off.norm();
        let Some(view) = off.try_normalize(self.within_m) else { return 0.0 };
        let steps = |length_m: f64, step_rad: f64| length_m.max(0.0) / (distance_m * step_rad);
        let beams = steps(2.0 * half_m, self.lidar.azimuth_step_rad) * steps(high - low, self.lidar.elevation_step_rad);
        let takes = |i: &(u32, u32)| {
            let ray = self.cloud.points[i.1 as usize].position - eye;
            let off = Vector2::new(ray.x, ray.z);
            let along_m = off.dot(&view);
            let scale = distance_m / along_m;
            along_m > 0.0
                && along_m < distance_m - self.within_m
                && (view.perp(&off) * scale).abs() <= half_m
                && (low..=high).contains(&-(eye.y + ray.y * scale))
        };
        let aside = Vector2::new(-view.y, view.x) * (half_m / distance_m);
        let (first, last) = (sector(&(view - aside)), sector(&(view + aside)));
        let sectors = (0..=(last + SECTORS - first) % SECTORS).map(|k| (first + k) % SECTORS);
        let taken: usize = sectors.map(|k| self.of_sector(key(scan, k)).iter().filter(|i| takes(i)).count()).sum();
        if beams > 0.0 { (taken as f64 / beams).min(1.0) } else { 0.0 }
    }

    fn of_sector(&self, key: u32) -> &[(u32, u32)] {
        let start = self.hits.partition_point(|(k, _)| *k < key);
        let hits = &self.hits[start..];
        &hits[..hits.partition_point(|(k, _)| *k == key)]
    }
}

fn key(scan: u16, sector: usize) -> u32 {
    u32::from(scan) * SECTORS as u32 + sector as u32
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::testing::{CAMERA_HEIGHT_M, Street};

    #[test]
    fn what_is_before_a_plate_hides_it_and_what_is_on_it_or_behind_it_does_not() {
        let lidar = LidarConfig::default();
        let plate = Point3::new(4.0, CAMERA_HEIGHT_M - 2.5, 20.0);
        let eye = Point3::new(0.0, -lidar.apex_m, 0.0);
        // Every beam of the first scan through the plate's left half ends at so much of the way.
        let hidden = |share: f64| {
            let mut street = Street::new();
            for (k, i) in (0..6).flat_map(|k| (-4..=4).map(move |i| (k, i))) {
                let range_m = plate.coords.norm();
                let across = -(f64::from(k) + 0.5) * lidar.azimuth_step_rad * range_m;
                let up = f64::from(i) * lidar.elevation_step_rad * range_m;
                street.add(eye + (plate + Vector3::new(across, -up, 0.0) - eye) * share, 0, 0.4, None);
            }
            let cloud = street.cloud();
            let views = Views::new(&cloud, &LookConfig::default(), &lidar);
            let of_scan = |scan: u16| {
                views.hidden_share(scan, &Point2::new(plate.x, plate.z), 0.3, (-plate.y - 0.3, -plate.y + 0.3))
            };
            (of_scan(0), of_scan(1))
        };
        let (before, of_another) = hidden(0.7);
        assert!((before - 0.5).abs() < 0.15 && of_another == 0.0, "{before} {of_another}");
        assert_eq!((hidden(1.0).0, hidden(1.5).0), (0.0, 0.0));
    }
}
