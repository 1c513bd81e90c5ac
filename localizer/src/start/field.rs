//! A cheap score for the many cells of a search: how well columns and rows of
//! poles, signs and lane lines fit at a pose. No gates of a covariance, no
//! pairs of ends: it only says which cells are worth the full matching.

use common::geometry::Pose;
use common::map::PoleKind;
use nalgebra::{Point2, Vector3, Vector6};

use super::StartConfig;
use crate::associate::matching::Scene;
use crate::prepare::{MAX_KNOTS, PreparedLane};
use crate::projection::View;

/// A pole feature, as far as the score needs it.
#[derive(Debug, Clone, Copy)]
struct Mark {
    is_trunk: bool,
    column_px: f64,
    top_px: f64,
    bottom_px: f64,
    variance_px2: f64,
}

/// A stretch of a lane feature.
#[derive(Debug, Clone, Copy, Default)]
struct Stretch {
    from_row_px: f64,
    to_row_px: f64,
    column_px: f64,
    /// Columns per row.
    slope: f64,
}

/// A lane feature: where it is in each row.
#[derive(Debug, Clone, Copy, Default)]
struct Curve {
    stretches: [Stretch; MAX_KNOTS],
    count: usize,
    first_row_px: f64,
    last_row_px: f64,
}

impl Curve {
    fn new(feature: &PreparedLane) -> Self {
        let mut curve = Self { first_row_px: f64::MAX, last_row_px: f64::MIN, ..Self::default() };
        for ends in feature.knots().windows(2) {
            let (a, b) = (ends[0].at_px, ends[1].at_px);
            let rows_px = b.y - a.y;
            let Some(stretch) = curve.stretches.get_mut(curve.count).filter(|_| rows_px.abs() > 1e-6) else { continue };
            *stretch = Stretch { from_row_px: a.y, to_row_px: b.y, column_px: a.x, slope: (b.x - a.x) / rows_px };
            curve.count += 1;
            curve.first_row_px = curve.first_row_px.min(a.y).min(b.y);
            curve.last_row_px = curve.last_row_px.max(a.y).max(b.y);
        }
        curve
    }

    /// Its column at a row, and columns per row there; none beyond its ends.
    fn column_at(&self, row_px: f64) -> Option<(f64, f64)> {
        if !(self.first_row_px..=self.last_row_px).contains(&row_px) {
            return None;
        }
        let is_in = |at: &&Stretch| (row_px - at.from_row_px) * (row_px - at.to_row_px) <= 0.0;
        let at = self.stretches.iter().take(self.count).find(is_in)?;
        Some((at.column_px + at.slope * (row_px - at.from_row_px), at.slope))
    }
}

/// Variances of a cell.
#[derive(Debug, Clone, Copy)]
struct Cell {
    position_m2: f64,
    yaw_rad2: f64,
    height_m2: f64,
    tilt_rad2: f64,
    focal_px2: f64,
}

impl Cell {
    fn new(sigmas: &Vector6<f64>, focal_px: f64) -> Self {
        let squares = sigmas.component_mul(sigmas);
        Self {
            position_m2: squares[0].max(squares[2]),
            yaw_rad2: squares[4],
            height_m2: squares[1],
            tilt_rad2: squares[3].max(squares[5]),
            focal_px2: focal_px * focal_px,
        }
    }

    /// Variances of column and row (px^2) of a point in camera axes, of which
    /// one over the depth is known.
    fn variances_px2(&self, p: &Vector3<f64>, inverse_m: f64) -> (f64, f64) {
        let (slope, inverse_m2) = (p.x * inverse_m, inverse_m * inverse_m);
        let slant2 = slope * slope + 1.0;
        let column = (self.position_m2 * inverse_m2 + self.yaw_rad2 * slant2) * slant2;
        (self.focal_px2 * column, self.focal_px2 * (self.height_m2 * inverse_m2 + self.tilt_rad2 * slant2))
    }
}

