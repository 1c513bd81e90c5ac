use serde::{Deserialize, Serialize};

/// How kerbs of roads without paint are found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct KerbConfig {
    /// Distance of the places along the path at which the road's height across it is
    /// looked at, metres.
    pub bin_m: f64,
    /// Length of the road that is looked at there, metres: so short that it is straight.
    pub window_m: f64,
    /// Width of the cells across it, metres.
    pub cell_m: f64,
    /// Nearest kerb beside the path, metres: the vehicle's half width.
    pub nearest_m: f64,
    /// Farthest kerb beside the path, metres: that of the oncoming lane, behind a row of
    /// parked cars.
    pub half_width_m: f64,
    /// Width of the strip on its inner side that tells how the road goes on, metres.
    pub inner_m: f64,
    /// How far the heights there may lie off a straight line, metres, root mean square: a
    /// gutter bends by a centimetre, and behind a drop or in grass they lie anyhow.
    pub largest_roughness_m: f64,
    /// Width of the strip on its outer side that is higher than that, metres.
    pub outer_m: f64,
    /// Width of the strip behind it on which there is ground, metres: behind the foot of
    /// a wall or a hedge there is none.
    pub beyond_m: f64,
    /// Least and largest height of the step over the road as it goes on outwards, metres:
    /// gutters of lowered kerbs are 0.03 m deep, and kerbs 0.1 to 0.2 m high.
    pub rise_m: [f64; 2],
    /// Fewest points in a cell that tell its height.
    pub fewest_points: u32,
    /// How far one step may lie aside of where those before it lead, metres.
    pub aside_m: f64,
    /// Longest stretch without a step, metres: a parked car, a driveway.
    pub longest_gap_m: f64,
    /// Shortest kerb, metres.
    pub shortest_m: f64,
    /// Least share of its length on which the step is seen.
    pub least_share: f64,
    /// Half length over which it is smoothed, metres.
    pub smooth_m: f64,
    /// Largest root mean square distance of the steps from it, metres.
    pub largest_spread_m: f64,
    /// Distance from a painted line within which no kerb is sought, metres: there
    /// networks see the paint, and it is known better. Two lanes.
    pub paint_within_m: f64,
    /// The same along the road, metres: a gap in its lines, or lines that are worn.
    pub paint_along_m: f64,
    /// Tolerance of the polyline, metres: networks put it no better.
    pub tolerance_m: f64,
}

impl Default for KerbConfig {
    fn default() -> Self {
        Self {
            bin_m: 1.0,
            window_m: 2.0,
            cell_m: 0.1,
            nearest_m: 1.2,
            half_width_m: 6.0,
            inner_m: 0.9,
            largest_roughness_m: 0.015,
            outer_m: 0.3,
            beyond_m: 0.5,
            rise_m: [0.03, 0.25],
            fewest_points: 3,
            aside_m: 0.2,
            longest_gap_m: 6.0,
            shortest_m: 12.0,
            least_share: 0.6,
            smooth_m: 4.0,
            largest_spread_m: 0.08,
            paint_within_m: 7.0,
            paint_along_m: 20.0,
            tolerance_m: 0.05,
        }
    }
}
