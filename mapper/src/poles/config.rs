use serde::{Deserialize, Serialize};

use super::{HedgeConfig, ShelterConfig, TreeConfig, WallConfig};
use crate::looks::LookConfig;

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
    /// The same for what is no wider than the thinnest, metres.
    pub largest_spread_thin_m: f64,
    /// Noise of a hit across a pole, metres: range noise, beam width and
    /// what is left of the poses' errors.
    pub noise_m: f64,
    /// Spread of the hits of far poles, radians: the half width of a beam and
    /// what the poses err in heading.
    pub beam_rad: f64,
    /// Distance within which a point belongs to the axis, metres.
    pub inlier_m: f64,
    /// Radius, as a share of that, from which on it may have cut off part of a
    /// stem, which is then fitted again within [`Self::thickest_m`]: a stem that
    /// is as wide as the reach comes out a tenth slimmer.
    pub cut_off_share: f64,
    /// Noise of a hit within its scan, metres: of its range and across its beam.
    pub hit_noise_m: f64,
    /// Error of the range of one laser, metres: all its hits on a pole share it.
    /// The lasers of a lidar differ by 3 cm on house fronts, and by somewhat more
    /// on what is as narrow as their beams.
    pub beam_noise_m: f64,
    /// Least angle between two beams, radians: hits within it are of one laser.
    pub beam_step_rad: f64,
    /// Noise of a scan's position, metres: all its hits share it.
    pub pose_noise_m: f64,
    /// How far the plumb line may be from the map's vertical, radians, one
    /// standard deviation: the first camera does not stand level.
    pub usual_tilt_rad: f64,
    /// How far a pole usually leans from the plumb line, radians: 1 cm per
    /// metre is what they are put up with. Holds the slope of short ones.
    pub usual_lean_rad: f64,
    /// Share of poles that lean by up to [`Self::largest_tilt_rad`], two standard
    /// deviations: they were hit, or their ground has moved.
    pub leaning_share: f64,
    /// How much wider than the post a slice is that a sign hangs in, metres:
    /// less is noise.
    pub wider_m: f64,
    /// Radii around the foot within which the ground is looked for, metres, as
    /// near as there are enough points: a kerb may be half a metre off.
    pub foot_radii_m: [f64; 3],
    /// Thickness of the layer of points that the ground makes around a foot,
    /// metres: range noise, a rough surface and a slope of 10 %.
    pub ground_layer_m: f64,
    /// Least radius, metres.
    pub thinnest_m: f64,
    /// Largest radius, metres: thicker things are no poles.
    pub thickest_m: f64,
    /// How well the width of a pole tells how far its surface lies before its
    /// axis, metres, one standard deviation.
    pub surface_sigma_m: f64,
    /// Farthest scan from which a pole is expected to be hit, metres.
    pub farthest_m: f64,
    /// A pole has been hit from within this, metres: farther off neighbouring beams
    /// are wider apart than columns, and what stands beside it goes unseen. What
    /// lies ahead of the last scan is seen so, and what most scans do not see.
    pub hit_within_m: f64,
    /// Least share of the expected points: fewer mean that a hedge or a fence
    /// stands before it, and that no camera sees it.
    pub least_visibility: f64,
    /// The same for a pole that stands close before something: what sticks out
    /// of a hedge here and there is seen little. Where it is less than
    /// [`Self::least_visibility`], that counts.
    pub least_visibility_before: f64,
    /// A pole close before something stands out where it has so many times the
    /// points of the fullest place around it.
    pub stands_out: f64,
    /// And so many points more than that.
    pub stands_out_by: u32,
    /// Distance of these places from it, metres: as far as a pole's own points
    /// never reach.
    pub beside_m: f64,
    /// Its points lie within this of its column, metres.
    pub before_reach_m: f64,
    /// Least length over which it stands out, metres.
    pub least_before_m: f64,
    /// Longest gap between points along one pole, metres.
    pub longest_gap_m: f64,
    /// Highest foot of a pole whose lower end cannot be seen, metres above
    /// ground: a hedge hides the rest.
    pub highest_foot_m: f64,
    /// The same for what carries sheeting, metres: the lower edge of a sign over
    /// a footway.
    pub highest_foot_sign_m: f64,
    /// A foot lower than this reaches the ground, metres.
    pub foot_m: f64,
    /// Fewest points.
    pub fewest_points: usize,
    /// Fewest scans that must have hit it: one scan's edge of a passing car
    /// is no pole.
    pub fewest_scans: usize,
    /// Most scans of a glimpse: so few, with so few points, and of so small a
    /// share of the scans that are near, may be no more than what is seen of a
    /// wall through a gap.
    pub glimpse_scans: usize,
    /// A glimpse has fewer points than this.
    pub glimpse_points: usize,
    /// And is of less than this share of the scans within `farthest_m`.
    pub glimpse_share: f64,
    /// Least share of a post's length that is free: signs and boxes hang on it.
    pub least_free_share: f64,
    /// The same for what carries sheeting: a post with a sign may stand in a
    /// hedge up to it.
    pub least_free_share_sign: f64,
    /// The same for what is thicker than a post: trees fork low, and what is free over
    /// less is a banner, a person or a corner of something.
    pub least_free_share_thick: f64,
    /// Largest radius of a post, metres.
    pub post_radius_m: f64,
    /// Largest radius of a slender post, metres: tubes of 60 and 76 mm carry
    /// signs, and are measured to 2 cm.
    pub slender_m: f64,
    /// Share of the space around the upper end, up to `crown_height_m` over it and
    /// within `crown_radii_m`, that is filled by the crown of a tree.
    pub crown_share: f64,
    /// Height over the upper end up to which a crown is looked for, metres.
    pub crown_height_m: f64,
    /// Distances from the axis between which it is, metres: plates of signs reach
    /// half a metre from their post. What is nearer is a plate where it covers the
    /// post, and a crown that is seen from below where it does not.
    pub crown_radii_m: [f64; 2],
    /// Lowest top, metres above ground: grass and stones are lower.
    pub lowest_top_m: f64,
    /// Least free length of a pole that does not reach the ground, metres.
    pub least_free_hanging_m: f64,
    /// Largest share of a pole's slices in which something reaches from it
    /// outwards: a post of a fence carries its rails.
    pub largest_attached_share: f64,
    /// Height above which the free part of a pole begins where it stands in a
    /// hedge, metres above ground: lower bushes end below.
    pub largest_bush_m: f64,
    /// What has moved.
    pub looks: LookConfig,
    /// Top of hedges and doors, metres above ground: hedges are kept at 2 m, doors
    /// are 2.0 to 2.1 m high. What stands out before them and ends below, with more
    /// of the same above it, is a stem or a jamb of theirs.
    pub hedge_top_m: f64,
    /// What is seen up to so far below the end of the field of view may go on beyond
    /// it, metres: two slices, as the highest beams may pass beside it.
    pub open_top_m: f64,
    /// Length that a rail of a fence is followed from its post, metres.
    pub rail_m: f64,
    /// Half the width within which it lies, metres: noise.
    pub rail_half_width_m: f64,
    /// Lowest rail, metres above ground: below it is grass, which has rows as straight: from
    /// 0.2 m on a delineator of KITTI 04 would be the post of a fence.
    pub lowest_rail_m: f64,
    /// Longest gap between the last post of a fence and its rails, metres: a
    /// gate for those who walk, or what hides them.
    pub fence_gap_m: f64,
    /// Longest span of a fence between two posts, metres.
    pub fence_span_m: f64,
    /// How far a post may be off the line of a rail, metres: its direction is
    /// known to 10 degrees.
    pub fence_off_line_m: f64,
    /// The posts of one fence are as high as each other within this, metres:
    /// a slope, and how far apart the beams are.
    pub fence_height_m: f64,
    /// Least radius of a pillar that carries a roof, metres: thinner ones carry
    /// lamps and signs.
    pub pillar_radius_m: f64,
    /// Least and largest side of a rectangle of pillars, metres: closer ones
    /// are the masts of one sign, and no beam of a light roof spans more.
    pub pillars_apart_m: [f64; 2],
    /// How far a pillar may be from the corner of the rectangle, metres.
    pub pillars_off_m: f64,
    /// How much the radii of three of them differ where the fourth is hidden,
    /// metres: they are measured to 1 cm.
    pub pillars_alike_m: f64,
    /// Top of what ends below any sign, metres above ground: posts of fences and
    /// gates are up to 1.6 m high, and low signs hang from 1.9 m on.
    pub short_top_m: f64,
    /// Largest radius of what ends below any sign, metres: delineators and
    /// bollards are tubes of 6 to 12 cm across, measured to 3 cm; what is thicker
    /// is a gate post, a person or a box.
    pub thickest_short_m: f64,
    /// The same of what carries sheeting, metres: it dazzles.
    pub thickest_equipped_m: f64,
    /// Radius of what ends below any sign up to which it is no corner of a vehicle
    /// with its tail lamp, metres.
    pub slender_short_m: f64,
    /// Least visibility of a thicker one that is attached to something: a delineator in
    /// a hedge stands out of it to the road, and corners are seen from one side.
    pub least_visibility_in_hedge: f64,
    /// Least share of its hits that are on sheeting: reflectors of delineators are 0.18 m
    /// of 0.8 m high, those of vehicles 0.05 to 0.1 m.
    pub least_bright_share: f64,
    /// Reflectance of retro-reflective sheeting: the lidar saturates on it.
    pub least_reflectance: f32,
    /// The same for what must have been put up for the traffic.
    pub sheeting_reflectance: f32,
    /// Heights of the reflectors of delineators and bollards, metres above ground.
    pub reflector_m: [f64; 2],
    /// Largest extent of such a reflector along the ground, metres: those of
    /// vehicles and their plates are wider.
    pub widest_reflector_m: f64,
    /// Heights of signs, metres above ground: posts are looked for under them, and
    /// plates that are lower are boxes, people and boards of fences.
    pub sheet_m: [f64; 2],
    /// Largest width of a sign on one post, metres: wider ones have two.
    pub widest_sheet_m: f64,
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
    /// Radius from which on anything is a trunk, metres.
    pub trunk_radius_m: f64,
    /// Least width of a plate that may be all that is seen of its post, metres: stems of
    /// masts are narrower.
    pub least_plate_m: f64,
    /// Logarithm of the odds from which on something is a plate and no stem, nats.
    pub plate_evidence: f64,
    /// What tells pieces of walls from posts.
    pub walls: WallConfig,
    /// What tells posts in hedges.
    pub hedges: HedgeConfig,
    /// What tells posts of stalls and shelters.
    pub shelters: ShelterConfig,
    /// What tells trees from posts else.
    pub trees: TreeConfig,
    /// Whether trunks go into the map, under their own semantic: trees change,
    /// and networks that find poles in images leave them out, so the localizer
    /// does not use them unless told to.
    pub keep_trunks: bool,
}

