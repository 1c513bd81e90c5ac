use serde::{Deserialize, Serialize};

/// How the landmarks that localize best are told: a model of the camera that
/// will use the map. The noise is in pixels of this camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BudgetConfig {
    /// Distance of the places along a road at which the accuracy is predicted,
    /// metres: what a car drives in a third of a second.
    pub place_step_m: f64,
    /// Nothing farther is used, metres: there a metre of position moves a
    /// landmark 10 m beside the road by less than a pixel.
    pub farthest_m: f64,
    /// Nothing nearer is seen, metres: it passes through the image too fast,
    /// and mostly below or beside it.
    pub nearest_m: f64,
    /// Least size over distance of a pole or sign: 12 pixels.
    pub least_relative_size: f64,
    /// Lane lines are seen from here on, metres ahead: nearer ones are hidden
    /// by the bonnet and the image's lower edge.
    pub lane_near_m: f64,
    /// Lane lines are seen up to here, metres ahead: beyond they are as narrow
    /// as a pixel and hidden by traffic.
    pub lane_far_m: f64,
    /// Line through a pole in the image, pixels at each end, one standard
    /// deviation: the edges of masks.
    pub pole_sigma_px: f64,
    /// Centre of a sign in the image, pixels.
    pub sign_sigma_px: f64,
    /// Centre of a sign as a share of its size in the image: only part of it
    /// is seen as one.
    pub sign_sigma_of_size: f64,
    /// Lane line in the image, pixels.
    pub lane_sigma_px: f64,
    /// How far a mapped pole or sign is off in the image, metres, whatever
    /// its evidence: image and lidar do not see the same middle of it, and
    /// posts get bent.
    pub landmark_sigma_m: f64,
    /// The same for lane lines, metres: they are repainted.
    pub lane_sigma_m: f64,
    /// How far off the marks of a dashed line are along it, metres, as one:
    /// beams of the survey on one side, edges in the image on the other.
    pub mark_sigma_m: f64,
    /// Calibration, rectification and exposure time, pixels, for all alike.
    pub calibration_sigma_px: f64,
    /// What is known of the pose before any landmark is seen, one standard
    /// deviation, in the camera's axes: right, down, forward (metres), pitch,
    /// yaw, roll (radians). What a satellite receiver, the road below and the
    /// vehicle's springs leave open.
    pub before_sigma: [f64; 6],
    /// By how much that grows with the square root of a metre driven: what
    /// is known at one place helps at the next.
    pub drift_sigma: [f64; 6],
    /// The camera.
    pub camera: Camera,
    /// How often landmarks are found in an image that shows them.
    pub found: Found,
    /// How far off a pose may be that is taken for the right one, to the right
    /// and forward, metres: as far as a search starts from, next to a lane.
    pub wrong_m: [f64; 2],
    /// How surely a landmark that is found tells the right pose from a wrong
    /// one at most, nats: at a wrong one, something else stands in its place
    /// now and then.
    pub most_evidence: f64,
    /// Errors that weigh the same, in the camera's axes: right, down, forward
    /// (metres), pitch, yaw, roll (radians). A camera that is wrong in height
    /// or tilt takes one landmark for another, so these count, too.
    pub wanted_sigma: [f64; 6],
    /// Power of the weighted variance of a place: 1 for the least mean square
    /// error along the drive; larger ones care more for the worst places, from
    /// where on a drive may be lost.
    pub worst_power: f64,
    /// Coarser details that are tried where a map does not fit: quantum, lane
    /// tolerance, road tolerance, metres; each with the marks of dashed lines
    /// and without. The one that localizes best is taken.
    pub coarser: Vec<[f64; 3]>,
}

/// A forward-looking pinhole camera, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Camera {
    /// Focal length.
    pub focal_px: f64,
    /// Columns of the image.
    pub width_px: f64,
    /// Rows of the image.
    pub height_px: f64,
    /// Row of the horizon, the principal point.
    pub centre_row_px: f64,
}

/// Share of the images in which a landmark in view is found and matched, as
/// counted on KITTI 04 and on generated streets.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Found {
    /// Length in the image at which half of the poles are found, pixels: of
    /// half that length it is a quarter, of twice it three quarters.
    pub half_of_poles_px: f64,
    /// The same of delineators and bollards, pixels: they are nearer and wider
    /// than other poles of that length, and nothing hides their foot.
    pub half_of_delineators_px: f64,
    /// Sign posts against other poles of that length: in generated images as
    /// many are found, in those of KITTI 04 none, being thin.
    pub sign_posts: f64,
    /// Trunks against other poles of that length: most stand before hedges and
    /// other trees. In generated streets it is a tenth to a half.
    pub trunks: f64,
    /// Signs and lights.
    pub signs: f64,
    /// Lane lines of which enough is in view.
    pub lanes: f64,
    /// The same of kerbs: not every network has learnt them.
    pub kerbs: f64,
    /// Length in view that is enough, metres.
    pub lane_length_m: f64,
    /// Marks of a dashed line that is found, where some are in view: three
    /// quarters in generated images. 0 for a localizer that has label images
    /// only, in which dashed lines have no gaps.
    pub marks: f64,
}

impl Default for BudgetConfig {
    fn default() -> Self {
        Self {
            place_step_m: 5.0,
            farthest_m: 100.0,
            nearest_m: 3.0,
            least_relative_size: 0.017,
            lane_near_m: 5.0,
            lane_far_m: 30.0,
            landmark_sigma_m: 0.05,
            lane_sigma_m: 0.02,
            mark_sigma_m: 0.13,
            pole_sigma_px: 1.5,
            sign_sigma_px: 1.5,
            sign_sigma_of_size: 0.1,
            lane_sigma_px: 1.5,
            calibration_sigma_px: 1.0,
            before_sigma: [1.0, 0.2, 1.0, 0.02, 0.035, 0.02],
            drift_sigma: [0.05, 0.03, 0.1, 0.005, 0.005, 0.005],
            camera: Camera::default(),
            found: Found::default(),
            wanted_sigma: [0.1, 0.1, 0.1, 0.005, 0.005, 0.005],
            wrong_m: [2.0, 2.0],
            most_evidence: 3.0,
            worst_power: 2.0,
            coarser: vec![[0.02, 0.05, 0.2], [0.05, 0.08, 0.3]],
        }
    }
}

impl Default for Camera {
    /// The cameras of KITTI, as most forward cameras of cars: 80 degrees wide.
    fn default() -> Self {
        Self { focal_px: 707.0, width_px: 1226.0, height_px: 370.0, centre_row_px: 183.0 }
    }
}

impl Default for Found {
    fn default() -> Self {
        Self {
            half_of_poles_px: 80.0,
            half_of_delineators_px: 36.0,
            sign_posts: 0.5,
            trunks: 0.1,
            signs: 0.6,
            lanes: 0.93,
            kerbs: 0.4,
            lane_length_m: 18.0,
            marks: 0.75,
        }
    }
}
