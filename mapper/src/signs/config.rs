use serde::{Deserialize, Serialize};

use crate::looks::LookConfig;

/// How signs are told from everything else.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SignConfig {
    /// Reflectance of retro-reflective sheeting: the lidar saturates on it.
    pub least_reflectance: f32,
    /// Lowest point of a sign, metres above ground: lower ones are number
    /// plates, lamps and delineators.
    pub lowest_m: f64,
    /// Points nearer than this to each other are one sign, metres.
    pub join_m: f64,
    /// Least gap between two plates on one post, metres: plates are mounted
    /// with a hand's width between them, blurred by the beams and the poses.
    pub plate_gap_m: f64,
    /// Least share of bright points among all that the same scans have in the
    /// box around them: on a wall only some stones are bright.
    pub least_bright_share: f64,
    /// Fewest bright points.
    pub fewest_points: usize,
    /// Fewest scans that saw it bright at the same place: what moves is seen
    /// once at each place.
    pub fewest_scans: usize,
    /// Largest share of the lidar's own motion that a cluster may follow: the
    /// plate of a vehicle ahead moves along.
    pub largest_following: f64,
    /// What has moved: lamps and plates of vehicles that waited beside the lidar.
    pub looks: LookConfig,
    /// Smallest extent, metres.
    pub smallest_m: f64,
    /// Largest extent, metres: larger ones are hoardings and shop fronts.
    pub largest_m: f64,
    /// Largest thickness across its plane, metres, one standard deviation.
    pub thickest_m: f64,
    /// The outline of plates.
    pub outline: OutlineConfig,
    /// Plates seen from behind only.
    pub backs: BackConfig,
    /// Traffic lights.
    pub lights: LightConfig,
}

impl Default for SignConfig {
    fn default() -> Self {
        Self {
            least_reflectance: 0.7,
            lowest_m: 1.2,
            join_m: 0.35,
            plate_gap_m: 0.05,
            least_bright_share: 0.3,
            fewest_points: 10,
            fewest_scans: 2,
            largest_following: 0.2,
            looks: LookConfig::default(),
            smallest_m: 0.2,
            largest_m: 2.5,
            thickest_m: 0.2,
            outline: OutlineConfig::default(),
            backs: BackConfig::default(),
            lights: LightConfig::default(),
        }
    }
}

/// How the outline of a plate is found from the rows of hits on it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutlineConfig {
    /// Width of a beam, radians: by this share of the range things look wider.
    pub beam_rad: f64,
    /// What a row may be wider than its post before it is a plate's, metres.
    pub slack_m: f64,
    /// Narrowest row that is a plate's, metres.
    pub narrowest_m: f64,
    /// What an edge of a plate costs, in rows that do not fit: fewer odd rows
    /// than twice this make no plate and no gap.
    pub edge_cost: f64,
    /// Share of a plate's rows that are odd for reasons of their own, as those are
    /// from far behind.
    pub odd_share: f64,
    /// Rows of one scan that weigh as much as what is known of all scans, that
    /// `odd_share` of a plate's rows are hidden: a second one among five is no
    /// accident, leaves hide the plate from there.
    pub telling_rows: f64,
    /// Least that a row of the bare post counts which ends a plate: below it most of what
    /// is beside it is hidden, and it may be one of the plate.
    pub least_telling: f64,
    /// Most beams that are expected on a plate between two rows and left no hit
    /// there: leaves hide several in a row, not this many from all scans.
    pub most_missed: f64,
    /// What a row costs of which only one end is where a plate's is, as the other
    /// is hidden: three such are as odd as one that fits nowhere.
    pub hidden_cost: f64,
    /// What another plate on the same post costs, in rows that do not fit: its form and
    /// its place, less what many signs have one.
    pub stacked_cost: f64,
    /// And this for each row: of many, more are odd together by chance.
    pub stacked_share: f64,
    /// Standard deviation of the logarithm of a plate's height over its width: nine in
    /// ten are from 0.6 to 1.6 times as high as they are wide.
    pub aspect_spread: f64,
    /// Largest height over width of two plates that stand on each other.
    pub tallest_stack: f64,
    /// Least height of plates that stand on each other, metres, between their
    /// outermost rows: those at the edge of one, half on it, are no other.
    pub least_stacked_m: f64,
    /// Least cosine between the view and a plate's normal: edge-on it is as
    /// narrow as its post.
    pub least_cosine: f64,
    /// An edge less certain than this was out of sight, metres, one standard
    /// deviation.
    pub open_m: f64,
    /// Plates up to this width are about as high as they are wide, metres:
    /// wider ones are boards of any form.
    pub widest_like_high_m: f64,
    /// Reflectance of retro-reflective sheeting.
    pub bright: f32,
    /// Farthest row that must be bright on sheeting, metres: beyond it the lidar
    /// reports less.
    pub bright_within_m: f64,
    /// Least share of bright rows among the nearer ones on the front of a
    /// retro-reflective sign: else its outline is that of a wall around it.
    pub least_bright_share: f64,
    /// Noise of a row's middle, metres.
    pub noise_m: f64,
    /// What all rows of a plate err by together, metres: poses, and range errors
    /// of the beams.
    pub pose_m: f64,
}

