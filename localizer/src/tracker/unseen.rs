//! Where a vehicle may have gone while no image came for long.
//!
//! The filter moves a pose on as a car goes that is seen again soon: along its road. In
//! half a minute it may have turned into any street. So until a pose is ok again nothing
//! is said to be known better than how far the vehicle may have gone.

use common::geometry::Pose;
use nalgebra::{Matrix6, Point3, Vector6};
use serde::{Deserialize, Serialize};

use crate::estimate::Status;
use crate::gps::GpsFix;

/// What is known of a vehicle whose camera was off.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct UnseenConfig {
    /// Longest time without an image after which the filter knows where a vehicle is,
    /// seconds: within it a car goes round a corner.
    pub longest_seen_s: f64,
    /// Time after which nothing is known of where a vehicle went that nobody saw, seconds:
    /// at the speed of towns it is three hundred metres away, as far as it is ever
    /// searched. Moved on for a day, at the speed that it had, it would be beyond the
    /// Earth's other side.
    pub longest_untold_s: f64,
    /// The same where wheels and gyroscope tell one mean speed and one turn, seconds: of
    /// minutes they say little more than whether it stood.
    pub longest_told_s: f64,
    /// A longer time without an image is gone through in steps, seconds: of this where
    /// nothing tells how the vehicle moved, for a speed that changes and a turn die out,
    /// else of this or longer, as a log has lines.
    pub step_s: f64,
    /// What goes unseen goes as fast or faster, m/s, as in towns: who stood may have set
    /// off.
    pub least_m_s: f64,
    /// Way after which a vehicle may head anywhere, metres: half a circle of a small car.
    pub turned_m: f64,
    /// Standard deviation of a heading of which nothing is known, radians: the same chance
    /// for all.
    pub any_heading_rad: f64,
}

impl Default for UnseenConfig {
    fn default() -> Self {
        Self {
            longest_seen_s: 3.0,
            longest_untold_s: 30.0,
            longest_told_s: 300.0,
            step_s: 0.25,
            least_m_s: 10.0,
            turned_m: 15.0,
            any_heading_rad: 1.8,
        }
    }
}

/// What is not known since the images failed to come.
#[derive(Debug, Clone, Default)]
pub(super) struct Unseen {
    /// How far the vehicle may be from where it is taken to be, or from the last fix,
    /// metres; zero where all was seen.
    way_m: f64,
    /// The last fix since then.
    fix_map: Option<Point3<f64>>,
}

impl Unseen {
    /// Takes in a time without an image, and the speed of the vehicle: `told_m_s` by what
    /// tells it all along, else `tracked_m_s`, which it had when it was last seen. Says
    /// whether that was so long that it may be elsewhere.
    pub fn drive(&mut self, dt_s: f64, told_m_s: Option<f64>, tracked_m_s: f64, config: &UnseenConfig) -> bool {
        let is_long = dt_s > config.longest_seen_s;
        if is_long || self.fix_map.is_some() {
            let least_m_s = if is_long { config.least_m_s } else { 0.0 };
            self.way_m += told_m_s.map_or(tracked_m_s.abs().max(least_m_s), f64::abs) * dt_s;
        }
        is_long && self.is_open()
    }

    /// Takes in that the vehicle is near a fix, within this distance, metres; says whether
    /// nothing else told before where it is.
    pub fn hear(&mut self, fix: &GpsFix, within_m: f64) -> bool {
        if !self.is_open() {
            return false;
        }
        self.way_m = within_m;
        self.fix_map.replace(fix.position_map).is_none()
    }

    /// Whether it may be elsewhere than it is taken to be.
    pub fn is_open(&self) -> bool {
        self.way_m > 0.0
    }

