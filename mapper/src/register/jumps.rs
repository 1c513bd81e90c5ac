//! Steps of the survey that the vehicle did not make.
//!
//! What is compared over several steps ([`super::doubt`]) does not see a single one that is
//! wrong: where the survey's positions jump, and go on from there as if nothing were, the map
//! is right before and behind, and torn in between. So each step from frame to frame is held
//! against those around it, and a step that fits neither is put to the scans: laid on those
//! before them, they say whether the vehicle went there. A scan is laid twice, from where the
//! survey leads and from where the drive leads without the jump, for a jump of some metres
//! leads to where it fits wrong surfaces.

use common::geometry::{Pose, interpolate};
use serde::{Deserialize, Serialize};

use super::align::{AlignConfig, Alignment};
use crate::drive::Drive;

/// Which steps of the survey are jumps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JumpConfig {
    /// Least way, metres, by which a step is off those before and after it: twice what the
    /// given poses of KITTI 00 are off where their satellites change.
    pub least_m: f64,
    /// Hardest change of a vehicle's speed, metres per second squared, which a step may be off
    /// for besides: twice what tyres hold.
    pub hardest_m_s2: f64,
    /// Fastest vehicle, metres per second: that of a motorway without a limit. It is asked
    /// only where the survey has times.
    pub fastest_m_s: f64,
}

impl Default for JumpConfig {
    fn default() -> Self {
        Self { least_m: 0.5, hardest_m_s2: 20.0, fastest_m_s: 70.0 }
    }
}

/// What tells that a step of the survey is a jump.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JumpWitness {
    /// The scans lie elsewhere on those before them.
    Scans,
    /// No vehicle makes the step in its time, and scans do not say whether this one did.
    Times,
}

/// A step of the survey that the vehicle did not make.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurveyJump {
    /// The frame before it.
    pub before_frame: usize,
    /// The frame after it.
    pub after_frame: usize,
    /// How far it is off the steps around it, or farther than the fastest vehicle goes, metres.
    pub off_m: f64,
    /// What tells so.
    pub told_by: JumpWitness,
}

/// A step of the survey that fits none of those around it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Suspect {
    /// The frame before it; the next one is after it.
    before: usize,
    /// As [`SurveyJump::off_m`].
    off_m: f64,
    /// The step as those around it go on (`camera_before_from_camera_after`); none where all
    /// are suspected.
    expected: Option<Pose>,
}

/// What the scans say of the suspected steps between two stitched frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    /// The vehicle went elsewhere.
    Contradicted,
    /// It went there.
    Confirmed,
}

/// The steps of a drive's survey that may be jumps, and what scans say of them.
#[derive(Debug, Clone, Default)]
pub(super) struct Jumps {
    suspects: Vec<Suspect>,
    /// Of the suspected steps from a frame to the one before another.
    verdicts: Vec<(usize, usize, Verdict)>,
    has_times: bool,
    least_m: f64,
}

impl Jumps {
    /// Looks at the survey of a drive.
    pub fn of(drive: &Drive, config: &JumpConfig) -> Self {
        let has_times = drive.has_times();
        let (first, last) = drive.span();
        let suspects = suspects(&drive.survey, &drive.times_s, (first, last), has_times, config);
        Self { suspects, verdicts: Vec::new(), has_times, least_m: config.least_m }
    }

    /// The survey's motion from one frame to another (`camera_from_from_camera_to`) without
    /// the steps that are suspected; none where that is hardly another.
    pub fn without(&self, survey: &[Pose], from: usize, to: usize) -> Option<Pose> {
        let mut motion = Pose::identity();
        let mut at = from;
        for suspect in self.suspects.iter().filter(|suspect| (from..to).contains(&suspect.before)) {
            motion *= survey[at].inverse() * survey[suspect.before] * suspect.expected?;
            at = suspect.before + 1;
        }
        motion *= survey[at].inverse() * survey[to];
        let surveyed = survey[from].inverse() * survey[to];
        let apart_m = (motion.translation.vector - surveyed.translation.vector).norm();
        (apart_m > self.least_m).then_some(motion)
    }

    /// Hears the scan of a frame: where it lies from where the survey leads (`guess`), and from
    /// where the drive leads without the steps that are suspected.
    pub fn hear(
        &mut self,
        (from, to): (usize, usize),
        guess: &Pose,
        [surveyed, without]: [&Alignment; 2],
        config: &AlignConfig,
    ) {
        // Laid on the wrong surfaces, fewer of the scan's lie on any, and these worse.
        let is_better = without.overlap >= surveyed.overlap && without.rms_m <= surveyed.rms_m;
        let better = if is_better || surveyed.overlap < config.least_overlap { without } else { surveyed };
        if better.overlap < config.least_overlap {
            return;
        }
        let off_m = (better.map_from_velodyne.translation.vector - guess.translation.vector).norm();
        let verdict = if off_m > self.least_m { Verdict::Contradicted } else { Verdict::Confirmed };
        self.verdicts.push((from, to, verdict));
    }

