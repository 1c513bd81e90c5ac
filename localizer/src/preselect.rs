//! Section IV.A: the landmarks that a camera near a predicted pose may see.

mod lanes;

use common::geometry::{PinholeCamera, Pose};
use common::map::PoleKind;
use nalgebra::{Matrix6, Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::Result;
use crate::local_map::{LocalMap, RoadKey};
use crate::projection::{ImageSize, NEAR_M, View};

/// Settings of the preselection.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PreselectConfig {
    /// Least size over distance (s = m / distance) of a pole or sign; the
    /// paper's 0.017 is 12 px at KITTI's focal length.
    pub min_relative_size: f64,
    /// Nothing beyond is used, metres: there a metre of position moves a
    /// landmark 10 m beside the road by less than a pixel.
    pub max_distance_m: f64,
    /// Lane lines are used from here on, metres ahead; the paper's 5.
    pub lane_near_m: f64,
    /// Lane lines are used up to here, metres ahead. The paper's 20 for a
    /// straight line; polylines carry further, until a lane line is as wide as
    /// a pixel and hidden behind traffic.
    pub lane_far_m: f64,
    /// Use tree trunks, where something tells of vegetation.
    pub use_trunks: bool,
    /// Lines of sight are looked at where the position is known to this,
    /// metres; beyond it none is called blocked.
    pub sight_reach_m: f64,
}

impl Default for PreselectConfig {
    fn default() -> Self {
        Self {
            min_relative_size: 0.017,
            max_distance_m: 100.0,
            lane_near_m: 5.0,
            lane_far_m: 30.0,
            use_trunks: true,
            sight_reach_m: 15.0,
        }
    }
}

/// A pole that may be seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoleCandidate {
    /// Number among the map's poles.
    pub index: usize,
    /// What it is.
    pub kind: PoleKind,
    /// Lower control point, map frame, metres.
    pub foot_map: Point3<f64>,
    /// Upper control point, map frame, metres.
    pub top_map: Point3<f64>,
    /// How far the line of sight leaves the roads, metres; see `Lookup::sight_m`.
    pub sight_m: f64,
}

/// A sign that may be seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignCandidate {
    /// Number among the map's signs.
    pub index: usize,
    /// What it is.
    pub kind: common::map::SignKind,
    /// Centroid, map frame, metres.
    pub centroid_map: Point3<f64>,
    /// Its size, metres.
    pub size_m: f64,
    /// How far the line of sight leaves the roads, metres; see `Lookup::sight_m`.
    pub sight_m: f64,
}

/// The part of a lane line that may be seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaneCandidate {
    /// Number among the map's lane lines.
    pub index: usize,
    /// How it is painted.
    pub kind: common::map::LaneKind,
    /// Its vertices are `lane_points_map[start..end]`, at least two.
    pub start: usize,
    /// One past the last.
    pub end: usize,
    /// Its line's marks near the camera are `marks_map[marks.0..marks.1]`.
    pub marks: (usize, usize),
}

/// Everything that may be seen. Buffers are reused from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct Candidates {
    /// Poles.
    pub poles: Vec<PoleCandidate>,
    /// Signs.
    pub signs: Vec<SignCandidate>,
    /// Lane lines, cut to the usable range.
    pub lanes: Vec<LaneCandidate>,
    /// Vertices of all lane candidates, map frame, metres.
    pub lane_points_map: Vec<Point3<f64>>,
    /// Where marks of dashed lines begin and end, map frame, metres.
    pub marks_map: Vec<[Point3<f64>; 2]>,
    /// The road stretches near the pose, in the order of the map.
    pub roads: Vec<RoadKey>,
}

/// How far around the predicted pose the true one may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// Horizontal, metres.
    pub position_m: f64,
    /// Turning, radians.
    pub angle_rad: f64,
}

impl Reach {
    /// Three standard deviations of a pose covariance (camera tangent).
    pub fn of_covariance(covariance: &Matrix6<f64>) -> Self {
        let sigma = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        Self { position_m: 3.0 * sigma(0).hypot(sigma(2)), angle_rad: 3.0 * sigma(3).max(sigma(4)).max(sigma(5)) }
    }
}

/// Where a line of sight is looked at, shares of its length.
const SIGHT_SHARES: [f64; 4] = [0.2, 0.4, 0.6, 0.8];

/// Beside the axis by more, nothing is in the image of a camera that still looks ahead,
/// radians: just under a right angle, where slopes end.
const WIDEST_RAD: f64 = 1.5;

/// What preselection looks up.
#[derive(Debug)]
pub struct Lookup<'a> {
    /// The map.
    pub map: &'a mut LocalMap,
    /// The camera.
    pub camera: &'a PinholeCamera,
    /// Its image.
    pub image: ImageSize,
    /// Settings.
    pub config: &'a PreselectConfig,
}

