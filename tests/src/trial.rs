//! A drive that was looked at once, to be localized many times: with something
//! wrong, or with a part of the localizer switched off.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use common::geometry::{PinholeCamera, Pose};
use common::kitti::Sequence;
use common::map::SemanticMap;
use localizer::cli::ConfigArgs;
use localizer::cli::input::{InputArgs, SourceArgs, simulated};
use localizer::config::Config;
use localizer::drive::Drive;
use localizer::estimate::Status;
use localizer::eval::{FrameError, LOST_M, START_FRAMES, StageTime, nothing_scored, score};
use localizer::gps::GpsFix;
use localizer::local_map::LocalMap;
use localizer::odometry::OdometryLog;
use localizer::output::Recorded;
use localizer::projection::ImageSize;
use localizer::run::{FrameFeatures, FrameResult, Localizer, Method, localize};
use localizer::watch::{self, Delivery, odometry};
use serde::Serialize;

/// Position error that nobody should meet unwarned, metres.
pub use localizer::eval::trust::ALERT_LIMIT_M;

/// The drive, and how it is localized.
#[derive(Debug, Clone, Args)]
pub struct LookArgs {
    /// The drive, and where its features come from.
    #[command(flatten)]
    pub input: InputArgs,
    /// Seed of the simulated GPS start, and of whatever else is drawn.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// What wheels and gyroscope say: lines `t_s,speed_m_s,yaw_rate_rad_s`.
    #[arg(long, value_name = "FILE")]
    odometry: Option<PathBuf>,
    /// How it is localized.
    #[command(flatten)]
    pub config: ConfigArgs,
}

/// A drive for a table of many runs.
#[derive(Debug, Args)]
pub struct TrialArgs {
    /// The drive.
    #[command(flatten)]
    pub look: LookArgs,
    /// Print the table as JSON.
    #[arg(long)]
    pub json: bool,
    /// Tell of the frames that are called ok and are off by 0.5 m or more: the
    /// worst of each stretch of them.
    #[arg(long)]
    pub list: bool,
}

/// All that a run of the localizer takes in, and the truth.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// The map.
    pub map: SemanticMap,
    /// The camera, as the localizer is told of it.
    pub camera: PinholeCamera,
    /// Size of the images.
    pub image: ImageSize,
    /// What is seen, in the order in which it is delivered.
    pub frames: Vec<FrameFeatures>,
    /// GPS fixes by frame.
    pub fixes: BTreeMap<usize, GpsFix>,
    /// What wheels and gyroscope say, or the images.
    pub odometry: OdometryLog,
    /// The images, where they said it, or what of it wheels do not.
    pub images: Option<Images>,
    /// `map_from_camera` of every frame of the sequence.
    pub truth: Vec<Pose>,
    /// Settings.
    pub config: Config,
    /// How it is localized.
    pub method: Method,
}

/// The images of a drive, to be looked at as they come when something is wrong
/// with them.
#[derive(Debug, Clone, PartialEq)]
pub struct Images {
    /// The folder with `sequences/`.
    pub root: PathBuf,
    /// Name of the sequence.
    pub sequence: String,
    /// Folder with label images, where there are any.
    pub labels: Option<PathBuf>,
    /// Whether wheels tell the motion, and these pitch and roll alone.
    pub are_beside_wheels: bool,
    /// Settings.
    pub config: Config,
}

impl Images {
    /// How the camera moved, as they say.
    ///
    /// # Errors
    /// Where one cannot be read.
    pub fn motion(&self, deliveries: &[Delivery]) -> localizer::Result<OdometryLog> {
        let (labels, widest_px) = (self.labels.as_deref(), self.config.vision.widest_px);
        let drive = Drive::open(&self.root, &self.sequence, labels, 0, None, widest_px)?;
        Ok(watch::motion(&drive, labels, deliveries, &self.config)?.log)
    }
}

impl LookArgs {
    /// A generated drive, from its label images, and what its wheels say.
    pub fn of_labels(drive: &Path, map: &Path, truth: &Path, odometry: Option<PathBuf>) -> Self {
        let input = InputArgs {
            map: Some(map.to_path_buf()),
            kitti: Some(drive.to_path_buf()),
            sequence: "00".to_owned(),
            source: SourceArgs { labels: Some(drive.join("sequences/00/labels_2")), ..SourceArgs::default() },
            truth: Some(truth.to_path_buf()),
            first: 0,
            last: None,
        };
        Self { input, seed: 0, odometry, config: ConfigArgs::default() }
    }

    /// The same, of a folder with other images of its sequence: the poses are where
    /// they were.
    #[must_use]
    pub fn at(&self, root: &Path, sequence: &Sequence) -> Self {
        let mut there = self.clone();
        there.input.truth.get_or_insert_with(|| sequence.poses_path());
        there.input.kitti = Some(root.to_path_buf());
        there
    }

