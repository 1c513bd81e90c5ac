//! A made-up drive for the tests: a curved, hilly road with landmarks, and the
//! features that a camera would give along it, with noise, false ones and
//! misses.

use common::geometry::{PinholeCamera, Pose, PoseParameters, local, retract};
use common::map::{LaneKind, LaneLine, Pole, PoleKind, Road, RoadId, SemanticMap, Sign, SignKind};
use nalgebra::{Point2, Point3, Vector2, Vector3, Vector6};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use crate::features::{Features, LaneFeature, LineFeature, PointFeature};
use crate::local_map::{LocalMap, RoadKey};
use crate::odometry::Odometry;
use crate::projection::{ImageSize, NEAR_M, View};

/// Size of the made-up images.
pub const IMAGE: ImageSize = ImageSize { width_px: 1226.0, height_px: 370.0 };
/// Time between frames, seconds.
const DT_S: f64 = 0.1;
/// Height of the camera above the road, metres.
const CAMERA_HEIGHT_M: f64 = 1.65;

/// What the drive is made of.
#[derive(Debug, Clone, Copy)]
pub struct Recipe {
    /// Seed of everything random.
    pub seed: u64,
    /// Length of the road, metres.
    pub length_m: f64,
    /// Mean distance of poles, metres.
    pub pole_spacing_m: f64,
    /// Offsets of the lane lines to the right of the path, metres.
    pub lanes_m: &'static [f64],
    /// Largest change of direction per metre, 1/m.
    pub curvature: f64,
    /// Standard deviation of the map's landmarks, metres.
    pub map_sigma_m: f64,
    /// Share of visible landmarks that give no feature.
    pub missed: f64,
    /// False pole features per frame.
    pub false_poles: usize,
    /// Poles that stand there and are not in the map, as a share of those that
    /// are; and as many are in the map and are gone.
    pub changed: f64,
    /// Largest distance of poles from the path, metres.
    pub pole_reach_m: f64,
    /// A corner in the middle of the drive: its angle, radians, and length,
    /// metres.
    pub corner: (f64, f64),
    /// Speed, m/s.
    pub speed_m_s: f64,
}

/// Time of a frame, seconds.
pub fn time_s(frame: usize) -> f64 {
    frame as f64 * DT_S
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            seed: 1,
            length_m: 400.0,
            pole_spacing_m: 10.0,
            lanes_m: &[-5.2, -1.7, 1.8],
            curvature: 0.006,
            map_sigma_m: 0.05,
            missed: 0.3,
            false_poles: 3,
            changed: 0.0,
            pole_reach_m: 12.0,
            corner: (0.0, 10.0),
            speed_m_s: 12.0,
        }
    }
}

/// A drive with its map and truth.
pub struct World {
    /// The camera.
    pub camera: PinholeCamera,
    /// The map.
    pub map: SemanticMap,
    /// `map_from_camera` of every frame.
    pub truth: Vec<Pose>,
    exact: SemanticMap,
    recipe: Recipe,
}

struct Random(Pcg64);

impl Random {
    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }

    fn chance(&mut self, probability: f64) -> bool {
        self.between(0.0, 1.0) < probability
    }

    fn around(&mut self, point: &Point3<f64>, sigma: f64) -> Point3<f64> {
        point + Vector3::new(self.normal(), self.normal(), self.normal()) * sigma
    }
}

/// The camera's pose on the road, `s_m` along it.
fn on_road(s_m: f64, recipe: &Recipe) -> Pose {
    // Heading a slow sine; position its integral in small steps.
    let (corner_rad, corner_m) = recipe.corner;
    let turned = |s: f64| ((s - 0.5 * recipe.length_m) / corner_m + 0.5).clamp(0.0, 1.0);
    let smooth = |x: f64| x * x * (3.0 - 2.0 * x);
    let heading = |s: f64| recipe.curvature * 60.0 * (s / 60.0).sin() + corner_rad * smooth(turned(s));
    let steps = (s_m / 0.5).ceil().max(1.0);
    let ds = s_m / steps;
    let (mut x, mut z) = (0.0, 0.0);
    for i in 0..steps as usize {
        let yaw = heading((i as f64 + 0.5) * ds);
        x += yaw.sin() * ds;
        z += yaw.cos() * ds;
    }
    let y_m = -2.0 * (1.0 - (s_m / 80.0).cos());
    let slope = 2.0 / 80.0 * (s_m / 80.0).sin();
    PoseParameters { x_m: x, y_m, z_m: z, yaw_rad: heading(s_m), pitch_rad: slope.atan(), roll_rad: 0.0 }.to_pose()
}

impl World {
    /// The map as the localizer holds it, with all its roads.
    pub fn local_map(&self) -> (LocalMap, Vec<RoadKey>) {
        let (mut map, mut roads) = (LocalMap::whole(self.map.clone()), Vec::new());
        map.roads_near(&Point3::origin(), 1e5, &mut roads).unwrap();
        (map, roads)
    }

