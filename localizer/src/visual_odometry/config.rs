//! Settings of the motion between two images.

use serde::{Deserialize, Serialize};

use crate::odometry::OdometryConfig;

/// How the motion between two images is found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VisualOdometryConfig {
    /// Whether it is: where there are images or label images, and no log of wheels.
    pub is_on: bool,
    /// The points that are followed.
    pub tracks: TrackConfig,
    /// The rotation from them.
    pub rotation: RotationConfig,
    /// The speed from the road.
    pub road: RoadConfig,
    /// The turn from label images, where there are no others.
    pub labels: LabelConfig,
    /// How well the motion is known in the end. Its scale is that of the assumed
    /// height of the camera; its errors last for some frames, as the scale of the points
    /// does that the road told: held against the worlds and KITTI 04, 0.07 to 0.15 m/s
    /// (0.08 where it stands) and 0.001 to 0.003 rad/s. Speeds are taken so that a second of
    /// them has the standard deviation of their mean, 0.06 to 0.12 m/s; of who turns by
    /// more than 0.3 rad/s that is up to 0.2: the view lies to one side, where the road's
    /// fall counts.
    pub accuracy: OdometryConfig,
}

/// Points that are followed from one image to the next.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackConfig {
    /// Cells across the image, each with its own best points: far ones tell the
    /// turn and near ones the direction, so they have to be everywhere.
    pub columns: u32,
    /// Cells from the top to the bottom.
    pub rows: u32,
    /// Points in a cell at most.
    pub most_in_cell: u32,
    /// Strength of the weakest corner, as a share of the strongest one near.
    pub least_quality: f32,
    /// Distance between two of them, pixels.
    pub apart_px: u32,
    /// Side of the window that is compared, pixels, odd.
    pub window_px: usize,
    /// Levels of the image pyramid: with the window, a point is found up to
    /// `window_px * 2^(levels - 2)` pixels from where it is expected.
    pub levels: usize,
    /// How far off a point may be that was followed there and back, pixels.
    pub round_trip_px: f32,
}

/// Rotation and direction of the motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RotationConfig {
    /// Standard deviation of a point that was followed, pixels.
    pub sigma_px: f64,
    /// Standard deviation of the turn about each axis of the camera between two
    /// images, radians: pitching and rolling of 10 degrees a second, corners at
    /// 20 degrees a second more or less than in the image before.
    pub turn_sigma_rad: [f64; 3],
    /// Standard deviation of the direction of motion to the right, radians: the
    /// mounting of the camera, and slip.
    pub aside_sigma_rad: f64,
    /// Standard deviation of the pitch of the camera against the road, radians,
    /// around its mean.
    pub pitch_sigma_rad: f64,
    /// The same of that mean from camera to camera, radians: three degrees of mounting.
    pub mounting_sigma_rad: f64,
    /// Standard deviation of the camera's vertical speed, m/s: bumps. A vehicle
    /// at this over [`Self::pitch_sigma_rad`] is as much bumped as it pitches;
    /// below, the direction of motion tells little of the pitch.
    pub bump_sigma_m_s: f64,
    /// How far the camera is ahead of the axle that does not steer, metres.
    pub lever_m: f64,
    /// Time in which the mean pitch follows, seconds: another load, another road.
    pub pitch_memory_s: f64,
    /// Fewest points that have to agree, and so has half of all.
    pub fewest: usize,
}

/// The turn from label images: what is a pole, a sign or a line, and what is
/// taken for one, stays where it is. They do not show the road, so they tell no
/// speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LabelConfig {
    /// Standard deviation of a point that was followed, pixels: edges of masks
    /// flicker, so it is twice that of images.
    pub sigma_px: f64,
    /// Fewest points that have to agree.
    pub fewest: usize,
    /// Standard deviation of the direction of motion to the right, radians: what
    /// few points leave open between it and the turn is decided by how cameras
    /// are mounted.
    pub aside_sigma_rad: f64,
    /// Standard deviation of the yaw rate over one frame, rad/s: held against
    /// KITTI 04 and the worlds 0.006 to 0.027, with single ones that are six times
    /// as far off, so taken as more than twice as much.
    pub yaw_rate_sigma_rad_s: f64,
    /// Standard deviation of the yaw rate's bias, rad/s: held against the same,
    /// up to 0.006 in the mean of a drive.
    pub yaw_bias_sigma_rad_s: f64,
    /// Standard deviation of the rates of pitch and roll over one frame, rad/s: held
    /// against the same 0.004 to 0.014 and 0.009 to 0.061. What is ten times as far off, as
    /// a roll is in an empty street, no spring does.
    pub sway_sigma_rad_s: f64,
}