impl Default for OutlineConfig {
    fn default() -> Self {
        Self {
            beam_rad: 0.002,
            slack_m: 0.03,
            narrowest_m: 0.13,
            edge_cost: 1.4,
            odd_share: 0.05,
            telling_rows: 5.0,
            least_telling: 0.5,
            most_missed: 6.0,
            hidden_cost: 0.3,
            stacked_cost: 2.0,
            stacked_share: 0.03,
            aspect_spread: 0.3,
            tallest_stack: 2.5,
            least_stacked_m: 0.12,
            least_cosine: 0.5,
            open_m: 0.15,
            widest_like_high_m: 1.0,
            bright: 0.7,
            bright_within_m: 40.0,
            least_bright_share: 0.6,
            noise_m: 0.03,
            pose_m: 0.015,
        }
    }
}

/// How plates that were seen from behind only are told from boxes, people and
/// leaves beside a post.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BackConfig {
    /// Lowest edge, metres above ground: below are people, boxes and bins.
    pub lowest_m: f64,
    /// The same below another plate, metres above ground: timetables hang from
    /// 1.2 m on.
    pub lowest_below_m: f64,
    /// Least height, metres.
    pub least_height_m: f64,
    /// Least and largest width, metres.
    pub width_m: [f64; 2],
    /// Largest height over width, and width over height.
    pub largest_aspect: f64,
    /// Farthest that its middle may be to the side of its post, in widths: signs are
    /// mounted in the middle, and a jamb is at the end of its wall. Lights may hang to
    /// one side.
    pub largest_aside: f64,
    /// Largest thickness within single rows, metres, one standard deviation:
    /// range noise and posts behind.
    pub thickest_m: f64,
    /// Fewest long rows.
    pub fewest_rows: usize,
    /// The same on a post that carries another sign: signs come in twos and threes.
    pub fewest_rows_beside: usize,
    /// Fewest scans.
    pub fewest_scans: usize,
    /// Least share of the rows between its edges that are long: leaves and lost returns cut
    /// some short.
    pub least_agreement: f64,
    /// Fewest rows on the bare post below it.
    pub fewest_post_rows: usize,
    /// Least width of its rows over those of the bare post below it: those of a
    /// thick mast differ by up to a half.
    pub least_over_post: f64,
    /// What shows without the bare post below it, in a hedge.
    pub alone: AloneConfig,
}

impl Default for BackConfig {
    fn default() -> Self {
        Self {
            lowest_m: 1.5,
            lowest_below_m: 1.2,
            least_height_m: 0.2,
            width_m: [0.3, 1.3],
            largest_aspect: 3.0,
            largest_aside: 0.25,
            thickest_m: 0.05,
            fewest_rows: 5,
            fewest_rows_beside: 4,
            fewest_scans: 2,
            least_agreement: 0.7,
            fewest_post_rows: 4,
            least_over_post: 1.6,
            alone: AloneConfig::default(),
        }
    }
}

