//! A pole as its fit describes it.

use nalgebra::{Matrix2, Point2, Point3, Vector2, Vector3};

use super::PoleConfig;
use super::axis::Axis;

/// A pole as fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedPole {
    /// Lower end of the axis, map frame, metres: on the ground, whether the
    /// pole can be seen down to it or not.
    pub foot: Point3<f64>,
    /// Upper end of the axis, map frame, metres.
    pub top: Point3<f64>,
    /// Height above ground from which on it is seen, metres; 0 where that is
    /// near the ground.
    pub foot_height_m: f64,
    /// Height of the upper end above ground, metres.
    pub top_height_m: f64,
    /// Radius of the pole, metres.
    pub radius_m: f64,
    /// Root mean square horizontal distance of the points from a cylinder of
    /// that radius, metres, beyond what the width of the beams explains.
    pub spread_m: f64,
    /// Points on the free part.
    pub points: usize,
    /// Scans that hit it.
    pub scans: usize,
    /// Scans from near enough to expect hits on it.
    pub scans_near: usize,
    /// Points on the free part over those expected were nothing in the way.
    pub visibility: f64,
    /// Range of the nearest hit on it, metres.
    pub nearest_hit_m: f64,
    /// Length of the free part, metres.
    pub free_m: f64,
    /// Whether it ends where the scanners' field of view does.
    pub top_is_open: bool,
    /// Share of its slices in which something reaches from it outwards: rails
    /// of a fence, boards, a hedge that it stands in.
    pub attached_share: f64,
    /// Share of the space around it, at its own heights, that is filled: a hedge's.
    pub hedge_share: f64,
    /// How many times as many hits per area are on it as around it, in three of four slices;
    /// infinite where it is in no hedge.
    pub stands_out: f64,
    /// Whether there is a wall below that goes on to both sides: what looks free may be a
    /// piece of it between windows.
    pub stands_on_wall: bool,
    /// Direction, map (x, z), in which the rail of a fence goes out from it; none
    /// of what cannot be of a fence.
    pub rail: Option<Vector2<f64>>,
    /// Largest reflectance that at least three of its points have.
    pub reflectance: f32,
    /// Share of its points that are as bright as sheeting.
    pub bright_share: f64,
    /// Height of the third highest of them above ground, metres; 0 where there are fewer.
    pub bright_top_m: f64,
    /// Whether all that is seen of it is the plates that it carries: its axis is then in
    /// their middle.
    pub shows_plates_alone: bool,
    /// Slope of the axis, `(dx, dz)` per metre upwards, as its points and
    /// the plumb line tell it.
    pub slope: Vector2<f64>,
    /// The same as its points alone tell it.
    pub slope_of_hits: Vector2<f64>,
    /// The covariance of that, rad^2.
    pub slope_covariance: Matrix2<f64>,
}

impl FittedPole {
    /// Whether it ends below any sign: where the field of view ends nobody knows.
    pub fn is_short(&self, config: &PoleConfig) -> bool {
        self.top_height_m <= config.short_top_m && !self.top_is_open
    }

    /// Whether there is retro-reflective sheeting on it: it was put up for the
    /// traffic.
    pub fn has_sheeting(&self, config: &PoleConfig) -> bool {
        self.reflectance >= config.sheeting_reflectance
    }

    /// Where its axis, made longer if need be, is as high as a point: map (x, z).
    pub fn at_height_of(&self, point: &Point3<f64>) -> Point2<f64> {
        Point2::new(self.foot.x, self.foot.z) + self.slope * (self.foot.y - point.y)
    }

    /// Puts its ends, at their heights, on an axis.
    pub(super) fn put_along(&mut self, axis: &Axis) {
        for end in [&mut self.foot, &mut self.top] {
            let at = axis.at(-end.y);
            (end.x, end.z) = (at.x, at.y);
        }
        (self.slope, self.slope_of_hits, self.slope_covariance) =
            (axis.slope, axis.slope_of_hits, axis.slope_covariance);
    }

    /// Angle of the axis from the vertical of the map, radians.
    pub fn tilt_rad(&self) -> f64 {
        (self.top - self.foot).angle(&-Vector3::y())
    }
}
