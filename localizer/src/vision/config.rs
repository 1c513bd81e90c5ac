//! Settings of the way from probabilities to features.

use serde::{Deserialize, Serialize};

/// Everything that can be set here. Pixels are those of the image, or where it
/// is wider than `widest_px`, of the image as it is looked at.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VisionConfig {
    /// Wider images are scaled down to this width, pixels, before anything looks
    /// at them: that of the networks, which see no more of any image, and whose
    /// faults are of so many pixels of that.
    pub widest_px: usize,
    /// Height of the camera over the road that is assumed where `lanes.ground` gives
    /// none, metres: KITTI's. It says which rows the paper's straight line is fitted to,
    /// and the scale of the speed from images, which the map corrects.
    pub camera_height_m: f64,
    /// Poles.
    pub poles: PoleConfig,
    /// Trunks of trees.
    pub trunks: TrunkConfig,
    /// Signs and lights.
    pub signs: SignConfig,
    /// Lane lines.
    pub lanes: LaneConfig,
    /// Marks of dashed lines.
    pub marks: MarkConfig,
}

impl VisionConfig {
    /// The height over the road that the camera is taken to have, metres.
    pub fn height_over_road_m(&self) -> f64 {
        self.lanes.ground.map_or(self.camera_height_m, |ground| ground.camera_height_m)
    }
}

impl Default for VisionConfig {
    fn default() -> Self {
        Self {
            widest_px: 1248,
            camera_height_m: 1.65,
            poles: PoleConfig::default(),
            trunks: TrunkConfig::default(),
            signs: SignConfig::default(),
            lanes: LaneConfig::default(),
            marks: MarkConfig::default(),
        }
    }
}

/// Brightness along a lane line to the ends of its marks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MarkConfig {
    /// Length of a line, pixels, of which the direction is taken in which it is
    /// followed beyond the ends of its mask.
    pub direction_px: f64,
    /// Length on the ground before and behind an end over which brightness is
    /// compared, metres: less than the shortest marks and gaps, of 1 m.
    pub compare_m: f64,
    /// Least difference of both sides, grey levels of 255: patches and seams
    /// of asphalt reach 8.
    pub least_contrast: f64,
    /// The same as a share of the line's range of contrasts, from the tenth to
    /// the ninetieth percentile: worn paint within a mark stays below it.
    pub least_share: f64,
    /// Largest contrast of the darker side, as a share of the brighter one's: a
    /// gap is bare road, and paint in the shade is brighter than that.
    pub darkest_share: f64,
    /// Standard deviation of an end along the line, pixels: lens and
    /// interpolation.
    pub sigma_px: f64,
    /// The same on the ground, metres: worn and ragged paint.
    pub sigma_m: f64,
}

impl Default for MarkConfig {
    fn default() -> Self {
        Self {
            direction_px: 150.0,
            compare_m: 0.8,
            least_contrast: 12.0,
            least_share: 0.4,
            darkest_share: 0.5,
            sigma_px: 0.7,
            sigma_m: 0.03,
        }
    }
}

/// Regions of the class pole to centre lines.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoleConfig {
    /// Probability from which a pixel belongs to a region; the paper's 0.1.
    /// So low that poles in front of foliage stay whole; the line weighs its
    /// pixels with their probabilities, so the faint rim counts little.
    pub threshold: f64,
    /// Probability that one pixel of a region must reach. Faint regions
    /// without a core are foliage and shadows.
    pub seed: f64,
    /// Smallest mean over the rows of their largest probability: what stays
    /// below it was foliage, window frames and shadows in 9 of 11 cases.
    pub min_probability: f64,
    /// Distance from the line within which a row of a region supports it,
    /// pixels: the raggedness of masks.
    pub inlier_px: f64,
    /// The same as a share of the pole's width; the larger one holds.
    pub inlier_width_share: f64,
    /// Pairs of rows that are tried per line. With half of the rows outliers,
    /// 48 pairs miss the line with a chance of one in a million.
    pub ransac_rounds: usize,
    /// Seed of the choice of pairs.
    pub ransac_seed: u64,
    /// Lines that one region may hold: crossing and touching poles.
    pub lines_per_region: usize,
    /// Largest angle from the image's vertical, degrees. Poles lean by less
    /// than 5, and a camera pitched by 5 shows those at its border tilted by
    /// as much again; braces, wires and branches lean by more.
    pub max_tilt_deg: f64,
    /// Shortest line, pixels: a delineator, 1 m, at 60 m.
    pub min_length_px: f64,
    /// Smallest ratio of length to width: a delineator, 1 m by 0.2 m, with a
    /// mask that is 1 px too wide on either side.
    pub min_aspect: f64,
    /// Largest root mean square distance of the centres of the rows from the
    /// line, pixels.
    pub max_residual_px: f64,
    /// The same as a share of the width; the larger one holds.
    pub max_residual_width_share: f64,
    /// Share of the rows between its ends in which a piece of a pole must be
    /// seen.
    pub min_coverage: f64,
    /// Longest gap between two pieces of one pole, as a share of the longer
    /// piece. A gap that signs or lights fill may be of any length.
    pub max_gap_share: f64,
    /// Standard deviation of a mask's centre that is common to all its rows,
    /// pixels: measured against the edges of 172 poles in KITTI images it is
    /// 0.48 for poles of 3 to 6 px and 0.85 for those of 6 to 9 px.
    pub mask_sigma_px: f64,
    /// The same as a share of the width; both add up as variances.
    pub mask_sigma_width_share: f64,
    /// Rows over which the error of a mask is about the same, pixels: with
    /// 12, the directions of the same poles err as much as they claim. That
    /// is about the stride of a segmentation network.
    pub correlation_px: f64,
}

