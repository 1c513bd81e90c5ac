//! A cheap score for the many cells of a search: how well columns and rows of
//! poles, signs and lane lines fit at a pose. No gates of a covariance, no
//! pairs of ends: it only says which cells are worth the full matching.

use common::geometry::Pose;
use nalgebra::{Point2, Vector3, Vector6};

use super::StartConfig;
use crate::associate::matching::Scene;
use crate::features::PointFeature;
use crate::prepare::PreparedLane;
use crate::projection::View;

/// A pole feature, as far as the score needs it.
#[derive(Debug, Clone, Copy)]
struct Mark {
    column_px: f64,
    top_px: f64,
    bottom_px: f64,
    variance_px2: f64,
}

/// Standard deviations of a cell.
#[derive(Debug, Clone, Copy)]
struct Cell {
    position_m: f64,
    yaw_rad: f64,
    height_m: f64,
    tilt_rad: f64,
}

impl Cell {
    fn new(sigmas: &Vector6<f64>) -> Self {
        Self {
            position_m: sigmas[0].max(sigmas[2]),
            yaw_rad: sigmas[4],
            height_m: sigmas[1],
            tilt_rad: sigmas[3].max(sigmas[5]),
        }
    }

    /// The square of what [`Self::pixels`] gives but for rounding, which costs
    /// less.
    fn pixels2(&self, p: &Vector3<f64>, focal_px: f64) -> (f64, f64) {
        let (slope, inverse_m) = (p.x / p.z, 1.0 / p.z);
        let slant2 = slope * slope + 1.0;
        let (position, yaw) = (self.position_m * inverse_m, self.yaw_rad);
        let (height, tilt) = (self.height_m * inverse_m, self.tilt_rad);
        let column2 = position * position * slant2 + yaw * yaw * slant2 * slant2;
        (focal_px * focal_px * column2, focal_px * focal_px * (height * height + tilt * tilt * slant2))
    }

    /// Of the column and the row of a point in camera axes, pixels.
    fn pixels(&self, p: &Vector3<f64>, focal_px: f64) -> (f64, f64) {
        let slant = (p.x / p.z).hypot(1.0);
        let column = (self.position_m * slant / p.z).hypot(self.yaw_rad * slant * slant);
        (focal_px * column, focal_px * (self.height_m / p.z).hypot(self.tilt_rad * slant))
    }
}

/// What a frame shows, and buffers of the score.
#[derive(Debug, Clone, Default)]
pub struct Field {
    poles: Vec<Mark>,
    gains: Vec<f64>,
}

impl Field {
    /// Takes in what a frame shows.
    pub fn fill(&mut self, scene: &Scene<'_>) {
        self.poles.clear();
        self.poles.extend(scene.features.poles.iter().map(|pole| Mark {
            column_px: pole.upper_px.x + 0.5 * pole.length_px * pole.down.x,
            top_px: pole.upper_px.y,
            bottom_px: pole.upper_px.y + pole.length_px * pole.down.y,
            variance_px2: (pole.offset_sigma_px + pole.angle_sigma_rad * pole.length_px).powi(2),
        }));
    }

    /// The score of a cell with these standard deviations (camera tangent),
    /// nats: as the support of a frame, but each feature taken by the landmark
    /// that fits it best.
    pub fn score(&mut self, scene: &Scene<'_>, pose: &Pose, sigmas: &Vector6<f64>, config: &StartConfig) -> f64 {
        let (view, cell) = (View::new(scene.camera, pose), Cell::new(sigmas));
        self.score_poles(scene, &view, &cell, config)
            + self.score_signs(scene, &view, &cell, config)
            + self.score_lanes(scene, &view, &cell, config)
    }

    /// Begins a count over `features`.
    fn begin(&mut self, features: usize) {
        self.gains.clear();
        self.gains.resize(features, 0.0);
    }

    fn total(&self) -> f64 {
        self.gains.iter().sum()
    }