    pub fn new(recipe: Recipe) -> Self {
        let mut random = Random(Pcg64::seed_from_u64(recipe.seed));
        let mut exact = SemanticMap { frame_note: "made up".into(), ..SemanticMap::default() };
        let stretch_m = 50.0;
        let roads = ((recipe.length_m + 100.0) / stretch_m).ceil() as usize;
        for road in 0..roads {
            let s_m = road as f64 * stretch_m;
            let path_map = (0..=10)
                .map(|i| Point3::from(on_road(s_m + f64::from(i) * stretch_m / 10.0, &recipe).translation.vector))
                .collect();
            exact.roads.push(Road { path_map });
            for &right_m in recipe.lanes_m {
                let points_map = (0..=25)
                    .map(|i| {
                        on_road(s_m + f64::from(i) * stretch_m / 25.0, &recipe)
                            * Point3::new(right_m, CAMERA_HEIGHT_M, 0.0)
                    })
                    .collect();
                let kind = if right_m < 0.0 && right_m > -3.0 { LaneKind::Dashed } else { LaneKind::Solid };
                exact.lanes.push(LaneLine { kind, points_map, road: RoadId(road as u32), marks_m: Vec::new() });
            }
        }
        let mut s_m = 5.0;
        while s_m < recipe.length_m + 90.0 {
            let side = if random.chance(0.5) { 1.0 } else { -1.0 };
            let right_m = side * random.between(5.5, recipe.pole_reach_m);
            let (kind, length_m) = match random.0.random_range(0..4) {
                0 | 1 => (PoleKind::LampPost, random.between(4.0, 8.0)),
                2 => (PoleKind::SignPost, random.between(2.2, 3.0)),
                _ => (PoleKind::Delineator, 1.0),
            };
            let frame = on_road(s_m, &recipe);
            let road = RoadId((s_m / stretch_m) as u32);
            let foot = Point3::new(right_m, CAMERA_HEIGHT_M, 0.0);
            let top = Point3::new(right_m, CAMERA_HEIGHT_M - length_m, 0.0);
            exact.poles.push(Pole { kind, foot_map: frame * foot, top_map: frame * top, road });
            if kind == PoleKind::SignPost {
                exact.signs.push(Sign {
                    kind: SignKind::TrafficSign,
                    centroid_map: frame * (top + Vector3::new(0.0, 0.3, -0.1)),
                    size_m: 0.7,
                    road,
                });
            }
            s_m += recipe.pole_spacing_m * random.between(0.4, 1.6);
        }
        let mut map = exact.clone();
        map.poles.retain(|_| !random.chance(recipe.changed));
        exact.poles.retain(|_| !random.chance(recipe.changed));
        for pole in &mut map.poles {
            // A pole is off as a whole; its axis hardly leans.
            let off = random.around(&Point3::origin(), recipe.map_sigma_m).coords;
            pole.foot_map += off;
            pole.top_map += off;
        }
        for sign in &mut map.signs {
            sign.centroid_map = random.around(&sign.centroid_map, recipe.map_sigma_m);
        }
        for lane in &mut map.lanes {
            for point in &mut lane.points_map {
                *point = random.around(point, 0.5 * recipe.map_sigma_m);
            }
        }
        let frames = (recipe.length_m / (recipe.speed_m_s * DT_S)) as usize;
        let truth = (0..frames)
            .map(|i| {
                let s_m = i as f64 * recipe.speed_m_s * DT_S;
                // Weaving in the lane, pitching and rolling a little.
                let t = i as f64 * DT_S;
                let sway = Vector6::new(
                    0.3 * (t / 2.0).sin(),
                    0.02 * (t * 5.0).sin(),
                    0.0,
                    0.006 * (t * 6.0).sin(),
                    0.3 / (2.0 * recipe.speed_m_s) * (t / 2.0).cos(),
                    0.006 * (t * 4.0).sin(),
                );
                retract(&on_road(s_m, &recipe), &sway)
            })
            .collect();
        let camera = crate::projection::tests::camera();
        Self { camera, map, truth, exact, recipe }
    }

    /// What good wheels and a good gyroscope say of the motion up to a frame.
    pub fn odometry(&self, frame: usize) -> Odometry {
        let before = frame.checked_sub(1).map_or(&self.truth[0], |before| &self.truth[before]);
        let moved = local(before, &self.truth[frame]) / DT_S;
        Odometry::of_wheels(moved[2], -moved[4])
    }

