//! Poles and signs, and whether landmarks are near their road.

use common::map::{RoadId, SemanticMap};
use nalgebra::Point3;

use super::{Fault, Findings, Names, ValidateConfig};
use crate::merge::Nearest;

pub(super) fn check(map: &SemanticMap, config: &ValidateConfig, findings: &mut Findings) {
    let mut names = Names(Vec::new());
    let roads = Roads { map, nearest: Nearest::new(&map.roads), config };
    for pole in &map.poles {
        let name = names.next(pole.kind.name());
        let (foot, length_m) = (&pole.foot_map, pole.length_m());
        let axis = pole.top_map - pole.foot_map;
        let lean_rad = axis.x.hypot(axis.z).atan2(-axis.y);
        if length_m < config.shortest_pole_m {
            findings.add(Fault::NoLength, &name, foot, format!("has a length of {length_m:.2} m"));
        } else if lean_rad > config.largest_lean_rad {
            findings.add(Fault::Lean, &name, foot, format!("leans by {:.0} degrees", lean_rad.to_degrees()));
        }
        if length_m > config.tallest_pole_m {
            findings.add(Fault::AbsurdSize, &name, foot, format!("has a length of {length_m:.1} m"));
        }
        roads.check(&name, pole.road, &[pole.foot_map, pole.top_map], findings);
    }
    for sign in &map.signs {
        let name = names.next(sign.kind.name());
        let [least_m, most_m] = config.sign_sizes_m;
        let what = format!("has a size of {:.2} m", sign.size_m);
        if sign.size_m < least_m {
            findings.add(Fault::NoLength, &name, &sign.centroid_map, what);
        } else if sign.size_m > most_m {
            findings.add(Fault::AbsurdSize, &name, &sign.centroid_map, what);
        }
        roads.check(&name, sign.road, &[sign.centroid_map], findings);
    }
    for lane in &map.lanes {
        let name = names.next(lane.kind.name());
        let middle = lane.points_map.get(lane.points_map.len() / 2).copied();
        roads.check(&name, lane.road, middle.as_slice(), findings);
    }
}

struct Roads<'a> {
    map: &'a SemanticMap,
    nearest: Nearest,
    config: &'a ValidateConfig,
}

impl Roads<'_> {
    /// Whether a landmark with these points is on its road.
    fn check(&self, name: &str, road: RoadId, points: &[Point3<f64>], findings: &mut Findings) {
        let Some(first) = points.first() else { return };
        let Some((_, nearest_m)) = self.nearest.to(first) else {
            findings.add(Fault::OffRoad, name, first, "is in a map without roads".into());
            return;
        };
        if nearest_m > self.config.off_road_m {
            findings.add(Fault::OffRoad, name, first, format!("is {nearest_m:.0} m from the nearest road"));
            return;
        }
        let path = self.map.roads.get(road.0 as usize).map_or(&[][..], |road| &road.path_map);
        let Some((own_m, height_m)) = beside(path, first) else { return };
        if own_m > nearest_m + self.config.wrong_road_m {
            let what = format!("is on road {}, {own_m:.0} m away, and another is {nearest_m:.0} m away", road.0);
            findings.add(Fault::WrongRoad, name, first, what);
            return;
        }
        // y points down.
        for up_m in points.iter().map(|point| height_m - point.y) {
            if up_m > self.config.highest_m || -up_m > self.config.lowest_m {
                let (by_m, way) = (up_m.abs(), if up_m > 0.0 { "above" } else { "below" });
                let what = format!("is {by_m:.1} m {way} the path of the camera");
                findings.add(Fault::AbsurdSize, name, first, what);
                return;
            }
        }
    }
}

/// Distance of a point from a path and the path's y there, metres.
fn beside(path: &[Point3<f64>], point: &Point3<f64>) -> Option<(f64, f64)> {
    let first = path.first()?;
    let mut best = ((point - first).norm(), first.y);
    for pair in path.windows(2) {
        let way = pair[1] - pair[0];
        let share = ((point - pair[0]).dot(&way) / way.norm_squared().max(1e-12)).clamp(0.0, 1.0);
        let at = pair[0] + way * share;
        if (point - at).norm() < best.0 {
            best = ((point - at).norm(), at.y);
        }
    }
    Some(best)
}