/// A frame seen from a cell.
struct Look<'a> {
    scene: &'a Scene<'a>,
    view: View,
    cell: Cell,
    config: &'a StartConfig,
}

/// The sum of logarithms, of which few are taken.
#[derive(Debug, Clone, Copy)]
struct Product {
    ln: f64,
    rest: f64,
}

impl Product {
    const ONE: Self = Self { ln: 0.0, rest: 1.0 };

    /// By a factor of 0.01 to 1.
    fn times(&mut self, factor: f64) {
        self.rest *= factor;
        if self.rest < 1e-200 {
            *self = Self { ln: self.ln(), rest: 1.0 };
        }
    }

    fn ln(&self) -> f64 {
        self.ln + self.rest.ln()
    }
}

/// What a frame shows, and buffers of the score.
#[derive(Debug, Clone, Default)]
pub struct Field {
    /// By column.
    poles: Vec<Mark>,
    /// The largest of their variances.
    most_px2: f64,
    lanes: Vec<Curve>,
    gains: Vec<f64>,
}

impl Field {
    /// Takes in what a frame shows.
    pub fn fill(&mut self, scene: &Scene<'_>) {
        self.poles.clear();
        self.poles.extend(scene.features.poles.iter().map(|pole| Mark {
            is_trunk: pole.is_trunk,
            column_px: pole.upper_px.x + 0.5 * pole.length_px * pole.down.x,
            top_px: pole.upper_px.y,
            bottom_px: pole.upper_px.y + pole.length_px * pole.down.y,
            variance_px2: (pole.offset_sigma_px + pole.angle_sigma_rad * pole.length_px).powi(2),
        }));
        self.poles.sort_unstable_by(|a, b| a.column_px.total_cmp(&b.column_px));
        self.most_px2 = self.poles.iter().map(|mark| mark.variance_px2).fold(0.0, f64::max);
        self.lanes.clear();
        self.lanes.extend(scene.features.lanes.iter().map(Curve::new));
    }

    /// The score of a cell with these standard deviations (camera tangent),
    /// nats: as the support of a frame, but each feature taken by the landmark
    /// that fits it best.
    pub fn score(&mut self, scene: &Scene<'_>, pose: &Pose, sigmas: &Vector6<f64>, config: &StartConfig) -> f64 {
        let (view, cell) = (View::new(scene.camera, pose), Cell::new(sigmas, scene.camera.fx_px));
        let look = Look { scene, view, cell, config };
        let mut unseen = Product::ONE;
        let gains = self.score_poles(&look, &mut unseen)
            + self.score_signs(&look, &mut unseen)
            + self.score_lanes(&look, &mut unseen);
        unseen.ln() + gains
    }

    /// Begins a count over `features`.
    fn begin(&mut self, features: usize) {
        self.gains.clear();
        self.gains.resize(features, 0.0);
    }

    fn total(&self) -> f64 {
        self.gains.iter().sum()
    }

