//! What a run leaves on disk, and how it is read back.
//!
//! `estimates.csv` says everything about each frame and is the same for the
//! same input; how long things took stands in `timing.csv`.

use std::fmt::Write as _;
use std::path::Path;

use common::atomic_file;
use common::earth::{Geodetic, OnEarth};
use common::geometry::Pose;
use common::map::Numbering;
use common::trajectory::{StampedPose, Trajectory};
use nalgebra::{Matrix6, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};

use crate::estimate::{LandmarkId, Status};
use crate::run::FrameResult;
use crate::{Error, Result};

/// Names of the tangent's components, as they stand in the CSV's header.
const AXES: [&str; 6] = ["right", "down", "forward", "pitch", "yaw", "roll"];
/// Columns of `estimates.csv` before the covariance.
const LEADING: &str = "frame,time_s,status,x_m,y_m,z_m,qx,qy,qz,qw,poles,lanes,signs,correspondences,\
                       residual_px,support,margin,iterations,converged,time_sigma_s";
/// Its last columns, of a map that is on the Earth.
const PLACE: &str = ",latitude_deg,longitude_deg,altitude_m,heading_deg";
const TIMING: &str = "frame,maps_ms,features_ms,localize_ms";

/// Writes `poses.txt` (KITTI), `poses.tum`, `estimates.csv`, `matches.csv`
/// (what was matched with what, landmarks by their `numbers`) and `timing.csv`
/// into a folder that exists. Of a map that is on the Earth estimates say where.
///
/// # Errors
/// As [`atomic_file::write`].
pub fn write(folder: &Path, results: &[FrameResult], numbers: Numbering, on_earth: Option<&OnEarth>) -> Result<()> {
    let stamps = results
        .iter()
        .map(|r| StampedPose { frame: r.frame, time_s: r.time_s, map_from_camera: r.estimate.map_from_camera })
        .collect();
    let trajectory = Trajectory { stamps };
    trajectory.write_kitti(folder.join("poses.txt"))?;
    trajectory.write_tum(folder.join("poses.tum"))?;
    atomic_file::write(folder.join("estimates.csv"), estimates_csv(results, on_earth).as_bytes())?;
    atomic_file::write(folder.join("matches.csv"), matches_csv(results, numbers).as_bytes())?;
    atomic_file::write(folder.join("timing.csv"), timing_csv(results).as_bytes())?;
    Ok(())
}

fn estimates_csv(results: &[FrameResult], on_earth: Option<&OnEarth>) -> String {
    let rows = results.iter().map(|result| estimates_row(result, on_earth));
    std::iter::once(estimates_header(on_earth)).chain(rows).collect()
}

/// The first line of `estimates.csv`, of a map that is or is not on the Earth.
pub fn estimates_header(on_earth: Option<&OnEarth>) -> String {
    let mut text = String::from(LEADING);
    for (i, axis) in AXES.iter().enumerate() {
        let _ = write!(text, ",sigma_{axis}_{}", if i < 3 { "m" } else { "rad" });
    }
    for (i, row) in AXES.iter().enumerate() {
        for column in &AXES[i..] {
            let _ = write!(text, ",cov_{row}_{column}");
        }
    }
    text.push_str(on_earth.map_or("", |_| PLACE));
    text.push('\n');
    text
}

/// A frame's line of `estimates.csv`.
pub fn estimates_row(result: &FrameResult, on_earth: Option<&OnEarth>) -> String {
    let mut text = String::new();
    let estimate = &result.estimate;
    let t = estimate.map_from_camera.translation.vector;
    let q = estimate.map_from_camera.rotation.coords;
    let _ = write!(
        text,
        "{},{:.6},{},{:.4},{:.4},{:.4},{:.8},{:.8},{:.8},{:.8},{},{},{},{},{:.3},{:.3},{:.3},{},{},{:.4}",
        result.frame,
        result.time_s,
        estimate.status,
        t.x,
        t.y,
        t.z,
        q.x,
        q.y,
        q.z,
        q.w,
        result.features[0],
        result.features[1],
        result.features[2],
        estimate.correspondences.len(),
        estimate.residual_rms_px,
        estimate.support,
        estimate.margin,
        estimate.iterations,
        u8::from(estimate.converged),
        estimate.time_sigma_s,
    );
    for sigma in estimate.sigmas() {
        let _ = write!(text, ",{sigma:.6}");
    }
    for i in 0..6 {
        for j in i..6 {
            let _ = write!(text, ",{:.9e}", estimate.covariance[(i, j)]);
        }
    }
    if let Some(on_earth) = on_earth {
        let at_map = Point3::from(t);
        let place = on_earth.place(&at_map);
        let forward = estimate.map_from_camera.rotation * Vector3::z();
        let heading_deg = on_earth.bearing_rad(&at_map, &forward).to_degrees();
        let Geodetic { latitude_deg, longitude_deg, altitude_m } = place;
        // A tenth of a millimetre, as the metres are.
        let _ = write!(text, ",{latitude_deg:.9},{longitude_deg:.9},{altitude_m:.3},{heading_deg:.4}");
    }
    text.push('\n');
    text
}

