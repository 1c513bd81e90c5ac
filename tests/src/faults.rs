//! What goes wrong in a vehicle, one thing at a time, and what the localizer
//! makes of it.

mod images;
#[cfg(test)]
pub(crate) mod made_up;
mod signals;
#[cfg(test)]
mod tests;

use clap::ValueEnum;
use localizer::eval::FrameError;
use localizer::features::Features;
use localizer::odometry::{Odometry, OdometryLog};
use localizer::run::{FrameFeatures, FrameResult};
use localizer::watch::Delivery;
use nalgebra::{UnitVector3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::Serialize;

use crate::trial::{Scored, Trial, is_good};

/// Length of a stretch in which the camera is black, or frozen, frames.
const BLACK_FRAMES: usize = 20;
/// Stretches with a fault begin after this many frames ...
const FIRST_BLACK: usize = 15;
/// ... and again after so many.
const BLACK_EVERY: usize = 100;
/// Length of a stretch without poles, metres of the path.
const BARE_M: f64 = 50.0;
/// They begin after this way, metres ...
const FIRST_BARE_M: f64 = 10.0;
/// ... and again after as much.
const BARE_EVERY_M: f64 = 150.0;
/// By how much a kidnapped vehicle is taken to be elsewhere, metres and
/// degrees: the range that learned methods are trained for.
const KIDNAPPED_M: f64 = 3.5;
const KIDNAPPED_DEG: f64 = 17.0;
/// What tells the motion is wrong for so many frames, from one on and again after so
/// many.
const TOLD_FRAMES: usize = 10;
const FIRST_TOLD: usize = 30;
const TOLD_EVERY: usize = 100;
/// No image comes for so many frames, from one on and again after so many.
const GAP_FRAMES: usize = 100;
const FIRST_GAP: usize = 30;
const GAP_EVERY: usize = 200;
/// Frames that always come: those of which the start has fixes.
const STARTED: usize = 2;
/// Every which frame is dropped, delivered twice or the only one that comes.
const EVERY_FIFTH: usize = 5;

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Fault {
    /// Nothing.
    None,
    /// A fifth of all features is false: lines and signs of the sizes found, at
    /// random places.
    #[value(name = "false-20")]
    False20,
    /// Two fifths of all features are false.
    #[value(name = "false-40")]
    False40,
    /// Half of the features is missing, each by chance.
    #[value(name = "missed-50")]
    Missed50,
    /// No lane line is ever seen.
    NoLanes,
    /// No pole is seen for 50 m, from 10 m on and again every 150 m.
    NoPoles,
    /// The camera is black for 20 frames, from the 16th on and again every 100.
    Black,
    /// The camera shows the same image for 20 frames, from the 16th on and again
    /// every 100.
    Frozen,
    /// No image comes for 100 frames, from the 31st on and again every 200.
    Gap,
    /// The map is turned by 1 degree about the middle of the drive; the truth
    /// is not, so the pose that fits the images is off by as much.
    MapTurned,
    /// The same, with a GPS fix a second, from which it could be told.
    MapTurnedGps,
    /// All poles, signs and lights of the map stand 5 to 25 m further on or back along
    /// the way, each by its own: the map of a street of the same road and lines.
    MapOther,
    /// The map ends half of the way, and the vehicle goes on.
    MapEnds,
    /// A third of the map is missing in its middle: two surveys that do not meet.
    MapTorn,
    /// The camera stands 0.1 m to the right of where the calibration has it,
    /// and is turned by 0.5 degrees to the right and up.
    Extrinsics,
    /// No fault, but a GPS fix a second.
    Gps,
    /// As `gps`, and every fifth fix is 20 m off.
    GpsOutliers,
    /// The focal lengths of the calibration are 1 % too long.
    Intrinsics,
    /// Every fifth frame is missing.
    Dropped,
    /// Half of the frames are missing, each by chance.
    #[value(name = "dropped-50")]
    Dropped50,
    /// Of five frames one comes: the camera is slow.
    Slow,
    /// Every fifth frame comes twice, with the same time.
    Doubled,
    /// Every fifth frame comes again in the place and with the time of the
    /// next, which is missing.
    Stale,
    /// The times of the frames are wrong by 50 ms, early and late in turns: a
    /// clock that is off by always the same disturbs no camera.
    Clock,
    /// As `clock`, by 25 ms.
    #[value(name = "clock-25")]
    Clock25,
    /// Whatever tells the speed says for ten frames that the vehicle stands, from the
    /// 31st on and again every 100: wheels lock, a plug is loose.
    WheelsLocked,
    /// It says twice the speed as often: wheels spin.
    WheelsSpinning,
    /// The gyroscope, or what tells the turn, says 1.5 rad/s too much as often.
    GyroscopeOff,
    /// The first fix is 3.5 m and 17 degrees off and says so: two of its
    /// standard deviations.
    KidnappedStart,
    /// As `black`, and then a fix that is 3.5 m and 17 degrees off.
    Kidnapped,
}

/// A drive with a fault.
#[derive(Debug, Clone, PartialEq)]
pub struct Faulty {
    /// The drive as the localizer gets it.
    pub trial: Trial,
    /// The frames with which all is well again.
    pub ends: Vec<usize>,
    /// The images as they come, where these or their times are spoilt and the
    /// motion is told from them.
    deliveries: Vec<Delivery>,
}

impl Faulty {
    /// Looks at spoilt images again: what they say of the motion is spoilt, too.
    ///
    /// # Errors
    /// Where one cannot be read.
    pub fn look_again(mut self) -> localizer::Result<Self> {
        if let Some(images) = self.trial.images.as_ref().filter(|_| !self.deliveries.is_empty()) {
            let shown = images.motion(&self.deliveries)?;
            let odometry = &mut self.trial.odometry;
            *odometry = if images.are_beside_wheels { odometry.swaying_as(&shown) } else { shown };
        }
        Ok(self)
    }
}

impl Fault {
    /// The drive with this fault; the same for the same seed.
    #[must_use]
    pub fn applied(self, clean: &Trial, seed: u64) -> Faulty {
        let mut trial = clean.clone();
        let mut random = Pcg64::seed_from_u64(seed);
        let mut ends = Vec::new();
        let image = clean.image;
        match self {
            Self::None => {}
            Self::False20 => images::each(&mut trial, |seen| images::add_false(seen, 0.2, image, &mut random)),
            Self::False40 => images::each(&mut trial, |seen| images::add_false(seen, 0.4, image, &mut random)),
            Self::Missed50 => images::each(&mut trial, |seen| images::miss(seen, 0.5, &mut random)),
            Self::NoLanes => images::each(&mut trial, |seen| seen.lanes.clear()),
            Self::NoPoles => ends = images::no_poles(&mut trial, FIRST_BARE_M, BARE_M, BARE_EVERY_M),
            Self::Black => ends = images::black(&mut trial, FIRST_BLACK, BLACK_FRAMES, BLACK_EVERY),
            Self::Frozen => ends = images::frozen(&mut trial, FIRST_BLACK, BLACK_FRAMES, BLACK_EVERY),
            Self::Gap => ends = signals::drop_stretches(&mut trial, FIRST_GAP, GAP_FRAMES, GAP_EVERY),
            Self::MapTurned => signals::turn_map(&mut trial, 1.0_f64.to_radians()),
            Self::MapTurnedGps => {
                signals::turn_map(&mut trial, 1.0_f64.to_radians());
                signals::fix_each_second(&mut trial, seed);
            }
            Self::MapOther => signals::shift_objects(&mut trial, 5.0..25.0, &mut random),
            Self::MapEnds => signals::keep_roads(&mut trial, |share| share < 0.5),
            Self::MapTorn => signals::keep_roads(&mut trial, |share| !(0.33..0.67).contains(&share)),
            Self::Extrinsics => {
                let right_and_up = UnitVector3::new_normalize(Vector3::new(1.0, 1.0, 0.0));
                signals::move_camera(&mut trial, Vector3::new(0.1, 0.0, 0.0));
                let camera = trial.camera;
                images::each(&mut trial, |seen| {
                    images::turn(seen, &camera, &right_and_up, 0.5_f64.to_radians());
                });
            }
            Self::Gps => signals::fix_each_second(&mut trial, seed),
            Self::GpsOutliers => {
                signals::fix_each_second(&mut trial, seed);
                signals::add_outliers(&mut trial, 5, 20.0, &mut random);
            }
            Self::Intrinsics => signals::scale_focal_lengths(&mut trial, 1.01),
            Self::Dropped => signals::keep(&mut trial, |index| index % EVERY_FIFTH != EVERY_FIFTH - 1),
            Self::Dropped50 => signals::keep(&mut trial, |index| index < STARTED || random.random_bool(0.5)),
            Self::Slow => signals::keep(&mut trial, |index| index.is_multiple_of(EVERY_FIFTH)),
            Self::Doubled => signals::double_every(&mut trial, EVERY_FIFTH),
            Self::Stale => signals::hold_every(&mut trial, EVERY_FIFTH),
            Self::Clock => signals::jitter(&mut trial, 0.05),
            Self::Clock25 => signals::jitter(&mut trial, 0.025),
            Self::WheelsLocked => {
                let speed = |shown: Odometry| Odometry { speed_m_s: shown.speed_m_s.map(|_| 0.0), ..shown };
                signals::change_motion(&mut trial, FIRST_TOLD, TOLD_FRAMES, TOLD_EVERY, speed);
            }
            Self::WheelsSpinning => {
                let speed = |shown: Odometry| Odometry { speed_m_s: shown.speed_m_s.map(|m_s| 2.0 * m_s), ..shown };
                signals::change_motion(&mut trial, FIRST_TOLD, TOLD_FRAMES, TOLD_EVERY, speed);
            }
            Self::GyroscopeOff => {
                let turn = |shown: Odometry| Odometry { yaw_rate_rad_s: shown.yaw_rate_rad_s + 1.5, ..shown };
                signals::change_motion(&mut trial, FIRST_TOLD, TOLD_FRAMES, TOLD_EVERY, turn);
            }
            Self::KidnappedStart => {
                let first = trial.frames.first().map(|seen| seen.frame);
                trial.fixes.clear();
                ends.extend(first);
                signals::kidnap(&mut trial, &ends, KIDNAPPED_M, KIDNAPPED_DEG.to_radians(), &mut random);
            }
            Self::Kidnapped => {
                ends = images::black(&mut trial, FIRST_BLACK, BLACK_FRAMES, BLACK_EVERY);
                signals::kidnap(&mut trial, &ends, KIDNAPPED_M, KIDNAPPED_DEG.to_radians(), &mut random);
            }
        }
        let mut deliveries = Vec::new();
        if let Some(images) = trial.images.as_ref().filter(|_| self.is_of_images()) {
            // What they said of the motion when they were whole, they do not say.
            if !images.are_beside_wheels {
                trial.odometry = OdometryLog::default();
            }
            deliveries = delivered(&trial.frames);
        }
        Faulty { trial, ends, deliveries }
    }

    /// Whether it spoils the images or their times, and not only what is found in
    /// them.
    fn is_of_images(self) -> bool {
        use Fault::{Black, Clock, Clock25, Doubled, Dropped, Dropped50, Frozen, Gap, Kidnapped, Slow, Stale};
        let is_late = matches!(self, Doubled | Stale | Clock | Clock25);
        is_late || matches!(self, Black | Frozen | Gap | Slow | Kidnapped | Dropped | Dropped50)
    }

    /// The word for it on the command line and in the table.
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

/// The images that show these features: one that shows none is black, and one that
/// shows what the one before does is the same.
fn delivered(frames: &[FrameFeatures]) -> Vec<Delivery> {
    let mut deliveries: Vec<Delivery> = Vec::with_capacity(frames.len());
    for (i, seen) in frames.iter().enumerate() {
        let is_black = seen.features == Features::default();
        let before = i.checked_sub(1).filter(|&before| frames[before].features == seen.features);
        let frame = match before {
            _ if is_black => None,
            Some(before) => deliveries[before].frame,
            None => Some(seen.frame),
        };
        deliveries.push(Delivery { time_s: seen.time_s, frame });
    }
    deliveries
}

/// A row of the table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// What went wrong.
    pub fault: String,
    /// What came of it.
    #[serde(flatten)]
    pub outcome: Scored,
    /// For each end of the fault the frames until one is called ok and is: 0
    /// where the first is; none where no frame is any more.
    pub recovered_after: Vec<Option<usize>>,
}

impl Row {
    /// Localizes the drive with this fault.
    ///
    /// # Errors
    /// As [`Faulty::look_again`] and [`Trial::run`].
    pub fn of(fault: Fault, clean: &Trial, seed: u64) -> localizer::Result<Self> {
        let Faulty { trial, ends, .. } = fault.applied(clean, seed).look_again()?;
        let results = trial.run()?;
        let errors = trial.errors(&results);
        Ok(Self {
            fault: fault.name(),
            outcome: trial.outcome(&results),
            recovered_after: ends.iter().map(|&end| recovered_after(end, &results, &errors)).collect(),
        })
    }

    /// The slowest recovery as a word.
    pub fn slowest_recovery(&self) -> String {
        if self.recovered_after.contains(&None) {
            return "never".to_owned();
        }
        self.recovered_after.iter().flatten().max().map_or_else(|| "-".to_owned(), ToString::to_string)
    }
}

/// Frames from `end` until one is called ok and is.
fn recovered_after(end: usize, results: &[FrameResult], errors: &[FrameError]) -> Option<usize> {
    let after = results.iter().zip(errors).filter(|(result, _)| result.frame >= end);
    after.into_iter().position(|(result, error)| is_good(result, error))
}
