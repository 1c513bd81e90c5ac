//! Scores a map's poles against the pole maps of the pole-localization data
//! set of the `PRBonn` group, which were made with another trajectory.

use std::path::Path;

use common::geometry::{Pose, above};
use common::kitti::{Sequence, read_poses};
use common::map::SemanticMap;
use common::{Error, Result};
use nalgebra::{Point2, Point3};

use crate::matching::one_to_one;

/// Poles farther from the driven path than this do not count, metres.
pub const BESIDE_PATH_M: f64 = 15.0;
/// Farthest distance of a found pole from the one it is, metres.
pub const WITHIN_M: f64 = 1.0;

/// Poles of a map against those of the reference.
#[derive(Debug, Clone)]
pub struct Score {
    /// Reference poles that were found, with the index of the pole in the map.
    pub found: Vec<(Reference, usize)>,
    /// Reference poles that were not found.
    pub missed: Vec<Reference>,
    /// Poles of the map that are in no reference.
    pub wrong: Vec<usize>,
}

/// A pole of the reference, in the frame of the map that is scored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    /// Row in the reference, from 0.
    pub row: usize,
    /// Place in the map's (x, z), metres.
    pub at: Point2<f64>,
}

impl Score {
    /// Share of the reference that was found.
    pub fn recall(&self) -> f64 {
        self.found.len() as f64 / (self.found.len() + self.missed.len()).max(1) as f64
    }

    /// Share of the map's poles that are in the reference.
    pub fn precision(&self) -> f64 {
        self.found.len() as f64 / (self.found.len() + self.wrong.len()).max(1) as f64
    }
}

/// Scores the poles of a map that was built with the poses `trajectory` (one
/// per frame) of a drive.
///
/// # Errors
/// What cannot be read: `poses_semantickitti.txt` of the sequence, its
/// calibration, or `ROOT/pole_maps/NN.csv`.
pub fn score(map: &SemanticMap, trajectory: &[Pose], root: &Path, sequence: &str) -> Result<Score> {
    let drive = Sequence::open(root, sequence)?;
    let theirs = read_poses(drive.folder().join("poses_semantickitti.txt"))?;
    let rows = read_pole_map(&root.join("pole_maps").join(format!("{sequence}.csv")))?;
    let (first, last) = driven(map, trajectory).unwrap_or((0, 0));
    let frames = first..(last + 1).min(theirs.len());
    let camera_from_velodyne = drive.calibration()?.camera_from_velodyne;
    let beside = |at: &Point2<f64>, poses: &[Pose]| {
        let nearest = frames.clone().map(|f| (f, (above(&centre(&poses[f])) - at).norm()));
        nearest.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, distance_m)| *distance_m < BESIDE_PATH_M)
    };
    let reference: Vec<Reference> = rows
        .iter()
        .enumerate()
        .filter_map(|(row, p)| {
            // Their map frame is the camera of the first frame; ours is not
            // theirs, but what both saw from a frame stands at the same place
            // before that frame's camera.
            let at = camera_from_velodyne * Point3::new(p.x, p.y, 0.0);
            let (frame, _) = beside(&above(&at), &theirs)?;
            Some(Reference { row, at: above(&(trajectory[frame] * theirs[frame].inverse() * at)) })
        })
        .collect();
    let places: Vec<Point2<f64>> =
        map.poles.iter().map(|p| above(&nalgebra::center(&p.foot_map, &p.top_map))).collect();
    let counted: Vec<usize> = (0..places.len()).filter(|i| beside(&places[*i], trajectory).is_some()).collect();
    let found: Vec<Point2<f64>> = counted.iter().map(|i| places[*i]).collect();
    let wanted: Vec<Point2<f64>> = reference.iter().map(|r| r.at).collect();
    let pairs = one_to_one(&found, &wanted, WITHIN_M);
    let is_found = |w: usize| pairs.iter().any(|(_, pair)| *pair == w);
    let is_right = |f: usize| pairs.iter().any(|(pair, _)| *pair == f);
    Ok(Score {
        found: pairs.iter().map(|(f, w)| (reference[*w], counted[*f])).collect(),
        missed: (0..wanted.len()).filter(|w| !is_found(*w)).map(|w| reference[w]).collect(),
        wrong: (0..found.len()).filter(|f| !is_right(*f)).map(|f| counted[f]).collect(),
    })
}

/// First and last frame of the drive that the map's roads cover.
fn driven(map: &SemanticMap, trajectory: &[Pose]) -> Option<(usize, usize)> {
    let path = || map.roads.iter().flat_map(|road| &road.path_map);
    let frame = |end: &Point3<f64>| {
        let distances = trajectory.iter().map(|pose| (centre(pose) - end).norm());
        distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(frame, _)| frame)
    };
    Some((frame(path().next()?)?, frame(path().last()?)?))
}

fn centre(map_from_camera: &Pose) -> Point3<f64> {
    map_from_camera.translation.vector.into()
}

/// Reads `x,y` rows under a header: metres in the first Velodyne frame.
fn read_pole_map(path: &Path) -> Result<Vec<Point2<f64>>> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    (1..)
        .zip(text.lines())
        .skip(1)
        .filter(|(_, row)| !row.trim().is_empty())
        .map(|(line, row)| {
            let bad = || Error::BadNumber { path: path.to_path_buf(), line, text: row.into() };
            let mut values = row.split(',').map(|value| value.trim().parse::<f64>());
            match (values.next(), values.next()) {
                (Some(Ok(x)), Some(Ok(y))) if x.is_finite() && y.is_finite() => Ok(Point2::new(x, y)),
                _ => Err(bad()),
            }
        })
        .collect()
}