/// The road before the vehicle, seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RoadConfig {
    /// From how far ahead of the camera, metres, and how far: what is nearer is
    /// below the image, and farther off an image row is longer than 0.3 m.
    pub ahead_m: [f64; 2],
    /// How far ahead it is looked at where images come so seldom that it may have gone more
    /// than half of that meanwhile, metres: farther off paint is a pixel high. What may be more
    /// is not told.
    pub farthest_m: f64,
    /// Shares of the road ahead between which it is looked at so much farther off as is below
    /// the image: less changes little, and what is left of more is too far off.
    pub hidden_share: [f64; 2],
    /// To each side of the way that the vehicle goes on, metres: there is road.
    pub half_width_m: f64,
    /// Side of a pixel of the view, metres.
    pub pixel_m: f64,
    /// Half the side of the square by whose mean and spread a pixel is
    /// normalised, metres.
    pub around_m: f64,
    /// Fastest vehicle, m/s.
    pub fastest_m_s: f64,
    /// The same in reverse, m/s: as [`crate::tracker::BankConfig::max_reverse_m_s`],
    /// for the tracker refuses what is faster.
    pub fastest_back_m_s: f64,
    /// Hardest braking, m/s^2, with what the speeds are off by: a speed that no
    /// vehicle gets to from the last is none.
    pub hardest_m_s2: f64,
    /// Hardest speeding up, m/s^2, with what the speeds are off by: how much farther than at the
    /// last speed it is looked for where images come seldom.
    pub speeds_up_m_s2: f64,
    /// Speed at which the road is looked at while none is known, m/s: by it the direction of
    /// the motion is believed.
    pub usual_m_s: f64,
    /// After so many images in a row in which the road goes on to show a speed that cannot have
    /// followed the last, that was wrong; and so many have to go on to show the first, where
    /// images come so seldom that it may be more than the road shows.
    pub believed_after: usize,
    /// Share of the road that is seen at least in both views: a few pixels
    /// correlate by chance.
    pub least_shared: f64,
    /// Least correlation of two views.
    pub least_correlation: f64,
    /// How much more that has to be than at any other speed, as a share of what
    /// it is short of one: lines along the road make views alike at any speed.
    pub least_lead: f64,
    /// Half the width of the peak of the correlation, metres: what lies farther
    /// off is another speed.
    pub peak_m: f64,
    /// Standard deviation of the curvature of roads upwards, 1/m: crests and sags
    /// of 670 m, as roads for 50 to 60 km/h have them.
    pub sag_sigma_per_m: f64,
    /// Length over which that changes, metres.
    pub sag_length_m: f64,
    /// Standard deviation of the shift of one half of the view, metres: a pixel
    /// of it, with what the pitch and bumps of the road do.
    pub half_sigma_m: f64,
    /// Standard deviation of how much lower the road is per metre to the right than
    /// in the camera's axes: a camera mounted level to a degree, a crossfall of 2.5 %.
    pub fall_sigma: f64,
    /// Length after which it is another one, metres: a stretch between junctions.
    pub fall_length_m: f64,
    /// Standard deviation of the shift of a left or right side, metres: on KITTI 04 two
    /// sides differ by 0.009 from image to image, on rough roads by 0.02.
    pub side_sigma_m: f64,
    /// Standard deviation of how far the road says that the vehicle went, as a share of
    /// that: what is left of grades, crossfall and pitching.
    pub share_sigma: f64,
    /// What is added to that, metres: a quarter of a pixel of the view.
    pub way_sigma_m: f64,
    /// Length over which such errors are alike, metres.
    pub alike_m: f64,
}

impl VisualOdometryConfig {
    /// How well the turn from label images is known.
    pub fn accuracy_of_labels(&self) -> OdometryConfig {
        let LabelConfig { yaw_rate_sigma_rad_s, yaw_bias_sigma_rad_s, sway_sigma_rad_s, .. } = self.labels;
        OdometryConfig { yaw_rate_sigma_rad_s, yaw_bias_sigma_rad_s, sway_sigma_rad_s, ..self.accuracy }
    }
}

