//! Settings of `mapper merge`.

use std::ops::RangeInclusive;

use common::config::{Limits, limits};
use serde::{Deserialize, Serialize};

use crate::fuse::FuseConfig;

/// Settings of `mapper merge`: you do not need to touch them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
pub struct MergeConfig {
    /// How maps are aligned.
    pub align: AlignConfig,
    /// When two landmarks are one.
    pub fuse: FuseConfig,
    /// Which passes should have seen a landmark.
    pub witness: WitnessConfig,
    /// When two paths are one road.
    pub roads: SameRoadConfig,
}

/// What the numbers of [`MergeConfig`] may be: by steps and standard deviations
/// is divided, and time grows with reaches.
pub const LIMITS: &[Limits] = &[
    limits("align.reach_m", 0.0, 20.0),
    limits("align.node_m", 1.0, 1000.0),
    limits("align.window_m", 1.0, 1000.0),
    limits("align.lane_step_m", 0.5, 100.0),
    limits("align.fewest_*", 1.0, 1e6),
    limits("align.least_lead", 1.0, 1e6),
    limits("align.least_shared", 0.0, 1.0),
    limits("align.*sigma_m", 1e-4, 1000.0),
    limits("align.*sigma_rad", 1e-6, 10.0),
    limits("fuse.lane_step_m", 0.1, 50.0),
    limits("fuse.lane_angle_rad", 0.0, 3.2),
    limits("fuse.*_m", 0.0, 100.0),
    limits("witness.*_m", 0.0, 1000.0),
    limits("roads.step_m", 0.1, 100.0),
    limits("roads.angle_rad", 0.0, 3.2),
    limits("roads.*_m", 0.0, 1000.0),
];

/// How maps of one area are aligned: each by small corrections of place and
/// heading along its roads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AlignConfig {
    /// Farthest that the same landmark may lie apart in two maps before they
    /// are aligned, metres: what surveys differ by.
    pub reach_m: f64,
    /// Distance of the corrections along a road, metres: surveys drift over
    /// longer ones.
    pub node_m: f64,
    /// Radius in which landmarks vote for where another map lies, metres.
    pub window_m: f64,
    /// Fewest landmarks that agree on where another map lies.
    pub fewest_votes: usize,
    /// By how much the votes for the best place surpass those for the next
    /// best: a row of like bollards fits at many.
    pub least_lead: f64,
    /// Stated accuracy of a map's frame, metres per axis.
    pub frame_sigma_m: f64,
    /// Stated accuracy of a map's heading, radians.
    pub frame_sigma_rad: f64,
    /// Drift of a survey between neighbouring corrections, metres per axis.
    pub drift_sigma_m: f64,
    /// The same, radians.
    pub drift_sigma_rad: f64,
    /// Standard deviation of a landmark's position in a map, metres per axis;
    /// also the scale of the Cauchy weight that takes wrong pairs out.
    pub landmark_sigma_m: f64,
    /// Distance of the places at which lane lines are compared, metres.
    pub lane_step_m: f64,
    /// Fewest landmarks near the other maps from which on it is asked whether
    /// a map could be aligned.
    pub fewest_checked: usize,
    /// Least share of them that other maps have, too, or of those beside one of
    /// these that this one has; a map with fewer is kept as given.
    pub least_shared: f64,
}

impl Default for AlignConfig {
    fn default() -> Self {
        Self {
            reach_m: 2.5,
            node_m: 25.0,
            window_m: 60.0,
            fewest_votes: 4,
            least_lead: 1.5,
            frame_sigma_m: 1.0,
            frame_sigma_rad: 0.01,
            drift_sigma_m: 0.05,
            drift_sigma_rad: 1e-3,
            landmark_sigma_m: 0.1,
            lane_step_m: 8.0,
            fewest_checked: 5,
            least_shared: 0.25,
        }
    }
}

/// Which passes should have seen a landmark.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WitnessConfig {
    /// A pass whose path comes this near should have seen a pole or a sign,
    /// metres: farther ones are often hidden or hit by too few beams.
    pub point_m: f64,
    /// The same for paint, metres: two lanes.
    pub lane_m: f64,
    /// A pass that came as near as one that saw a landmark, or farther by up to
    /// this, should have seen it, too, metres.
    pub as_near_m: f64,
    /// From farther than this nothing is expected to be seen, metres.
    pub farthest_m: f64,
    /// Largest difference in height of path and sign, metres: other levels of a
    /// road see nothing of it.
    pub height_m: f64,
    /// The ground of a pole or of paint may lie higher than the path by up to
    /// this, metres. The path is that of the camera, which is some 1.65 m above
    /// its road: so a bank beside the road is near, and a bridge over it, whose
    /// deck is 5 m up or more, is not.
    pub ground_above_m: f64,
    /// The same for ground below the path, metres: from a bridge nothing is seen
    /// of the road below, which is 6.5 m or more below a camera there.
    pub ground_below_m: f64,
    /// Shorter gaps in a lane line are closed, metres: vehicles hide paint.
    pub shortest_gap_m: f64,
}

impl Default for WitnessConfig {
    fn default() -> Self {
        Self {
            point_m: 15.0,
            lane_m: 7.5,
            as_near_m: 1.0,
            farthest_m: 30.0,
            height_m: 6.0,
            ground_above_m: 2.0,
            ground_below_m: 5.0,
            shortest_gap_m: 5.0,
        }
    }
}

impl WitnessConfig {
    /// How far below a path (above it: negative, metres) the foot of a pole or
    /// paint is that the pass may have seen.
    pub fn ground_m(&self) -> RangeInclusive<f64> {
        -self.ground_above_m..=self.ground_below_m
    }

    /// The same for the centroid of a sign.
    pub fn signs_m(&self) -> RangeInclusive<f64> {
        -self.height_m..=self.height_m
    }
}

/// When two paths are one road.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SameRoadConfig {
    /// Largest lateral distance of two paths on one road, metres: three lanes.
    pub within_m: f64,
    /// Largest angle between them, radians, whichever way they are driven.
    pub angle_rad: f64,
    /// Largest difference in height, metres: less than under a bridge.
    pub height_m: f64,
    /// Distance of the places at which paths are compared, metres.
    pub step_m: f64,
    /// Shortest stretch that another pass adds to a road, metres.
    pub shortest_m: f64,
}

impl Default for SameRoadConfig {
    fn default() -> Self {
        Self { within_m: 10.0, angle_rad: 0.5, height_m: 3.0, step_m: 2.0, shortest_m: 10.0 }
    }
}