    fn score_poles(&mut self, look: &Look<'_>, unseen: &mut Product) -> f64 {
        let Look { scene, view, cell, config } = look;
        self.begin(self.poles.len());
        let (camera, focal_px) = (scene.camera, scene.camera.fx_px);
        let clutter_per_px = |kind| scene.features.count_of(kind).max(1) as f64 / scene.image.width_px;
        for pole in scene.candidates.poles.iter().filter(|pole| scene.features.tells_of(pole.kind)) {
            let is_trunk = pole.kind == PoleKind::Trunk;
            let (foot, top) = (view.to_camera(&pole.foot_map), view.to_camera(&pole.top_map));
            if foot.z.min(top.z) < config.nearest_m {
                continue;
            }
            let inverse_m = 1.0 / foot.z;
            let column_px = focal_px * foot.x * inverse_m + camera.cx_px;
            let top_is_in = camera.fy_px * top.y < (scene.image.height_px - camera.cy_px) * top.z;
            let is_expected = column_px > 0.0 && column_px < scene.image.width_px && top_is_in;
            let found = || scene.detection.pole(pole.kind, foot.z, pole.sight_m);
            let mut known = None;
            if is_expected {
                let found = *known.get_or_insert_with(found);
                unseen.times(1.0 - found);
            }
            let (column_px2, row_px2) = cell.variances_px2(&foot, inverse_m);
            let (landmark_px, calibration_px) =
                (scene.noise.pole_sigma_m * focal_px * inverse_m, scene.noise.calibration_px(focal_px));
            let own_px2 = column_px2 + landmark_px * landmark_px + calibration_px * calibration_px;
            let reach_px = (NEAR2 * (own_px2 + self.most_px2)).sqrt();
            let first = self.poles.partition_point(|mark| mark.column_px < column_px - reach_px);
            for (mark, gain) in self.poles.iter().zip(&mut self.gains).skip(first) {
                let off_px = column_px - mark.column_px;
                if off_px < -reach_px {
                    break;
                }
                let (off_px2, variance_px2) = (off_px * off_px, own_px2 + mark.variance_px2);
                if off_px2 >= NEAR2 * variance_px2 || mark.is_trunk != is_trunk {
                    continue;
                }
                let row_px = row_px2.sqrt();
                let (low_px, high_px) =
                    (camera.fy_px * foot.y * inverse_m + camera.cy_px, camera.fy_px * top.y / top.z + camera.cy_px);
                let deepest_px = low_px + 2.0 * row_px + scene.noise.foot_sigma_m * focal_px * inverse_m;
                let overlaps = mark.top_px < low_px + row_px && mark.bottom_px > high_px - row_px;
                if overlaps && mark.bottom_px < deepest_px {
                    let found = *known.get_or_insert_with(found);
                    let ratio = found / ((1.0 - found) * clutter_per_px(pole.kind));
                    *gain = gain.max(log_normal(ratio, off_px2, variance_px2));
                }
            }
        }
        self.total()
    }

    fn score_signs(&mut self, look: &Look<'_>, unseen: &mut Product) -> f64 {
        let Look { scene, view, cell, config } = look;
        self.begin(scene.features.signs.len());
        let focal_px = scene.camera.fx_px;
        let band_px2 = scene.image.width_px * scene.image.height_px * scene.detection.sign_band_of_height;
        let clutter_per_px2 = scene.features.signs.len().max(1) as f64 / band_px2;
        for sign in &scene.candidates.signs {
            let p = view.to_camera(&sign.centroid_map);
            if p.z < config.nearest_m {
                continue;
            }
            let inverse_m = 1.0 / p.z;
            let at = view.pixel(&p);
            let found = || scene.detection.sign(sign.kind, p.z, sign.sight_m);
            let mut known = None;
            if scene.image.contains(&at, 0.0) {
                let found = *known.get_or_insert_with(found);
                unseen.times(1.0 - found);
            }
            let (fixed_m, by_size_m) = (scene.noise.sign_sigma_m, scene.noise.sign_sigma_of_size * sign.size_m);
            let (column_px2, row_px2) = cell.variances_px2(&p, inverse_m);
            let own_px2 = (fixed_m * fixed_m + by_size_m * by_size_m) * cell.focal_px2 * inverse_m * inverse_m;
            for ((_, feature), gain) in scene.features.signs.iter().zip(&mut self.gains) {
                let (off_px, own_px2) = (at - feature.centre_px, own_px2 + feature.sigma_px * feature.sigma_px);
                let (across_px2, along_px2) = (own_px2 + column_px2, own_px2 + row_px2);
                let (off_x2, off_y2) = (off_px.x * off_px.x, off_px.y * off_px.y);
                if off_x2 >= NEAR2 * across_px2 || off_y2 >= NEAR2 * along_px2 || feature.kind != sign.kind {
                    continue;
                }
                let ratio = feature.extent_px.norm() / (sign.size_m * focal_px * inverse_m).max(1.0);
                let most = scene.noise.max_size_ratio;
                if (1.0 / most..=most).contains(&ratio) {
                    let found = *known.get_or_insert_with(found);
                    let ratio = found / ((1.0 - found) * clutter_per_px2);
                    let along = log_normal(ratio, off_y2, along_px2);
                    *gain = gain.max(along + log_normal(1.0, off_x2, across_px2));
                }
            }
        }
        self.total()
    }