impl Default for VisualOdometryConfig {
    fn default() -> Self {
        let accuracy = OdometryConfig {
            speed_sigma_m_s: 0.25,
            standing_sigma_m_s: 0.15,
            speed_sigma_of_turn_m: 1.2,
            scale_sigma: 0.05,
            yaw_rate_sigma_rad_s: 0.01,
            yaw_bias_sigma_rad_s: 0.001,
            drift_per_minute: 0.1,
            ..OdometryConfig::default()
        };
        Self {
            is_on: true,
            tracks: TrackConfig::default(),
            rotation: RotationConfig::default(),
            road: RoadConfig::default(),
            labels: LabelConfig::default(),
            accuracy,
        }
    }
}

impl Default for TrackConfig {
    fn default() -> Self {
        Self {
            columns: 24,
            rows: 8,
            most_in_cell: 3,
            least_quality: 0.05,
            apart_px: 8,
            window_px: 15,
            levels: 4,
            round_trip_px: 0.7,
        }
    }
}

impl Default for RotationConfig {
    fn default() -> Self {
        Self {
            sigma_px: 0.5,
            turn_sigma_rad: [0.02, 0.03, 0.02],
            aside_sigma_rad: 0.03,
            pitch_sigma_rad: 0.0075,
            mounting_sigma_rad: 0.05,
            bump_sigma_m_s: 0.06,
            lever_m: 1.5,
            pitch_memory_s: 2.0,
            fewest: 30,
        }
    }
}

impl Default for LabelConfig {
    fn default() -> Self {
        Self {
            sigma_px: 1.0,
            fewest: 12,
            aside_sigma_rad: 0.015,
            yaw_rate_sigma_rad_s: 0.06,
            yaw_bias_sigma_rad_s: 0.003,
            sway_sigma_rad_s: 0.04,
        }
    }
}

impl RoadConfig {
    /// The longest shift that it can be asked for, metres: half of the road has to be in both.
    pub fn longest_shift_m(&self) -> f64 {
        0.5 * (self.ahead_m[1] - self.ahead_m[0])
    }

    /// The same of as much of the road as can be looked at.
    pub(super) fn farthest_shift_m(&self) -> f64 {
        let [near_m, far_m] = self.ahead_m;
        0.5 * (self.farthest_m.max(far_m) - near_m)
    }

    /// Whether images come so seldom that the fastest vehicle goes further between two of them.
    pub(super) fn are_seldom(&self, dt_s: f64) -> bool {
        self.fastest_m_s * dt_s > self.longest_shift_m()
    }

    /// The same with as much of the road as shifts of so many metres ask for; none where that
    /// is more than can be seen.
    pub fn for_shifts_of(&self, most_m: f64) -> Option<Self> {
        let [near_m, far_m] = self.ahead_m;
        let ahead_m = [near_m, far_m.max(near_m + 2.0 * most_m)];
        (most_m <= self.farthest_shift_m()).then_some(Self { ahead_m, ..*self })
    }

    /// The same for images that show the road from this distance on, metres: as much more of
    /// it as is below them, if that is neither little nor most of it.
    #[must_use]
    pub fn seen_from(&self, nearest_m: f64) -> Self {
        let [near_m, far_m] = self.ahead_m;
        let [least, most] = self.hidden_share.map(|share| share * (far_m - near_m));
        let hidden_m = nearest_m - near_m;
        let more_m = if (least..most).contains(&hidden_m) { hidden_m } else { 0.0 };
        Self { ahead_m: [near_m, (far_m + more_m).min(self.farthest_m.max(far_m))], ..*self }
    }
}

impl Default for RoadConfig {
    fn default() -> Self {
        Self {
            ahead_m: [5.0, 15.0],
            farthest_m: 25.0,
            hidden_share: [0.15, 0.6],
            half_width_m: 2.5,
            pixel_m: 0.04,
            around_m: 0.5,
            fastest_m_s: 45.0,
            fastest_back_m_s: 3.0,
            hardest_m_s2: 20.0,
            speeds_up_m_s2: 7.0,
            usual_m_s: 10.0,
            believed_after: 5,
            least_shared: 0.3,
            least_correlation: 0.3,
            least_lead: 0.2,
            peak_m: 0.3,
            sag_sigma_per_m: 0.0015,
            sag_length_m: 30.0,
            half_sigma_m: 0.035,
            fall_sigma: 0.03,
            fall_length_m: 100.0,
            side_sigma_m: 0.02,
            share_sigma: 0.02,
            way_sigma_m: 0.01,
            alike_m: 2.0,
        }
    }
}