    /// Looks at all images; none where the settings were to be printed, and are.
    ///
    /// # Errors
    /// Where an option is missing or a file cannot be read.
    pub fn read(&self) -> localizer::Result<Option<Trial>> {
        self.config.load()?.map(|config| self.read_by(config)).transpose()
    }

    /// Looks at all images by these settings.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_by(&self, mut config: Config) -> localizer::Result<Trial> {
        let wheels = self.input.read_odometry(self.odometry.as_deref(), &config)?;
        let images = Images {
            root: self.input.kitti.clone().unwrap_or_default(),
            sequence: self.input.sequence.clone(),
            labels: self.input.source.labels.clone(),
            are_beside_wheels: wheels.is_some(),
            config: config.clone(),
        };
        let input = self.input.read(wheels.is_some(), &config)?;
        let images = Some(images).filter(|_| wheels.is_none() || input.drive.moves_by_images());
        // The map as a whole, for it may be moved; `read` saw that it is given.
        let map = self.input.map.as_ref().map(common::map::read).transpose()?.unwrap_or_default();
        let truth = self.input.true_poses(&input.drive)?;
        let fixes = simulated(&input.drive.frames.iter().copied(), &truth, &config, self.seed)?;
        let odometry = odometry(wheels, &input.motion, &mut config);
        let mut frames = input.frames;
        frames.retain(|seen| seen.frame < truth.len());
        let (camera, image) = (input.drive.camera.pinhole, input.drive.camera.seen_px());
        let method = Method::Robust;
        Ok(Trial { map, camera, image, frames, fixes, odometry, images, truth, config, method })
    }
}

impl Trial {
    /// Localizes the drive.
    ///
    /// # Errors
    /// What the localizer says; a map in memory gives it no reason.
    pub fn run(&self) -> localizer::Result<Vec<FrameResult>> {
        self.run_in(&self.map, &self.fixes)
    }

    /// The same in another map, with other GPS fixes.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn run_in(&self, map: &SemanticMap, fixes: &BTreeMap<usize, GpsFix>) -> localizer::Result<Vec<FrameResult>> {
        let mut map = LocalMap::whole(map.clone());
        localize(
            &self.frames,
            fixes,
            &self.odometry,
            Localizer::new(self.method, &mut map, &self.camera, self.image, &self.config),
        )
    }

    /// How far each result is off, in their order.
    pub fn errors(&self, results: &[FrameResult]) -> Vec<FrameError> {
        let error = |result: &FrameResult| {
            let truth = self.truth.get(result.frame)?;
            Some(FrameError::new(result.frame, truth, &result.estimate.map_from_camera))
        };
        results.iter().filter_map(error).collect()
    }

    /// What came of a run.
    pub fn outcome(&self, results: &[FrameResult]) -> Scored {
        let figures = self.figures_after_start(results);
        let why_none = figures.is_none().then(|| nothing_scored(results.len()).to_string());
        Scored { figures, why_none }
    }

    fn figures_after_start(&self, results: &[FrameResult]) -> Option<Figures> {
        let scored = results.get(START_FRAMES..)?;
        let recorded: Vec<Recorded> = scored.iter().map(Recorded::from).collect();
        let truth: Vec<Option<Pose>> = self.truth.iter().copied().map(Some).collect();
        let report = score(&recorded, &truth, &scored.iter().map(FrameResult::timing).collect::<Vec<_>>())?;
        let [ok, _, lost] = report.ok_degraded_lost?;
        let count = report.frames as f64;
        let hazards = scored.iter().zip(&report.errors).filter(|(r, e)| is_hazardous(r, e));
        Some(Figures {
            frames: report.frames,
            rms_m: report.rms_position_m,
            max_m: report.max_position_m,
            under_half_metre: report.share_under_half_metre,
            flagged: 1.0 - ok as f64 / count,
            lost: lost as f64 / count,
            mean_nees: report.trust.and_then(|trust| trust.nees).map(|nees| nees.mean_nees),
            is_lost_at_end: report.errors.last().is_none_or(|error| error.position_m() > LOST_M),
            hazards: hazards.map(|(result, error)| Hazard::new(result, error)).collect(),
            time: report.localize,
        })
    }
}

/// It is called ok, and is off by more than anybody may be unwarned.
fn is_hazardous(result: &FrameResult, error: &FrameError) -> bool {
    result.estimate.status == Status::Ok && error.position_m() >= ALERT_LIMIT_M
}

/// It is called ok, and is.
pub fn is_good(result: &FrameResult, error: &FrameError) -> bool {
    result.estimate.status == Status::Ok && error.position_m() < ALERT_LIMIT_M
}

