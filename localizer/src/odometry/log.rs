//! The motion along a drive, step by step: a log of wheels and gyroscope, or what the
//! images said.

use std::path::Path;

use super::{Odometry, OdometryConfig};
use crate::{Error, Result};

/// Gaps up to this are rounding of the times in the files, seconds.
pub(super) const ROUNDING_S: f64 = 1e-3;

/// What was said of the motion along a drive.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OdometryLog {
    /// One after the other.
    steps: Vec<Step>,
}

/// The mean motion over some time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    /// Seconds.
    pub(super) began_s: f64,
    /// Seconds.
    pub(super) ended_s: f64,
    pub(super) mean: Odometry,
}

impl Step {
    /// Whether it comes after another, or after nothing.
    pub(super) fn follows(&self, last: Option<&Self>) -> bool {
        last.is_none_or(|last| last.ended_s <= self.began_s) && self.began_s < self.ended_s
    }

    /// Whether the turn rate does not jump from the step before.
    pub(super) fn turns_on(&self, before: Option<&Self>, config: &OdometryConfig) -> bool {
        let Some(before) = before else { return true };
        let most_rad_s = config.most_jump_rad_s + config.hardest_rad_s2 * (self.ended_s - before.ended_s);
        (self.mean.yaw_rate_rad_s - before.mean.yaw_rate_rad_s).abs() <= most_rad_s
    }
}

/// Names of the columns of a log.
const COLUMNS: [&str; 3] = ["t_s", "speed_m_s", "yaw_rate_rad_s"];

impl OdometryLog {
    /// Reads lines `t_s,speed_m_s,yaw_rate_rad_s`, separated by commas or
    /// blanks, each the mean since the line before; times are those of the
    /// sequence's `times.txt`. A first line of these names and lines that begin with
    /// `#` are skipped.
    ///
    /// # Errors
    /// [`Error::OdometryColumns`], [`Error::OdometryRow`] and [`Error::OdometryTime`] at their line,
    /// [`Error::NoOdometry`] with fewer than two lines, and [`common::Error::Io`], [`common::Error::NotText`] or [`common::Error::BadNumber`].
    pub fn read(path: &Path) -> Result<Self> {
        let text = common::read_text(path)?;
        let mut rows: Vec<(f64, Odometry)> = Vec::new();
        let mut is_first = true;
        for (i, row) in text.lines().map(str::trim).enumerate() {
            let line = i + 1;
            if row.is_empty() || row.starts_with('#') {
                continue;
            }
            if std::mem::take(&mut is_first) && crate::gps::is_of_names(row) {
                let names = common::words(row);
                if names.map(|name| name.trim_matches('"')).eq(COLUMNS) {
                    continue;
                }
                return Err(Error::OdometryColumns {
                    path: path.to_path_buf(),
                    line,
                    found: row.chars().take(80).collect(),
                });
            }
            let values = crate::gps::numbers(path, line, row)?;
            let &[time_s, speed_m_s, yaw_rate_rad_s] = values.as_slice() else {
                return Err(Error::OdometryRow { path: path.to_path_buf(), line, found: values.len() });
            };
            if let Some(bad) = values.iter().find(|v| !v.is_finite()) {
                return Err(crate::gps::bad_number(path, line, &bad.to_string()));
            }
            if rows.last().is_some_and(|(last_s, _)| time_s <= *last_s) {
                return Err(Error::OdometryTime { path: path.to_path_buf(), line, time_s });
            }
            rows.push((time_s, Odometry::of_wheels(speed_m_s, yaw_rate_rad_s)));
        }
        // The first step began one step earlier, as far as one knows.
        let mut began_s = match rows.as_slice() {
            [(first_s, _), (second_s, _), ..] => 2.0 * first_s - second_s,
            _ => return Err(Error::NoOdometry { path: path.to_path_buf() }),
        };
        let mut log = Self::default();
        for (ended_s, mean) in rows {
            log.push(began_s, ended_s, mean);
            began_s = ended_s;
        }
        Ok(log)
    }