impl Default for PoleConfig {
    fn default() -> Self {
        Self {
            threshold: 0.1,
            seed: 0.35,
            min_probability: 0.2,
            inlier_px: 1.5,
            inlier_width_share: 0.3,
            ransac_rounds: 48,
            ransac_seed: 1,
            lines_per_region: 4,
            max_tilt_deg: 12.0,
            min_length_px: 12.0,
            min_aspect: 3.0,
            max_residual_px: 0.9,
            max_residual_width_share: 0.12,
            min_coverage: 0.7,
            max_gap_share: 1.0,
            mask_sigma_px: 0.3,
            mask_sigma_width_share: 0.1,
            correlation_px: 12.0,
        }
    }
}

/// Columns of the class vegetation to centre lines. What is not here is as of poles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrunkConfig {
    /// Probability from which a pixel is vegetation.
    pub threshold: f64,
    /// Widest trunk, as a share of the image's width: 0.6 m at 7 m.
    pub widest_of_width: f64,
    /// What must be free of vegetation on either side, as a share of the
    /// width: gaps in a crown are narrower than what is between them.
    pub free_share: f64,
    /// Smallest mean over the rows of their largest probability.
    pub min_probability: f64,
    /// Shortest trunk, pixels: 2 m at 45 m. What is shorter is mostly a gap
    /// between leaves.
    pub min_length_px: f64,
    /// Smallest ratio of length to width: 1.2 m between hedge and fork, 0.6 m
    /// thick.
    pub min_aspect: f64,
    /// Standard deviation of the centre that is common to all rows, pixels.
    pub mask_sigma_px: f64,
    /// The same as a share of the width; both add up as variances. Of trunks
    /// the network finds one side in the shade.
    pub mask_sigma_width_share: f64,
}

impl Default for TrunkConfig {
    fn default() -> Self {
        Self {
            threshold: 0.4,
            widest_of_width: 0.05,
            free_share: 0.4,
            min_probability: 0.5,
            min_length_px: 32.0,
            min_aspect: 2.0,
            mask_sigma_px: 1.5,
            mask_sigma_width_share: 0.1,
        }
    }
}

impl TrunkConfig {
    /// As settings of poles.
    pub(super) fn as_poles(&self, poles: &PoleConfig) -> PoleConfig {
        PoleConfig {
            threshold: self.threshold,
            seed: self.min_probability,
            min_probability: self.min_probability,
            min_length_px: self.min_length_px,
            min_aspect: self.min_aspect,
            mask_sigma_px: self.mask_sigma_px,
            mask_sigma_width_share: self.mask_sigma_width_share,
            ..poles.clone()
        }
    }
}

/// Regions of the classes sign and light to points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SignConfig {
    /// Probability from which a pixel belongs to a region. Higher than for
    /// poles: a sign is compact, and its rim moves its centre.
    pub threshold: f64,
    /// Probability that one pixel of a region must reach: adverts and foliage
    /// stay below it more often than signs.
    pub seed: f64,
    /// Smallest region, pixels: a plate of 0.6 m at 50 m.
    pub min_area_px: usize,
    /// Smallest share of its bounding box that a region fills; a disc fills
    /// 0.79, a triangle 0.5, what a network sees in foliage less.
    pub min_fill: f64,
    /// Largest ratio of the sides of the bounding box. Two plates above each
    /// other reach 2.5; gutters and eaves are longer.
    pub max_aspect: f64,
    /// Largest side of the bounding box, pixels: a plate of 0.9 m is that
    /// large at 6 m; adverts and shop fronts are larger.
    pub max_extent_px: f64,
    /// Standard deviation of the centre, pixels.
    pub sigma_px: f64,
    /// The same as a share of the larger side of the bounding box; both add
    /// up as variances.
    pub sigma_extent_share: f64,
}

