//! Retro-reflective plates: clusters of points on which the lidar saturates.

use common::map::SignKind;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Point2, Point3, Vector3};
use parry3d::transformation::try_convex_hull;

use super::FoundSign;
use super::config::SignConfig;
use crate::cloud::{Cloud, CloudPoint};
use crate::lidar::LidarConfig;
use crate::sheeting::Glance;

/// A retro-reflective plate and where its bright points lie.
#[derive(Debug, Clone)]
pub struct BrightPlate {
    /// As it is by its bright points alone.
    pub sign: FoundSign,
    /// Heights of its lowest and highest point, along -y of the map, metres.
    pub heights: (f64, f64),
    /// Height of its lowest point above ground, metres.
    pub above_ground_m: f64,
}

/// The retro-reflective plates of a stitched cloud, in the order of their first
/// points.
pub fn bright_plates(cloud: &Cloud, config: &SignConfig, lidar: &LidarConfig) -> Vec<BrightPlate> {
    let bright: Vec<&CloudPoint> = cloud
        .points
        .iter()
        .filter(|p| p.reflectance >= config.least_reflectance && f64::from(p.height_m) >= config.lowest_m)
        .collect();
    clusters(&bright, config.join_m)
        .iter()
        .flat_map(|c| plates(c, config, lidar))
        .filter(|c| {
            let (seen, bright) = (glances(c, cloud), config.least_reflectance);
            bright_share(c, &seen) >= config.least_bright_share
                && lidar.sheeting.saturates(&seen, bright)
                && lidar.sheeting.is_steady(&seen, bright)
        })
        .filter(|c| following(c, cloud) <= config.largest_following)
        .filter_map(|c| {
            let heights = c.iter().map(|p| -p.position.y);
            Some(BrightPlate {
                sign: sign(&c, config)?,
                heights: (heights.clone().fold(f64::INFINITY, f64::min), heights.fold(f64::NEG_INFINITY, f64::max)),
                above_ground_m: c.iter().map(|p| f64::from(p.height_m)).fold(f64::INFINITY, f64::min),
            })
        })
        .collect()
}

/// The plates of a cluster, one above the other on one post: between them is a
/// gap that is wider than that between two beams.
fn plates<'a>(cluster: &[&'a CloudPoint], config: &SignConfig, lidar: &LidarConfig) -> Vec<Vec<&'a CloudPoint>> {
    let mut points = cluster.to_vec();
    points.sort_by(|a, b| a.position.y.total_cmp(&b.position.y));
    let nearest_m = points.iter().map(|p| f64::from(p.range_m)).fold(f64::INFINITY, f64::min);
    let gap_m = config.plate_gap_m.max(1.2 * nearest_m * lidar.elevation_step_rad);
    points.chunk_by(|a, b| b.position.y - a.position.y < gap_m).map(<[_]>::to_vec).collect()
}

/// Groups of points joined by steps of at most `join_m`.
pub(crate) fn clusters<'a>(points: &[&'a CloudPoint], join_m: f64) -> Vec<Vec<&'a CloudPoint>> {
    let places: Vec<[f64; 3]> = points.iter().map(|p| p.position.coords.into()).collect();
    // No points have no tree, and no clusters.
    let Ok(tree) = ImmutableKdTree::<f64, 3>::new_from_slice(&places) else { return Vec::new() };
    let mut group = vec![usize::MAX; points.len()];
    let mut groups: Vec<Vec<&CloudPoint>> = Vec::new();
    for seed in 0..points.len() {
        if group[seed] != usize::MAX {
            continue;
        }
        let name = groups.len();
        let mut members = Vec::new();
        let mut open = vec![seed];
        group[seed] = name;
        while let Some(i) = open.pop() {
            members.push(points[i]);
            let near = tree.query(&places[i]).within::<SquaredEuclidean<f64>>(join_m * join_m).unsorted().execute();
            for near in near {
                let j = near.item as usize;
                if group[j] == usize::MAX {
                    group[j] = name;
                    open.push(j);
                }
            }
        }
        groups.push(members);
    }
    groups
}

/// What all scans saw in the box around a cluster.
fn glances(cluster: &[&CloudPoint], cloud: &Cloud) -> Vec<Glance> {
    let first = cluster[0].position;
    let (low, high) =
        cluster.iter().fold((first, first), |(low, high), p| (low.inf(&p.position), high.sup(&p.position)));
    let middle = Point2::new(f64::midpoint(low.x, high.x), f64::midpoint(low.z, high.z));
    cloud.glances(&middle, |p| p.position >= low && p.position <= high)
}

/// Share of bright points among what its own scans saw in the box around a cluster.
fn bright_share(cluster: &[&CloudPoint], seen: &[Glance]) -> f64 {
    let mut scans: Vec<u16> = cluster.iter().map(|p| p.scan).collect();
    scans.sort_unstable();
    scans.dedup();
    let inside = seen.iter().filter(|glance| scans.binary_search(&glance.scan).is_ok()).count();
    cluster.len() as f64 / inside.max(1) as f64
}

/// Motion of a cluster between its first and its last scan along the lidar's
/// own motion, over that motion; 0 where the lidar hardly moved.
fn following(cluster: &[&CloudPoint], cloud: &Cloud) -> f64 {
    let scans = cluster.iter().map(|p| p.scan);
    let (Some(first), Some(last)) = (scans.clone().min(), scans.max()) else { return 0.0 };
    let centre = |scan: u16| {
        let of: Vec<Vector3<f64>> = cluster.iter().filter(|p| p.scan == scan).map(|p| p.position.coords).collect();
        of.iter().sum::<Vector3<f64>>() / of.len() as f64
    };
    let driven = cloud.sensors[usize::from(last)].at_map - cloud.sensors[usize::from(first)].at_map;
    if driven.norm() < LEAST_DRIVEN_M {
        return 0.0;
    }
    (centre(last) - centre(first)).dot(&driven) / driven.norm_squared()
}

