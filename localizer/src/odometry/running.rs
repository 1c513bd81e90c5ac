//! The motion as it comes in, while a vehicle drives by it.

use std::collections::VecDeque;

use super::log::{ROUNDING_S, Step};
use super::{Odometry, OdometryConfig, OdometryLog};

/// A log of which the end is not known yet and the beginning is forgotten, with gaps
/// where the turn rate jumps: at any time the same as what
/// [`OdometryLog::without_jumps`] makes of all that came.
#[derive(Debug, Default)]
pub struct RunningLog {
    log: OdometryLog,
    /// The last step that came, one that jumps, too.
    last: Option<Step>,
}

impl RunningLog {
    /// Adds the mean motion from one time to another, as [`OdometryLog::push`] does.
    pub fn push(&mut self, began_s: f64, ended_s: f64, mean: Odometry, config: &OdometryConfig) {
        let step = Step { began_s, ended_s, mean };
        if !step.follows(self.last.as_ref()) {
            return;
        }
        if step.turns_on(self.last.as_ref(), config) {
            self.log.push(began_s, ended_s, mean);
        }
        self.last = Some(step);
    }

    /// What is known.
    pub fn log(&self) -> &OdometryLog {
        &self.log
    }

    /// Forgets what ended until a time, seconds.
    pub fn forget(&mut self, until_s: f64) {
        self.log.forget(until_s);
    }
}

/// Lines of wheels and gyroscope, each the mean since the line before, as they come.
///
/// An image hardly ever comes together with a line. Up to its time the line tells
/// that is there already, or else the one before is taken to hold for as long as it
/// had, for by then the next is due.
#[derive(Debug, Default)]
pub struct WheelLines {
    /// Those that end later than what was told: when they do, seconds.
    waiting: VecDeque<(f64, Odometry)>,
    /// Until when the motion was told, seconds; none before two lines came.
    told_s: Option<f64>,
    /// When the last line of those ended, seconds, how long it took, and what it said.
    last: Option<(f64, f64, Odometry)>,
}

impl WheelLines {
    /// Takes in the mean motion since the line before; not where it ends no later.
    pub fn push(&mut self, ended_s: f64, mean: Odometry) -> bool {
        let before_s = self.waiting.back().map(|(ended_s, _)| *ended_s).or(self.last.map(|(ended_s, ..)| ended_s));
        let is_later = before_s.is_none_or(|before_s| before_s < ended_s);
        if is_later {
            self.waiting.push_back((ended_s, mean));
        }
        is_later
    }

