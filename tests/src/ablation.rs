//! What each step of the localizer beyond the paper is worth: the drive is
//! localized with the step switched off, alone.
//!
//! Steps are switched off by settings, or by taking out of the features what
//! the step would use.

use clap::ValueEnum;
use localizer::features::{Features, LineFeature};
use localizer::odometry::{Odometry, OdometryLog};
use localizer::run::Method;
use localizer::solver::Loss;
use serde::Serialize;

use crate::trial::{Scored, Trial};

/// A step beyond the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Step {
    /// Nothing is switched off.
    None,
    /// The paper's method instead of all.
    Paper,
    /// One hypothesis is tracked, not several.
    Bank,
    /// Poses a lane or a delineator beside the best are looked at.
    Rivals,
    /// The frame is also asked without most of the prediction.
    Loose,
    /// What fits as well elsewhere is tracked: rivals, and poses that matches
    /// ask for which are not believed.
    Jumps,
    /// The last trusted pose, driven on, and fixes speak against other places.
    Astray,
    /// Matches far from the prediction are not believed.
    Innovation,
    /// Evidence counts over several frames.
    Memory,
    /// Evidence fades as frames tell hypotheses apart, not by the frame.
    Telling,
    /// The start leaves several poses for the next frames to choose from.
    Starts,
    /// After a loss the search goes along the roads.
    RoadSearch,
    /// All roads that a lost vehicle can have reached are searched.
    Sweep,
    /// The camera's height is that of the survey.
    Height,
    /// Vehicles stay near roads and head along them.
    Road,
    /// Images, label images, or a log of wheels tell how fast it drove and turned.
    Odometry,
    /// Images, or label images, tell how the camera pitched and rolled.
    Pitch,
    /// What is odd of the motion is followed by one pose and not by another.
    Disbelief,
    /// A vehicle goes where its axle points.
    Wheels,
    /// Speeding up and braking last: without, the speed wanders as much at once.
    Acceleration,
    /// Swaying dies out by itself.
    Sway,
    /// Springs take pitch and roll back to where they rest.
    Springs,
    /// Shifts along the way, there and back, are put down to the times of the
    /// images.
    Clock,
    /// A pole's ends are looked for, not only its line.
    Ends,
    /// Lane lines are curves.
    Curves,
    /// Signs are of the size that they are mapped with.
    Sizes,
    /// Every feature has a standard deviation of its own, not its class's.
    Sigmas,
    /// What is far is seen less often.
    Range,
    /// What stands behind houses is seen less often.
    Sight,
    /// How sure the network was of a pole counts.
    Odds,
    /// Trunks are found in vegetation.
    Trunks,
    /// One bus may hide any number of landmarks.
    Blocked,
    /// The robust loss.
    Loss,
    /// Matching is repeated with the pose that came of it.
    Rounds,
    /// Ok needs that no object decides, and no two.
    Separation,
    /// What was known before a landmark came into view bears witness for it.
    Anchor,
    /// Ok needs that residuals are as small as expected.
    Residuals,
    /// Ok needs a lead over all that is tracked beside.
    Lead,
    /// Ok needs some frames of being the best.
    Led,
    /// Ok needs two good frames in a row, and three where it was lost.
    Well,
    /// Ok needs support of this frame.
    Support,
    /// Ok needs that the image does not contradict how it moved.
    Contradiction,
    /// Ok needs some frames of tracking.
    Verified,
    /// Ok needs that what the map promises is found.
    Promised,
    /// Who is told how far it went is not lost for seeing nothing.
    Carried,
}

/// No distance, angle or evidence reaches this.
const NEVER: f64 = 1e9;

