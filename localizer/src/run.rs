//! Localizes the frames of a drive one after the other.

use std::collections::BTreeMap;
use std::time::Instant;

use common::geometry::PinholeCamera;

use crate::config::Config;
use crate::estimate::PoseEstimate;
use crate::features::Features;
use crate::gps::GpsFix;
use crate::local_map::LocalMap;
use crate::odometry::OdometryLog;
use crate::output::Timing;
use crate::paper_tracker::PaperTracker;
use crate::passage::Passage;
use crate::projection::ImageSize;
use crate::tracker::{FrameInput, Tracker};
use crate::{Error, Result};

/// How a frame is localized.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Method {
    /// Several hypotheses, one-to-one matches, a filter.
    Robust,
    /// The paper's algorithm, with its repairs named in the source.
    Paper,
}

impl Method {
    /// Whether the method takes in what is given besides images and a start, each with
    /// the option or setting that gives it.
    ///
    /// # Errors
    /// [`Error::NotOfPaper`] where it would pass over it.
    pub fn check(self, besides: &[(bool, &'static str)]) -> Result<()> {
        match besides.iter().find(|(is_given, _)| *is_given) {
            Some((_, option)) if self == Self::Paper => Err(Error::NotOfPaper { option }),
            _ => Ok(()),
        }
    }
}

/// The localizer of either method.
#[derive(Debug)]
pub enum Localizer<'a> {
    /// See [`Tracker`].
    Robust(Box<Tracker<'a>>),
    /// See [`PaperTracker`].
    Paper(Box<PaperTracker<'a>>),
}

impl<'a> Localizer<'a> {
    /// A localizer that knows nothing of its position yet.
    pub fn new(
        method: Method,
        map: &'a mut LocalMap,
        camera: &PinholeCamera,
        image: ImageSize,
        config: &Config,
    ) -> Self {
        match method {
            Method::Robust => Self::Robust(Box::new(Tracker::new(map, camera, image, config))),
            Method::Paper => Self::Paper(Box::new(PaperTracker::new(map, camera, image, config))),
        }
    }

    /// What it localizes with; none of the paper's method, which asks no odometry.
    fn config(&self) -> Option<&Config> {
        match self {
            Self::Robust(tracker) => Some(tracker.config()),
            Self::Paper(_) => None,
        }
    }

    /// Since when a log is to be asked for the motion up to the next frame, seconds, after
    /// what it tells of a long time before; none before the first frame. The paper asks none.
    fn coast(&mut self, until_s: f64, log: &OdometryLog) -> Result<Option<f64>> {
        match self {
            Self::Robust(tracker) => tracker.coast(until_s, log),
            Self::Paper(_) => Ok(None),
        }
    }

    /// Up to when a log is not asked for the motion again, seconds; none before the first frame.
    pub(crate) fn gone_over_s(&self) -> Option<f64> {
        match self {
            Self::Robust(tracker) => tracker.gone_over_s(),
            Self::Paper(_) => None,
        }
    }

    /// The pose at the next frame; none before the first GPS fix.
    ///
    /// # Errors
    /// Where the map cannot be read; only a map in memory cannot fail.
    pub fn step(&mut self, input: &FrameInput<'_>) -> Result<Option<PoseEstimate>> {
        match self {
            Self::Robust(tracker) => Ok(tracker.step(input)?.cloned()),
            Self::Paper(tracker) => tracker.step(input),
        }
    }

    /// The next frame, to which a log leads that tells the motion up to its time; none
    /// before the first fix.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn follow(
        &mut self,
        seen: &FrameFeatures,
        gps: Option<&GpsFix>,
        log: &OdometryLog,
    ) -> Result<Option<FrameResult>> {
        let started = Instant::now();
        let since_s = self.coast(seen.time_s, log)?;
        let odometry = since_s.and_then(|since_s| log.between(since_s, seen.time_s));
        let input = FrameInput { time_s: seen.time_s, features: &seen.features, gps, odometry };
        let Some(estimate) = self.step(&input)? else { return Ok(None) };
        let features = &seen.features;
        Ok(Some(FrameResult {
            frame: seen.frame,
            time_s: seen.time_s,
            estimate,
            features: [features.uprights(), features.lanes.len(), features.signs.len()],
            maps_ms: seen.maps_ms,
            features_ms: seen.features_ms,
            localize_ms: started.elapsed().as_secs_f64() * 1e3,
        }))
    }
}

/// One frame of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameResult {
    /// Index of the frame in its sequence.
    pub frame: usize,
    /// Its time, seconds.
    pub time_s: f64,
    /// What came out.
    pub estimate: PoseEstimate,
    /// Number of features: poles and trunks, lanes, signs.
    pub features: [usize; 3],
    /// Time for the probabilities, milliseconds.
    pub maps_ms: f64,
    /// Time for the features from them, milliseconds.
    pub features_ms: f64,
    /// Time for association and pose, milliseconds.
    pub localize_ms: f64,
}

impl FrameResult {
    /// The times that it took.
    pub fn timing(&self) -> Timing {
        let Self { frame, maps_ms, features_ms, localize_ms, .. } = *self;
        Timing { frame, maps_ms, features_ms, localize_ms }
    }
}

/// One frame before it is localized.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameFeatures {
    /// Index of the frame in its sequence.
    pub frame: usize,
    /// Its time, seconds.
    pub time_s: f64,
    /// Its features.
    pub features: Features,
    /// Time for the probabilities, milliseconds.
    pub maps_ms: f64,
    /// Time for the features from them, milliseconds.
    pub features_ms: f64,
}

/// Localizes the frames in order. Frames before the first fix give nothing.
/// An empty log of odometry says nothing.
///
/// # Errors
/// Where the map cannot be read; only a map in memory cannot fail.
pub fn localize(
    frames: &[FrameFeatures],
    fixes: &BTreeMap<usize, GpsFix>,
    odometry: &OdometryLog,
    mut localizer: Localizer<'_>,
) -> Result<Vec<FrameResult>> {
    let odometry =
        localizer.config().map_or_else(|| odometry.clone(), |config| odometry.without_jumps(&config.odometry));
    let mut passage = Passage::default();
    let mut step = |seen: &FrameFeatures| -> Result<Option<FrameResult>> {
        let fix = fixes.get(&seen.frame).map(|fix| passage.moved_on(*fix));
        let result = localizer.follow(seen, fix.as_ref(), &odometry)?;
        passage.pass(result.as_ref());
        Ok(result)
    };
    frames.iter().filter_map(|seen| step(seen).transpose()).collect()
}
