//! Signs and lights: compact regions to points (section IV.B: the centre of
//! the region).

use common::map::SignKind;
use nalgebra::{Point2, Vector2};

use super::config::SignConfig;
use super::regions::{self, Growth, Region};
use super::{Class, Plane, ProbabilityMaps};
use crate::features::PointFeature;

/// The signs and lights of an image, signs first, each in reading order.
pub fn extract(maps: &ProbabilityMaps, config: &SignConfig) -> Vec<PointFeature> {
    let growth = Growth { threshold: config.threshold, seed: config.seed, min_area_px: config.min_area_px };
    let mut features = Vec::new();
    for (class, kind) in [(Class::Sign, SignKind::TrafficSign), (Class::Light, SignKind::TrafficLight)] {
        let plane = maps.plane(class);
        let regions = regions::grow(plane, &growth);
        features.extend(regions.iter().filter_map(|region| feature(region, plane, kind, config)));
    }
    features
}

fn feature(region: &Region, plane: &Plane, kind: SignKind, config: &SignConfig) -> Option<PointFeature> {
    let (left, top, right, bottom) = region.bounds();
    let extent_px = Vector2::new((right - left + 1) as f64, (bottom - top + 1) as f64);
    let is_compact = region.area as f64 >= config.min_fill * extent_px.x * extent_px.y
        && extent_px.max() <= config.max_aspect * extent_px.min()
        && extent_px.max() <= config.max_extent_px;
    is_compact.then(|| PointFeature {
        kind,
        centre_px: centroid(region, plane),
        extent_px,
        sigma_px: config.sigma_px.hypot(config.sigma_extent_share * extent_px.max()),
        probability: region.probability(),
        is_cut: left == 0 || top == 0 || right + 1 == plane.width() || bottom + 1 == plane.height(),
    })
}

fn centroid(region: &Region, plane: &Plane) -> Point2<f64> {
    let mut sum = Vector2::zeros();
    for run in &region.runs {
        for (x, &value) in (run.start..).zip(&plane.row(run.y)[run.start..run.end]) {
            sum += Vector2::new(x as f64, run.y as f64) * f64::from(value);
        }
    }
    // A region holds its seed, so its mass is positive.
    Point2::from(sum / region.mass as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn maps(value: impl Fn(f64, f64) -> f64) -> ProbabilityMaps {
        let mut maps = ProbabilityMaps::zeros(120, 80);
        let data = (0..120 * 80).map(|i| (255.0 * value((i % 120) as f64, (i / 120) as f64)) as u8).collect();
        maps.set(Class::Sign, Plane::new(120, data).unwrap()).unwrap();
        maps
    }

    fn disc(u: f64, v: f64, radius: f64) -> impl Fn(f64, f64) -> f64 {
        move |x, y| (radius + 0.5 - (x - u).hypot(y - v)).clamp(0.0, 1.0)
    }

    #[test]
    fn the_centre_of_a_disc_is_found_to_a_fraction_of_a_pixel() {
        let signs = extract(&maps(disc(40.3, 30.7, 9.0)), &SignConfig::default());
        assert_eq!(signs.len(), 1);
        assert!((signs[0].centre_px - Point2::new(40.3, 30.7)).norm() < 0.05, "{:?}", signs[0]);
        assert!(!signs[0].is_cut && signs[0].probability > 0.9);
        assert!((signs[0].extent_px - Vector2::new(19.0, 19.0)).norm() < 1.5);
    }

    #[test]
    fn a_disc_at_the_border_is_cut() {
        for (u, v) in [(2.0, 40.0), (117.0, 40.0), (60.0, 3.0), (60.0, 77.0)] {
            let signs = extract(&maps(disc(u, v, 9.0)), &SignConfig::default());
            assert!(signs.len() == 1 && signs[0].is_cut);
        }
    }

    #[test]
    fn eaves_rings_and_specks_are_no_signs() {
        let eave = |x: f64, y: f64| if (20.0..80.0).contains(&x) && (30.0..34.0).contains(&y) { 1.0 } else { 0.0 };
        let arc = |x: f64, y: f64| if ((x - 50.0).hypot(y - 40.0) - 20.0).abs() < 2.0 { 1.0 } else { 0.0 };
        assert!(extract(&maps(eave), &SignConfig::default()).is_empty());
        assert!(extract(&maps(arc), &SignConfig::default()).is_empty());
        assert!(extract(&maps(disc(40.0, 30.0, 1.5)), &SignConfig::default()).is_empty());
        assert!(extract(&maps(|x, y| 0.6 * disc(40.0, 30.0, 9.0)(x, y)), &SignConfig::default()).is_empty());
    }
}