    fn score_poles(&mut self, scene: &Scene<'_>, view: &View, cell: &Cell, config: &StartConfig) -> f64 {
        self.begin(self.poles.len());
        let focal_px = scene.camera.fx_px;
        let clutter_ln = (self.poles.len().max(1) as f64 / scene.image.width_px).ln();
        let mut unseen = 0.0;
        for pole in &scene.candidates.poles {
            let (foot, top) = (view.to_camera(&pole.foot_map), view.to_camera(&pole.top_map));
            if foot.z.min(top.z) < config.nearest_m {
                continue;
            }
            let (low, high) = (view.pixel(&foot), view.pixel(&top));
            let is_expected = is_inside(&low, scene) && high.y < scene.image.height_px;
            let landmark_px = scene.noise.pole_sigma_m * focal_px / foot.z;
            let calibration_px = scene.noise.calibration_sigma_px;
            let (column2, _) = cell.pixels2(&foot, focal_px);
            let all2 = column2 + landmark_px * landmark_px + calibration_px * calibration_px;
            let is_near = |mark: &Mark| {
                let off_px = low.x - mark.column_px;
                off_px * off_px < FAR2 * (all2 + mark.variance_px2)
            };
            let any_is_near = self.poles.iter().any(is_near);
            if !is_expected && !any_is_near {
                continue;
            }
            let found = scene.detection.pole(pole.kind, foot.z, pole.sight_m);
            if is_expected {
                unseen += (1.0 - found).ln();
            }
            if !any_is_near {
                continue;
            }
            let (column_px, row_px) = cell.pixels(&foot, focal_px);
            let own_px = landmark_px.hypot(calibration_px);
            let least = (found / (1.0 - found)).ln() - clutter_ln;
            let deepest_px = low.y + 2.0 * row_px + scene.noise.foot_sigma_m * focal_px / foot.z;
            for (mark, gain) in self.poles.iter().zip(&mut self.gains).filter(|(mark, _)| is_near(mark)) {
                let sigma_px = (column_px * column_px + own_px * own_px + mark.variance_px2).sqrt();
                let off_px = low.x - mark.column_px;
                let overlaps = mark.top_px < low.y + row_px && mark.bottom_px > high.y - row_px;
                if off_px.abs() < 3.0 * sigma_px && overlaps && mark.bottom_px < deepest_px {
                    *gain = gain.max(least + log_normal(off_px, sigma_px));
                }
            }
        }
        unseen + self.total()
    }

    fn score_signs(&mut self, scene: &Scene<'_>, view: &View, cell: &Cell, config: &StartConfig) -> f64 {
        self.begin(scene.features.signs.len());
        let focal_px = scene.camera.fx_px;
        let area_px2 = scene.image.width_px * scene.image.height_px;
        let clutter_ln = (scene.features.signs.len().max(1) as f64 / area_px2).ln();
        let mut unseen = 0.0;
        for sign in &scene.candidates.signs {
            let p = view.to_camera(&sign.centroid_map);
            if p.z < config.nearest_m {
                continue;
            }
            let at = view.pixel(&p);
            let is_expected = scene.image.contains(&at, 0.0);
            let (fixed_m, by_size_m) = (scene.noise.sign_sigma_m, scene.noise.sign_sigma_of_size * sign.size_m);
            let (column2, row2) = cell.pixels2(&p, focal_px);
            let own2 = (fixed_m * fixed_m + by_size_m * by_size_m) * (focal_px / p.z) * (focal_px / p.z);
            let is_near = |feature: &PointFeature| {
                let (off_px, own2) = (at - feature.centre_px, own2 + feature.sigma_px * feature.sigma_px);
                off_px.x * off_px.x < FAR2 * (own2 + column2) && off_px.y * off_px.y < FAR2 * (own2 + row2)
            };
            let any_is_near = scene.features.signs.iter().any(|(_, feature)| is_near(feature));
            if !is_expected && !any_is_near {
                continue;
            }
            let found = scene.detection.sign(sign.kind, p.z, sign.sight_m);
            if is_expected {
                unseen += (1.0 - found).ln();
            }
            if !any_is_near {
                continue;
            }
            let (column_px, row_px) = cell.pixels(&p, focal_px);
            let own_px = fixed_m.hypot(by_size_m) * focal_px / p.z;
            let least = (found / (1.0 - found)).ln() - clutter_ln;
            let expected_px = (sign.size_m * focal_px / p.z).max(1.0);
            for ((_, feature), gain) in scene.features.signs.iter().zip(&mut self.gains) {
                if !is_near(feature) {
                    continue;
                }
                let ratio = feature.extent_px.norm() / expected_px;
                let most = scene.noise.max_size_ratio;
                let own_px = own_px.hypot(feature.sigma_px);
                let (across_px, along_px) = (own_px.hypot(column_px), own_px.hypot(row_px));
                let off_px = at - feature.centre_px;
                let near = off_px.x.abs() < 3.0 * across_px && off_px.y.abs() < 3.0 * along_px;
                if near && feature.kind == sign.kind && (1.0 / most..=most).contains(&ratio) {
                    let density = log_normal(off_px.x, across_px) + log_normal(off_px.y, along_px);
                    *gain = gain.max(least + density);
                }
            }
        }
        unseen + self.total()
    }

