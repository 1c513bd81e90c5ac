//! What the localizer answers for one frame, and how far to trust it.

use std::fmt;

use common::geometry::Pose;
use nalgebra::Matrix6;

/// Horizontal standard deviation of a pose by its covariance, metres.
pub fn horizontal_sigma_m(covariance: &Matrix6<f64>) -> f64 {
    (covariance[(0, 0)] + covariance[(2, 2)]).max(0.0).sqrt()
}

/// How far an estimate can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Status {
    /// Verified over several frames, supported by this one, no rival.
    Ok,
    /// Usable with care: not yet verified, thinly supported, or with a rival.
    Degraded,
    /// The pose is a prediction only; the localizer is searching.
    Lost,
}

impl Status {
    /// The word that stands in output files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Degraded => "degraded",
            Self::Lost => "lost",
        }
    }

    /// The inverse of [`Self::as_str`].
    pub fn from_word(word: &str) -> Option<Self> {
        [Self::Ok, Self::Degraded, Self::Lost].into_iter().find(|status| status.as_str() == word)
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// A landmark of the map, by its index there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LandmarkId {
    /// Index into `SemanticMap::poles`.
    Pole(usize),
    /// Index into `SemanticMap::lanes`.
    Lane(usize),
    /// Index into `SemanticMap::signs`.
    Sign(usize),
    /// The marks of a dashed line; index into `SemanticMap::lanes`.
    Marks(usize),
}

impl LandmarkId {
    /// It stands or hangs beside the road; all others are painted on it.
    pub fn is_object(self) -> bool {
        matches!(self, Self::Pole(_) | Self::Sign(_))
    }
}

/// A landmark and the feature that it was found in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correspondence {
    /// The landmark.
    pub landmark: LandmarkId,
    /// Index into the features of the same semantics.
    pub feature: usize,
    /// Root mean square distance between the two in the image, pixels.
    pub residual_px: f64,
    /// Weight that the robust loss left it, 0 to 1.
    pub weight: f64,
}

/// A pose with what is known about its quality.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseEstimate {
    /// The pose of the reference camera.
    pub map_from_camera: Pose,
    /// Covariance in the tangent of [`common::geometry::retract`]: translation
    /// right, down, forward (m), then rotation (rad), in the camera's frame.
    pub covariance: Matrix6<f64>,
    /// What was matched, in the order poles, lanes, signs.
    pub correspondences: Vec<Correspondence>,
    /// Root mean square of the matched distances, pixels; 0 without matches.
    pub residual_rms_px: f64,
    /// Iterations of the solver, summed over the rounds of the association.
    pub iterations: usize,
    /// The solver reached a minimum.
    pub converged: bool,
    /// How far to trust it.
    pub status: Status,
    /// Log-likelihood ratio of the frame's features under this pose against
    /// clutter alone (nats): support is positive.
    pub support: f64,
    /// How much more support the pose has than the best rival that lies
    /// elsewhere (nats).
    pub margin: f64,
    /// Standard deviation of the time between two images, as far as the images
    /// tell, seconds: 0 where the clock is good.
    pub time_sigma_s: f64,
}

impl PoseEstimate {
    /// Standard deviations right, down, forward (m) and about these axes (rad).
    pub fn sigmas(&self) -> [f64; 6] {
        std::array::from_fn(|i| self.covariance[(i, i)].max(0.0).sqrt())
    }
}
