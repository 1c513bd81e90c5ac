//! All settings of the localizer, as they stand in its TOML file.

use common::config::{Limits, limits, range};
use serde::{Deserialize, Serialize};

use crate::associate::detection::DetectionConfig;
use crate::associate::paper::PaperConfig;
use crate::associate::robust::RobustConfig;
use crate::associate::separation::SeparationConfig;
use crate::filter::MotionConfig;
use crate::gps::GpsConfig;
use crate::local_map::LocalMapConfig;
use crate::measurement::NoiseConfig;
use crate::odometry::OdometryConfig;
use crate::preselect::PreselectConfig;
use crate::solver::SolverConfig;
use crate::start::StartConfig;
use crate::tracker::{BankConfig, ClockConfig, HealthConfig, NearbyConfig, RivalConfig, SweepConfig, UnseenConfig};
use crate::vision::VisionConfig;
use crate::visual_odometry::VisualOdometryConfig;

/// What the numbers of [`Config`] may be: cells of the search that are ever
/// finer, pixels that are ever smaller, and rounds without number, take all
/// memory or all time; no feature is believed where false ones are endlessly
/// dense.
pub const LIMITS: &[Limits] = &[
    limits("vision.widest_px", 64.0, 1e6),
    limits("vision.camera_height_m", 0.05, 100.0),
    limits("vision.poles.ransac_rounds", 1.0, 1e5),
    limits("vision.poles.ransac_seed", 0.0, 1e18),
    limits("vision.poles.lines_per_region", 1.0, 1000.0),
    limits("vision.trunks.widest_of_width", 0.0, 1.0),
    limits("vision.trunks.free_share", 0.0, 1.0),
    limits("vision.marks.*_share", 0.0, 1.0),
    limits("vision.*.threshold", 0.0, 1.0),
    limits("vision.*.seed", 0.0, 1.0),
    limits("vision.*.min_probability", 0.0, 1.0),
    limits("vision.*.min_coverage", 0.0, 1.0),
    limits("vision.*.min_fill", 0.0, 1.0),
    limits("vision.*_deg", 0.0, 90.0),
    limits("vision.*", 0.0, 1e4),
    limits("preselect.min_relative_size", 0.0, 1.0),
    limits("preselect.*_m", 0.0, 1e4),
    limits("noise.end_sigma_px", 0.1, 1000.0),
    limits("noise.seen_end", 0.0, 1.0),
    limits("noise.min_overlap", 0.0, 1.0),
    limits("noise.max_size_ratio", 1.0, 1e9),
    limits("noise.*", 0.0, 1e6),
    limits("detection.lane_spread_of_width", 0.001, 1.0),
    limits("detection.sign_band_of_height", 0.01, 1.0),
    limits("detection.odds.usual_pole", 0.0, 1.0),
    limits("detection.odds.*", 0.0, 1e9),
    limits("detection.*_m", 0.0, 1e4),
    limits("detection.pole_spread_rad", 0.001, 3.2),
    limits("detection.mark_lead", 0.0, 1e4),
    // Those of being seen, by kind, and shares.
    limits("detection.*", 0.0, 1.0),
    limits("solver.loss_scale", 0.01, 1e6),
    limits("solver.max_iterations", 1.0, 1000.0),
    limits("solver.*", 0.0, 1e6),
    limits("robust.max_rounds", 1.0, 1000.0),
    limits("robust.*", 0.0, 1e9),
    limits("separation.prior_share", 0.0, 1.0),
    limits("separation.anchor_s", 0.1, 3600.0),
    limits("separation.*", 0.0, 1e9),
    limits("paper.*hypotheses", 1.0, 1e5),
    limits("paper.drawn", 1.0, 1000.0),
    limits("paper.seed", 0.0, 1e18),
    limits("paper.*", 0.0, 1e9),
    limits("start.step_m", 0.05, 100.0),
    limits("start.step_rad", 0.002, 3.2),
    limits("start.reach_sigmas", 0.1, 10.0),
    limits("start.max_cells", 1.0, 1e7),
    limits("start.matched_cells", 1.0, 1e6),
    limits("start.refined", 1.0, 1e4),
    limits("start.kept", 1.0, 1e4),
    limits("start.grid_sigma_m", 0.1, 1000.0),
    limits("start.height_above_path_m", -10.0, 10.0),
    limits("start.other_heights_m", -10.0, 10.0),
    limits("start.other_heights_every", 1.0, 1e6),
    limits("start.*_rad", 1e-4, 10.0),
    limits("start.*", 0.0, 1e4),
    limits("motion.*.memory_s", 0.01, 1e6),
    limits("motion.*", 0.0, 1e6),
    limits("clock.frames", 1.0, 1000.0),
    limits("clock.max_sigma_s", 0.0, 10.0),
    limits("clock.told_sigma_s", 0.0, 10.0),
    limits("clock.soonest", 0.0, 1.0),
    limits("clock.nearest_s", 0.0, 10.0),
    limits("odometry.drift_per_minute", 0.0, 1e3),
    limits("odometry.speed_sigma_of_turn_m", 0.0, 1e3),
    limits("odometry.*", 1e-6, 1e3),
    limits("visual_odometry.tracks.columns", 1.0, 200.0),
    limits("visual_odometry.tracks.rows", 1.0, 200.0),
    limits("visual_odometry.tracks.most_in_cell", 1.0, 100.0),
    limits("visual_odometry.tracks.least_quality", 0.0, 1.0),
    limits("visual_odometry.tracks.apart_px", 1.0, 1000.0),
    limits("visual_odometry.tracks.window_px", 5.0, 101.0),
    limits("visual_odometry.tracks.levels", 1.0, 8.0),
    limits("visual_odometry.tracks.round_trip_px", 0.0, 1000.0),
    limits("visual_odometry.accuracy.drift_per_minute", 0.0, 1e3),
    limits("visual_odometry.accuracy.speed_sigma_of_turn_m", 0.0, 1e3),
    limits("visual_odometry.accuracy.*", 1e-6, 1e3),
    limits("visual_odometry.rotation.*", 1e-4, 1000.0),
    limits("visual_odometry.labels.*", 1e-4, 1000.0),
    range("visual_odometry.road.ahead_m", 1.0, 40.0),
    limits("visual_odometry.road.farthest_m", 1.0, 40.0),
    range("visual_odometry.road.hidden_share", 0.0, 1.0),
    limits("visual_odometry.road.believed_after", 1.0, 1e6),
    limits("visual_odometry.road.half_width_m", 0.5, 8.0),
    limits("visual_odometry.road.pixel_m", 0.02, 0.5),
    limits("visual_odometry.road.around_m", 0.05, 5.0),
    limits("visual_odometry.road.sag_sigma_per_m", 0.0, 0.1),
    limits("visual_odometry.road.sag_length_m", 0.1, 1e4),
    limits("visual_odometry.road.half_sigma_m", 1e-3, 10.0),
    limits("visual_odometry.road.side_sigma_m", 1e-3, 10.0),
    limits("visual_odometry.road.fall_sigma", 0.0, 0.5),
    limits("visual_odometry.road.fall_length_m", 0.1, 1e4),
    limits("visual_odometry.road.share_sigma", 1e-3, 0.5),
    limits("visual_odometry.road.way_sigma_m", 0.0, 1.0),
    limits("visual_odometry.road.alike_m", 0.0, 1e3),
    limits("visual_odometry.road.*", 0.0, 200.0),
    limits("bank.*memory", 0.0, 1.0),
    limits("bank.least_anew", 0.0, 1.0),
    limits("bank.*capacity", 1.0, 1e4),
    limits("bank.max_*_m_s", 0.0, 200.0),
    limits("bank.*", 0.0, 1e9),
    limits("rivals.every_frames", 1.0, 1e6),
    limits("rivals.sideways_m", -100.0, 100.0),
    limits("rivals.along_m", -100.0, 100.0),
    limits("rivals.uncertain_m", -100.0, 100.0),
    limits("rivals.loose_rad", 0.0, 3.2),
    limits("rivals.*", 0.0, 1e4),
    limits("nearby.every_frames", 1.0, 1e6),
    limits("nearby.*_rad", 0.0, 0.5),
    limits("nearby.*_m", 0.0, 20.0),
    limits("nearby.*", 0.0, 1e4),
    limits("health.search_sigma_rad", 1e-3, 0.5),
    limits("health.*search_sigma_m", 0.1, 100.0),
    limits("health.foreseen_memory_m", 0.1, 1e5),
    limits("health.least_foreseen_anew", 0.0, 2.0),
    limits("health.least_foreseen*", 0.0, 1.0),
    limits("health.enough_known", 0.0, 1.0),
    limits("health.strange_images", 1.0, 1e6),
    limits("health.most_strange", 1.0, 1e6),
    limits("health.most_missing", 0.0, 1e6),
    limits("health.*", 0.0, 1e9),
    limits("gps.heading_sigma_deg", 0.1, 180.0),
    limits("gps.horizontal_sigma_m", 0.01, 1000.0),
    limits("gps.course_sigma_m_s", 0.0, 100.0),
    limits("gps.oldest_s", 0.0, 60.0),
    limits("gps.way_*_rad", 0.0, 3.2),
    limits("gps.*", 0.0, 1e6),
    // Shorter ones have no number.
    limits("sweep.stretch_m", 5.0, 1e3),
    limits("sweep.*_m", 0.0, 1e5),
    limits("sweep.*", 1.0, 1e6),
    limits("unseen.longest_told_s", 0.1, 3600.0),
    limits("unseen.longest_untold_s", 0.1, 3600.0),
    limits("unseen.step_s", 0.05, 10.0),
    limits("unseen.any_heading_rad", 0.0, 10.0),
    limits("unseen.*", 0.1, 1e4),
    limits("local_map.*_m", 1.0, 1e5),
];

