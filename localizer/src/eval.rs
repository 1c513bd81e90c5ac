//! Estimates against true poses, without any alignment, in the paper's terms.

use common::geometry::{Pose, local};
use serde::Serialize;

use crate::Error;
use crate::estimate::Status;
use crate::output::{Recorded, Timing};

pub mod trust;
pub mod turn;

use trust::Trust;
use turn::ConstantTurn;

/// What the paper reports on 190 frames of KITTI 04.
pub const PAPER: PaperFigures =
    PaperFigures { rms_position_m: 0.345, share_under_half_metre: 0.90, mean_angle_rad: 0.019 };

/// Frames that a run is started with, by GPS, and that are not scored.
pub const START_FRAMES: usize = 2;
/// A run is lost where its last frame is off by more than this, metres: half a
/// lane.
pub const LOST_M: f64 = 1.75;

/// Figures of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PaperFigures {
    /// Root mean square position error, metres.
    pub rms_position_m: f64,
    /// Share of frames with less than 0.5 m.
    pub share_under_half_metre: f64,
    /// Mean angle error, radians.
    pub mean_angle_rad: f64,
}

/// Median and 99th percentile of a stage, milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StageTime {
    /// Half of the frames take no longer.
    pub median_ms: f64,
    /// 99 % of the frames take no longer.
    pub p99_ms: f64,
}

impl StageTime {
    /// Of these times; none without any.
    pub fn of(mut times_ms: Vec<f64>) -> Option<Self> {
        times_ms.sort_by(f64::total_cmp);
        let at = |share: f64| times_ms.get(((times_ms.len() as f64 * share).ceil() as usize).max(1) - 1).copied();
        Some(Self { median_ms: at(0.5)?, p99_ms: at(0.99)? })
    }
}

/// The error of one frame, in the axes of the true camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FrameError {
    /// Index of the frame.
    pub frame: usize,
    /// To the right, metres.
    pub lateral_m: f64,
    /// Downwards, metres.
    pub vertical_m: f64,
    /// Forward, metres.
    pub longitudinal_m: f64,
    /// Angle of the rotation between truth and estimate, radians.
    pub angle_rad: f64,
}

impl FrameError {
    /// Of an estimate against the truth.
    pub fn new(frame: usize, truth: &Pose, estimate: &Pose) -> Self {
        let off = local(truth, estimate);
        Self {
            frame,
            lateral_m: off[0],
            vertical_m: off[1],
            longitudinal_m: off[2],
            angle_rad: off.fixed_rows::<3>(3).norm(),
        }
    }

    /// Distance between truth and estimate, metres.
    pub fn position_m(&self) -> f64 {
        self.lateral_m.hypot(self.vertical_m).hypot(self.longitudinal_m)
    }
}

/// The figures of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Frames that were scored.
    pub frames: usize,
    /// Root mean square position error, metres.
    pub rms_position_m: f64,
    /// Largest position error, metres.
    pub max_position_m: f64,
    /// Root mean square to the right, metres.
    pub rms_lateral_m: f64,
    /// Root mean square forward, metres.
    pub rms_longitudinal_m: f64,
    /// Root mean square in height, metres.
    pub rms_vertical_m: f64,
    /// Mean to the right, metres: a bias.
    pub mean_lateral_m: f64,
    /// Mean forward, metres: a bias.
    pub mean_longitudinal_m: f64,
    /// Mean downwards, metres: a bias.
    pub mean_vertical_m: f64,
    /// Share of frames with a position error under 0.5 m.
    pub share_under_half_metre: f64,
    /// Mean angle error, radians.
    pub mean_angle_rad: f64,
    /// Largest angle error, radians.
    pub max_angle_rad: f64,
    /// Correspondences per frame, where known.
    pub mean_correspondences: Option<f64>,
    /// Frames that are called ok, degraded and lost, where known.
    pub ok_degraded_lost: Option<[usize; 3]>,
    /// Frames that are called ok and are off by 0.5 m or more.
    pub ok_but_off: usize,
    /// What the covariances are worth, where known.
    pub trust: Option<Trust>,
    /// The turn that truth and estimates have against each other throughout, where the
    /// covariances are known.
    pub constant_turn: Option<ConstantTurn>,
    /// Time for the probabilities.
    pub maps: Option<StageTime>,
    /// Time for the features from them.
    pub features: Option<StageTime>,
    /// Time for association and pose.
    pub localize: Option<StageTime>,
    /// The paper's figures, for comparison.
    pub paper: PaperFigures,
    /// The errors of the frames.
    pub errors: Vec<FrameError>,
}

/// Why nothing of a run can be scored of which so many frames were localized.
pub fn nothing_scored(localized: usize) -> Error {
    if localized == 0 { Error::NothingLocalized } else { Error::NothingScored { localized } }
}