    /// Tells the motion up to a time, seconds, from where it was told before: each step
    /// by when it began and ended, seconds, and its mean.
    pub fn tell(&mut self, until_s: f64, mut step: impl FnMut(f64, f64, Odometry)) {
        if self.told_s.is_none() {
            // The first line began one line earlier, as far as one knows.
            let mut ends_s = self.waiting.iter().map(|(ended_s, _)| *ended_s);
            let Some((first_s, second_s)) = ends_s.next().zip(ends_s.next()) else { return };
            self.told_s = Some(2.0 * first_s - second_s);
        }
        let Some(mut at_s) = self.told_s else { return };
        while let Some((ended_s, mean)) = self.waiting.pop_front_if(|(ended_s, _)| *ended_s <= until_s + ROUNDING_S) {
            let began_s = self.last.map_or(at_s, |(last_s, ..)| last_s);
            if at_s < ended_s {
                step(at_s, ended_s, mean);
                at_s = ended_s;
            }
            self.last = Some((ended_s, ended_s - began_s, mean));
        }
        if at_s + ROUNDING_S < until_s {
            let holds = |(_, took_s, _): &(f64, f64, Odometry)| until_s - at_s <= took_s + ROUNDING_S;
            let later = self.waiting.front().map(|(_, mean)| *mean);
            if let Some(mean) = later.or_else(|| self.last.filter(holds).map(|(.., mean)| mean)) {
                step(at_s, until_s, mean);
                at_s = until_s;
            }
        }
        self.told_s = Some(at_s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(lines: &mut WheelLines, until_s: f64) -> Vec<(f64, f64, f64)> {
        let mut steps = Vec::new();
        lines.tell(until_s, |began_s, ended_s, mean| {
            steps.push((rounded(began_s), rounded(ended_s), mean.speed_m_s.unwrap()));
        });
        steps
    }

    fn rounded(time_s: f64) -> f64 {
        (time_s * 1e6).round() / 1e6
    }

    #[test]
    fn up_to_an_image_the_line_tells_that_is_there_or_the_last_one_holds() {
        let mut lines = WheelLines::default();
        assert!(lines.push(0.02, Odometry::of_wheels(1.0, 0.0)));
        // When the first began, the second tells.
        assert!(told(&mut lines, 0.03).is_empty());
        assert!(lines.push(0.04, Odometry::of_wheels(2.0, 0.0)));
        assert_eq!(told(&mut lines, 0.05), [(0.0, 0.02, 1.0), (0.02, 0.04, 2.0), (0.04, 0.05, 2.0)]);
        // The next one begins where that ended; another is there before its image.
        assert!(lines.push(0.06, Odometry::of_wheels(3.0, 0.0)) && lines.push(0.08, Odometry::of_wheels(4.0, 0.0)));
        assert_eq!(told(&mut lines, 0.07), [(0.05, 0.06, 3.0), (0.06, 0.07, 4.0)]);
        assert_eq!(told(&mut lines, 0.08), [(0.07, 0.08, 4.0)]);
        // Two periods later nobody knows.
        assert!(told(&mut lines, 0.12).is_empty());
        assert!(!lines.push(0.08, Odometry::of_wheels(5.0, 0.0)) && !lines.push(0.01, Odometry::of_wheels(5.0, 0.0)));
        assert!(lines.push(0.12, Odometry::of_wheels(6.0, 0.0)));
        assert_eq!(told(&mut lines, 0.12), [(0.08, 0.12, 6.0)]);
    }

    #[test]
    fn the_mean_over_any_images_is_that_of_the_whole_log() {
        let mean = |i: usize| Odometry::of_wheels(5.0 + (i as f64).sin(), 0.1 * (i as f64).cos());
        let (mut lines, mut running, mut whole) =
            (WheelLines::default(), RunningLog::default(), OdometryLog::default());
        let config = OdometryConfig::default();
        let mut image_s = 0.0;
        for i in 0..400 {
            let (began_s, ended_s) = (0.02 * (i as f64 - 1.0), 0.02 * i as f64);
            whole.push(began_s, ended_s, mean(i));
            lines.push(ended_s, mean(i));
            if i % 5 == 0 && i > 0 {
                lines.tell(ended_s, |began_s, ended_s, mean| running.push(began_s, ended_s, mean, &config));
                let [found, right] = [running.log(), &whole].map(|log| log.between(image_s, ended_s).unwrap());
                assert!((found.speed_m_s.unwrap() - right.speed_m_s.unwrap()).abs() < 1e-12, "{i}");
                assert!((found.yaw_rate_rad_s - right.yaw_rate_rad_s).abs() < 1e-12, "{i}");
                image_s = ended_s;
                running.forget(image_s);
                assert!(running.log().len() <= 1 && lines.waiting.is_empty(), "{i}");
            }
        }
    }

    #[test]
    fn a_jump_of_the_turn_is_left_out_as_it_comes_as_from_the_whole_log() {
        let config = OdometryConfig::default();
        let (mut running, mut whole) = (RunningLog::default(), OdometryLog::default());
        for (i, yaw_rate_rad_s) in [0.0, 0.1, 0.0, 1.5, 1.4, 0.0, 0.1].into_iter().enumerate() {
            let (began_s, ended_s) = (0.02 * i as f64, 0.02 * (i + 1) as f64);
            let mean = Odometry::of_wheels(10.0, yaw_rate_rad_s);
            running.push(began_s, ended_s, mean, &config);
            // Goes back in time.
            running.push(began_s, ended_s, mean, &config);
            whole.push(began_s, ended_s, mean);
        }
        assert_eq!(*running.log(), whole.without_jumps(&config));
        assert!(running.log().len() == 5);
    }
}
