//! Poles and signs that several passes saw.

use std::cmp::Ordering;

use common::map::{Pole, Sign};
use nalgebra::{Matrix3, Point3};

use super::cluster::{Place, cluster};
use super::weights::{Mean, covariance_m2, information, vote};
use super::{FuseConfig, Fused, Sighting};
use crate::quantile::upper_median;

/// How much less a difference in height counts than one in place when poles are
/// compared: feet are seen as far down as what hides them lets one, while 3 m
/// up, where another road has its poles, make the whole of the default gate.
const HEIGHT_SHARE: f64 = 1.0 / 6.0;

/// Makes one pole of those that several passes saw. Feet are combined by their
/// information, leans by information times squared length (a short piece of a
/// pole hardly tells its lean); the length is that of the upper median, for
/// passes see less of a pole than there is, and hardly ever more.
pub fn fuse_poles(sightings: &[Sighting<Pole>], config: &FuseConfig) -> Vec<Fused<Pole>> {
    let place = |s: &Sighting<Pole>| {
        let foot = s.landmark.foot_map;
        Place { point_map: Point3::new(foot.x, foot.y * HEIGHT_SHARE, foot.z), pass: s.pass, class: 0 }
    };
    let within_m = [config.pole_within_m, config.pole_double_m];
    fuse(sightings, config, compare_poles, place, within_m, |members, mean| {
        let first = members.first()?.0;
        let (foot_map, covariance) = mean.finish()?;
        let (mut lean, mut weights) = (nalgebra::Vector2::zeros(), 0.0);
        for (pole, information) in members {
            let axis = pole.top_map - pole.foot_map;
            let weight = information.trace() * axis.norm_squared();
            // y points down.
            if -axis.y > 1e-6 {
                lean += nalgebra::Vector2::new(axis.x, axis.z) / -axis.y * weight;
                weights += weight;
            }
        }
        if weights > 0.0 {
            lean /= weights;
        }
        let height_m = upper_median(members.iter().map(|(pole, _)| pole.foot_map.y - pole.top_map.y).collect());
        let top_map = foot_map + nalgebra::Vector3::new(lean.x * height_m, -height_m, lean.y * height_m);
        let kind = vote(members.iter().map(|(pole, information)| (pole.kind, information.trace())))?;
        Some((Pole { kind, foot_map, top_map, road: first.road }, covariance))
    })
}

/// Makes one sign of those of one kind that several passes saw: centroids are
/// combined by their information, the size is the upper median.
pub fn fuse_signs(sightings: &[Sighting<Sign>], config: &FuseConfig) -> Vec<Fused<Sign>> {
    let place =
        |s: &Sighting<Sign>| Place { point_map: s.landmark.centroid_map, pass: s.pass, class: s.landmark.kind as u32 };
    let within_m = [config.sign_within_m, config.sign_double_m];
    fuse(sightings, config, compare_signs, place, within_m, |members, mean| {
        let first = members.first()?.0;
        let (centroid_map, covariance) = mean.finish()?;
        let size_m = upper_median(members.iter().map(|(sign, _)| sign.size_m).collect());
        Some((Sign { centroid_map, size_m, ..*first }, covariance))
    })
}

/// What the sightings of one landmark give: the landmark and its covariance.
type Combined<T> = Option<(T, Matrix3<f64>)>;

fn fuse<T: Anchored + Clone>(
    sightings: &[Sighting<T>],
    config: &FuseConfig,
    compare: impl Fn(&T, &T) -> Ordering,
    place: impl Fn(&Sighting<T>) -> Place,
    [within_m, double_m]: [f64; 2],
    combine: impl Fn(&[(&T, Matrix3<f64>)], &Mean) -> Combined<T>,
) -> Vec<Fused<T>> {
    let covariances: Vec<Matrix3<f64>> =
        sightings.iter().map(|s| covariance_m2(s.covariance_map_m2.as_ref(), config)).collect();
    let spread = |index: &usize| covariances[*index].trace();
    let mut order: Vec<usize> = (0..sightings.len()).collect();
    order.sort_by(|a, b| {
        let (left, right) = (&sightings[*a].landmark, &sightings[*b].landmark);
        compare(left, right).then(spread(a).total_cmp(&spread(b)))
    });
    let places: Vec<Place> = order.iter().map(|&index| place(&sightings[index])).collect();
    let groups = cluster(&places, within_m, double_m);
    let fused = groups.into_iter().filter_map(|group| {
        let mut members: Vec<usize> = group.into_iter().map(|place| order[place]).collect();
        // The sort is stable: equally certain ones stay in their own order.
        members.sort_by(|a, b| spread(a).total_cmp(&spread(b)));
        if let [only] = members[..] {
            let covariance_map_m2 = covariances[only];
            return Some(Fused { landmark: sightings[only].landmark.clone(), covariance_map_m2, sightings: members });
        }
        let mut mean = Mean::new();
        let mut weighted = Vec::with_capacity(members.len());
        for &member in &members {
            let information = information(&covariances[member]);
            mean.add(&sightings[member].landmark.anchor(), &information);
            weighted.push((&sightings[member].landmark, information));
        }
        let (landmark, covariance_map_m2) = combine(&weighted, &mean)?;
        Some(Fused { landmark, covariance_map_m2, sightings: members })
    });
    fused.collect()
}

/// What has a position.
trait Anchored {
    /// The point that a covariance is of, map frame, metres.
    fn anchor(&self) -> Point3<f64>;
}

impl Anchored for Pole {
    fn anchor(&self) -> Point3<f64> {
        self.foot_map
    }
}

impl Anchored for Sign {
    fn anchor(&self) -> Point3<f64> {
        self.centroid_map
    }
}