    /// What is said of a pose that is taken for this: where it is ok, all is known again,
    /// but by what shows the same; until then it may be anywhere where no fix says where.
    pub fn judged(&mut self, status: Status, shows_the_same: bool) -> Status {
        if status == Status::Ok && !shows_the_same {
            *self = Self::default();
        }
        if self.is_open() && self.fix_map.is_none() { Status::Lost } else { status }
    }

    /// What is not known of a pose, in its tangent: as far to the right as forward, and its
    /// heading; none where all was seen.
    pub fn covariance(&self, map_from_camera: &Pose, config: &UnseenConfig) -> Option<Matrix6<f64>> {
        let position_map = Point3::from(map_from_camera.translation.vector);
        let off_m = self.fix_map.map_or(0.0, |fix_map| (fix_map - position_map).xz().norm());
        let turned = (self.way_m / config.turned_m).min(1.0);
        let (off_m, heading_rad) = (self.way_m.hypot(off_m), config.any_heading_rad * turned);
        let sigmas = Vector6::new(off_m, 0.0, off_m, 0.0, heading_rad, 0.0);
        self.is_open().then(|| Matrix6::from_diagonal(&sigmas.component_mul(&sigmas)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sigmas(unseen: &Unseen) -> Vector6<f64> {
        unseen.covariance(&Pose::identity(), &UnseenConfig::default()).unwrap_or_default().diagonal().map(f64::sqrt)
    }

    #[test]
    fn what_went_unseen_is_as_far_away_as_it_can_have_gone_to_any_side() {
        let mut unseen = Unseen::default();
        unseen.drive(0.1, None, 12.0, &UnseenConfig::default());
        assert!(sigmas(&unseen).norm() <= 0.0 && unseen.judged(Status::Degraded, false) == Status::Degraded);
        unseen.drive(30.0, None, 12.0, &UnseenConfig::default());
        let after = sigmas(&unseen);
        assert!((after[0] - 360.0).abs() < 1e-9 && (after[2] - 360.0).abs() < 1e-9 && after[4] > 1.5, "{after}");
        // Images come again, and do not say where.
        unseen.drive(0.1, None, 12.0, &UnseenConfig::default());
        assert!((sigmas(&unseen) - after).norm() <= 0.0);
        assert_eq!(
            (unseen.judged(Status::Degraded, false), unseen.judged(Status::Ok, true)),
            (Status::Lost, Status::Lost)
        );
        assert_eq!(unseen.judged(Status::Ok, false), Status::Ok);
        assert!(sigmas(&unseen).norm() <= 0.0);
    }

    #[test]
    fn who_stood_may_have_set_off_but_where_wheels_say_that_it_did_not() {
        for (told_m_s, least_m) in [(None, 290.0), (Some(0.0), 0.0)] {
            let mut unseen = Unseen::default();
            unseen.drive(30.0, told_m_s, 0.0, &UnseenConfig::default());
            let right_m = sigmas(&unseen)[0];
            assert!(right_m >= least_m && (told_m_s.is_none() || right_m <= 0.0), "{right_m}");
        }
    }

    #[test]
    fn a_fix_says_where_it_went() {
        let mut unseen = Unseen::default();
        unseen.drive(30.0, None, 12.0, &UnseenConfig::default());
        let position_map = Point3::new(30.0, 0.0, 40.0);
        let fix = GpsFix { position_map, horizontal_sigma_m: 1.5, heading: None, is_course: false, age_s: 0.0 };
        assert!(unseen.hear(&fix, 6.0) && !unseen.hear(&fix, 6.0) && !Unseen::default().hear(&fix, 6.0));
        // What is said 50 m from it is off by about as much.
        let right_m = sigmas(&unseen)[0];
        assert!((50.0..51.0).contains(&right_m), "{right_m}");
        assert_eq!(unseen.judged(Status::Degraded, false), Status::Degraded);
        unseen.drive(0.5, None, 12.0, &UnseenConfig::default());
        let later_m = sigmas(&unseen)[0];
        assert!(later_m > right_m + 0.5, "{later_m}");
    }
}