fn matches_csv(results: &[FrameResult], numbers: Numbering) -> String {
    let mut text = String::from("frame,semantics,landmark,feature,residual_px,weight\n");
    for result in results {
        for found in &result.estimate.correspondences {
            let (semantics, landmark) = match found.landmark {
                LandmarkId::Pole(index) => ("pole", numbers.pole(index)),
                LandmarkId::Lane(index) => ("lane", numbers.lane(index)),
                LandmarkId::Sign(index) => ("sign", numbers.sign(index)),
                LandmarkId::Marks(index) => ("marks", numbers.lane(index)),
            };
            let (residual_px, weight) = (found.residual_px, found.weight);
            let _ = writeln!(
                text,
                "{},{semantics},{landmark},{},{residual_px:.3},{weight:.4}",
                result.frame, found.feature
            );
        }
    }
    text
}

fn timing_csv(results: &[FrameResult]) -> String {
    let mut text = format!("{TIMING}\n");
    for r in results {
        let _ = writeln!(text, "{},{:.4},{:.4},{:.4}", r.frame, r.maps_ms, r.features_ms, r.localize_ms);
    }
    text
}

/// One frame of `estimates.csv`, as far as the evaluation needs it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recorded {
    /// Index of the frame in its sequence.
    pub frame: usize,
    /// The pose.
    pub map_from_camera: Pose,
    /// What the localizer said of it; none for files without a status.
    pub status: Option<Status>,
    /// Number of correspondences, where the file has them.
    pub correspondences: Option<usize>,
    /// Covariance in the tangent at the pose, where the file has one.
    pub covariance: Option<Matrix6<f64>>,
}

impl From<&FrameResult> for Recorded {
    fn from(result: &FrameResult) -> Self {
        Self {
            frame: result.frame,
            map_from_camera: result.estimate.map_from_camera,
            status: Some(result.estimate.status),
            correspondences: Some(result.estimate.correspondences.len()),
            covariance: Some(result.estimate.covariance),
        }
    }
}

/// Times of one frame, milliseconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// The frame.
    pub frame: usize,
    /// Probabilities: networks, or reading labels.
    pub maps_ms: f64,
    /// Features from them.
    pub features_ms: f64,
    /// Association and pose.
    pub localize_ms: f64,
}

/// Reads `estimates.csv`. Lines that begin with `#` say of images that were not
/// localized why, where they were answered as they came.
///
/// # Errors
/// [`common::Error::Io`], or [`Error::BadResult`] at its line.
pub fn read_estimates(path: &Path) -> Result<Vec<Recorded>> {
    let leading: Vec<&str> = LEADING.split(',').collect();
    let rows = rows(path, &leading)?;
    let mut before: Option<usize> = None;
    rows.iter()
        .map(|(line, words)| {
            let number = |i: usize| number(path, *line, words, i);
            let quaternion = Quaternion::new(number(9)?, number(6)?, number(7)?, number(8)?);
            if (quaternion.norm() - 1.0).abs() > 1e-3 {
                return Err(bad(path, *line, "has a quaternion that is not of unit length"));
            }
            let frame = frame(path, *line, words)?;
            if before.replace(frame).is_some_and(|before| before >= frame) {
                return Err(bad(path, *line, format!("has frame {frame}, no later than the one above it")));
            }
            let status = words.get(2).and_then(|word| Status::from_word(word));
            Ok(Recorded {
                frame,
                map_from_camera: Pose::from_parts(
                    Translation3::new(number(3)?, number(4)?, number(5)?),
                    UnitQuaternion::from_quaternion(quaternion),
                ),
                status: Some(status.ok_or_else(|| bad(path, *line, "has an unknown status"))?),
                correspondences: Some(number(13)? as usize),
                covariance: Some(covariance(&number)?),
            })
        })
        .collect()
}