fn compare_points(a: &Point3<f64>, b: &Point3<f64>) -> Ordering {
    a.z.total_cmp(&b.z).then(a.x.total_cmp(&b.x)).then(a.y.total_cmp(&b.y))
}

fn compare_poles(a: &Pole, b: &Pole) -> Ordering {
    compare_points(&a.foot_map, &b.foot_map)
        .then_with(|| compare_points(&a.top_map, &b.top_map))
        .then(a.kind.cmp(&b.kind))
        .then(a.road.cmp(&b.road))
}

fn compare_signs(a: &Sign, b: &Sign) -> Ordering {
    compare_points(&a.centroid_map, &b.centroid_map)
        .then(a.size_m.total_cmp(&b.size_m))
        .then(a.kind.cmp(&b.kind))
        .then(a.road.cmp(&b.road))
}

#[cfg(test)]
mod tests {
    use common::map::{PoleKind, RoadId, SignKind};
    use nalgebra::Vector3;

    use super::*;

    fn pole(x: f64, z: f64, height: f64, pass: u32) -> Sighting<Pole> {
        let foot_map = Point3::new(x, 1.6, z);
        let top_map = foot_map - Vector3::y() * height;
        let landmark = Pole { kind: PoleKind::LampPost, foot_map, top_map, road: RoadId(0) };
        Sighting { landmark, pass, covariance_map_m2: None }
    }

    #[test]
    fn two_sightings_of_a_pole_are_one_between_them() {
        let fused = fuse_poles(&[pole(5.0, 10.0, 4.0, 0), pole(5.2, 10.0, 6.0, 1)], &FuseConfig::default());
        let [one] = &fused[..] else { panic!("{fused:?}") };
        assert!((one.landmark.foot_map - Point3::new(5.1, 1.6, 10.0)).norm() < 1e-9);
        assert!((one.landmark.length_m() - 6.0).abs() < 1e-9);
        assert_eq!(one.sightings.len(), 2);
        let alone = &fuse_poles(&[pole(5.0, 10.0, 4.0, 0)], &FuseConfig::default())[0];
        assert!(one.covariance_map_m2.trace() < 0.6 * alone.covariance_map_m2.trace());
    }

    #[test]
    fn the_more_certain_sighting_counts_more() {
        let mut sure = pole(5.0, 10.0, 4.0, 0);
        sure.covariance_map_m2 = Some(Matrix3::identity() * 1e-6);
        let fused = fuse_poles(&[pole(5.3, 10.0, 4.0, 1), sure], &FuseConfig::default());
        assert!(fused[0].landmark.foot_map.x < 5.1);
        assert_eq!(fused[0].sightings, [1, 0]);
    }

    #[test]
    fn a_leaning_pole_keeps_its_lean() {
        let mut leaning = [pole(5.0, 10.0, 4.0, 0), pole(5.0, 10.0, 2.0, 1)];
        for sighting in &mut leaning {
            sighting.landmark.top_map.x += 0.1 * sighting.landmark.length_m();
        }
        let fused = &fuse_poles(&leaning, &FuseConfig::default())[0].landmark;
        assert!((fused.top_map - leaning[0].landmark.top_map).norm() < 1e-9);
    }

    #[test]
    fn what_stands_on_a_bridge_is_another_pole() {
        let mut above = pole(5.0, 10.0, 4.0, 1);
        above.landmark.foot_map.y -= 6.0;
        above.landmark.top_map.y -= 6.0;
        assert_eq!(fuse_poles(&[pole(5.0, 10.0, 4.0, 0), above], &FuseConfig::default()).len(), 2);
    }

    #[test]
    fn a_sign_that_one_pass_found_twice_is_one() {
        let sign = |y: f64| Sighting {
            landmark: Sign {
                kind: SignKind::TrafficSign,
                centroid_map: Point3::new(4.0, y, 9.0),
                size_m: 0.6,
                road: RoadId(0),
            },
            pass: 0,
            covariance_map_m2: None,
        };
        assert_eq!(fuse_signs(&[sign(-1.0), sign(-1.1), sign(-1.6)], &FuseConfig::default()).len(), 2);
    }

    #[test]
    fn signs_of_different_kinds_stay_two() {
        let sign = |kind, pass| Sighting {
            landmark: Sign { kind, centroid_map: Point3::new(4.0, -1.0, 9.0), size_m: 0.6, road: RoadId(0) },
            pass,
            covariance_map_m2: None,
        };
        let sightings =
            [sign(SignKind::TrafficSign, 0), sign(SignKind::TrafficLight, 1), sign(SignKind::TrafficSign, 2)];
        assert_eq!(fuse_signs(&sightings, &FuseConfig::default()).len(), 2);
    }

    #[test]
    fn the_order_of_sightings_and_the_names_of_passes_do_not_matter() {
        let noise = |i: u32| f64::from(i * 7919 % 101) / 101.0 - 0.5;
        let mut sightings: Vec<Sighting<Pole>> = (0..60)
            .map(|i| pole(noise(i) * 0.6, f64::from(i / 6) * 1.5 + noise(i + 60) * 0.6, 3.0 + noise(i + 9), i % 6))
            .collect();
        let poles = |sightings: &[Sighting<Pole>]| {
            let fused = fuse_poles(sightings, &FuseConfig::default());
            fused.into_iter().map(|f| (f.landmark, f.covariance_map_m2)).collect::<Vec<_>>()
        };
        let expected = poles(&sightings);
        assert!(expected.len() < 60);
        sightings.reverse();
        sightings.swap(3, 40);
        for sighting in &mut sightings {
            sighting.pass = 17 - sighting.pass;
        }
        assert_eq!(poles(&sightings), expected);
    }
}
