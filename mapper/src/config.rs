//! Settings of `mapper build`.

use std::path::Path;

use common::config::{Limits, limits, load_or_default, range};
use common::map::EncodeOptions;
use serde::{Deserialize, Serialize};

use crate::budget::BudgetConfig;
use crate::cloud::CloudConfig;
use crate::error::Result;
use crate::evidence::EvidenceConfig;
use crate::fuse::FuseConfig;
use crate::ground::GroundConfig;
use crate::input::InputConfig;
use crate::lanes::LaneConfig;
use crate::lidar::LidarConfig;
use crate::poles::PoleConfig;
use crate::register::RefineConfig;
use crate::roads::RoadConfig;
use crate::signs::SignConfig;

/// Settings of `mapper build`: you do not need to touch them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Quantum of the coordinates in the map file, metres.
    pub quantum_m: f64,
    /// Scans and clouds that are not KITTI's.
    pub input: InputConfig,
    /// The lidar's beams.
    pub lidar: LidarConfig,
    /// What is stitched.
    pub cloud: CloudConfig,
    /// Poses that the scans agree with.
    pub refine: RefineConfig,
    /// The ground.
    pub ground: GroundConfig,
    /// Road stretches.
    pub roads: RoadConfig,
    /// Poles.
    pub poles: PoleConfig,
    /// Signs.
    pub signs: SignConfig,
    /// Lane lines.
    pub lanes: LaneConfig,
    /// How well landmarks are known.
    pub evidence: EvidenceConfig,
    /// What was seen twice.
    pub fuse: FuseConfig,
    /// Which landmarks are kept within `--budget`.
    pub budget: BudgetConfig,
}