/// The upper triangle that ends a row of `estimates.csv`.
fn covariance(number: &impl Fn(usize) -> Result<f64>) -> Result<Matrix6<f64>> {
    let mut column = LEADING.split(',').count() + AXES.len();
    let mut covariance = Matrix6::zeros();
    for i in 0..AXES.len() {
        for j in i..AXES.len() {
            covariance[(i, j)] = number(column)?;
            covariance[(j, i)] = covariance[(i, j)];
            column += 1;
        }
    }
    Ok(covariance)
}

/// Reads `timing.csv`.
///
/// # Errors
/// As [`read_estimates`].
pub fn read_timing(path: &Path) -> Result<Vec<Timing>> {
    let leading: Vec<&str> = TIMING.split(',').collect();
    rows(path, &leading)?
        .iter()
        .map(|(line, words)| {
            let number = |i: usize| number(path, *line, words, i);
            let frame = frame(path, *line, words)?;
            Ok(Timing { frame, maps_ms: number(1)?, features_ms: number(2)?, localize_ms: number(3)? })
        })
        .collect()
}

fn bad(path: &Path, line: usize, problem: impl Into<String>) -> Error {
    Error::BadResult { path: path.to_path_buf(), line, problem: problem.into() }
}

fn number(path: &Path, line: usize, words: &[String], column: usize) -> Result<f64> {
    let word = words.get(column).map_or("", String::as_str);
    let value = word.parse::<f64>().ok().filter(|v| v.is_finite());
    value.ok_or_else(|| bad(path, line, format!("has `{word}` in column {}", column + 1)))
}

/// The frame of a row: neither -3 nor 1.5 is one.
fn frame(path: &Path, line: usize, words: &[String]) -> Result<usize> {
    let word = words.first().map_or("", String::as_str);
    word.parse().map_err(|_| bad(path, line, format!("has `{word}` in column 1, which is no frame")))
}

