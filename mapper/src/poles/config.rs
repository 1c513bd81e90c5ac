use serde::{Deserialize, Serialize};

/// How poles are told from everything else.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoleConfig {
    /// Edge of the columns, metres: the beams' spacing at 30 m.
    pub column_m: f64,
    /// Height of the slices of a column, metres: the beams' vertical spacing
    /// at 25 m, so that a pole fills every slice.
    pub slice_m: f64,
    /// Lowest height looked at, metres above ground: below it is grass.
    pub lowest_m: f64,
    /// A pole's points lie within this radius of its axis in one slice, metres.
    pub core_radius_m: f64,
    /// Inner radius of the ring that must be free, metres.
    pub ring_inner_m: f64,
    /// Outer radius of the ring that must be free, metres: a pole stands free
    /// of walls and hedges by at least this much.
    pub ring_outer_m: f64,
    /// From this far off its surface on points are not its own, metres: noise
    /// and the edges of beams.
    pub gap_from_m: f64,
    /// What reaches from a pole outwards is seen up to here, metres off its
    /// surface: what stands behind it stands farther off.
    pub gap_to_m: f64,
    /// Points in the ring over those in the core from which on a slice counts
    /// as hindered: stray echoes and misplaced scans leave some.
    pub largest_clutter: f64,
    /// Least length of the free part of a pole, metres: a delineator is 0.8 m
    /// high, its lowest slices hidden in grass.
    pub least_free_m: f64,
    /// Largest tilt from the vertical of the map, radians: 10 degrees, for
    /// leaning posts and for a first camera that does not stand level.
    pub largest_tilt_rad: f64,
    /// Largest root mean square distance of points from the surface, metres.
    pub largest_spread_m: f64,
    /// Noise of a hit across a pole, metres: range noise, beam width and
    /// what is left of the poses' errors.
    pub noise_m: f64,
    /// Spread of the hits of far poles, radians: the half width of a beam and
    /// what the poses err in heading.
    pub beam_rad: f64,
    /// Distance within which a point belongs to the axis, metres.
    pub inlier_m: f64,
    /// Usual tilt of a pole, radians: holds the slope of short ones.
    pub usual_tilt_rad: f64,
    /// Least radius, metres.
    pub thinnest_m: f64,
    /// Largest radius, metres: thicker things are no poles.
    pub thickest_m: f64,
    /// How well the width of a pole tells how far its surface lies before its
    /// axis, metres, one standard deviation.
    pub surface_sigma_m: f64,
    /// Farthest scan from which a pole is expected to be hit, metres.
    pub farthest_m: f64,
    /// Least share of the expected points: fewer mean that a hedge or a fence
    /// stands before it, and that no camera sees it.
    pub least_visibility: f64,
    /// Longest gap between points along one pole, metres.
    pub longest_gap_m: f64,
    /// Highest foot of a pole whose lower end cannot be seen, metres above
    /// ground: a hedge hides the rest.
    pub highest_foot_m: f64,
    /// A foot lower than this reaches the ground, metres.
    pub foot_m: f64,
    /// Fewest points.
    pub fewest_points: usize,
    /// Fewest scans that must have hit it: one scan's edge of a passing car
    /// is no pole.
    pub fewest_scans: usize,
    /// Least share of a post's length that is free: signs and boxes hang on it.
    pub least_free_share: f64,
    /// The same for what is thicker than a post: else it is a banner, a person
    /// or a corner of something.
    pub least_free_share_thick: f64,
    /// Largest radius of a post, metres.
    pub post_radius_m: f64,
    /// Share of a cylinder of 1 m radius above the upper end that is filled
    /// by the crown of a tree.
    pub crown_share: f64,
    /// Lowest top, metres above ground: grass and stones are lower.
    pub lowest_top_m: f64,
    /// Least free length of a pole that does not reach the ground, metres.
    pub least_free_hanging_m: f64,
    /// Largest share of a low post's slices in which something reaches from it
    /// outwards: a post of a fence carries its rails.
    pub largest_attached_share: f64,
    /// Top of what ends below any sign, metres above ground.
    pub short_top_m: f64,
    /// Largest radius of what ends below any sign, metres: delineators and
    /// bollards are tubes of 6 to 12 cm across, what is thicker is a gate post,
    /// a person or a box.
    pub thickest_short_m: f64,
    /// Reflectance of retro-reflective sheeting: the lidar saturates on it.
    pub least_reflectance: f32,
    /// The same for what must have been put up for the traffic.
    pub sheeting_reflectance: f32,
    /// Heights of the reflectors of delineators and bollards, metres above ground.
    pub reflector_m: [f64; 2],
    /// Largest extent of such a reflector along the ground, metres: those of
    /// vehicles and their plates are wider.
    pub widest_reflector_m: f64,
    /// Largest height of the post over its highest reflector, metres.
    pub reflector_below_top_m: f64,
    /// Distance from the reflector's middle within which its post is looked
    /// for, metres: a hedge may begin beyond.
    pub reflector_reach_m: f64,
    /// Top of a delineator or bollard at most, metres above ground.
    pub delineator_top_m: f64,
    /// Top of a lamp post at least, metres above ground.
    pub lamp_top_m: f64,
    /// The same where the pole goes on beyond the field of view, metres.
    pub open_lamp_top_m: f64,
    /// Radius that tells a trunk from a post, metres.
    pub trunk_radius_m: f64,
    /// Whether trunks go into the map, under their own semantic: trees change,
    /// and networks that find poles in images leave them out, so the localizer
    /// does not use them unless told to.
    pub keep_trunks: bool,
}

impl Default for PoleConfig {
    fn default() -> Self {
        Self {
            column_m: 0.1,
            slice_m: 0.2,
            lowest_m: 0.2,
            core_radius_m: 0.2,
            ring_inner_m: 0.35,
            ring_outer_m: 0.7,
            gap_from_m: 0.12,
            gap_to_m: 0.3,
            largest_clutter: 0.3,
            least_free_m: 0.6,
            largest_tilt_rad: 0.175,
            largest_spread_m: 0.085,
            noise_m: 0.04,
            beam_rad: 0.002,
            inlier_m: 0.2,
            usual_tilt_rad: 0.04,
            thinnest_m: 0.03,
            thickest_m: 0.35,
            surface_sigma_m: 0.02,
            farthest_m: 40.0,
            least_visibility: 0.08,
            longest_gap_m: 0.8,
            highest_foot_m: 2.0,
            foot_m: 0.6,
            fewest_points: 9,
            fewest_scans: 2,
            least_free_share: 0.35,
            least_free_share_thick: 0.6,
            post_radius_m: 0.12,
            crown_share: 0.015,
            lowest_top_m: 0.75,
            least_free_hanging_m: 1.1,
            largest_attached_share: 0.5,
            short_top_m: 2.0,
            thickest_short_m: 0.12,
            least_reflectance: 0.7,
            sheeting_reflectance: 0.9,
            reflector_m: [0.35, 1.2],
            widest_reflector_m: 0.25,
            reflector_below_top_m: 0.2,
            reflector_reach_m: 0.15,
            delineator_top_m: 1.5,
            lamp_top_m: 4.5,
            open_lamp_top_m: 2.8,
            trunk_radius_m: 0.18,
            keep_trunks: true,
        }
    }
}