impl Lookup<'_> {
    /// Fills `out` with the landmarks that a camera within `reach` of
    /// `map_from_camera` may see.
    ///
    /// # Errors
    /// As [`LocalMap::roads_near`].
    pub fn select(self, map_from_camera: &Pose, reach: &Reach, out: &mut Candidates) -> Result<()> {
        let position = Point3::from(map_from_camera.translation.vector);
        let view = View::new(self.camera, map_from_camera);
        out.poles.clear();
        out.signs.clear();
        out.lanes.clear();
        out.lane_points_map.clear();
        out.marks_map.clear();
        self.map.roads_near(&position, self.config.max_distance_m + reach.position_m, &mut out.roads)?;
        for i in 0..out.roads.len() {
            let road = out.roads[i];
            self.select_poles(road, &view, reach, out);
            self.select_signs(road, &view, reach, out);
            for (index, lane) in self.map.lanes(road) {
                self.cut_lane(index, lane, &view, reach, out);
            }
        }
        if reach.position_m <= self.config.sight_reach_m {
            for pole in &mut out.poles {
                pole.sight_m = self.sight_m(&out.roads, &position, &pole.foot_map);
            }
            for sign in &mut out.signs {
                sign.sight_m = self.sight_m(&out.roads, &position, &sign.centroid_map);
            }
        }
        Ok(())
    }

    /// How far the straight line from `from` to `to` comes from all `roads`,
    /// metres. Roads are open; what lies between two of them may be houses,
    /// which the map does not have.
    fn sight_m(&self, roads: &[RoadKey], from: &Point3<f64>, to: &Point3<f64>) -> f64 {
        SIGHT_SHARES.iter().fold(0.0, |most, &share| {
            let place = from + (to - from) * share;
            let nearest = self.map.nearest_path(roads, &place);
            let off = nearest.map(|nearest| place - nearest.point_map);
            off.map_or(most, |off| off.x.hypot(off.z).max(most))
        })
    }

    fn select_poles(&self, road: RoadKey, view: &View, reach: &Reach, out: &mut Candidates) {
        for (index, pole) in self.map.poles(road) {
            if pole.kind == PoleKind::Trunk && !self.config.use_trunks {
                continue;
            }
            let (foot, top) = (view.to_camera(&pole.foot_map), view.to_camera(&pole.top_map));
            let middle = (foot + top) * 0.5;
            if self.is_big_enough(&middle, pole.length_m(), reach)
                && (self.may_be_in_image(&foot, reach)
                    || self.may_be_in_image(&top, reach)
                    || self.may_be_in_image(&middle, reach))
            {
                out.poles.push(PoleCandidate {
                    index,
                    kind: pole.kind,
                    foot_map: pole.foot_map,
                    top_map: pole.top_map,
                    sight_m: 0.0,
                });
            }
        }
    }

    fn select_signs(&self, road: RoadKey, view: &View, reach: &Reach, out: &mut Candidates) {
        for (index, sign) in self.map.signs(road) {
            let p = view.to_camera(&sign.centroid_map);
            if self.is_big_enough(&p, sign.size_m, reach) && self.may_be_in_image(&p, reach) {
                out.signs.push(SignCandidate {
                    index,
                    kind: sign.kind,
                    centroid_map: sign.centroid_map,
                    size_m: sign.size_m,
                    sight_m: 0.0,
                });
            }
        }
    }

    /// s = m / distance over the threshold, from the nearest place in reach.
    fn is_big_enough(&self, p: &Vector3<f64>, size_m: f64, reach: &Reach) -> bool {
        let distance_m = (p.norm() - reach.position_m).max(NEAR_M);
        distance_m < self.config.max_distance_m && size_m > self.config.min_relative_size * distance_m
    }

    /// In front of the camera and in the image, for some pose in reach, however far
    /// it turns. Only to the sides: a pole's ends may well lie above or below.
    fn may_be_in_image(&self, p: &Vector3<f64>, reach: &Reach) -> bool {
        let depth_m = p.z + reach.position_m;
        if depth_m < NEAR_M {
            return false;
        }
        let slope_at = |half_px: f64| ((half_px / self.camera.fx_px).atan() + reach.angle_rad).min(WIDEST_RAD).tan();
        let (left, right) = (slope_at(self.camera.cx_px), slope_at(self.image.width_px - self.camera.cx_px));
        p.x > -left * depth_m - reach.position_m && p.x < right * depth_m + reach.position_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::projection::tests::camera;
    use common::geometry::PoseParameters;
    use common::map::{LaneKind, LaneLine, Pole, Road, RoadId, SemanticMap, Sign, SignKind};

    const IMAGE: ImageSize = ImageSize { width_px: 1226.0, height_px: 370.0 };
    const NONE: Reach = Reach { position_m: 0.0, angle_rad: 0.0 };

    fn pole(x: f64, z: f64, length_m: f64, kind: PoleKind) -> Pole {
        Pole { kind, foot_map: Point3::new(x, 1.6, z), top_map: Point3::new(x, 1.6 - length_m, z), road: RoadId(0) }
    }

    fn map() -> SemanticMap {
        SemanticMap {
            roads: vec![Road { path_map: vec![Point3::origin(), Point3::new(0.0, 0.0, 300.0)] }],
            poles: vec![
                pole(5.0, 20.0, 4.0, PoleKind::LampPost),
                pole(5.0, -20.0, 4.0, PoleKind::LampPost),
                pole(40.0, 20.0, 4.0, PoleKind::LampPost),
                pole(5.0, 80.0, 1.0, PoleKind::Delineator),
                pole(-4.0, 15.0, 4.0, PoleKind::Trunk),
            ],
            signs: vec![Sign {
                kind: SignKind::TrafficSign,
                centroid_map: Point3::new(4.0, -1.0, 30.0),
                size_m: 0.7,
                road: RoadId(0),
            }],
            lanes: vec![LaneLine {
                kind: LaneKind::Solid,
                points_map: vec![
                    Point3::new(-1.8, 1.6, -10.0),
                    Point3::new(-1.8, 1.6, 10.0),
                    Point3::new(-1.6, 1.6, 50.0),
                ],
                road: RoadId(0),
                marks_m: Vec::new(),
            }],
            ..SemanticMap::default()
        }
    }

    fn select(reach: &Reach, config: &PreselectConfig) -> Candidates {
        let lookup = Lookup { map: &mut LocalMap::whole(map()), camera: &camera(), image: IMAGE, config };
        let mut out = Candidates::default();
        lookup.select(&Pose::identity(), reach, &mut out).unwrap();
        out
    }

    #[test]
    fn what_is_behind_beside_too_small_or_a_trunk_is_left_out() {
        let found = select(&NONE, &PreselectConfig { use_trunks: false, ..PreselectConfig::default() });
        assert_eq!(found.poles.iter().map(|p| p.index).collect::<Vec<_>>(), [0]);
        assert_eq!(found.signs.len(), 1);
        assert_eq!(select(&NONE, &PreselectConfig::default()).poles.len(), 2);
    }

    #[test]
    fn an_uncertain_pose_sees_more() {
        let wide = Reach { position_m: 12.0, angle_rad: 0.6 };
        let found = select(&wide, &PreselectConfig::default());
        assert!(found.poles.iter().any(|p| p.index == 2));
    }

    #[test]
    fn what_a_camera_in_reach_sees_once_it_turns_is_a_candidate() {
        let config = PreselectConfig::default();
        let reach = Reach { position_m: 0.0, angle_rad: 0.6 };
        let half_rad = (camera().cx_px / camera().fx_px).atan();
        for (off_rad, is_in_reach) in [(half_rad + 0.55, true), (half_rad + 0.65, false)] {
            let beside = pole(-15.0 * off_rad.sin(), 15.0 * off_rad.cos(), 3.0, PoleKind::LampPost);
            let mut map = LocalMap::whole(SemanticMap { poles: vec![beside], ..map() });
            let mut out = Candidates::default();
            let lookup = Lookup { map: &mut map, camera: &camera(), image: IMAGE, config: &config };
            lookup.select(&Pose::identity(), &reach, &mut out).unwrap();
            assert_eq!(out.poles.len(), usize::from(is_in_reach), "{off_rad} rad");
        }
    }

    #[test]
    fn lanes_are_cut_out_of_the_polyline_with_their_bends() {
        let config = PreselectConfig { lane_near_m: 5.0, lane_far_m: 20.0, ..PreselectConfig::default() };
        let found = select(&NONE, &config);
        let lane = found.lanes[0];
        let points = &found.lane_points_map[lane.start..lane.end];
        assert_eq!(points.len(), 3);
        // Depth counts from this camera, 6 mm before the reference camera.
        assert!((points[0].z - 5.0).abs() < 0.01 && (points[2].z - 20.0).abs() < 0.01);
        assert!((points[1] - Point3::new(-1.8, 1.6, 10.0)).norm() < 1e-9);
        assert!((points[2].x - (-1.75)).abs() < 1e-3);
    }

    #[test]
    fn a_camera_that_looks_away_sees_nothing() {
        let lookup = Lookup {
            map: &mut LocalMap::whole(map()),
            camera: &camera(),
            image: IMAGE,
            config: &PreselectConfig::default(),
        };
        let pose =
            PoseParameters { x_m: 0.0, y_m: 0.0, z_m: 0.0, yaw_rad: 1.57, pitch_rad: 0.0, roll_rad: 0.0 }.to_pose();
        let mut out = Candidates::default();
        lookup.select(&pose, &NONE, &mut out).unwrap();
        assert!(out.poles.iter().all(|p| p.index == 2));
    }
}
