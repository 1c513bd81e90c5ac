//! Traffic signs and lights: retro-reflective clusters above the ground, and
//! plates and boxes on posts.
//!
//! Reflectance finds the fronts of signs, and shape what is seen from behind.
//! Either way the outline comes from the [`rows`] of hits that single beams
//! leave, whether bright or not: the mean of the bright hits lies low, as the
//! lidar's field of view cuts a plate until it is so far that it looks dark.

mod backs;
mod bright;
mod config;
mod lights;
mod outline;
mod plate;
mod rows;
mod stacked;
mod told;
mod views;

use common::map::{PoleKind, SignKind};
use nalgebra::{Point2, Point3, Vector2};
use rayon::prelude::*;

pub(crate) use bright::clusters;
pub use config::{AloneConfig, BackConfig, LightConfig, OutlineConfig, SignConfig};
pub use outline::plates;
pub use plate::Plate;
pub use rows::{Axis, Row, rows};

use backs::Known;
use bright::{BrightPlate, bright_plates};
use views::Views;

use crate::cloud::Cloud;
use crate::config::Config;
use crate::looks::{Stands, standing};
use crate::poles::{FittedPole, PoleConfig};

/// A sign as found.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundSign {
    /// What it is.
    pub kind: SignKind,
    /// Centroid, map frame, metres.
    pub centroid: Point3<f64>,
    /// Largest distance of two of its points, metres.
    pub size_m: f64,
    /// Hits on it.
    pub points: usize,
    /// Scans that saw it.
    pub scans: usize,
    /// Direction that its front looks in, of unit length, in the plane (x, z) of
    /// the map; none where it cannot be told.
    pub facing: Option<Vector2<f64>>,
    /// One standard deviation of the centroid across, in height and along the
    /// normal, metres; none where the outline could not be found.
    pub sigma_m: Option<[f64; 3]>,
}

/// The signs and lights of a stitched cloud, given its poles.
pub fn find_signs(cloud: &Cloud, poles: &[(PoleKind, FittedPole)], config: &Config) -> Vec<FoundSign> {
    let Config { signs: config, poles: of_poles, lidar, .. } = config;
    let views = Views::new(cloud, &config.looks, lidar);
    let bright = bright_plates(cloud, config, lidar);
    let bright: Vec<Vec<FoundSign>> = bright.par_iter().map(|plate| outlined(plate, &views, poles, config)).collect();
    let carries_sign = |pole: &FittedPole| bright.iter().flatten().any(|sign| is_over(sign, &pole.top));
    let on_posts: Vec<Vec<FoundSign>> = poles
        .par_iter()
        .filter(|(kind, pole)| may_be_post(*kind, pole, of_poles))
        .map(|(_, pole)| on_post(pole, carries_sign(pole), &views, config))
        .collect();
    // Of what hides in part, bright points alone tell least.
    let (with_outline, without): (Vec<FoundSign>, Vec<FoundSign>) =
        bright.into_iter().flatten().partition(|sign| sign.sigma_m.is_some());
    let mut found: Vec<FoundSign> = Vec::new();
    for sign in with_outline.into_iter().chain(on_posts.into_iter().flatten()).chain(without) {
        if !found.iter().any(|known| is_same(known, &sign)) {
            found.push(sign);
        }
    }
    standing(found, cloud, &config.looks, lidar)
}

impl Stands for FoundSign {
    fn middle(&self) -> Point2<f64> {
        Point2::new(self.centroid.x, self.centroid.z)
    }

    fn radius_m(&self) -> f64 {
        HALF_SIDE * self.size_m
    }

    fn beside_m(&self, at: &Point3<f64>, view: Vector2<f64>) -> Option<f64> {
        let off = at - self.centroid;
        (off.y.abs() <= self.radius_m()).then(|| Vector2::new(off.x, off.z).perp(&view).abs())
    }
}

/// Half of the side of a square over its diagonal.
const HALF_SIDE: f64 = 0.35;

/// What is called a sign post ends at a sign: where none hangs at the upper end of
/// a post, leaves may hide how far it goes on (of 46 such posts on ten generated
/// drives 32 do go on, 26 of them lamp posts), and it counts as a lamp post. A stem
/// as thin as a post that ends at a sign is one.
pub fn name_posts(poles: &mut [(PoleKind, FittedPole)], signs: &[FoundSign], config: &PoleConfig) {
    for (kind, pole) in poles {
        let ends_at = |sign: &FoundSign| {
            let upper = sign.centroid.y - sign.size_m / 2.0;
            is_over(sign, &pole.top) && upper < pole.top.y + BELOW_TOP_M
        };
        *kind = match (*kind, signs.iter().any(ends_at)) {
            (PoleKind::SignPost, false) => PoleKind::LampPost,
            (PoleKind::Trunk, true) if may_be_post(*kind, pole, config) => PoleKind::SignPost,
            (kind, _) => kind,
        };
    }
}

