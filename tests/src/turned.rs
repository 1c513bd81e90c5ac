//! How much of what a map holds hangs on where its grids begin: a drive is mapped in
//! frames that are turned about the vertical, which changes nothing that was surveyed.

use std::path::Path;

use common::geometry::{Pose, above};
use common::map::PoleKind;
use mapper::drive::Drive;
use mapper::{Config, PoseSource};
use nalgebra::{Point2, Translation3, UnitQuaternion, Vector3};

use crate::pole_map::{Score, score};

/// Angle from one frame to the next, radians: the golden angle, which spreads any
/// number of frames evenly and puts none of them square to another.
const TURN_RAD: f64 = 2.399_963;
/// And by how much it is moved, right and forward, metres: no multiples of any cell.
const STEP_M: [f64; 2] = [0.37, 0.21];
/// Poles of two frames within this are the same, metres.
const SAME_M: f64 = 0.6;

/// Maps of a drive in several frames.
#[derive(Debug, Clone, Default)]
pub struct Turned {
    /// The score in each frame; the first is the survey's own.
    pub scores: Vec<Score>,
    /// Each pole that was found in any of them.
    pub poles: Vec<TurnedPole>,
}

/// A pole, and the frames that it was found in.
#[derive(Debug, Clone)]
pub struct TurnedPole {
    /// Its foot in the survey's own frame, (x, z), metres.
    pub at: Point2<f64>,
    /// Row of the reference, from 0, where it is in it.
    pub row: Option<usize>,
    /// What it was called in each frame in which it was found.
    pub kinds: Vec<PoleKind>,
}

impl Turned {
    /// Mean, least and largest of what a function says of the scores.
    pub fn spread(&self, of: impl Fn(&Score) -> f64) -> [f64; 3] {
        let values: Vec<f64> = self.scores.iter().map(of).collect();
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        [values.iter().sum::<f64>() / values.len().max(1) as f64, least, most]
    }

    fn add(&mut self, at: Point2<f64>, kind: PoleKind, row: Option<usize>) {
        match self.poles.iter_mut().find(|pole| (pole.at - at).norm() < SAME_M) {
            Some(known) => {
                known.kinds.push(kind);
                known.row = known.row.or(row);
            }
            None => self.poles.push(TurnedPole { at, row, kinds: vec![kind] }),
        }
    }
}

/// The frame of a number, as it lies in the survey's own.
fn turned_from_map(number: u32) -> Pose {
    let n = f64::from(number);
    Pose::from_parts(
        Translation3::new(STEP_M[0] * n, 0.0, STEP_M[1] * n),
        UnitQuaternion::from_axis_angle(&Vector3::y_axis(), TURN_RAD * n),
    )
}

/// Maps a drive in so many frames, and scores the poles of each map.
///
/// # Errors
/// As [`mapper::build()`] and [`score`].
pub fn turned(
    drive: &Drive,
    frames: u32,
    config: &Config,
    root: &Path,
    sequence: &str,
) -> Result<Turned, Box<dyn std::error::Error>> {
    let mut turned = Turned::default();
    for number in 0..frames {
        let turned_from_map = turned_from_map(number);
        let mut drive = drive.clone();
        drive.survey.iter_mut().for_each(|pose| *pose = turned_from_map * *pose);
        let built = mapper::build(&drive, PoseSource::Refine, config, |_| Ok(()))?;
        let score = score(&built.map, &built.registration.map_from_camera, root, sequence)?;
        for (i, pole) in built.map.poles.iter().enumerate() {
            let row = score.found.iter().find(|(_, found)| *found == i).map(|(reference, _)| reference.row);
            turned.add(above(&(turned_from_map.inverse() * pole.foot_map)), pole.kind, row);
        }
        turned.scores.push(score);
    }
    Ok(turned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_keep_what_is_up_and_how_far_things_are_apart() {
        for number in 0..20 {
            let pose = turned_from_map(number);
            let (a, b) = (nalgebra::Point3::new(3.0, -2.0, 40.0), nalgebra::Point3::new(-7.0, 1.5, 12.0));
            assert!(((pose * a - pose * b).norm() - (a - b).norm()).abs() < 1e-9);
            assert!(((pose * a).y - a.y).abs() < 1e-9);
        }
        assert_eq!(turned_from_map(0), Pose::identity());
    }

    #[test]
    fn a_pole_is_the_same_in_all_frames_that_found_it() {
        let mut turned = Turned::default();
        turned.add(Point2::new(1.0, 2.0), PoleKind::LampPost, None);
        turned.add(Point2::new(1.2, 2.1), PoleKind::Trunk, Some(4));
        turned.add(Point2::new(9.0, 2.0), PoleKind::Trunk, None);
        assert_eq!(turned.poles.len(), 2);
        assert_eq!(turned.poles[0].kinds, [PoleKind::LampPost, PoleKind::Trunk]);
        assert_eq!(turned.poles[0].row, Some(4));
    }
}