    /// Those that are jumps.
    pub fn told(&self) -> Vec<SurveyJump> {
        let told_by = |before: usize| {
            let heard = self.verdicts.iter().find(|(from, to, _)| (*from..*to).contains(&before));
            match heard {
                Some((_, _, Verdict::Contradicted)) => Some(JumpWitness::Scans),
                Some((_, _, Verdict::Confirmed)) => None,
                None => self.has_times.then_some(JumpWitness::Times),
            }
        };
        let jump = |&Suspect { before, off_m, .. }: &Suspect| {
            told_by(before).map(|told_by| SurveyJump { before_frame: before, after_frame: before + 1, off_m, told_by })
        };
        self.suspects.iter().filter_map(jump).collect()
    }
}

/// The jumps of a survey that is taken as it is: no scan is asked.
pub fn jumps_by_times(drive: &Drive, config: &JumpConfig) -> Vec<SurveyJump> {
    Jumps::of(drive, config).told()
}

/// The steps from `first` to `last` that fit none of those around them.
fn suspects(
    survey: &[Pose],
    times_s: &[f64],
    (first, last): (usize, usize),
    has_times: bool,
    config: &JumpConfig,
) -> Vec<Suspect> {
    let last = last.min(survey.len().min(times_s.len()).saturating_sub(1));
    let way = |k: usize| survey[k + 1].translation.vector - survey[k].translation.vector;
    let time_s = |k: usize| times_s[k + 1] - times_s[k];
    let off_m = |k: usize| {
        let beside = [k.checked_sub(1).filter(|before| *before >= first), Some(k + 1).filter(|after| *after < last)];
        let off = beside.into_iter().flatten().map(|other| {
            let (taken_s, longest_s) = (time_s(k), time_s(k).max(time_s(other)));
            let off_m = (way(k) - way(other) * (taken_s / time_s(other))).norm();
            if off_m > config.least_m + config.hardest_m_s2 * longest_s.powi(2) { off_m } else { 0.0 }
        });
        let off_m = off.min_by(f64::total_cmp).unwrap_or(0.0);
        let too_far_m = if has_times { way(k).norm() - config.fastest_m_s * time_s(k) } else { 0.0 };
        off_m.max(too_far_m)
    };
    let off_m: Vec<f64> = (first..last).map(off_m).collect();
    let is_suspect = |k: usize| off_m[k - first] > config.least_m;
    let expected = |k: usize| {
        let other = (first..k).rev().chain(k + 1..last).find(|other| !is_suspect(*other))?;
        let step = survey[other].inverse() * survey[other + 1];
        Some(interpolate(&Pose::identity(), &step, time_s(k) / time_s(other)))
    };
    let suspect = |k: usize| Suspect { before: k, off_m: off_m[k - first], expected: expected(k) };
    (first..last).filter(|k| is_suspect(*k)).map(suspect).collect()
}

/// Jumps that are named; of more only how many they are.
const MOST_NAMED: usize = 3;