/// What the numbers of [`Config`] may be. Resolutions are no finer than a tenth
/// of their defaults and extents no larger than some times theirs: memory grows
/// with the square of both.
pub const LIMITS: &[Limits] = &[
    limits("quantum_m", 0.001, 1.0),
    limits("input.full_intensity", 0.0, 1e9),
    limits("input.held_points", 1000.0, 1e12),
    limits("input.deal.reach_m", 1.0, 1e6),
    limits("input.deal.cell_m", 0.05, 100.0),
    limits("input.deal.lying_m", 0.0, 100.0),
    limits("input.strip_m", 0.01, 1.0),
    limits("input.*_s", 0.0, 3600.0),
    limits("lidar.*_step_rad", 1e-5, 0.2),
    limits("lidar.apex_m", -10.0, 10.0),
    limits("lidar.at_m", -50.0, 50.0),
    limits("lidar.place.least_sharper", 1.0, 1e6),
    limits("lidar.place.farthest_m", 0.0, 20.0),
    range("lidar.place.heights_m", 0.1, 10.0),
    range("lidar.place.usual_m", 0.0, 1000.0),
    limits("lidar.place.*", 0.0, 1000.0),
    limits("lidar.measure.sector_rad", 0.005, 3.2),
    range("lidar.measure.band_rad", -1.5, 1.5),
    limits("lidar.measure.scans", 1.0, 1000.0),
    limits("lidar.measure.below_lowest", 0.0, 1.0),
    limits("lidar.measure.above_highest", 0.0, 1.0),
    limits("lidar.measure.fewest_points", 100.0, 1e9),
    limits("lidar.measure.most_times", 1.01, 1e6),
    limits("lidar.measure.most_times_as_bright", 1.01, 1e6),
    limits("lidar.measure.*_share", 0.0, 1.0),
    range("lidar.measure.road_m", 0.0, 1000.0),
    limits("lidar.measure.road_within_m", 0.01, 5.0),
    limits("lidar.measure.*_rad", 0.0, 3.2),
    limits("lidar.measure.*_m", 0.0, 1000.0),
    limits("lidar.*est_rad", -1.6, 1.6),
    limits("lidar.intensity.*", 1e-4, 1e6),
    limits("lidar.sheeting.cone_rad", 0.0, 3.2),
    limits("lidar.sheeting.within_m", 0.0, 1000.0),
    limits("lidar.sheeting.*", 0.0, 1.0),
    limits("cloud.half_width_m", 1.0, 200.0),
    limits("cloud.beyond_m", 0.0, 500.0),
    limits("cloud.*_m", 0.0, 1000.0),
    limits("cloud.most_from_one_place", 1.0, 1e6),
    limits("refine.*voxel_m", 0.05, 10.0),
    limits("refine.*step_m", 0.05, 10.0),
    limits("refine.*spacing_m", 0.5, 1000.0),
    limits("refine.*reach_m", 0.0, 20.0),
    limits("refine.graph.*sigma_m", 1e-4, 10_000.0),
    limits("refine.graph.*sigma_rad", 1e-6, 10.0),
    limits("refine.graph.robust_sigmas", 0.1, 1e6),
    limits("refine.*_m", 0.0, 10_000.0),
    limits("refine.vertical_angle.fixed_rad", -0.2, 0.2),
    limits("refine.*_rad", 0.0, 3.2),
    limits("refine.*_cos", -1.0, 1.0),
    limits("refine.*overlap", 0.0, 1.0),
    limits("refine.*rival", 0.0, 1.0),
    limits("refine.align.surface.fewest_points", 3.0, 1e6),
    limits("refine.align.surface.*", 0.0, 1.0),
    limits("refine.*sigmas", 0.1, 1e6),
    limits("refine.*inflation", 1e-3, 1e6),
    limits("refine.*", 1.0, 1e6),
    limits("ground.cell_m", 0.1, 20.0),
    range("ground.camera_height_m", 0.0, 100.0),
    limits("ground.*_m", 0.0, 100.0),
    limits("ground.fewest_points", 1.0, 1e6),
    limits("ground.least_under_path", 0.0, 100.0),
    limits("roads.length_m", 5.0, 1000.0),
    limits("roads.longest_step_m", 1.0, 2000.0),
    limits("roads.farthest_m", 1.0, 1e6),
    limits("roads.*_m", 0.0, 10_000.0),
    limits("roads.per_window", 1.0, 1000.0),
    limits("roads.parallel_rad", 0.0, 3.2),
    limits("poles.column_m", 0.02, 1.0),
    limits("poles.slice_m", 0.02, 2.0),
    range("poles.crown_radii_m", 0.0, 60.0),
    range("poles.pillars_apart_m", 0.0, 60.0),
    range("poles.shelters.posts_apart_m", 0.0, 60.0),
    range("poles.reflector_m", 0.0, 60.0),
    range("poles.sheet_m", 0.0, 60.0),
    limits("poles.trees.*_radius_m", 0.01, 1.0),
    limits("poles.trees.*_spread", 0.05, 5.0),
    limits("poles.trees.bare_m", 1.0, 60.0),
    limits("poles.trees.usual_poles", 0.1, 1e6),
    limits("poles.trees.tree_lean_rad", 0.001, 1.0),
    limits("poles.trees.reach_of_others_m", 0.0, 60.0),
    limits("poles.trees.*", 0.0, 1e6),
    limits("poles.leaning_share", 0.0, 0.5),
    limits("poles.*_share", 0.0, 1.0),
    limits("poles.least_free_share*", 0.0, 1.0),
    limits("poles.largest_attached_share*", 0.0, 1.0),
    limits("poles.*reflectance", 0.0, 1.0),
    limits("poles.least_visibility*", 0.0, 100.0),
    limits("poles.fewest_points", 4.0, 1e6),
    limits("poles.*_rad", 1e-6, 1.5),
    limits("poles.*_m", 0.0, 60.0),
    limits("poles.*", 0.0, 1e6),
    range("signs.*.width_m", 0.0, 60.0),
    range("signs.lights.seen_m", 0.0, 60.0),
    limits("signs.outline.odd_share", 0.001, 0.5),
    limits("signs.outline.telling_rows", 0.1, 1e3),
    limits("signs.outline.least_telling", 0.0, 1.0),
    limits("signs.outline.most_missed", 1.0, 1e6),
    limits("signs.lights.most_own_odds", 1.0, 1e6),
    limits("signs.*_m", 0.0, 60.0),
    limits("signs.*_share", 0.0, 1.0),
    limits("signs.*reflectance", 0.0, 1.0),
    limits("signs.backs.*least_agreement", 0.0, 1.0),
    limits("signs.outline.least_cosine", 0.0, 1.0),
    limits("signs.outline.bright", 0.0, 1.0),
    limits("signs.outline.beam_rad", 1e-6, 0.2),
    limits("signs.outline.aspect_spread", 0.01, 10.0),
    limits("signs.lights.darkest", 0.0, 1.0),
    limits("signs.fewest*", 1.0, 1e6),
    limits("signs.*", 0.0, 1e6),
    limits("lanes.kerbs.cell_m", 0.02, 2.0),
    limits("lanes.kerbs.window_m", 0.1, 100.0),
    limits("lanes.kerbs.fewest_points", 1.0, 1e6),
    range("lanes.kerbs.rise_m", 0.0, 2.0),
    limits("lanes.window_m", 2.0, 200.0),
    limits("lanes.apart_m", 0.0, 5.0),
    limits("lanes.*step_m", 0.1, 200.0),
    limits("lanes.*bin_m", 0.05, 10.0),
    limits("lanes.profile_m", 0.025, 5.0),
    limits("lanes.half_line_m", 0.02, 2.0),
    limits("lanes.half_core_m", 0.01, 2.0),
    limits("lanes.fords.cell_m", 0.02, 2.0),
    range("lanes.fords.periods_m", 0.1, 20.0),
    range("lanes.fords.across_m", 0.0, 20.0),
    range("lanes.rhythm.periods_m", 0.1, 20.0),
    limits("lanes.rhythm.window_m", 1.0, 200.0),
    limits("lanes.rhythm.same_period", 0.0, 0.5),
    range("lanes.fords.lengths_m", 0.0, 1000.0),
    range("lanes.wall_m", 0.0, 100.0),
    limits("lanes.side.thin_m", 0.02, 2.0),
    limits("lanes.side.most_axes", 0.0, 20.0),
    limits("lanes.most_bin_points", 1.0, 255.0),
    limits("lanes.least_worn_ratio", 1.5, 100.0),
    limits("lanes.*_m", 0.0, 1000.0),
    limits("lanes.*_share", 0.0, 1.0),
    limits("lanes.contrast.highest_rad", -1.6, 1.6),
    limits("lanes.contrast.least_noise", 1e-4, 1.0),
    limits("lanes.*_rad", 0.0, 3.2),
    limits("lanes.*", 0.0, 1e6),
    limits("evidence.slice_m", 0.01, 2.0),
    limits("evidence.piece_m", 0.1, 200.0),
    limits("evidence.*_m", 0.0, 100.0),
    limits("evidence.*_share", 0.0, 1.0),
    limits("evidence.*_rad", 1e-6, 3.2),
    limits("evidence.scan_sigma_scans", 0.1, 1e6),
    limits("fuse.lane_step_m", 0.1, 50.0),
    limits("fuse.*_m", 0.0, 100.0),
    limits("fuse.lane_angle_rad", 0.0, 3.2),
    limits("budget.place_step_m", 0.5, 1000.0),
    // Shares of images.
    limits("budget.found.*s", 0.0, 1.0),
    limits("budget.*_m", 0.0, 1000.0),
    limits("budget.camera.centre_row_px", -1e5, 1e5),
    limits("budget.camera.*_px", 1.0, 1e5),
    limits("budget.*sigma_px", 1e-6, 1e4),
    limits("budget.*_sigma", 1e-6, 1e4),
    limits("budget.sign_sigma_of_size", 1e-6, 1e4),
    limits("budget.*", 0.0, 1e6),
];

impl Config {
    /// The settings of a file, or the defaults.
    ///
    /// # Errors
    /// As [`common::config::load_within`].
    pub fn load(path: Option<&Path>) -> Result<Self> {
        Ok(load_or_default(path, LIMITS)?)
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            quantum_m: EncodeOptions::default().quantum_m,
            input: InputConfig::default(),
            lidar: LidarConfig::default(),
            cloud: CloudConfig::default(),
            refine: RefineConfig::default(),
            ground: GroundConfig::default(),
            roads: RoadConfig::default(),
            poles: PoleConfig::default(),
            signs: SignConfig::default(),
            lanes: LaneConfig::default(),
            evidence: EvidenceConfig::default(),
            fuse: FuseConfig::default(),
            budget: BudgetConfig::default(),
        }
    }
}