    /// Adds the mean motion from one time to another, seconds, after all that
    /// the log has; what goes back in time is left out.
    pub fn push(&mut self, began_s: f64, ended_s: f64, mean: Odometry) {
        let step = Step { began_s, ended_s, mean };
        if step.follows(self.steps.last()) {
            self.steps.push(step);
        }
    }

    /// Forgets the steps that ended until a time, seconds.
    pub fn forget(&mut self, until_s: f64) {
        let first = self.steps.partition_point(|step| step.ended_s <= until_s);
        self.steps.drain(..first);
    }

    /// Steps that it holds.
    pub fn len(&self) -> usize {
        self.steps.len()
    }

    /// The same with gaps where the turn rate jumps: the mean over a jump is that of
    /// neither side, and small enough to be believed.
    #[must_use]
    pub fn without_jumps(&self, config: &OdometryConfig) -> Self {
        let before = std::iter::once(None).chain(self.steps.iter().map(Some));
        let turning_on = before.zip(&self.steps).filter(|(before, step)| step.turns_on(*before, config));
        Self { steps: turning_on.map(|(_, step)| *step).collect() }
    }

    /// The same with another motion in each step, told by the time at which it ended,
    /// seconds.
    #[must_use]
    pub fn changed(&self, change: impl Fn(f64, Odometry) -> Odometry) -> Self {
        let steps = self.steps.iter().map(|step| Step { mean: change(step.ended_s, step.mean), ..*step }).collect();
        Self { steps }
    }

    /// The same with how the camera pitched and rolled by another log, where that says so.
    #[must_use]
    pub fn swaying_as(&self, other: &Self) -> Self {
        let sway_rad_s = |step: &Step| other.between(step.began_s, step.ended_s)?.sway_rad_s;
        let swaying = |step: &Step| Step { mean: Odometry { sway_rad_s: sway_rad_s(step), ..step.mean }, ..*step };
        Self { steps: self.steps.iter().map(swaying).collect() }
    }

    /// Whether it says nothing at all.
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// When it begins and ends, seconds; none where it says nothing.
    pub fn span_s(&self) -> Option<[f64; 2]> {
        self.steps.first().zip(self.steps.last()).map(|(first, last)| [first.began_s, last.ended_s])
    }

    /// Of how many of the steps between these times, seconds, it tells the motion.
    pub fn told(&self, times_s: &[f64]) -> usize {
        times_s.windows(2).filter(|step| self.between(step[0], step[1]).is_some()).count()
    }