impl Default for PoleConfig {
    #[expect(clippy::too_many_lines, reason = "a line for each setting")]
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
            largest_spread_thin_m: 0.065,
            noise_m: 0.04,
            beam_rad: 0.002,
            inlier_m: 0.2,
            cut_off_share: 0.7,
            hit_noise_m: 0.02,
            beam_noise_m: 0.035,
            beam_step_rad: 0.005,
            pose_noise_m: 0.02,
            usual_tilt_rad: 0.04,
            usual_lean_rad: 0.01,
            leaning_share: 0.02,
            wider_m: 0.05,
            foot_radii_m: [0.3, 0.5, 0.8],
            ground_layer_m: 0.1,
            thinnest_m: 0.03,
            thickest_m: 0.35,
            surface_sigma_m: 0.02,
            farthest_m: 40.0,
            hit_within_m: 30.0,
            least_visibility: 0.08,
            least_visibility_before: 0.25,
            stands_out: 1.5,
            stands_out_by: 4,
            beside_m: 0.3,
            before_reach_m: 0.15,
            least_before_m: 0.8,
            longest_gap_m: 0.8,
            highest_foot_m: 2.0,
            highest_foot_sign_m: 2.5,
            foot_m: 0.6,
            fewest_points: 9,
            fewest_scans: 2,
            glimpse_scans: 2,
            glimpse_points: 20,
            glimpse_share: 0.34,
            least_free_share: 0.35,
            least_free_share_sign: 0.25,
            least_free_share_thick: 0.4,
            post_radius_m: 0.12,
            slender_m: 0.06,
            crown_share: 0.015,
            crown_height_m: 1.5,
            crown_radii_m: [0.6, 1.0],
            lowest_top_m: 0.75,
            least_free_hanging_m: 1.1,
            largest_attached_share: 0.5,
            largest_bush_m: 1.0,
            looks: LookConfig::default(),
            hedge_top_m: 2.2,
            open_top_m: 0.4,
            rail_m: 0.5,
            rail_half_width_m: 0.08,
            lowest_rail_m: 0.35,
            fence_gap_m: 1.2,
            fence_span_m: 3.0,
            fence_off_line_m: 0.5,
            fence_height_m: 0.2,
            pillar_radius_m: 0.13,
            pillars_apart_m: [2.5, 12.0],
            pillars_off_m: 0.3,
            pillars_alike_m: 0.02,
            short_top_m: 1.8,
            thickest_short_m: 0.09,
            thickest_equipped_m: 0.11,
            slender_short_m: 0.05,
            least_visibility_in_hedge: 0.5,
            least_bright_share: 0.15,
            least_reflectance: 0.7,
            sheeting_reflectance: 0.9,
            reflector_m: [0.35, 1.2],
            widest_reflector_m: 0.25,
            sheet_m: [1.2, 4.5],
            widest_sheet_m: 1.3,
            reflector_below_top_m: 0.2,
            reflector_reach_m: 0.15,
            delineator_top_m: 1.5,
            lamp_top_m: 4.5,
            open_lamp_top_m: 2.8,
            trunk_radius_m: 0.18,
            least_plate_m: 0.3,
            plate_evidence: 10.0,
            walls: WallConfig::default(),
            hedges: HedgeConfig::default(),
            shelters: ShelterConfig::default(),
            trees: TreeConfig::default(),
            keep_trunks: true,
        }
    }
}