    fn score_lanes(&mut self, look: &Look<'_>, unseen: &mut Product) -> f64 {
        let Look { scene, view, cell, config } = look;
        self.begin(self.lanes.len());
        let clutter_per_px = self.lanes.len().max(1) as f64 / scene.image.width_px;
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
            let places = places.map(|place| {
                let p = place?;
                let at_px = view.pixel(&p);
                let variances_px2 = cell.variances_px2(&p, 1.0 / p.z);
                scene.image.contains(&at_px, 0.0).then_some(Place { at_px, variances_px2 })
            });
            if places.iter().all(Option::is_none) {
                continue;
            }
            let found = scene.detection.lane(lane.kind);
            unseen.times(1.0 - found);
            let ratio = found / ((1.0 - found) * clutter_per_px);
            for (curve, gain) in self.lanes.iter().zip(&mut self.gains) {
                *gain = gain.max(places_on(curve, &places, ratio, config.lane_sigma_px));
            }
        }
        self.total()
    }
}

/// What speaks for a lane line being at these places, nats, or 0. They are not
/// independent: the one that fits worst counts.
fn places_on(curve: &Curve, places: &[Option<Place>; 3], ratio: f64, lane_sigma_px: f64) -> f64 {
    let mut fits = [None; 3];
    for (place, fit) in places.iter().zip(&mut fits) {
        let Some(place) = place else { continue };
        let Some((column_px, slope)) = curve.column_at(place.at_px.y) else { continue };
        let off_px = place.at_px.x - column_px;
        let (across_px2, along_px2) = place.variances_px2;
        let variance_px2 = across_px2 + slope * slope * along_px2 + lane_sigma_px * lane_sigma_px;
        if off_px * off_px >= NEAR2 * variance_px2 {
            return 0.0;
        }
        *fit = Some((off_px * off_px, variance_px2));
    }
    let fits = fits.iter().flatten().map(|&(off_px2, variance_px2)| log_normal(ratio, off_px2, variance_px2));
    fits.reduce(f64::min).unwrap_or(0.0)
}

/// Where a cell sees a lane line, with the cell's variances there (px^2), of
/// the column and of the row.
#[derive(Debug, Clone, Copy)]
struct Place {
    at_px: Point2<f64>,
    variances_px2: (f64, f64),
}

/// Three standard deviations, within which something is near, squared.
const NEAR2: f64 = 9.0;

/// Logarithm of a ratio times a normal density, one for both.
fn log_normal(ratio: f64, off2: f64, variance: f64) -> f64 {
    0.5 * (ratio * ratio / (variance * std::f64::consts::TAU)).ln() - 0.5 * off2 / variance
}

#[cfg(test)]
mod tests {
    use common::geometry::retract;

    use super::*;
    use crate::associate::detection::DetectionConfig;
    use crate::associate::odds::UsualOdds;
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
            let (noise, detection, odds) = (&noise, &detection, UsualOdds::default());
            let scene = Scene { camera, image: IMAGE, features, candidates, noise, detection, odds };
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

    #[test]
    fn a_product_of_many_small_factors_is_the_sum_of_their_logarithms() {
        let mut product = Product::ONE;
        (0..1000).for_each(|_| product.times(0.01));
        assert!((product.ln() - 1000.0 * 0.01_f64.ln()).abs() < 1e-6, "{}", product.ln());
    }
}