    /// Ends of its steps between two times, seconds, each `apart_s` or more behind the one
    /// before, and before the end.
    pub fn ends_between(&self, from_s: f64, to_s: f64, apart_s: f64) -> impl Iterator<Item = f64> + '_ {
        let first = self.steps.partition_point(|step| step.ended_s <= from_s);
        let ends_s = self.steps[first..].iter().map(|step| step.ended_s);
        let ends_s = ends_s.take_while(move |end_s| *end_s + apart_s <= to_s);
        ends_s
            .scan(from_s, move |last_s, end_s| {
                let is_apart = end_s - *last_s >= apart_s;
                *last_s = if is_apart { end_s } else { *last_s };
                Some(is_apart.then_some(end_s))
            })
            .flatten()
    }

    /// The mean motion from one time to another, seconds; none where the log
    /// does not cover all of it. The speed is known where it is all along.
    pub fn between(&self, from_s: f64, to_s: f64) -> Option<Odometry> {
        let first = self.steps.partition_point(|step| step.ended_s <= from_s);
        let mut at_s = from_s;
        let (mut way_m, mut turn_rad, mut sway_rad) = (Some(0.0), 0.0, Some([0.0; 2]));
        for step in self.steps.iter().skip(first) {
            if at_s >= to_s || step.began_s > at_s + ROUNDING_S {
                break;
            }
            let until_s = step.ended_s.min(to_s);
            way_m = way_m.zip(step.mean.speed_m_s).map(|(m, speed_m_s)| m + speed_m_s * (until_s - at_s));
            turn_rad += step.mean.yaw_rate_rad_s * (until_s - at_s);
            sway_rad = sway_rad
                .zip(step.mean.sway_rad_s)
                .map(|(rad, rad_s)| [rad[0] + rad_s[0] * (until_s - at_s), rad[1] + rad_s[1] * (until_s - at_s)]);
            at_s = until_s;
        }
        let span_s = at_s - from_s;
        (span_s > 0.0 && at_s >= to_s - ROUNDING_S).then(|| Odometry {
            speed_m_s: way_m.map(|m| m / span_s),
            yaw_rate_rad_s: turn_rad / span_s,
            sway_rad_s: sway_rad.map(|rad| rad.map(|rad| rad / span_s)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<OdometryLog> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("odometry.csv");
        std::fs::write(&path, text).unwrap();
        OdometryLog::read(&path)
    }

    #[test]
    fn the_mean_between_two_images_weighs_steps_by_their_share() {
        let log = read_text("t_s,speed_m_s,yaw_rate_rad_s\n0.02,10,0.1\n0.04,12,0.1\n0.06 14 0.4\n").unwrap();
        let mean = log.between(0.01, 0.05).unwrap();
        assert!((mean.speed_m_s.unwrap() - (0.01 * 10.0 + 0.02 * 12.0 + 0.01 * 14.0) / 0.04).abs() < 1e-9);
        assert!((mean.yaw_rate_rad_s - (0.03 * 0.1 + 0.01 * 0.4) / 0.04).abs() < 1e-9);
        assert!(log.between(0.0, 0.06).is_some());
    }

    #[test]
    fn a_speed_that_is_missing_is_missing_from_the_mean_and_a_gap_is_a_gap() {
        let mut log = OdometryLog::default();
        let motion = |speed_m_s| Odometry { speed_m_s, yaw_rate_rad_s: 0.2, sway_rad_s: None };
        log.push(0.0, 0.1, motion(Some(8.0)));
        log.push(0.1, 0.2, motion(None));
        // Goes back in time, and would close the gap.
        log.push(0.15, 0.3, motion(Some(9.0)));
        log.push(0.3, 0.4, motion(Some(9.0)));
        assert!((log.between(0.0, 0.1).unwrap().speed_m_s.unwrap() - 8.0).abs() < 1e-9);
        let turn_alone = log.between(0.0, 0.2).unwrap();
        assert!(turn_alone.speed_m_s.is_none() && (turn_alone.yaw_rate_rad_s - 0.2).abs() < 1e-9);
        assert_eq!((log.between(0.2, 0.3), log.between(0.1, 0.4)), (None, None));
    }

    #[test]
    fn wheels_sway_as_the_images_say_for_as_long_as_these_do() {
        let mut images = OdometryLog::default();
        for (i, pitch_rad_s) in [(0, 0.04), (1, 0.0), (2, -0.02)] {
            let sway_rad_s = Some([pitch_rad_s, 0.01]);
            let began_s = 0.1 * f64::from(i);
            images.push(began_s, began_s + 0.1, Odometry { sway_rad_s, ..Odometry::of_wheels(99.0, 9.0) });
        }
        let wheels = read_text("0.05,10,0.1\n0.1,10,0.1\n0.15,12,0.1\n0.2,12,0.1\n0.35,12,0.1\n0.4,12,0.1\n").unwrap();
        let log = wheels.swaying_as(&images);
        let mean = log.between(0.0, 0.2).unwrap();
        assert_eq!(Odometry { sway_rad_s: None, ..mean }, wheels.between(0.0, 0.2).unwrap());
        let [pitch_rad_s, roll_rad_s] = mean.sway_rad_s.unwrap();
        assert!((pitch_rad_s - 0.02).abs() < 1e-9 && (roll_rad_s - 0.01).abs() < 1e-9, "{mean:?}");
        // They are over before the wheels are.
        assert_eq!(log.between(0.1, 0.4), wheels.between(0.1, 0.4));
        assert_eq!(wheels.swaying_as(&OdometryLog::default()), wheels);
    }

    #[test]
    fn a_mean_over_a_jump_of_the_turn_is_none() {
        let off = read_text("0.02,10,0\n0.04,10,0.1\n0.06,0,0\n0.08,0,0\n0.1,0,1.5\n0.12,0,1.4\n").unwrap();
        let log = off.without_jumps(&OdometryConfig::default());
        assert_eq!(log.between(0.01, 0.08), off.between(0.01, 0.08));
        assert!(off.between(0.07, 0.09).is_some() && log.between(0.07, 0.09).is_none());
        assert!(log.between(0.1, 0.12).is_some());
    }

    #[test]
    fn ends_are_apart_and_before_the_end() {
        let log = read_text("0.1,10,0\n0.2,10,0\n0.3,10,0\n0.8,10,0\n0.9,10,0\n1.0,10,0\n").unwrap();
        let ends_s = |from_s, to_s, apart_s| log.ends_between(from_s, to_s, apart_s).collect::<Vec<_>>();
        assert_eq!(ends_s(0.1, 1.0, 0.15), vec![0.3, 0.8]);
        assert_eq!(ends_s(0.0, 5.0, 0.25), vec![0.3, 0.8]);
        assert_eq!(ends_s(0.2, 0.41, 0.09), vec![0.3]);
        for [from_s, to_s] in [[0.3, 0.3], [0.9, 0.1], [2.0, 3.0], [0.1, 0.3]] {
            assert!(ends_s(from_s, to_s, 0.15).is_empty(), "{from_s} {to_s}");
        }
    }

    #[test]
    fn what_the_log_does_not_cover_it_does_not_say() {
        let log = read_text("1.0,10,0\n1.1,10,0\n1.2,10,0\n").unwrap();
        assert_eq!(log.between(0.5, 1.1), None);
        assert_eq!(log.between(1.1, 1.3), None);
        assert_eq!(log.between(1.1, 1.1), None);
        assert_eq!(OdometryLog::default().between(0.0, 1.0), None);
        assert_eq!((log.told(&[0.8, 0.95, 1.05, 1.15, 1.25]), log.told(&[2.0, 2.1]), log.told(&[1.0])), (2, 0, 0));
        let [began_s, ended_s] = log.span_s().unwrap();
        assert!((began_s - 0.9).abs() < 1e-9 && (ended_s - 1.2).abs() < 1e-9);
    }

    #[test]
    fn a_bad_row_is_named_with_its_line() {
        assert!(matches!(read_text("0.02,10,0\n0.04,10\n"), Err(Error::OdometryRow { line: 2, found: 2, .. })));
        assert!(matches!(read_text("0.02,10,0\n0.02,10,0\n"), Err(Error::OdometryTime { line: 2, .. })));
        assert!(read_text("nan,10,0\n0.02,10,0\n0.04,10,0\n").unwrap_err().to_string().contains(":1: `NaN`"));
        // Since when the first line is meant, only a second one tells.
        for none in ["", "t_s,speed_m_s,yaw_rate_rad_s\n", "0.02,10,0\n"] {
            assert!(matches!(read_text(none), Err(Error::NoOdometry { .. })), "{none}");
        }
        assert!(read_text("0.02,10,nan\n").unwrap_err().to_string().to_lowercase().contains("nan"));
        assert!(read_text("0.02,10,0\n0.04,ten,0\n").unwrap_err().to_string().contains("ten"));
    }
}
