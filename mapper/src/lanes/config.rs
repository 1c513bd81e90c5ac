use serde::{Deserialize, Serialize};

use super::ContrastConfig;

/// How lane lines are found and described.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LaneConfig {
    /// Paint against asphalt.
    pub contrast: ContrastConfig,
    /// Contrast of a point of paint, standard deviations of its surroundings.
    pub least_contrast: f32,
    /// Farthest line beside the path, metres: four lanes.
    pub half_width_m: f64,
    /// Height of paint above or below the ground map, metres.
    pub thickness_m: f64,
    /// Length of the windows in which lines are straight along the path, metres:
    /// two periods of the common dash patterns.
    pub window_m: f64,
    /// Distance of the windows, metres.
    pub step_m: f64,
    /// Largest angle between a lane line and the path, radians: a lane change
    /// at urban speed.
    pub largest_angle_rad: f64,
    /// Half width of a line, metres: broad lines are 0.25 m wide, registration
    /// and beams add some centimetres.
    pub half_line_m: f64,
    /// Length of the bins in which paint is counted along a line, metres.
    pub bin_m: f64,
    /// Least share of paint among the road points of a bin that is painted:
    /// half a bin's width is beside the line, and beams miss worn paint.
    pub least_bright_share: f64,
    /// Least share of a window's bins with paint: a dash of 3 m in 12 m.
    pub least_painted: f64,
    /// Largest share of paint points beside the line over those on it: more
    /// is a texture, a crossing or an arrow, no line.
    pub largest_clutter: f64,
    /// Shortest line kept, metres: arrows are shorter.
    pub shortest_m: f64,
    /// Fewest dashes of a dashed line: an arrow or a letter is one blot.
    pub fewest_dashes: usize,
    /// Shortest dash, metres of painted bins: the shortest in use are 1.5 m.
    pub shortest_dash_m: f64,
    /// Heights above ground between which walls, fences and hedges are seen,
    /// metres: kerbs are lower.
    pub wall_m: [f64; 2],
    /// Distance from a line within which none of them stands, metres: guard
    /// rails stand at least half a metre off the carriageway.
    pub wall_within_m: f64,
    /// Fewest scans that saw it there: vehicles pass along lines, too.
    pub fewest_wall_scans: u32,
    /// Largest share of a line that may have one beside it all the same.
    pub largest_walled_share: f64,
    /// Mean contrast from which on a line is paint whatever stands beside it,
    /// standard deviations: cars park along lines.
    pub least_walled_contrast: f64,
    /// Largest root mean square lateral distance of paint from its line, metres.
    pub largest_spread_m: f64,
    /// Longest gap joined within one line, metres: the longest dash gap in
    /// use on urban and rural roads.
    pub longest_gap_m: f64,
    /// Share of painted bins from which on a line is solid.
    pub solid_share: f64,
    /// Least distance of two lines, metres: double lines count as one.
    pub apart_m: f64,
    /// Lateral tolerance of the polyline, metres.
    pub tolerance_m: f64,
    /// Tolerance of the heights of the polyline, metres: at 10 m it is half a
    /// pixel's worth of the camera's height.
    pub height_tolerance_m: f64,
    /// Half length over which the line is smoothed, metres.
    pub smooth_m: f64,
}

impl Default for LaneConfig {
    fn default() -> Self {
        Self {
            contrast: ContrastConfig::default(),
            least_contrast: 3.0,
            half_width_m: 14.0,
            thickness_m: 0.12,
            window_m: 18.0,
            step_m: 6.0,
            largest_angle_rad: 0.1,
            half_line_m: 0.12,
            bin_m: 0.5,
            least_bright_share: 0.2,
            least_painted: 0.2,
            largest_clutter: 0.5,
            shortest_m: 10.0,
            fewest_dashes: 3,
            shortest_dash_m: 1.5,
            wall_m: [0.25, 1.5],
            wall_within_m: 0.45,
            fewest_wall_scans: 6,
            largest_walled_share: 0.3,
            least_walled_contrast: 5.7,
            largest_spread_m: 0.1,
            longest_gap_m: 13.0,
            solid_share: 0.7,
            apart_m: 0.4,
            tolerance_m: 0.03,
            height_tolerance_m: 0.06,
            smooth_m: 4.0,
        }
    }
}
