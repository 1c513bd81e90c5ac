//! The way from fix to fix: whither a vehicle heads that drives forward, whatever its
//! receiver tells of its heading.

use std::f64::consts::SQRT_2;

use common::geometry::PoseParameters;
use nalgebra::Point3;

use super::Tracker;
use super::region::Region;
use crate::gps::{GpsConfig, GpsFix};

use crate::start::wrapped;

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

impl Course {
    /// Time passes.
    pub fn drive(&mut self, dt_s: f64) {
        if let Some((_, since_s)) = &mut self.began {
            *since_s += dt_s;
        }
    }

    /// Takes in a fix, and the heading that is tracked, radians. Who goes no faster than
    /// `reverse_m_s` may go backwards, and ways that differ from each other say nothing.
    fn take(&mut self, fix: &GpsFix, tracked_rad: Option<f64>, reverse_m_s: f64, config: &GpsConfig) {
        let Some((from_map, since_s)) = self.began else {
            self.began = Some((fix.position_map, 0.0));
            return;
        };
        let way = fix.position_map - from_map;
        let (way_m, sigma_m) = (way.xz().norm(), SQRT_2 * fix.horizontal_sigma_m);
        if since_s <= 0.0 || way_m < config.way_sigmas * sigma_m {
            return;
        }
        self.began = Some((fix.position_map, 0.0));
        let before = self.way.take();
        if way_m <= reverse_m_s * since_s + sigma_m {
            (self.against_told, self.against_tracked) = (0, 0);
            return;
        }
        let way_rad = way.x.atan2(way.z);
        self.way = Some((way_rad, config.way_turned_rad.hypot(sigma_m.atan2(way_m))));
        let contradicts = |heading_rad: f64| wrapped(way_rad - heading_rad).abs() > config.way_contradicts_rad;
        let goes_on = !before.is_some_and(|(before_rad, _)| contradicts(before_rad));
        let count = |so_far: usize, heading_rad: Option<f64>| {
            let so_far = if goes_on { so_far } else { 0 };
            if heading_rad.is_some_and(contradicts) { so_far + 1 } else { 0 }
        };
        self.against_told = count(self.against_told, fix.heading.map(|(yaw_rad, _)| yaw_rad));
        self.against_tracked = count(self.against_tracked, tracked_rad);
    }

    /// The fix with the heading of the way, where so many ways contradict what it tells.
    fn corrected(&self, fix: &GpsFix, after: usize) -> GpsFix {
        match self.way {
            Some(way) if self.against_told >= after => GpsFix { heading: Some(way), is_course: false, ..*fix },
            _ => *fix,
        }
    }

    /// The fix with the heading of the way, once where so many ways contradict what is
    /// tracked.
    fn overrules(&mut self, fix: &GpsFix, after: usize) -> Option<GpsFix> {
        let way = self.way.filter(|_| self.against_tracked >= after)?;
        self.against_tracked = 0;
        Some(GpsFix { heading: Some(way), is_course: false, ..*fix })
    }
}

impl Tracker<'_> {
    /// A fix as it is believed: with the heading of the way where that overrules what it
    /// tells, and all begins again where that overrules what was tracked and never ok.
    pub(super) fn with_right_heading(&mut self, fix: &GpsFix) -> GpsFix {
        let (gps, after) = (&self.config.gps, self.config.gps.believed_after);
        let tracked = self.bank.first().map(|best| PoseParameters::from_pose(&best.state.map_from_camera).yaw_rad);
        self.course.take(fix, tracked, self.config.bank.max_reverse_m_s, gps);
        let fix = self.course.corrected(fix, after);
        let was_ever_ok = self.verdict.is_some_and(|verdict| verdict.was_ever_ok);
        if was_ever_ok || self.sight.shows_nothing() {
            return fix;
        }
        let Some(right) = self.course.overrules(&fix, after) else { return fix };
        self.bank.clear();
        (self.region, self.verdict) = (Region::default(), None);
        right
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    const AFTER: usize = 3;

    /// Fixes a second apart, so many metres one from the other, to the east, which tell
    /// one heading while another is tracked.
    fn driven(steps_m: &[f64], told_rad: f64, tracked_rad: f64) -> (Course, GpsFix) {
        let heading = Some((told_rad, 0.03));
        let mut fix =
            GpsFix { position_map: Point3::origin(), horizontal_sigma_m: 1.5, heading, is_course: true, age_s: 0.0 };
        let mut course = Course::default();
        course.take(&fix, Some(tracked_rad), 3.0, &GpsConfig::default());
        for step_m in steps_m {
            course.drive(1.0);
            fix.position_map.x += step_m;
            course.take(&fix, Some(tracked_rad), 3.0, &GpsConfig::default());
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