/// How a plate whose post is out of sight is told from the leaves around it: none of
/// them is flat, whole and as high as it is wide in many scans.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AloneConfig {
    /// Fewest long rows: thrice those of a plate on a bare post.
    pub fewest_rows: usize,
    /// Fewest scans: leaves hide each other from one place, and not from five.
    pub fewest_scans: usize,
    /// Least share of the rows between its edges that are long: leaves leave gaps.
    pub least_agreement: f64,
}

impl Default for AloneConfig {
    fn default() -> Self {
        Self { fewest_rows: 15, fewest_scans: 5, least_agreement: 0.98 }
    }
}

/// How traffic lights are told from everything else on a post: dark boxes that
/// hang before it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LightConfig {
    /// Lowest edge, metres above ground: lights for those who walk hang from
    /// 2.0 m on; below are boxes with buttons, and bins.
    pub lowest_m: f64,
    /// Largest reflectance of a black housing.
    pub darkest: f32,
    /// Farthest hit whose reflectance counts, metres: beyond it the lidar
    /// reports none for much that is not dark.
    pub farthest_m: f64,
    /// Least share of hits on the box that are dark: the edges of its post are not,
    /// nor is what else hangs on posts, but for a part of it.
    pub least_dark_share: f64,
    /// Hits farther than this off the surface of the post are the box's, metres.
    pub off_post_m: f64,
    /// Farthest hit of a box from the axis, metres: half its depth and its visors
    /// reach 0.45 m.
    pub reach_m: f64,
    /// Least and largest height of what is seen of a box, metres: half
    /// a lens of 0.2 m, and four of 0.3 m.
    pub seen_m: [f64; 2],
    /// Usual heights of boxes with two and with three lenses of 0.2 m, metres:
    /// upper edges are seldom seen, as 20 m off the highest beam is 2.4 m up.
    pub usual_heights_m: [f64; 2],
    /// Least and largest width of a box, metres: housings are 0.2 to 0.36 m wide.
    pub width_m: [f64; 2],
    /// Depth of a box without its visors, metres.
    pub depth_m: f64,
    /// Boxes whose middles are this far apart in the plane hang on different
    /// sides of their post, metres.
    pub apart_m: f64,
    /// How far the middle of a box lies from where a hit tells, metres, one standard
    /// deviation: half its depth behind the hit, where the box was seen straight.
    pub middle_sigma_m: f64,
    /// Largest odds by which a hit is of the one of two boxes: one in twenty is of
    /// their edges or their visors.
    pub most_own_odds: f64,
    /// Share of the one's hits at heights at which two boxes hang: the other one may
    /// hide most of it.
    pub own_share: f64,
    /// Longest gap in height between two hits on one box, metres: the distance of
    /// two beams at 35 m.
    pub longest_gap_m: f64,
    /// Fewest dark hits on the box, of rows that are wider than a post, beyond those
    /// that others at their height outweigh.
    pub fewest_hits: usize,
    /// Fewest hits on each of two boxes that are told apart.
    pub fewest_hits_of_two: usize,
    /// Fewest scans with hits on the box.
    pub fewest_scans: usize,
}

impl Default for LightConfig {
    fn default() -> Self {
        Self {
            lowest_m: 1.8,
            darkest: 0.15,
            farthest_m: 40.0,
            least_dark_share: 0.7,
            off_post_m: 0.06,
            reach_m: 0.5,
            seen_m: [0.1, 1.4],
            usual_heights_m: [0.6, 0.9],
            width_m: [0.1, 0.4],
            depth_m: 0.24,
            apart_m: 0.12,
            middle_sigma_m: 0.05,
            most_own_odds: 20.0,
            own_share: 0.15,
            longest_gap_m: 0.25,
            fewest_hits: 9,
            fewest_hits_of_two: 20,
            fewest_scans: 2,
        }
    }
}