impl Step {
    /// The drive without this step.
    #[must_use]
    pub fn without(self, whole: &Trial) -> Trial {
        let mut trial = whole.clone();
        let config = &mut trial.config;
        match self {
            Self::None => {}
            Self::Paper => trial.method = Method::Paper,
            Self::Bank => (config.bank.capacity, config.bank.young_capacity) = (1, 1),
            Self::Rivals => {
                let rivals = &mut config.rivals;
                for shifts_m in [&mut rivals.sideways_m, &mut rivals.along_m, &mut rivals.uncertain_m] {
                    shifts_m.clear();
                }
            }
            Self::Loose => config.rivals.loose_distinct_m = NEVER,
            Self::Jumps => config.bank.jump_cost = NEVER,
            Self::Astray => (config.bank.most_astray, config.bank.most_astray_unseen) = (0.0, 0.0),
            Self::Innovation => config.bank.max_innovation = NEVER,
            Self::Memory => config.bank.memory = 0.0,
            Self::Telling => config.bank.telling = 0.0,
            Self::Starts => config.start.kept = 1,
            Self::RoadSearch => config.start.grid_sigma_m = NEVER,
            Self::Sweep => config.sweep.after_m = NEVER,
            Self::Height => config.start.height_frames = NEVER,
            Self::Road => (config.bank.road_m, config.start.road_heading_sigma_rad) = (NEVER, NEVER),
            Self::Odometry => trial.odometry = OdometryLog::default(),
            Self::Pitch => {
                let still = |_, shown| Odometry { sway_rad_s: None, ..shown };
                trial.odometry = trial.odometry.changed(still);
            }
            Self::Disbelief => (config.odometry.usual_m_s2, config.odometry.usual_rad_s2) = (NEVER, NEVER),
            Self::Wheels => (config.motion.slip_sigma_rad, config.motion.slip_sigma_m_s) = (NEVER, NEVER),
            Self::Acceleration => {
                let motion = &mut config.motion;
                // What both come to over long times.
                let lasting = 2.0 * motion.acceleration_sigma_m_s2.powi(2) * motion.acceleration_memory_s;
                motion.forward.walk = (motion.forward.walk.powi(2) + lasting).sqrt();
                motion.acceleration_sigma_m_s2 = 0.0;
            }
            Self::Sway => {
                let motion = &mut config.motion;
                for axis in [&mut motion.right, &mut motion.down, &mut motion.pitch, &mut motion.yaw, &mut motion.roll]
                {
                    axis.memory_s = NEVER;
                }
            }
            Self::Springs => config.motion.spring_s = NEVER,
            Self::Clock => config.clock.max_sigma_s = 0.0,
            Self::Ends => config.noise.seen_end = 0.0,
            Self::Curves => {
                let lanes = trial.frames.iter_mut().flat_map(|seen| &mut seen.features.lanes);
                lanes.for_each(|lane| lane.points_px.clear());
            }
            Self::Sizes => config.noise.max_size_ratio = NEVER,
            Self::Sigmas => same_sigmas(&mut trial),
            Self::Range => (config.detection.range_m, config.detection.low_range_m) = (NEVER, NEVER),
            Self::Sight => config.detection.open_m = NEVER,
            Self::Odds => config.detection.odds.most = 0.0,
            Self::Trunks => config.preselect.use_trunks = false,
            Self::Blocked => config.detection.blocked = 0.0,
            Self::Loss => config.solver.loss = Loss::Quadratic,
            Self::Rounds => config.robust.max_rounds = 1,
            Self::Separation => {
                let health = &mut config.health;
                (health.max_separation_m, health.max_separation_of_two_m) = (NEVER, NEVER);
            }
            Self::Anchor => config.separation.anchor_s = NEVER,
            Self::Residuals => {
                (config.health.max_mean_square, config.health.max_mean_square_anew) = (NEVER, NEVER);
            }
            Self::Lead => config.health.ok_lead = -NEVER,
            Self::Led => config.health.led_frames = 0,
            Self::Well => (config.health.well_frames, config.health.well_frames_anew) = (1, 1),
            Self::Support => config.health.min_support = -NEVER,
            Self::Contradiction => config.health.max_contradiction_sigmas = NEVER,
            Self::Verified => config.health.verify_frames = 0,
            Self::Promised => {
                let health = &mut config.health;
                (health.least_foreseen, health.least_foreseen_anew, health.least_foreseen_again) = (0.0, 0.0, 0.0);
            }
            Self::Carried => config.health.most_missed = -NEVER,
        }
        trial
    }

    /// The word for it on the command line and in the table.
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

/// Gives all features of a class the median of the drive.
fn same_sigmas(trial: &mut Trial) {
    let median = |value: fn(&Features) -> Vec<f64>| {
        let mut values: Vec<f64> = trial.frames.iter().flat_map(|seen| value(&seen.features)).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(1.0)
    };
    let pole = (
        median(|seen| seen.poles.iter().map(|pole| pole.offset_sigma_px).collect()),
        median(|seen| seen.poles.iter().map(|pole| pole.angle_sigma_rad).collect()),
    );
    let lane = (
        median(|seen| seen.lanes.iter().map(|lane| lane.line.offset_sigma_px).collect()),
        median(|seen| seen.lanes.iter().map(|lane| lane.line.angle_sigma_rad).collect()),
    );
    let sign_px = median(|seen| seen.signs.iter().map(|sign| sign.sigma_px).collect());
    let set = |line: &mut LineFeature, to: (f64, f64)| (line.offset_sigma_px, line.angle_sigma_rad) = to;
    for seen in &mut trial.frames {
        seen.features.poles.iter_mut().for_each(|line| set(line, pole));
        seen.features.lanes.iter_mut().for_each(|curve| set(&mut curve.line, lane));
        seen.features.signs.iter_mut().for_each(|sign| sign.sigma_px = sign_px);
    }
}

/// A row of the table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// What is switched off.
    pub without: String,
    /// What came of it.
    #[serde(flatten)]
    pub outcome: Scored,
}

impl Row {
    /// Localizes the drive without this step.
    ///
    /// # Errors
    /// As [`Trial::run`].
    pub fn of(step: Step, whole: &Trial) -> localizer::Result<Self> {
        let trial = step.without(whole);
        Ok(Self { without: step.name(), outcome: trial.outcome(&trial.run()?) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::made_up::clean;

    #[test]
    fn every_step_can_be_switched_off_alone() {
        let whole = clean();
        let all: Vec<Trial> = Step::value_variants().iter().map(|step| step.without(&whole)).collect();
        for (i, trial) in all.iter().enumerate() {
            let step = Step::value_variants()[i];
            assert_eq!(*trial == whole, step == Step::None, "{}", step.name());
            assert!(all[..i].iter().all(|other| other != trial), "{}", step.name());
            // None touches what the run is scored against or started with.
            assert_eq!((&trial.truth, &trial.fixes, &trial.map), (&whole.truth, &whole.fixes, &whole.map));
            let settings = common::config::to_toml(&trial.config).unwrap();
            assert!(!settings.is_empty(), "{}", step.name());
        }
    }

    #[test]
    fn without_sigmas_of_their_own_features_have_the_median_of_their_class() {
        let whole = clean();
        let trial = Step::Sigmas.without(&whole);
        // The signs of frame i are known to i pixels.
        let signs = trial.frames.iter().flat_map(|seen| &seen.features.signs);
        assert!(signs.clone().count() > 0 && signs.clone().all(|sign| (sign.sigma_px - 150.0).abs() < 1e-12));
        let same = |seen: &Features| seen.poles.iter().all(|pole| (pole.offset_sigma_px - 0.5).abs() < 1e-12);
        assert!(trial.frames.iter().all(|seen| same(&seen.features)));
    }
}
