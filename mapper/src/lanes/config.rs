use serde::{Deserialize, Serialize};

use super::{ContrastConfig, FordConfig, KerbConfig, MarkConfig, RhythmConfig, SideConfig, SpacingConfig};

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
    /// How far beside a line, to both sides, the paint of as wide a strip is
    /// taken off that on it, metres: beyond the broadest line and its
    /// neighbour in a double line.
    pub beside_line_m: f64,
    /// Length of the bins in which paint is counted in a window, metres.
    pub bin_m: f64,
    /// Length of the bins in which paint is told from asphalt along a line that
    /// was found, metres: a third of the shortest gap.
    pub profile_m: f64,
    /// Half width of the core of a line, metres: narrow lines are 0.1 m wide.
    pub half_core_m: f64,
    /// Share of paint among the road points on a painted core to begin with:
    /// beams see some of the paint as asphalt.
    pub usual_share: f64,
    /// Share of paint where it is worn, or where stripes beside it hide how much
    /// brighter it is, as a share of what the line has elsewhere: a quarter of
    /// the points is still far from bare asphalt's.
    pub worn_share: f64,
    /// How many times over it must exceed the share beside the line: grains lie
    /// closer here and there.
    pub least_worn_ratio: f64,
    /// Share of what is painted that has to be clear paint, of lines and of runs
    /// longer than any dash: grass is as worn paint is, all along.
    pub least_clear_share: f64,
    /// Least such share of a line: less is a texture.
    pub least_bright_share: f64,
    /// Least share of bright points on bare asphalt: its grains.
    pub least_bare_share: f64,
    /// How many times over it must exceed the share beside the line.
    pub least_share_ratio: f64,
    /// Points of paint on a line in a window, at most, that one bin counts for:
    /// near the path a blot has hundreds.
    pub most_bin_points: u16,
    /// The same as a multiple of what a bin of a line's width has on average in the
    /// window, where that is more: where scans lie close grains fill the bins.
    pub most_bin_ratio: f64,
    /// Fewest points of paint, on average, in a painted bin.
    pub fewest_bin_points: f64,
    /// Least significance of a line in a window: points of paint more than
    /// beside it, over the square root of those.
    pub least_significance: f64,
    /// What a point says as a share of what it would if all were independent:
    /// several of one ring fall on the same spot.
    pub evidence_share: f64,
    /// Most that one bin says for or against paint, natural logarithm of odds.
    pub most_evidence: f64,
    /// Cost of a change between painted and bare, natural logarithm of odds: of
    /// the bins of a dashed line one in twelve begins or ends a dash.
    pub change_cost: f64,
    /// Least share of a window's bins with paint, and of a dashed line's
    /// length: a dash of 3 m in 12 m, and some of it unseen.
    pub least_painted: f64,
    /// Least length of what counts as paint, metres: half of the shortest
    /// dash in use.
    pub shortest_blot_m: f64,
    /// Fewest points of paint of it: a stray or two are grains of the asphalt.
    pub fewest_blot_points: f64,
    /// Shortest bare length between two dashes, metres: the shortest gaps in
    /// use are 1 m, less a beam's footprint.
    pub shortest_gap_m: f64,
    /// Shortest line kept, metres: arrows are shorter, and so are the fords
    /// across side streets.
    pub shortest_m: f64,
    /// Share of paint among the road points right beside a line from which on it is
    /// a stripe: of bare asphalt a fiftieth shines, of worn paint a fifth.
    pub least_striped_share: f64,
    /// Share of the bins of a line with paint right beside it from which on
    /// dashes, or a line with paint on both sides, are part of a crossing or of
    /// an area.
    pub largest_striped_share: f64,
    /// The same on both sides, from which on a line beside which something
    /// stands is a ragged strip of grass or kerb.
    pub ragged_share: f64,
    /// Share of such a line beside which something has to stand for that.
    pub ragged_walled_share: f64,
    /// Fewest dashes of a dashed line: an arrow or a letter is one blot.
    pub fewest_dashes: usize,
    /// Shortest dash, metres, as it looks: the shortest in use are 1 m, those
    /// of crossings 0.5 m.
    pub shortest_dash_m: f64,
    /// Shortest line of nothing but dashes, metres: two periods of the longest
    /// patterns in use; the fords across side streets are shorter.
    pub shortest_dashed_m: f64,
    /// Longest stretch without a point of paint that paint goes on over where
    /// the road is hardly seen, metres.
    pub longest_unseen_m: f64,
    /// Longest stretch that a solid line goes on over where the road was seen to be
    /// bare, metres: worn. The mouths of side streets are wider.
    pub longest_bare_m: f64,
    /// Largest share of a gap in itself and the shorter run of paint beside it that is
    /// a spot of a solid line, worn or under a vehicle: of the patterns in use none
    /// has gaps of less than a quarter of its period (3 m and 1 m, 9 m and 3 m), and
    /// beams widen its marks by two bins.
    pub largest_spot_share: f64,
    /// Least share of the bins of a solid line that have a point of paint or lie
    /// beside one that has: of what was seen less often nobody knows where its
    /// gaps are.
    pub least_seen_share: f64,
    /// Longest dash, metres: longer paint is a solid line. The longest in use
    /// are 9 m.
    pub longest_dash_m: f64,
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
    /// Mean contrast from which on a line is paint whatever stands or rises
    /// beside it, standard deviations: cars park along lines, and some are
    /// painted along kerbs.
    pub least_walled_contrast: f64,
    /// Width of the strips beside a line in which a kerb is sought, metres: its
    /// edge is not far from what shines of it.
    pub kerb_within_m: f64,
    /// Height of a step in the road that is a kerb, metres: gutters and worn
    /// asphalt are less, and only lowered kerbs are lower.
    pub least_kerb_m: f64,
    /// Largest root mean square lateral distance of paint from its line, metres.
    pub largest_spread_m: f64,
    /// Longest gap joined within one line, metres: the longest dash gap in
    /// use on urban and rural roads.
    pub longest_gap_m: f64,
    /// Least distance of two lines, metres: double lines count as one.
    pub apart_m: f64,
    /// Least distance of two lines that are told apart in a window where both
    /// are painted, metres: narrow lines of 0.1 m a line's width apart, less
    /// what registration and beams widen them.
    pub least_pair_m: f64,
    /// How much more paint the two must have than the one line that was found,
    /// as a share of its own: a dashed line beside a solid one has a third.
    pub least_pair_share: f64,
    /// Most paint between the two, as a share of that on the weaker one: broad
    /// lines are painted between their edges.
    pub largest_between_share: f64,
    /// Distance of the lines of the narrowest lanes, metres: 2.75 m, less a
    /// line's width. What has lines nearer than that on both sides has no lane
    /// beside it.
    pub narrowest_lane_m: f64,
    /// Share of the length on which dashes have to have them to be no line: lanes
    /// open and close like wedges.
    pub least_enclosed_share: f64,
    /// Lateral tolerance of the polyline, metres.
    pub tolerance_m: f64,
    /// Tolerance of the heights of the polyline, metres: the largest error, so that
    /// most are off by less than a localizer takes them to be
    /// (`noise.lane_height_sigma_m`).
    pub height_tolerance_m: f64,
    /// Half length over which the line is smoothed, metres.
    pub smooth_m: f64,
    /// How much farther off the paint a bend may lie than one that follows the
    /// chain of windows, as a ratio, to be preferred: the chain has more freedom
    /// to follow it, some 5 % where it does not swing at all.
    pub largest_simple_ratio: f64,
    /// Distances of dashes.
    pub spacing: SpacingConfig,
    /// Ends of the marks of dashed lines.
    pub marks: MarkConfig,
    /// Short dashes that are seen from afar.
    pub rhythm: RhythmConfig,
    /// Crossings and fords.
    pub fords: FordConfig,
    /// Lines of side streets.
    pub side: SideConfig,
    /// Kerbs of roads without paint.
    pub kerbs: KerbConfig,
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
            beside_line_m: 0.32,
            bin_m: 0.5,
            profile_m: 0.25,
            half_core_m: 0.07,
            usual_share: 0.35,
            worn_share: 0.6,
            least_worn_ratio: 3.0,
            least_clear_share: 0.5,
            least_bright_share: 0.2,
            least_bare_share: 0.02,
            least_share_ratio: 4.0,
            most_bin_points: 6,
            most_bin_ratio: 6.0,
            fewest_bin_points: 2.0,
            least_significance: 4.0,
            evidence_share: 0.5,
            most_evidence: 3.0,
            change_cost: 2.5,
            least_painted: 0.15,
            shortest_blot_m: 0.5,
            fewest_blot_points: 3.0,
            shortest_gap_m: 0.75,
            shortest_m: 12.0,
            least_striped_share: 0.1,
            largest_striped_share: 0.5,
            ragged_share: 0.15,
            ragged_walled_share: 0.1,
            fewest_dashes: 3,
            shortest_dash_m: 0.9,
            shortest_dashed_m: 18.0,
            longest_unseen_m: 4.0,
            longest_bare_m: 8.0,
            largest_spot_share: 0.18,
            least_seen_share: 0.4,
            longest_dash_m: 9.5,
            wall_m: [0.25, 1.5],
            wall_within_m: 0.45,
            fewest_wall_scans: 6,
            largest_walled_share: 0.3,
            least_walled_contrast: 5.7,
            kerb_within_m: 0.2,
            least_kerb_m: 0.04,
            largest_spread_m: 0.1,
            longest_gap_m: 13.0,
            apart_m: 0.4,
            least_pair_m: 0.16,
            least_pair_share: 0.3,
            largest_between_share: 0.5,
            narrowest_lane_m: 2.6,
            least_enclosed_share: 0.7,
            tolerance_m: 0.03,
            height_tolerance_m: 0.03,
            smooth_m: 4.0,
            largest_simple_ratio: 1.1,
            spacing: SpacingConfig::default(),
            marks: MarkConfig::default(),
            rhythm: RhythmConfig::default(),
            fords: FordConfig::default(),
            side: SideConfig::default(),
            kerbs: KerbConfig::default(),
        }
    }
}
