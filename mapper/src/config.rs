//! Settings of `mapper build`.

use common::map::EncodeOptions;
use serde::{Deserialize, Serialize};

use crate::budget::BudgetConfig;
use crate::cloud::CloudConfig;
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