    fn score_lanes(&mut self, scene: &Scene<'_>, view: &View, cell: &Cell, config: &StartConfig) -> f64 {
        self.begin(scene.features.lanes.len());
        let focal_px = scene.camera.fx_px;
        let clutter_ln = (scene.features.lanes.len().max(1) as f64 / scene.image.width_px).ln();
        let mut unseen = 0.0;
        for lane in &scene.candidates.lanes {
            let points = scene.candidates.lane_points_map.get(lane.start..lane.end).unwrap_or(&[]);
            let mut places = [None; 3];
            let mut last: Option<Vector3<f64>> = None;
            for point in points {
                let p = view.to_camera(point);
                if let Some(q) = last {
                    for (place, depth_m) in places.iter_mut().zip(config.lane_depths_m) {
                        if (q.z - depth_m) * (p.z - depth_m) <= 0.0 && (p.z - q.z).abs() > 1e-6 {
                            *place = Some(q + (p - q) * ((depth_m - q.z) / (p.z - q.z)));
                        }
                    }
                }
                last = Some(p);
            }
            let found = scene.detection.lane(lane.kind);
            let places = places.map(|place| {
                let p = place?;
                let at_px = view.pixel(&p);
                scene.image.contains(&at_px, 0.0).then(|| Place::new(at_px, &p, cell, focal_px))
            });
            if places.iter().all(Option::is_none) {
                continue;
            }
            unseen += (1.0 - found).ln();
            let least = (found / (1.0 - found)).ln() - clutter_ln;
            self.lane_gains(scene, places.as_slice(), least, config.lane_sigma_px);
        }
        unseen + self.total()
    }

    /// The places are not independent: the one that fits worst counts.
    fn lane_gains(&mut self, scene: &Scene<'_>, places: &[Option<Place>], least: f64, lane_sigma_px: f64) {
        for (feature, gain) in scene.features.lanes.iter().zip(&mut self.gains) {
            let mut worst: Option<f64> = None;
            for place in places.iter().flatten() {
                let Some((column, slope)) = column_at(feature, place.at_px.y) else { continue };
                let off_px = place.at_px.x - column;
                let all2 = place.column2 + slope * slope * place.row2 + lane_sigma_px * lane_sigma_px;
                let mut density = f64::NEG_INFINITY;
                if off_px * off_px < FAR2 * all2 {
                    let sigma_px = place.column_px.hypot(slope * place.row_px).hypot(lane_sigma_px);
                    if off_px.abs() < 3.0 * sigma_px {
                        density = log_normal(off_px, sigma_px);
                    }
                }
                worst = Some(worst.map_or(density, |worst| worst.min(density)));
                if density == f64::NEG_INFINITY {
                    break;
                }
            }
            if let Some(density) = worst {
                *gain = gain.max(least + density);
            }
        }
    }
}