/// Settings by stage; the defaults need no file.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Images to features (IV.B).
    pub vision: VisionConfig,
    /// Landmarks that may be seen (IV.A).
    pub preselect: PreselectConfig,
    /// Standard deviations of map and calibration.
    pub noise: NoiseConfig,
    /// Detection and clutter.
    pub detection: DetectionConfig,
    /// The optimiser (IV.D).
    pub solver: SolverConfig,
    /// The default association.
    pub robust: RobustConfig,
    /// What one object does to the pose.
    pub separation: SeparationConfig,
    /// The paper's association.
    pub paper: PaperConfig,
    /// The search around a rough position.
    pub start: StartConfig,
    /// The vehicle's motion.
    pub motion: MotionConfig,
    /// How well the times of images are kept.
    pub clock: ClockConfig,
    /// Wheels and gyroscope.
    pub odometry: OdometryConfig,
    /// Speed and turn from the images, where there is no log of wheels.
    pub visual_odometry: VisualOdometryConfig,
    /// The set of hypotheses.
    pub bank: BankConfig,
    /// The look beside the best hypothesis.
    pub rivals: RivalConfig,
    /// The search around a pose that is not trusted.
    pub nearby: NearbyConfig,
    /// When to trust.
    pub health: HealthConfig,
    /// What is known after images failed to come.
    pub unseen: UnseenConfig,
    /// The search of all roads in reach of a lost vehicle.
    pub sweep: SweepConfig,
    /// GPS fixes.
    pub gps: GpsConfig,
    /// What of an atlas is held in memory.
    pub local_map: LocalMapConfig,
}
