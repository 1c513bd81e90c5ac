use serde::{Deserialize, Serialize};

/// What the uncertainty of a landmark is made of, besides its own points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EvidenceConfig {
    /// Usual error of a scan's pose against its neighbours at the place of a
    /// landmark, metres, one standard deviation per axis: what registration
    /// leaves.
    pub scan_sigma_m: f64,
    /// How many scans that expectation is worth against what a landmark's own
    /// scans show: few scans say little about their scatter.
    pub scan_sigma_scans: f64,
    /// Usual scatter of a slice of one scan's hits about a pole or a line,
    /// metres: range noise and the width of the beams.
    pub slice_sigma_m: f64,
    /// Height of the slices of a pole whose hits count as one, metres: about
    /// one beam.
    pub slice_m: f64,
    /// Length of the pieces of a lane line whose paint counts as one, metres:
    /// the length over which lines are smoothed.
    pub piece_m: f64,
    /// How well it is known how far a pole's surface lies before its axis,
    /// metres: seen from one side only, this shifts it.
    pub surface_sigma_m: f64,
    /// Usual tilt of a pole, radians: how far a short one may lean unseen.
    pub tilt_sigma_rad: f64,
    /// Distance from a pole's axis (a plate's edge, a line) within which
    /// points are its own, metres.
    pub reach_m: f64,
    /// Height of the ground under a landmark, metres.
    pub ground_sigma_m: f64,
    /// The same where no ground was seen under it, metres.
    pub unseen_ground_sigma_m: f64,
    /// What is left of an error in the elevation of the beams, radians: all
    /// scans share it, and a landmark errs in height by it times its range.
    pub elevation_sigma_rad: f64,
    /// Height of the centroid of a plate that goes on above the lidar's field
    /// of view, metres: plates are 0.4 to 1 m high.
    pub cut_off_sigma_m: f64,
    /// How well the middle of a plate can be told whose outline was not seen
    /// wholly, as a share of the part that was not seen.
    pub unseen_share: f64,
    /// No landmark is better known than this against the trajectory, metres:
    /// calibration, and what all scans have in common.
    pub floor_m: f64,
    /// What is assumed across a landmark of which nothing is known, metres.
    pub unknown_sigma_m: f64,
    /// The same in height, metres.
    pub unknown_vertical_sigma_m: f64,
}

impl Default for EvidenceConfig {
    fn default() -> Self {
        Self {
            scan_sigma_m: 0.02,
            scan_sigma_scans: 4.0,
            slice_sigma_m: 0.03,
            slice_m: 0.1,
            piece_m: 4.0,
            surface_sigma_m: 0.015,
            tilt_sigma_rad: 0.02,
            reach_m: 0.2,
            ground_sigma_m: 0.03,
            unseen_ground_sigma_m: 0.1,
            elevation_sigma_rad: 1e-3,
            cut_off_sigma_m: 0.15,
            unseen_share: 0.5,
            floor_m: 0.01,
            unknown_sigma_m: 0.05,
            unknown_vertical_sigma_m: 0.15,
        }
    }
}