/// Whether plates may hang on it: beside a roof or leaves a slender post looks like a
/// tree, and few trees are as thin.
fn may_be_post(kind: PoleKind, pole: &FittedPole, config: &PoleConfig) -> bool {
    kind != PoleKind::Trunk || pole.radius_m <= config.slender_m
}

/// Whether a sign is where a post is, seen from above.
fn is_over(sign: &FoundSign, top: &Point3<f64>) -> bool {
    (sign.centroid.x - top.x).hypot(sign.centroid.z - top.z) < SAME_M
}

/// What hangs on a post, whether bright or not; `carries_sign` where something bright
/// is on it.
fn on_post(pole: &FittedPole, carries_sign: bool, views: &Views<'_>, config: &SignConfig) -> Vec<FoundSign> {
    let axis = Axis { foot: pole.foot, top: pole.top, radius_m: pole.radius_m };
    let from = |lowest_m: f64| rows(views, &axis, (lowest_m - POST_BELOW_M, pole.top_height_m + OVER_TOP_M));
    let known = Known { carries_sign, is_hidden: pole.shows_plates_alone };
    let plates_from =
        |lowest_m: f64, rows: &[Row], known: Known| backs::plates_on(rows, &axis, lowest_m, known, views, config);
    let rows = from(config.backs.lowest_m.min(config.lights.lowest_m));
    // Lights first: from behind they may look like plates.
    let mut found = lights::lights_on(&rows, &axis, config);
    let plates = plates_from(config.backs.lowest_m, &rows, known);
    // Only below a plate is another one looked for nearer to the ground.
    let lowest = plates.iter().map(|sign| sign.centroid.y).max_by(f64::total_cmp);
    found.extend(plates);
    if let Some(lowest) = lowest {
        let known = Known { carries_sign: true, ..known };
        let lower = plates_from(config.backs.lowest_below_m, &from(config.backs.lowest_below_m), known);
        found.extend(lower.into_iter().filter(|sign| sign.centroid.y > lowest));
    }
    found
}

/// Plates reach up to this far over the end of their post, metres: it is where
/// the post can no longer be told from them.
const OVER_TOP_M: f64 = 1.5;
/// The bare post is looked for this far below a plate, metres.
const POST_BELOW_M: f64 = 1.0;

/// Whether two are the same sign: closer in each direction than two plates on
/// one post.
fn is_same(a: &FoundSign, b: &FoundSign) -> bool {
    let d = a.centroid - b.centroid;
    d.y.abs() < 0.3 * (a.size_m + b.size_m).min(1.4) && d.x.hypot(d.z) < SAME_M
}

/// Signs nearer than this in the plane (x, z) hang on one post, metres.
const SAME_M: f64 = 0.5;

/// A post reaches up to this far above the sign that it ends at, metres: with a
/// cap, or as the beams that meet the sign lie apart.
const BELOW_TOP_M: f64 = 0.35;

/// A post is looked for this near to a bright plate, metres.
const POST_WITHIN_M: f64 = 0.4;
/// Radius of a post that is not known, metres.
const POST_RADIUS_M: f64 = 0.04;

/// A retro-reflective plate with its outline; several where its bright points
/// melt together, and as it is by its bright points where its rows do not
/// stand out.
fn outlined(
    plate: &BrightPlate,
    views: &Views<'_>,
    poles: &[(PoleKind, FittedPole)],
    config: &SignConfig,
) -> Vec<FoundSign> {
    let at = plate.sign.centroid;
    let radius_m = poles
        .iter()
        .find(|(_, p)| (p.foot.x - at.x).hypot(p.foot.z - at.z) < POST_WITHIN_M)
        .map_or(POST_RADIUS_M, |(_, p)| p.radius_m);
    let axis = Axis::through(&at, radius_m);
    let band = (plate.above_ground_m - 0.8, plate.above_ground_m + config.largest_m);
    let rows = rows(views, &axis, band);
    let (low, high) = plate.heights;
    let signs: Vec<FoundSign> = plates(&rows, &axis, views, &config.outline)
        .iter()
        .filter(|p| {
            p.bright_share >= config.outline.least_bright_share
                && p.width_m.max(p.edges.1 - p.edges.0) <= config.largest_m
        })
        .filter(|p| {
            let shared = p.edges.1.min(high) - p.edges.0.max(low);
            shared > 0.5 * (p.edges.1 - p.edges.0).min(high - low)
        })
        .map(|p| p.sign(SignKind::TrafficSign))
        .collect();
    if signs.is_empty() { vec![plate.sign.clone()] } else { signs }
}

impl Plate {
    fn sign(&self, kind: SignKind) -> FoundSign {
        FoundSign {
            kind,
            centroid: self.centroid,
            size_m: self.size_m,
            points: self.hits,
            scans: self.scans,
            facing: Some(self.normal),
            sigma_m: Some(self.sigma_m),
        }
    }
}

#[cfg(test)]
mod tests;