    /// What the camera sees in a frame.
    pub fn features(&self, frame: usize) -> Features {
        let mut random = Random(Pcg64::seed_from_u64(self.recipe.seed * 1_000_003 + frame as u64));
        let view = View::new(&self.camera, &self.truth[frame]);
        let mut features = Features::default();
        for pole in &self.exact.poles {
            let missed = random.chance(self.recipe.missed);
            let segment = view.project(&pole.foot_map).zip(view.project(&pole.top_map));
            let Some(((foot, depth_m), (top, _))) = segment.filter(|_| !missed) else { continue };
            if depth_m < 70.0 && foot.y - top.y > 12.0 {
                features.poles.extend(line(&top, &foot, &mut random));
            }
        }
        for _ in 0..self.recipe.false_poles {
            let top = Point2::new(random.between(20.0, 1200.0), random.between(20.0, 150.0));
            let foot = top + Vector2::new(random.between(-15.0, 15.0), random.between(40.0, 150.0));
            features.poles.extend(line(&top, &foot, &mut random));
        }
        for sign in &self.exact.signs {
            let missed = random.chance(self.recipe.missed);
            let Some((pixel, depth_m)) = view.project(&sign.centroid_map).filter(|_| !missed) else { continue };
            let size_px = sign.size_m * self.camera.fx_px / depth_m / std::f64::consts::SQRT_2;
            if IMAGE.contains(&pixel, -size_px) && size_px > 6.0 {
                let off = Vector2::new(random.normal(), random.normal());
                features.signs.push(PointFeature {
                    kind: sign.kind,
                    centre_px: pixel + off,
                    extent_px: Vector2::repeat(size_px),
                    sigma_px: 1.0,
                    probability: 0.7,
                    is_cut: false,
                });
            }
        }
        for lane in self.lane_curves(frame) {
            if !random.chance(self.recipe.missed) {
                features.lanes.extend(curve(&lane, &mut random));
            }
        }
        features
    }

    /// The lane lines as the road has them from 5 to 35 m ahead, in the image.
    fn lane_curves(&self, frame: usize) -> Vec<Vec<Point2<f64>>> {
        let view = View::new(&self.camera, &self.truth[frame]);
        let s_m = frame as f64 * self.recipe.speed_m_s * DT_S;
        let along = |right_m: f64| {
            (0..60)
                .map(|i| s_m + 35.0 - f64::from(i) * 0.5)
                .map(|s| on_road(s, &self.recipe) * Point3::new(right_m, CAMERA_HEIGHT_M, 0.0))
                .filter_map(|p| view.project(&p))
                .filter(|(p, depth_m)| *depth_m > NEAR_M && IMAGE.contains(p, 0.0))
                .map(|(p, _)| p)
                .collect::<Vec<_>>()
        };
        self.recipe.lanes_m.iter().map(|&m| along(m)).filter(|points| points.len() > 15).collect()
    }
}

/// A pole feature with noise, cut to the image.
fn line(top: &Point2<f64>, foot: &Point2<f64>, random: &mut Random) -> Option<LineFeature> {
    let across = Vector2::new(1.0, 0.0);
    let upper = top + across * random.normal();
    let lower = foot + across * random.normal();
    let at_row = |row: f64| upper + (lower - upper) * ((row - upper.y) / (lower.y - upper.y));
    let (first, last) = (upper.y.max(0.0), lower.y.min(IMAGE.height_px - 1.0));
    if last - first < 12.0 {
        return None;
    }
    let (upper_px, lower_px) = (at_row(first), at_row(last));
    let inside = IMAGE.contains(&upper_px, 0.0) && IMAGE.contains(&lower_px, 0.0);
    inside.then(|| LineFeature {
        upper_px,
        lower_px,
        offset_sigma_px: 0.7,
        angle_sigma_rad: 1.4 / (last - first),
        width_px: 5.0,
        probability: 0.8,
        upper_is_cut: first > upper.y,
        lower_is_cut: last < lower.y,
    })
}

/// A lane feature, one point per row, with noise.
fn curve(points: &[Point2<f64>], random: &mut Random) -> Option<LaneFeature> {
    let (first, last) = (points.first()?, points.last()?);
    let shift = random.normal();
    let mut points_px = Vec::new();
    for row in first.y.ceil() as i64..=last.y.floor() as i64 {
        let row = row as f64;
        let ends = points.windows(2).find(|w| w[0].y <= row && row <= w[1].y)?;
        let fraction = (row - ends[0].y) / (ends[1].y - ends[0].y).max(1e-9);
        let column = ends[0].x + (ends[1].x - ends[0].x) * fraction;
        points_px.push(Point2::new(column + shift + 0.3 * random.normal(), row));
    }
    let (first, last) = (*points_px.first()?, *points_px.last()?);
    let line = LineFeature {
        upper_px: first,
        lower_px: last,
        offset_sigma_px: 1.0,
        angle_sigma_rad: 0.01,
        width_px: 8.0,
        probability: 0.8,
        upper_is_cut: false,
        lower_is_cut: false,
    };
    Some(LaneFeature { points_px, line, edges: Vec::new() })
}