/// What to say of jumps, a line each.
pub fn jumps_text(jumps: &[SurveyJump]) -> Vec<String> {
    let one = |jump: &SurveyJump| {
        let why = match jump.told_by {
            JumpWitness::Scans => "which the scans contradict",
            JumpWitness::Times => "which no vehicle does in that time, and no scan tells otherwise",
        };
        format!(
            "from frame {} to frame {} the survey jumps by {:.1} m, {why}: correct the poses, or build the parts by \
             themselves with --first and --last",
            jump.before_frame, jump.after_frame, jump.off_m
        )
    };
    let more = jumps.len().saturating_sub(MOST_NAMED);
    let more = (more > 0).then(|| format!("the survey jumps {more} times more"));
    jumps.iter().take(MOST_NAMED).map(one).chain(more).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn ahead(metres: f64) -> Vector3<f64> {
        Vector3::new(0.0, 0.0, metres)
    }

    /// Poses a tenth of a second apart, of a vehicle that goes `step_m` a step, which from the
    /// frame `from` on are moved.
    fn survey(frames: usize, step_m: f64, from: usize, moved: Vector3<f64>) -> (Vec<Pose>, Vec<f64>) {
        let pose = |k: usize| {
            let moved = if k >= from { moved } else { Vector3::zeros() };
            Pose::from_parts((ahead(step_m * k as f64) + moved).into(), nalgebra::UnitQuaternion::identity())
        };
        ((0..frames).map(pose).collect(), (0..frames).map(|k| k as f64 * 0.104).collect())
    }

    fn suspected((survey, times_s): &(Vec<Pose>, Vec<f64>), has_times: bool) -> Vec<Suspect> {
        suspects(survey, times_s, (0, survey.len() - 1), has_times, &JumpConfig::default())
    }

    #[test]
    fn a_single_jump_is_found_where_it_is() {
        for moved in [ahead(1.0), ahead(-5.0), Vector3::new(20.0, 0.0, 0.0), Vector3::new(0.0, 300.0, 0.0)] {
            let found = suspected(&survey(40, 1.4, 17, moved), false);
            assert_eq!(found.iter().map(|s| s.before).collect::<Vec<_>>(), [16], "{moved}");
            assert!((found[0].off_m - moved.norm()).abs() < 1e-9);
            let expected = found[0].expected.unwrap().translation.vector;
            assert!((expected - ahead(1.4)).norm() < 1e-9, "{expected}");
        }
        assert_eq!(suspected(&survey(40, 1.4, 1, ahead(5.0)), false).len(), 1, "the first step");
        assert_eq!(suspected(&survey(40, 1.4, 39, ahead(5.0)), false).len(), 1, "the last step");
    }

    #[test]
    fn what_vehicles_do_is_no_jump() {
        assert!(suspected(&survey(40, 1.4, 17, ahead(0.3)), true).is_empty());
        // From 20 m/s to a stop at 10 m/s^2, and off again.
        let mut z_m = 0.0;
        let mut braked: (Vec<Pose>, Vec<f64>) = (Vec::new(), Vec::new());
        for k in 0..60 {
            let speed_m_s = (20.0 - f64::from(k)).abs();
            z_m += 0.1 * speed_m_s;
            braked.0.push(Pose::translation(0.0, 0.0, z_m));
            braked.1.push(0.1 * f64::from(k));
        }
        assert!(suspected(&braked, true).is_empty());
        // A second without frames.
        let mut gap = survey(40, 1.4, 17, ahead(14.0));
        gap.1.iter_mut().skip(17).for_each(|t| *t += 1.04);
        assert!(suspected(&gap, true).is_empty());
    }

    #[test]
    fn a_speed_counts_only_where_times_are_known() {
        let fast = survey(40, 10.0, 40, ahead(0.0));
        assert!(suspected(&fast, false).is_empty());
        assert_eq!(suspected(&fast, true).len(), 39);
    }

    #[test]
    fn scans_say_whether_a_step_is_a_jump_and_times_where_they_do_not() {
        let (survey, times_s) = survey(40, 1.4, 17, ahead(5.0));
        let config = JumpConfig::default();
        let jumps = |has_times: bool| Jumps {
            suspects: suspects(&survey, &times_s, (0, 39), has_times, &config),
            verdicts: Vec::new(),
            has_times,
            least_m: config.least_m,
        };
        let way = jumps(true).without(&survey, 15, 20).unwrap();
        assert!((way.translation.vector - ahead(7.0)).norm() < 1e-9, "{way}");
        assert!(jumps(true).without(&survey, 20, 25).is_none());
        let guess = Pose::translation(0.0, 0.0, 12.0);
        let laid = |z_m: f64, overlap: f64, rms_m: f64| Alignment {
            map_from_velodyne: Pose::translation(0.0, 0.0, z_m),
            information: nalgebra::Matrix6::identity(),
            overlap,
            rms_m,
            first_rms_m: rms_m,
            iterations: 5,
        };
        let told = |has_times: bool, surveyed: Option<Alignment>, without: Option<Alignment>| {
            let mut jumps = jumps(has_times);
            if let (Some(surveyed), Some(without)) = (&surveyed, &without) {
                jumps.hear((15, 20), &guess, [surveyed, without], &AlignConfig::default());
            }
            jumps.told().first().map(|jump| (jump.before_frame, jump.after_frame, jump.told_by))
        };
        let (scans, times) = (Some((16, 17, JumpWitness::Scans)), Some((16, 17, JumpWitness::Times)));
        // Figures of the street with such a jump.
        assert_eq!(told(false, Some(laid(11.4, 0.44, 0.017)), Some(laid(7.0, 0.51, 0.011))), scans);
        assert_eq!(told(true, Some(laid(12.0, 0.51, 0.011)), Some(laid(7.6, 0.44, 0.017))), None);
        let nowhere = [Some(laid(12.0, 0.0, 0.0)), Some(laid(7.0, 0.01, 0.1))];
        assert_eq!(told(true, nowhere[0], nowhere[1]), times);
        assert_eq!(told(false, nowhere[0], nowhere[1]), None);
        assert_eq!((told(true, None, None), told(false, None, None)), (times, None));
    }

    #[test]
    fn of_many_jumps_the_first_are_named() {
        let jump = |k| SurveyJump { before_frame: k, after_frame: k + 1, off_m: 5.0, told_by: JumpWitness::Scans };
        let said = jumps_text(&[jump(3), jump(5), jump(7), jump(9), jump(11)]);
        assert!(said.len() == 4 && said[0].contains("from frame 3 to frame 4 the survey jumps by 5.0 m"), "{said:?}");
        assert!(said[3].contains("2 times more"));
        assert!(jumps_text(&[]).is_empty());
    }
}