/// The rows below a header that begins with `leading`, each with its line.
fn rows(path: &Path, leading: &[&str]) -> Result<Vec<(usize, Vec<String>)>> {
    let text = common::read_text(path)?;
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    if !header.starts_with(leading) {
        return Err(bad(path, 1, format!("does not begin with `{}`", leading.join(","))));
    }
    let words = |row: &str| row.split(',').map(str::to_owned).collect::<Vec<_>>();
    let told = lines.enumerate().filter(|(_, row)| !row.starts_with('#'));
    let rows: Vec<(usize, Vec<String>)> = told.map(|(i, row)| (i + 2, words(row))).collect();
    match rows.iter().find(|(_, row)| row.len() != header.len()) {
        Some((line, row)) => Err(bad(path, *line, format!("has {} columns instead of {}", row.len(), header.len()))),
        None => Ok(rows),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::{Correspondence, PoseEstimate};
    use common::earth::Projection;
    use common::geometry::PoseParameters;
    use nalgebra::Matrix6;

    fn result(frame: usize) -> FrameResult {
        let pose = PoseParameters { x_m: 1.5, y_m: -0.2, z_m: 30.0, yaw_rad: 0.4, pitch_rad: 0.01, roll_rad: -0.02 };
        let estimate = PoseEstimate {
            map_from_camera: pose.to_pose(),
            covariance: Matrix6::identity() * 0.04,
            correspondences: Vec::new(),
            residual_rms_px: 1.25,
            iterations: 7,
            converged: true,
            status: Status::Degraded,
            support: 12.0,
            margin: f64::INFINITY,
            time_sigma_s: 0.025,
        };
        FrameResult {
            frame,
            time_s: 0.1 * frame as f64,
            estimate,
            features: [4, 2, 1],
            maps_ms: 5.0,
            features_ms: 3.0,
            localize_ms: 0.5,
        }
    }

    #[test]
    fn what_was_written_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let mut results = [result(2), result(5)];
        let matched = |landmark| Correspondence { landmark, feature: 3, residual_px: 0.5, weight: 1.0 };
        let landmarks = [LandmarkId::Pole(1), LandmarkId::Sign(0), LandmarkId::Lane(2), LandmarkId::Marks(2)];
        results[1].estimate.correspondences = landmarks.map(matched).to_vec();
        write(folder.path(), &results, Numbering::new(10, 5, 3), None).unwrap();
        // Poles, signs and lines are counted on, as in exports.
        let matches = std::fs::read_to_string(folder.path().join("matches.csv")).unwrap();
        let numbers: Vec<&str> = matches.lines().skip(1).filter_map(|line| line.split(',').nth(2)).collect();
        assert_eq!(numbers, ["2", "11", "18", "18"]);
        let read = read_estimates(&folder.path().join("estimates.csv")).unwrap();
        assert_eq!(read.iter().map(|r| r.frame).collect::<Vec<_>>(), [2, 5]);
        let off = common::geometry::local(&results[0].estimate.map_from_camera, &read[0].map_from_camera);
        assert!(off.norm() < 1e-4);
        assert!((read[0].covariance.unwrap() - results[0].estimate.covariance).norm() < 1e-6);
        assert_eq!(read[1].status, Some(Status::Degraded));
        let timing = read_timing(&folder.path().join("timing.csv")).unwrap();
        assert!((timing[1].localize_ms - 0.5).abs() < 1e-9);
        let kitti = Trajectory::read_kitti(folder.path().join("poses.txt"), &[0.0; 6]).unwrap();
        assert_eq!(kitti.stamps.iter().map(|s| s.frame).collect::<Vec<_>>(), [2, 5]);
    }

    #[test]
    fn the_sigmas_are_the_diagonal_and_the_triangle_is_whole() {
        let text = estimates_csv(&[result(0)], None);
        let mut lines = text.lines();
        let header: Vec<&str> = lines.next().unwrap().split(',').collect();
        let row: Vec<&str> = lines.next().unwrap().split(',').collect();
        assert_eq!(header.len(), row.len());
        assert_eq!(header.iter().filter(|h| h.starts_with("cov_")).count(), 21);
        let at = |name: &str| row[header.iter().position(|h| *h == name).unwrap()].parse::<f64>().unwrap();
        assert!((at("sigma_yaw_rad") - 0.2).abs() < 1e-9 && (at("cov_yaw_yaw") - 0.04).abs() < 1e-9);
    }

    #[test]
    fn of_a_map_on_the_earth_a_row_ends_with_the_place() {
        let on_earth = OnEarth::new("49,8,100,90".parse().unwrap(), Projection::Topocentric);
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &[result(2)], Numbering::new(1, 1, 1), Some(&on_earth)).unwrap();
        let path = folder.path().join("estimates.csv");
        let text = std::fs::read_to_string(&path).unwrap();
        let last: Vec<Vec<&str>> = text.lines().map(|line| line.rsplitn(5, ',').take(4).collect()).collect();
        assert_eq!(last[0], ["heading_deg", "altitude_m", "longitude_deg", "latitude_deg"]);
        let [heading_deg, altitude_m, east_deg, north_deg] = [0, 1, 2, 3].map(|i| last[1][i].parse::<f64>().unwrap());
        // 30 m ahead in the east, 1.5 m to the right of it, 0.2 m up, turned by 0.4 rad to the right.
        assert!((heading_deg - 90.0 - 0.4_f64.to_degrees()).abs() < 0.01, "{heading_deg}");
        assert!((altitude_m - 100.2).abs() < 0.01 && (east_deg - 8.0 - 30.0 / 73_172.0).abs() < 1e-7, "{east_deg}");
        assert!((north_deg - 49.0 + 1.5 / 111_210.0).abs() < 1e-7, "{north_deg}");
        // Who reads estimates finds them as ever.
        assert_eq!(read_estimates(&path).unwrap()[0].frame, 2);
    }

    #[test]
    fn a_file_that_is_no_result_is_refused_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("estimates.csv");
        std::fs::write(&path, "a,b\n1,2\n").unwrap();
        assert!(matches!(read_estimates(&path), Err(Error::BadResult { line: 1, .. })));
        let good = estimates_csv(&[result(0), result(1)], None);
        std::fs::write(&path, good.trim_end().rsplit_once(',').unwrap().0).unwrap();
        assert!(matches!(read_estimates(&path), Err(Error::BadResult { line: 3, .. })));
        for frame in ["-3", "1.5", "0", ""] {
            std::fs::write(&path, good.replace("\n1,", &format!("\n{frame},"))).unwrap();
            let said = read_estimates(&path).unwrap_err().to_string();
            assert!(said.contains("line 3 has ") && said.contains(frame), "{said}");
        }
    }
}