impl Default for SignConfig {
    fn default() -> Self {
        Self {
            threshold: 0.5,
            seed: 0.7,
            min_area_px: 40,
            min_fill: 0.5,
            max_aspect: 3.5,
            max_extent_px: 110.0,
            sigma_px: 0.5,
            sigma_extent_share: 0.06,
        }
    }
}

/// Regions of the class lane line to curves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LaneConfig {
    /// Probability from which a pixel belongs to a region. Lane networks give
    /// nearly hard masks, so this moves little.
    pub threshold: f64,
    /// Probability that one pixel of a region must reach.
    pub seed: f64,
    /// Smallest region, pixels.
    pub min_area_px: usize,
    /// Shortest piece of a curve, pixels, that is joined to others: shorter
    /// ones have no direction.
    pub min_piece_px: f64,
    /// Length at either end of a piece, pixels, over which its direction is
    /// taken: lanes are straight over so little.
    pub direction_px: f64,
    /// Longest gap that is joined, as a share of the longer piece: dashes of
    /// 3 m with gaps of 6 m, and of 6 m with 12 m.
    pub max_gap_share: f64,
    /// A gap of this length, pixels, may always be joined.
    pub min_gap_px: f64,
    /// How far a piece's end may lie beside the other one's extension, pixels.
    pub max_offset_px: f64,
    /// By how much that grows per pixel of the gap: curves.
    pub max_offset_per_gap: f64,
    /// By how much a line may bend where two pieces are joined, degrees, on
    /// top of what their scatter leaves open: a kerb that takes over from a
    /// lane line bends by 4, a road of 100 m radius by 2 over a gap of 4 m.
    pub max_bend_deg: f64,
    /// Shortest curve, pixels.
    pub min_length_px: f64,
    /// Smallest ratio of length to width: arrows and letters are below it.
    pub min_aspect: f64,
    /// Smallest angle from the image's horizontal, degrees: stop lines are
    /// below it, and lanes further than 20 m to the side.
    pub min_slope_deg: f64,
    /// Where the ground is; without it the straight line is fitted to the
    /// whole curve.
    pub ground: Option<Ground>,
    /// Nearest distance ahead of the part that the straight line is fitted
    /// to, metres; the paper's 5.
    pub near_m: f64,
    /// Its farthest distance, metres; the paper's 20.
    pub far_m: f64,
    /// Standard deviation of a mask's centre that is common to all its rows,
    /// pixels: measured against the paint at 2,000 places of KITTI images.
    pub mask_sigma_px: f64,
    /// Length over which the error of a mask is about the same, pixels.
    pub correlation_px: f64,
}

/// The flat ground ahead of a camera without pitch and roll: what lies at
/// distance z is in row `horizon_px + focal_px camera_height_m / z`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ground {
    /// Row of the horizon, pixels: the principal point's, less the focal
    /// length times the camera's pitch.
    pub horizon_px: f64,
    /// Focal length, pixels.
    pub focal_px: f64,
    /// Height of the camera over the ground, metres; KITTI: 1.65.
    pub camera_height_m: f64,
}

impl Ground {
    /// The row of what lies on the ground at this distance ahead.
    pub fn row_px(&self, distance_m: f64) -> f64 {
        self.horizon_px + self.focal_px * self.camera_height_m / distance_m
    }

    /// How far ahead what lies on the ground is in this row, metres: the
    /// inverse of [`Self::row_px`]; rows from one below the horizon up are as
    /// far as that one.
    pub fn distance_m(&self, row_px: f64) -> f64 {
        self.focal_px * self.camera_height_m / self.below_px(row_px)
    }

    /// How far below the horizon a row is, at least 1 pixel.
    pub fn below_px(&self, row_px: f64) -> f64 {
        (row_px - self.horizon_px).max(1.0)
    }
}

impl Default for LaneConfig {
    fn default() -> Self {
        Self {
            threshold: 0.3,
            seed: 0.6,
            min_area_px: 30,
            min_piece_px: 6.0,
            direction_px: 50.0,
            max_gap_share: 2.0,
            min_gap_px: 12.0,
            max_offset_px: 2.0,
            max_offset_per_gap: 0.03,
            max_bend_deg: 2.5,
            min_length_px: 20.0,
            min_aspect: 3.0,
            min_slope_deg: 4.0,
            ground: None,
            near_m: 5.0,
            far_m: 20.0,
            mask_sigma_px: 0.7,
            correlation_px: 12.0,
        }
    }
}