/// Where a cell sees a lane line, with the cell's variances there.
#[derive(Debug, Clone, Copy)]
struct Place {
    at_px: Point2<f64>,
    column_px: f64,
    row_px: f64,
    /// The squares of these, but for rounding.
    column2: f64,
    row2: f64,
}

impl Place {
    fn new(at_px: Point2<f64>, p: &Vector3<f64>, cell: &Cell, focal_px: f64) -> Self {
        let (column_px, row_px) = cell.pixels(p, focal_px);
        Self { at_px, column_px, row_px, column2: column_px * column_px, row2: row_px * row_px }
    }
}

/// Square of the standard deviations within which something is near, and a hair
/// more: what is not near by this is not by the exact ones either.
const FAR2: f64 = 9.0 * (1.0 + 1e-9);

fn is_inside(p: &Point2<f64>, scene: &Scene<'_>) -> bool {
    p.x > 0.0 && p.x < scene.image.width_px
}

fn log_normal(off: f64, sigma: f64) -> f64 {
    let share = off / sigma;
    -0.5 * share * share - (sigma * std::f64::consts::TAU.sqrt()).ln()
}

/// Column of a lane feature at a row, and columns per row there; none beyond
/// its ends.
fn column_at(feature: &PreparedLane, row_px: f64) -> Option<(f64, f64)> {
    feature.knots().windows(2).find_map(|ends| {
        let (a, b) = (ends[0].at_px, ends[1].at_px);
        let rows = b.y - a.y;
        let inside = rows.abs() > 1e-6 && (row_px - a.y) * (row_px - b.y) <= 0.0;
        let slope = (b.x - a.x) / rows;
        inside.then(|| (a.x + slope * (row_px - a.y), slope.abs()))
    })
}

#[cfg(test)]
mod tests {
    use common::geometry::retract;

    use super::*;
    use crate::associate::detection::DetectionConfig;
    use crate::local_map::LocalMap;
    use crate::measurement::NoiseConfig;
    use crate::prepare::Prepared;
    use crate::preselect::{Candidates, Lookup, PreselectConfig, Reach};
    use crate::testing::{IMAGE, Recipe, World};

    #[test]
    fn the_cell_of_the_true_pose_scores_higher_than_those_lanes_and_delineators_away() {
        let world = World::new(Recipe::default());
        let (mut map, preselect) = (LocalMap::whole(world.map.clone()), PreselectConfig::default());
        let (noise, detection) = (NoiseConfig::default(), DetectionConfig::default());
        let sigmas = Vector6::new(0.22, 0.15, 0.22, 0.026, 0.01, 0.026);
        for frame in [60, 100, 150] {
            let (truth, mut candidates) = (world.truth[frame], Candidates::default());
            let lookup = Lookup { map: &mut map, camera: &world.camera, image: IMAGE, config: &preselect };
            lookup.select(&truth, &Reach { position_m: 12.0, angle_rad: 0.4 }, &mut candidates).unwrap();
            let mut features = Prepared::default();
            features.fill(&world.features(frame));
            let (camera, candidates, features) = (&world.camera, &candidates, &features);
            let scene = Scene { camera, image: IMAGE, features, candidates, noise: &noise, detection: &detection };
            let (mut field, config) = (Field::default(), StartConfig::default());
            field.fill(&scene);
            let at_truth = field.score(&scene, &truth, &sigmas, &config);
            for (right_m, forward_m, yaw_rad) in [(3.5, 0.0, 0.0), (-3.5, 0.0, 0.0), (0.0, 6.0, 0.0), (0.0, 0.0, 0.15)]
            {
                let off = Vector6::new(right_m, 0.0, forward_m, 0.0, yaw_rad, 0.0);
                let there = field.score(&scene, &retract(&truth, &off), &sigmas, &config);
                assert!(there < at_truth, "frame {frame}, {off}: {there} against {at_truth}");
            }
        }
    }
}