/// Motion of the lidar over which a moving object can be told, metres.
const LEAST_DRIVEN_M: f64 = 0.8;

fn sign(points: &[&CloudPoint], config: &SignConfig) -> Option<FoundSign> {
    let mut scans: Vec<u16> = points.iter().map(|p| p.scan).collect();
    scans.sort_unstable();
    scans.dedup();
    if points.len() < config.fewest_points || scans.len() < config.fewest_scans {
        return None;
    }
    let places: Vec<Point3<f64>> = points.iter().map(|p| p.position).collect();
    let moments = crate::voxel::voxel_moments(&places, 1e4).into_iter().reduce(|a, b| a.merged(&b))?;
    let (sigma, axes) = moments.axes();
    // A plate is thin; the beam's range error on sheeting spreads it along
    // the view, so its plane is looked for among the horizontal directions.
    if sigma[2] > config.thickest_m {
        return None;
    }
    let size_m = largest_distance(&places, &axes[2]);
    (config.smallest_m..=config.largest_m).contains(&size_m).then(|| FoundSign {
        kind: SignKind::TrafficSign,
        centroid: centre(&places, &axes[2]),
        size_m,
        points: points.len(),
        scans: scans.len(),
        facing: None,
        sigma_m: None,
    })
}

/// Centre of the box around the points in the plane of the sign: beams fall
/// on it unevenly, so the mean of the hits is not its middle.
fn centre(points: &[Point3<f64>], normal: &Vector3<f64>) -> Point3<f64> {
    let up = -Vector3::y();
    let across = normal.cross(&up).try_normalize(1e-6).unwrap_or_else(Vector3::x);
    let middle = |axis: &Vector3<f64>| {
        let mut t: Vec<f64> = points.iter().map(|p| p.coords.dot(axis)).collect();
        t.sort_by(f64::total_cmp);
        // The outermost few per cent may be mixed echoes.
        let cut = t.len() / 50;
        f64::midpoint(t[cut], t[t.len() - 1 - cut])
    };
    let deep = across.cross(&up);
    let mut depth: Vec<f64> = points.iter().map(|p| p.coords.dot(&deep)).collect();
    depth.sort_by(f64::total_cmp);
    Point3::from(across * middle(&across) + up * middle(&up) + deep * depth[depth.len() / 2])
}

/// Largest distance of two points, across the view errors along `normal`:
/// both lie on the convex hull.
fn largest_distance(points: &[Point3<f64>], normal: &Vector3<f64>) -> f64 {
    let flat: Vec<Point3<f64>> = points.iter().map(|p| p - normal * p.coords.dot(normal)).collect();
    let vectors: Vec<_> = points.iter().map(|p| <[f64; 3]>::from(p.coords).into()).collect();
    // Points in one plane have no hull in space: then all of them are compared.
    let hull: Vec<Point3<f64>> = match try_convex_hull(&vectors) {
        Ok((corners, _)) => corners
            .into_iter()
            .map(|c| Point3::from(Vector3::new(c.x, c.y, c.z)))
            .map(|p| p - normal * p.coords.dot(normal))
            .collect(),
        Err(_) => flat,
    };
    let mut largest = 0.0_f64;
    for (i, a) in hull.iter().enumerate() {
        for b in &hull[i + 1..] {
            largest = largest.max((a - b).norm());
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plate(scans: u16) -> Vec<CloudPoint> {
        let mut points = Vec::new();
        for scan in 0..scans {
            for i in 0..7 {
                for k in 0..7 {
                    points.push(CloudPoint {
                        position: Point3::new(
                            5.0 + f64::from(i) * 0.1,
                            -1.0 + f64::from(k) * 0.1,
                            30.0 + 0.01 * f64::from((i * k + i32::from(scan)) % 3),
                        ),
                        height_m: 2.0,
                        reflectance: 0.95,
                        range_m: 20.0,
                        contrast: None,
                        scan,
                    });
                }
            }
        }
        points
    }

    fn found(points: &[CloudPoint]) -> Vec<FoundSign> {
        let config = SignConfig::default();
        let refs: Vec<&CloudPoint> = points.iter().collect();
        clusters(&refs, config.join_m).iter().filter_map(|c| sign(c, &config)).collect()
    }

    #[test]
    fn a_plate_has_its_centre_and_its_diagonal() {
        let signs = found(&plate(3));
        assert_eq!(signs.len(), 1);
        assert!((signs[0].centroid - Point3::new(5.3, -0.7, 30.01)).norm() < 0.02);
        assert!((signs[0].size_m - 0.6 * 2.0_f64.sqrt()).abs() < 0.02);
    }

    #[test]
    fn what_one_scan_saw_is_no_sign() {
        assert!(found(&plate(1)).is_empty());
        assert!(found(&[]).is_empty());
    }

    #[test]
    fn two_plates_on_one_post_are_two() {
        let (upper, mut lower) = (plate(3), plate(3));
        for p in &mut lower {
            p.position.y += 0.85;
        }
        let both: Vec<&CloudPoint> = upper.iter().chain(&lower).collect();
        let config = SignConfig::default();
        let joined = clusters(&both, config.join_m);
        assert_eq!(joined.len(), 1);
        assert_eq!(plates(&joined[0], &config, &LidarConfig::default()).len(), 2);
        assert_eq!(plates(&joined[0], &SignConfig { plate_gap_m: 0.3, ..config }, &LidarConfig::default()).len(), 1);
    }
}
