//! The way from fix to fix: whither a vehicle heads that drives forward, whatever its
//! receiver tells of its heading.

use std::f64::consts::{PI, SQRT_2, TAU};

use nalgebra::Point3;

use crate::gps::GpsFix;

/// A heading that is off the way by more contradicts it, radians: no corner is as sharp
/// from one fix to the next.
const CONTRADICTS_RAD: f64 = 1.0;
/// Standard deviation of a heading about the way that led there, radians: half of what a
/// car turns within a second.
const TURNED_RAD: f64 = 0.2;
/// A way is as long as so many standard deviations of the positions at its ends.
const LEAST_SIGMAS: f64 = 3.0;

/// What the fixes of a vehicle that moves say of its heading.
#[derive(Debug, Clone, Default)]
pub(super) struct Course {
    /// Where the present way began, and the time since then, seconds.
    began: Option<(Point3<f64>, f64)>,
    /// Direction of the last way about the down axis, and how well it is known, radians.
    way: Option<(f64, f64)>,
    /// Ways in a row that contradict the heading that fixes tell.
    against_told: usize,
    /// The same of the heading that is tracked.
    against_tracked: usize,
}

/// The angle from one heading to another, radians.
fn turned_rad(from_rad: f64, to_rad: f64) -> f64 {
    (to_rad - from_rad + PI).rem_euclid(TAU) - PI
}

impl Course {
    /// Time passes.
    pub fn drive(&mut self, dt_s: f64) {
        if let Some((_, since_s)) = &mut self.began {
            *since_s += dt_s;
        }
    }

    /// Takes in a fix, and the heading that is tracked, radians. Who goes no faster than
    /// `reverse_m_s` may go backwards, and ways that differ from each other say nothing.
    pub fn take(&mut self, fix: &GpsFix, tracked_rad: Option<f64>, reverse_m_s: f64) {
        let Some((from_map, since_s)) = self.began else {
            self.began = Some((fix.position_map, 0.0));
            return;
        };
        let way = fix.position_map - from_map;
        let (way_m, sigma_m) = (way.xz().norm(), SQRT_2 * fix.horizontal_sigma_m);
        if since_s <= 0.0 || way_m < LEAST_SIGMAS * sigma_m {
            return;
        }
        self.began = Some((fix.position_map, 0.0));
        let before = self.way.take();
        if way_m <= reverse_m_s * since_s + sigma_m {
            (self.against_told, self.against_tracked) = (0, 0);
            return;
        }
        let way_rad = way.x.atan2(way.z);
        self.way = Some((way_rad, TURNED_RAD.hypot(sigma_m.atan2(way_m))));
        let contradicts = |heading_rad: f64| turned_rad(heading_rad, way_rad).abs() > CONTRADICTS_RAD;
        let goes_on = !before.is_some_and(|(before_rad, _)| contradicts(before_rad));
        let count = |so_far: usize, heading_rad: Option<f64>| match heading_rad {
            Some(heading_rad) if contradicts(heading_rad) => {
                if goes_on {
                    so_far + 1
                } else {
                    1
                }
            }
            _ => 0,
        };
        self.against_told = count(self.against_told, fix.heading.map(|(yaw_rad, _)| yaw_rad));
        self.against_tracked = count(self.against_tracked, tracked_rad);
    }

    /// The fix with the heading of the way, where so many ways contradict what it tells.
    pub fn corrected(&self, fix: &GpsFix, after: usize) -> GpsFix {
        match self.way {
            Some(way) if self.against_told >= after => GpsFix { heading: Some(way), is_course: false, ..*fix },
            _ => *fix,
        }
    }

    /// The fix with the heading of the way, once where so many ways contradict what is
    /// tracked.
    pub fn overrules(&mut self, fix: &GpsFix, after: usize) -> Option<GpsFix> {
        let way = self.way.filter(|_| self.against_tracked >= after)?;
        self.against_tracked = 0;
        Some(GpsFix { heading: Some(way), is_course: false, ..*fix })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AFTER: usize = 3;

    /// Fixes a second apart, so many metres one from the other, to the east, which tell
    /// one heading while another is tracked.
    fn driven(steps_m: &[f64], told_rad: f64, tracked_rad: f64) -> (Course, GpsFix) {
        let heading = Some((told_rad, 0.03));
        let mut fix = GpsFix { position_map: Point3::origin(), horizontal_sigma_m: 1.5, heading, is_course: true };
        let mut course = Course::default();
        course.take(&fix, Some(tracked_rad), 3.0);
        for step_m in steps_m {
            course.drive(1.0);
            fix.position_map.x += step_m;
            course.take(&fix, Some(tracked_rad), 3.0);
        }
        (course, fix)
    }

    const EAST_RAD: f64 = PI / 2.0;

    #[test]
    fn fixes_that_move_on_overrule_headings_that_are_wrong() {
        for wrong_rad in [-EAST_RAD, 0.0, PI, -3.0] {
            let (mut course, fix) = driven(&[12.0; 4], wrong_rad, wrong_rad);
            for corrected in [course.corrected(&fix, AFTER), course.overrules(&fix, AFTER).unwrap()] {
                let (yaw_rad, sigma_rad) = corrected.heading.unwrap();
                assert!((yaw_rad - EAST_RAD).abs() < 1e-9 && (0.2..0.4).contains(&sigma_rad));
            }
            // Once: what is tracked then is another.
            assert!(course.overrules(&fix, AFTER).is_none());
        }
    }

    #[test]
    fn what_agrees_or_may_go_backwards_or_jumps_is_not_overruled() {
        let right = EAST_RAD + 0.6;
        // As it should be, in reverse, there and back by reflections, too few.
        for (steps_m, heading_rad) in
            [(&[12.0; 9][..], right), (&[2.5; 9], -EAST_RAD), (&[20.0, -20.0, 20.0, -20.0], 0.0), (&[12.0; 2], 0.0)]
        {
            let (mut course, fix) = driven(steps_m, heading_rad, heading_rad);
            assert_eq!(course.corrected(&fix, AFTER), fix);
            assert!(course.overrules(&fix, AFTER).is_none(), "{steps_m:?}");
        }
    }
}