/// What came of a run: figures, where anything was localized after the start.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scored {
    /// The figures.
    #[serde(flatten)]
    pub figures: Option<Figures>,
    /// Why there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why_none: Option<String>,
}

impl Scored {
    /// A cell of a table: a dash where there are no figures.
    pub fn cell(&self, of: impl Fn(&Figures) -> String) -> String {
        self.figures.as_ref().map_or_else(|| "-".to_owned(), of)
    }

    /// A line for each stretch of frames that are called ok and are not.
    pub fn stretches(&self) -> Vec<String> {
        self.figures.as_ref().map_or_else(Vec::new, |figures| stretches(&figures.hazards))
    }
}

/// That all rows of a table have figures, once all of it is said. Rows come by `kind`
/// and with their names.
///
/// # Errors
/// A sentence that names those without, and says why the first has none.
pub fn all_scored<'a>(kind: &str, rows: impl Iterator<Item = (&'a str, &'a Scored)>) -> Result<(), String> {
    let without: Vec<(&str, &str)> = rows.filter_map(|(name, of)| Some((name, of.why_none.as_deref()?))).collect();
    let Some((_, why)) = without.first() else { return Ok(()) };
    let names: Vec<String> = without.iter().map(|(name, _)| format!("`{name}`")).collect();
    Err(format!("{kind} {}: {why}", names.join(", ")))
}

/// What a row of a table says where something was localized.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figures {
    /// Frames that were scored.
    pub frames: usize,
    /// Root mean square of the position error, metres.
    pub rms_m: f64,
    /// Largest position error, metres.
    pub max_m: f64,
    /// Share of frames off by less than half a metre.
    pub under_half_metre: f64,
    /// Share of frames that are not called ok.
    pub flagged: f64,
    /// Share of frames that are called lost.
    pub lost: f64,
    /// Mean squared error of the ok frames, normalised by their covariance.
    pub mean_nees: Option<f64>,
    /// The last frame is off by more than half a lane.
    pub is_lost_at_end: bool,
    /// Frames that are called ok and are off by 0.5 m or more.
    pub hazards: Vec<Hazard>,
    /// Time for association and pose.
    pub time: Option<StageTime>,
}

/// A frame that is called ok and is not.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Hazard {
    /// By how much it is off.
    pub error: FrameError,
    /// What was claimed: standard deviations right, down, forward (m) and
    /// about these axes (rad).
    pub sigmas: [f64; 6],
    /// What was matched: features that found a landmark.
    pub correspondences: usize,
    /// Support of the frame, nats.
    pub support: f64,
    /// Over the best rival, nats.
    pub margin: f64,
}

impl Figures {
    /// How many frames are called so.
    pub fn ok_degraded_lost(&self) -> [usize; 3] {
        let count = |share: f64| (share * self.frames as f64).round() as usize;
        let (flagged, lost) = (count(self.flagged), count(self.lost));
        [self.frames - flagged, flagged - lost, lost]
    }
}

impl Hazard {
    fn new(result: &FrameResult, error: &FrameError) -> Self {
        let estimate = &result.estimate;
        Self {
            error: *error,
            sigmas: estimate.sigmas(),
            correspondences: estimate.correspondences.len(),
            support: estimate.support,
            margin: estimate.margin,
        }
    }
}

/// Hazards further apart than this are told of each for itself, frames.
const STRETCH_GAP: usize = 5;

/// A line for each stretch of hazardous frames: where it is, and its worst.
fn stretches(hazards: &[Hazard]) -> Vec<String> {
    let is_near = |a: &Hazard, b: &Hazard| b.error.frame.saturating_sub(a.error.frame) <= STRETCH_GAP;
    let line = |stretch: &[Hazard]| {
        let (first, last) = (stretch.first()?, stretch.last()?);
        let worst = stretch.iter().max_by(|a, b| a.error.position_m().total_cmp(&b.error.position_m()))?;
        Some(format!("{} of the frames {} to {}; {worst}", stretch.len(), first.error.frame, last.error.frame))
    };
    hazards.chunk_by(is_near).filter_map(line).collect()
}

impl std::fmt::Display for Hazard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (error, sigmas) = (&self.error, &self.sigmas);
        write!(
            f,
            "frame {}: right {:+.2}, down {:+.2}, forward {:+.2} m, {:.3} rad; claimed right {:.2}, down {:.2}, \
             forward {:.2} m, yaw {:.3} rad; {} matches, support {:.0}, margin {:.0}",
            error.frame,
            error.lateral_m,
            error.vertical_m,
            error.longitudinal_m,
            error.angle_rad,
            sigmas[0],
            sigmas[1],
            sigmas[2],
            sigmas[4],
            self.correspondences,
            self.support,
            self.margin
        )
    }
}