/// Scores the estimates that have a true pose (row = frame); none where no
/// frame has both.
pub fn score(estimates: &[Recorded], truth: &[Option<Pose>], timing: &[Timing]) -> Option<Report> {
    let with_truth: Vec<(&Recorded, &Pose)> =
        estimates.iter().filter_map(|e| Some((e, truth.get(e.frame)?.as_ref()?))).collect();
    let pairs: Vec<(&Recorded, FrameError)> =
        with_truth.iter().map(|(e, truth)| (*e, FrameError::new(e.frame, truth, &e.map_from_camera))).collect();
    if pairs.is_empty() {
        return None;
    }
    let count = pairs.len() as f64;
    let mean = |value: &dyn Fn(&FrameError) -> f64| pairs.iter().map(|(_, e)| value(e)).sum::<f64>() / count;
    let rms = |value: &dyn Fn(&FrameError) -> f64| mean(&|e| value(e).powi(2)).sqrt();
    let most = |value: &dyn Fn(&FrameError) -> f64| pairs.iter().map(|(_, e)| value(e)).fold(0.0, f64::max);
    let under = |e: &FrameError| f64::from(u8::from(e.position_m() < 0.5));
    let matched: Option<Vec<usize>> = pairs.iter().map(|(r, _)| r.correspondences).collect();
    let statuses: Option<Vec<Status>> = pairs.iter().map(|(r, _)| r.status).collect();
    let stage = |value: fn(&Timing) -> f64| StageTime::of(timing.iter().map(value).collect());
    Some(Report {
        frames: pairs.len(),
        rms_position_m: rms(&FrameError::position_m),
        max_position_m: most(&FrameError::position_m),
        rms_lateral_m: rms(&|e| e.lateral_m),
        rms_longitudinal_m: rms(&|e| e.longitudinal_m),
        rms_vertical_m: rms(&|e| e.vertical_m),
        mean_lateral_m: mean(&|e| e.lateral_m),
        mean_longitudinal_m: mean(&|e| e.longitudinal_m),
        mean_vertical_m: mean(&|e| e.vertical_m),
        share_under_half_metre: mean(&under),
        mean_angle_rad: mean(&|e| e.angle_rad),
        max_angle_rad: most(&|e| e.angle_rad),
        mean_correspondences: matched.map(|m| m.iter().sum::<usize>() as f64 / count),
        ok_degraded_lost: statuses
            .as_ref()
            .map(|all| [Status::Ok, Status::Degraded, Status::Lost].map(|s| all.iter().filter(|t| **t == s).count())),
        ok_but_off: pairs.iter().filter(|(r, e)| r.status == Some(Status::Ok) && e.position_m() >= 0.5).count(),
        trust: Trust::of(with_truth.iter().copied()),
        constant_turn: ConstantTurn::of(&with_truth),
        maps: stage(|t| t.maps_ms),
        features: stage(|t| t.features_ms),
        localize: stage(|t| t.localize_ms),
        paper: PAPER,
        errors: pairs.into_iter().map(|(_, e)| e).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::geometry::{PoseParameters, Tangent, retract};

    fn truth() -> Pose {
        // Driving along map x: its right is map -z.
        PoseParameters { x_m: 10.0, y_m: 1.0, z_m: 5.0, yaw_rad: 1.2, pitch_rad: 0.0, roll_rad: 0.0 }.to_pose()
    }

    fn recorded(frame: usize, off: Tangent, status: Status) -> Recorded {
        let map_from_camera = retract(&truth(), &off);
        Recorded { frame, map_from_camera, status: Some(status), correspondences: Some(10), covariance: None }
    }

    #[test]
    fn errors_are_told_apart_in_the_true_cameras_axes() {
        let estimates = [
            recorded(0, Tangent::new(0.3, 0.0, 0.0, 0.0, 0.0, 0.0), Status::Ok),
            recorded(1, Tangent::new(0.0, 0.0, 0.8, 0.0, 0.02, 0.0), Status::Ok),
        ];
        let report = score(&estimates, &[Some(truth()), Some(truth())], &[]).unwrap();
        assert!((report.rms_lateral_m - (0.09_f64 / 2.0).sqrt()).abs() < 1e-9);
        assert!((report.mean_longitudinal_m - 0.4).abs() < 1e-9);
        assert!(report.rms_vertical_m < 1e-9);
        assert!((report.rms_position_m - 0.365_f64.sqrt()).abs() < 1e-9);
        assert!((report.share_under_half_metre - 0.5).abs() < 1e-12);
        assert!((report.mean_angle_rad - 0.01).abs() < 1e-9 && (report.max_angle_rad - 0.02).abs() < 1e-9);
        assert_eq!(report.ok_but_off, 1);
        assert_eq!(report.ok_degraded_lost, Some([2, 0, 0]));
    }

    #[test]
    fn frames_without_truth_do_not_count() {
        let estimates = [recorded(0, Tangent::zeros(), Status::Ok), recorded(7, Tangent::zeros(), Status::Lost)];
        assert_eq!(score(&estimates, &[Some(truth())], &[]).unwrap().frames, 1);
        assert!(score(&estimates[1..], &[Some(truth())], &[]).is_none());
    }

    #[test]
    fn percentiles_are_of_the_sorted_times() {
        let times = (1..=100).rev().map(f64::from).collect();
        let stage = StageTime::of(times).unwrap();
        assert!((stage.median_ms - 50.0).abs() < 1e-9 && (stage.p99_ms - 99.0).abs() < 1e-9);
        assert!(StageTime::of(Vec::new()).is_none());
    }
}
