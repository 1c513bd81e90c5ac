//! Rough positions from outside: a fix file, or noise on a known pose.

use std::collections::BTreeMap;
use std::path::Path;

use common::geometry::{Pose, PoseParameters};
use nalgebra::{Point3, Quaternion, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::filter::State;
use crate::{Error, Result};

/// Norm of a quaternion below which it is no heading.
const LEAST_NORM: f64 = 0.1;

/// Standard deviations of GPS fixes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GpsConfig {
    /// Horizontal position, metres, along each of the two axes.
    pub horizontal_sigma_m: f64,
    /// Heading, degrees.
    pub heading_sigma_deg: f64,
    /// Where the heading is the course over ground (TUM lines): standard
    /// deviation of the velocity across the vehicle, metres per second. The
    /// receiver's is 0.1 to 0.2, and a camera 1.5 m ahead of the axle goes
    /// sideways by 0.3 where the vehicle turns at 0.2 rad/s. 0 for headings that
    /// are measured.
    pub course_sigma_m_s: f64,
    /// Fixes that are simulated, from the first frame on; the paper's 2.
    pub simulated_fixes: usize,
    /// Oldest that a fix may be when an image comes, seconds, where both are taken in as
    /// they come: it is moved on as the camera moved, and that changes meanwhile.
    pub oldest_s: f64,
    /// Fixes bound the pose wherever it is known less well than they are.
    /// Without, they only say where to search and which pose is the likelier.
    pub fuse: bool,
    /// A fix further from what is expected than this is refused, standard
    /// deviations of both: reflections put it tens of metres off.
    pub refused_sigmas: f64,
    /// So many fixes in a row that are refused may be right, and what was
    /// expected wrong: both places are believed until the images tell.
    pub believed_after: usize,
    /// A way from fix to fix says whither a vehicle heads where it is so many standard
    /// deviations of the positions at its ends long.
    pub way_sigmas: f64,
    /// A heading that is off the way by more contradicts it, radians: no corner is as
    /// sharp from one fix to the next.
    pub way_contradicts_rad: f64,
    /// Standard deviation of a heading about the way that led there, radians: half of
    /// what a car turns within a second.
    pub way_turned_rad: f64,
}

impl Default for GpsConfig {
    fn default() -> Self {
        Self {
            horizontal_sigma_m: 1.5,
            heading_sigma_deg: 2.0,
            course_sigma_m_s: 0.35,
            simulated_fixes: 2,
            oldest_s: 1.0,
            fuse: false,
            refused_sigmas: 4.0,
            believed_after: 3,
            way_sigmas: 3.0,
            way_contradicts_rad: 1.0,
            way_turned_rad: 0.2,
        }
    }
}

/// A rough position. Only its horizontal part and its heading are used: the
/// height of a GPS is worse than the map's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GpsFix {
    /// Position of the reference camera, map frame, metres.
    pub position_map: Point3<f64>,
    /// Standard deviation of the position along each horizontal axis, metres.
    pub horizontal_sigma_m: f64,
    /// Heading about the down axis and its standard deviation, radians.
    pub heading: Option<(f64, f64)>,
    /// The heading is the course over ground: of little worth at walking pace.
    pub is_course: bool,
    /// How long before the image it was taken, seconds; negative after it.
    pub age_s: f64,
}

impl GpsFix {
    /// A fix with the configured standard deviations; the heading is the
    /// pose's.
    pub fn from_pose(map_from_camera: &Pose, config: &GpsConfig) -> Self {
        let parameters = PoseParameters::from_pose(map_from_camera);
        Self {
            position_map: Point3::from(map_from_camera.translation.vector),
            horizontal_sigma_m: config.horizontal_sigma_m,
            heading: Some((parameters.yaw_rad, config.heading_sigma_deg.to_radians())),
            is_course: false,
            age_s: 0.0,
        }
    }

    /// A fix at a position, metres, with a forward direction right and forward.
    fn headed(position: [f64; 3], [forward_x, forward_z]: [f64; 2], config: &GpsConfig) -> Self {
        let heading = Some((forward_x.atan2(forward_z), config.heading_sigma_deg.to_radians()));
        Self { heading, ..Self::at(position, config) }
    }

    /// A fix at a position, metres, that knows no heading.
    fn at(position: [f64; 3], config: &GpsConfig) -> Self {
        let horizontal_sigma_m = config.horizontal_sigma_m;
        Self { position_map: Point3::from(position), horizontal_sigma_m, heading: None, is_course: false, age_s: 0.0 }
    }

    /// The time of a row `t x y z` or `t x y z qx qy qz qw` (TUM), seconds, and its fix;
    /// none of other rows. A heading is the course over ground.
    pub fn of_row(row: &[f64], config: &GpsConfig) -> Option<(f64, Self)> {
        match *row {
            [time_s, x, y, z] => Some((time_s, Self::at([x, y, z], config))),
            [time_s, x, y, z, i, j, k, w] => {
                // Four zeros are how receivers say that they know no heading.
                let rotation = UnitQuaternion::try_new(Quaternion::new(w, i, j, k), LEAST_NORM);
                let forward = rotation.map(|rotation| rotation * Vector3::z());
                let headed = forward.map(|forward| Self::headed([x, y, z], [forward.x, forward.z], config));
                let fix = headed.unwrap_or_else(|| Self::at([x, y, z], config));
                Some((time_s, Self { is_course: true, ..fix }))
            }
            _ => None,
        }
    }

    /// The same at the time of the image, which a camera of this velocity, m/s in the map,
    /// came to.
    #[must_use]
    pub fn moved_on(self, velocity_map: &Vector3<f64>) -> Self {
        Self { position_map: self.position_map + velocity_map * self.age_s, age_s: 0.0, ..self }
    }

    /// The heading at a speed, and how well it is known then, radians.
    pub fn heading_at(&self, speed_m_s: f64, config: &GpsConfig) -> Option<(f64, f64)> {
        let across_m_s = if self.is_course { config.course_sigma_m_s } else { 0.0 };
        let turned_rad = across_m_s.atan2(speed_m_s.abs());
        self.heading.map(|(yaw_rad, sigma_rad)| (yaw_rad, sigma_rad.hypot(turned_rad)))
    }

    /// How far the fix is from a state's position, right and forward, metres;
    /// none where it is further than can be believed.
    pub fn offset(&self, state: &State, config: &GpsConfig) -> Option<[f64; 2]> {
        let pose = &state.map_from_camera;
        let off = pose.rotation.inverse() * (self.position_map.coords - pose.translation.vector);
        let is_near = |component: usize| {
            let own_m2 = state.covariance[(component, component)];
            let sigma_m = (own_m2 + self.horizontal_sigma_m * self.horizontal_sigma_m).sqrt();
            off[component].abs() <= config.refused_sigmas * sigma_m
        };
        (is_near(0) && is_near(2)).then_some([off.x, off.z])
    }
}

/// Fixes with Gaussian noise on true poses: the same for the same seed.
pub fn simulate(truth: &[Pose], config: &GpsConfig, seed: u64) -> Vec<GpsFix> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut normal = move || -> f64 { StandardNormal.sample(&mut random) };
    truth
        .iter()
        .map(|pose| {
            let mut fix = GpsFix::from_pose(pose, config);
            fix.position_map.x += config.horizontal_sigma_m * normal();
            fix.position_map.z += config.horizontal_sigma_m * normal();
            let turn_rad = config.heading_sigma_deg.to_radians() * normal();
            fix.heading = fix.heading.map(|(yaw_rad, sigma_rad)| (yaw_rad + turn_rad, sigma_rad));
            fix
        })
        .collect()
}

/// What a file of fixes says.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FixFile {
    /// The fixes by their frames.
    pub fixes: BTreeMap<usize, GpsFix>,
    /// The lines of those that belong to no frame.
    pub astray_lines: Vec<usize>,
}

/// Which frame a row is of.
enum Place {
    Frame(usize),
    /// The one that is nearest to a time, seconds.
    Time(f64),
}

/// Reads fixes of given frames: rows `t x y z`, `t x y z qx qy qz qw` (TUM;
/// the frame is the one of `times_s` that is nearest, and of several of a frame the
/// nearest one is taken), `frame` and a 3x4 pose,
/// or a 3x4 pose for each frame from 0 on (twelve `nan` for none). Only the
/// horizontal position is used, and the heading where the row has one. A receiver
/// is on before the camera and after it, and while it pauses: what belongs to no
/// frame is left out.
///
/// # Errors
/// [`Error::GpsRow`] and [`Error::GpsFrame`] at their line, [`Error::GpsTime`] where
/// no fix belongs to any frame, and [`common::Error::Io`],
/// [`common::Error::NotText`], [`common::Error::BadNumber`],
/// [`common::Error::NotARotation`] or [`common::Error::Mirrors`].
pub fn read(path: &Path, times_s: &[f64], config: &GpsConfig) -> Result<FixFile> {
    let text = common::read_text(path)?;
    let mut file = FixFile::default();
    let mut first_astray = None;
    let rows = text.lines().enumerate().map(|(i, row)| (i + 1, row.trim()));
    let mut rows = rows.filter(|(_, row)| !row.is_empty() && !row.starts_with('#')).peekable();
    rows.next_if(|(_, row)| is_of_names(row));
    for (index, (line, row)) in rows.enumerate() {
        let values = numbers(path, line, row)?;
        if values.len() == 12 && values.iter().all(|v| v.is_nan()) {
            continue;
        }
        if let Some(bad) = values.iter().find(|v| !v.is_finite()) {
            return Err(bad_number(path, line, &bad.to_string()));
        }
        let (place, mut fix) = match *values.as_slice() {
            [_, _, forward_x, x, _, _, _, y, _, _, forward_z, z] => {
                (Place::Frame(index), GpsFix::headed([x, y, z], [forward_x, forward_z], config))
            }
            [frame, _, _, forward_x, x, _, _, _, y, _, _, forward_z, z] => {
                if frame < 0.0 || frame.fract() != 0.0 {
                    return Err(Error::GpsFrame { path: path.to_path_buf(), line, found: frame });
                }
                (Place::Frame(frame as usize), GpsFix::headed([x, y, z], [forward_x, forward_z], config))
            }
            _ => match GpsFix::of_row(&values, config) {
                Some((time_s, fix)) => (Place::Time(time_s), fix),
                None => return Err(Error::GpsRow { path: path.to_path_buf(), line, found: values.len() }),
            },
        };
        if let Some(matrix) = values.last_chunk::<12>().filter(|_| values.len() >= 12) {
            common::pose_of(path, line, matrix)?;
        }
        let frame = match place {
            Place::Frame(frame) => Some(frame).filter(|frame| *frame < times_s.len()),
            Place::Time(time_s) => frame_at(time_s, times_s).map_err(|off_s| (time_s, off_s)).map_or_else(
                |off| {
                    first_astray.get_or_insert((line, off));
                    None
                },
                |(frame, age_s)| {
                    fix.age_s = age_s;
                    Some(frame)
                },
            ),
        };
        let Some(frame) = frame else {
            file.astray_lines.push(line);
            continue;
        };
        let known = file.fixes.entry(frame).or_insert(fix);
        if fix.age_s.abs() <= known.age_s.abs() {
            *known = fix;
        }
    }
    match first_astray.filter(|_| file.fixes.is_empty()) {
        Some((line, (time_s, off_s))) => Err(Error::GpsTime { path: path.to_path_buf(), line, time_s, off_s }),
        None => Ok(file),
    }
}

/// What stands between the words of a row.
pub(crate) const SEPARATORS: [char; 3] = [' ', '\t', ','];

/// Whether a row names columns: `nan` and `inf` are numbers, which are none here.
pub(crate) fn is_of_names(row: &str) -> bool {
    let first = row.split(SEPARATORS).next().unwrap_or_default();
    first.trim_start_matches('"').starts_with(char::is_alphabetic) && first.parse::<f64>().is_err()
}

/// The error of a number that is none.
pub(crate) fn bad_number(path: &Path, line: usize, text: &str) -> Error {
    let text = text.chars().take(40).collect();
    common::Error::BadNumber { path: path.to_path_buf(), line, text }.into()
}

/// The numbers of a row, separated by blanks or commas.
pub(crate) fn numbers(path: &Path, line: usize, row: &str) -> Result<Vec<f64>> {
    row.split(SEPARATORS)
        .filter(|word| !word.is_empty())
        .map(|word| word.parse().map_err(|_| bad_number(path, line, word)))
        .collect()
}

/// The frame whose time is nearest, at most half a frame away, and by how much it is later,
/// seconds; else how far away it is.
fn frame_at(time_s: f64, times_s: &[f64]) -> std::result::Result<(usize, f64), f64> {
    let later_s = |frame: usize| times_s[frame] - time_s;
    // Times ascend.
    let after = times_s.partition_point(|at_s| *at_s < time_s);
    let beside = [after.checked_sub(1), Some(after).filter(|after| *after < times_s.len())];
    let nearest = beside.into_iter().flatten().min_by(|a, b| later_s(*a).abs().total_cmp(&later_s(*b).abs()));
    let span_s = times_s.last().zip(times_s.first()).map_or(0.0, |(last, first)| last - first);
    let half_s = 0.5 * span_s / times_s.len().saturating_sub(1).max(1) as f64;
    let frame = nearest.ok_or(f64::INFINITY)?;
    let later_s = later_s(frame);
    if later_s.abs() <= half_s + 1e-9 { Ok((frame, later_s)) } else { Err(later_s.abs()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<BTreeMap<usize, GpsFix>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("gps.txt");
        std::fs::write(&path, text).unwrap();
        let file = read(&path, &[0.0, 0.1, 0.2, 0.3], &GpsConfig::default())?;
        assert!(file.astray_lines.is_empty());
        Ok(file.fixes)
    }

    #[test]
    fn every_form_of_row_is_read() {
        let fixes = read_text("# t x y z\n0.11 1 2 3\n0.3 1 2 3 0 0.7071068 0 0.7071068\n").unwrap();
        assert_eq!(fixes.keys().copied().collect::<Vec<_>>(), [1, 3]);
        assert!(fixes[&1].heading.is_none());
        assert!((fixes[&3].heading.unwrap().0 - std::f64::consts::FRAC_PI_2).abs() < 1e-6);
        let fixes = read_text("2 1 0 0 5 0 1 0 6 0 0 1 7\n").unwrap();
        assert!((fixes[&2].position_map - Point3::new(5.0, 6.0, 7.0)).norm() < 1e-12);
        // Receivers that know no heading.
        let fixes = read_text("0.2 1 2 3 0 0 0 0\n").unwrap();
        assert!(fixes[&2].heading.is_none() && fixes[&2].position_map == Point3::new(1.0, 2.0, 3.0));
        let none = "nan ".repeat(12);
        let fixes = read_text(&format!("{none}\n1 0 0 5 0 1 0 6 0 0 1 7\n")).unwrap();
        assert_eq!(fixes.keys().copied().collect::<Vec<_>>(), [1]);
    }

    #[test]
    fn of_many_fixes_the_nearest_to_a_frame_is_taken_and_moved_on() {
        let rows: Vec<String> = (0..31).map(|i| format!("{:.2} {i} 0 0", f64::from(i) * 0.01)).collect();
        let fixes = read_text(&rows.join("\n")).unwrap();
        let at_m: Vec<f64> = fixes.values().map(|fix| fix.position_map.x).collect();
        assert_eq!(at_m, [0.0, 10.0, 20.0, 30.0]);
        // A receiver that is 40 ms later than the camera, and one that is earlier.
        let fixes = read_text("0.14 14 0 0\n0.26 26 0 0\n").unwrap();
        let moved: Vec<f64> =
            fixes.values().map(|fix| fix.moved_on(&Vector3::new(100.0, 0.0, 0.0)).position_map.x).collect();
        assert!((moved[0] - 10.0).abs() < 1e-9 && (moved[1] - 30.0).abs() < 1e-9, "{moved:?}");
        assert_eq!(fixes.keys().copied().collect::<Vec<_>>(), [1, 3]);
    }

    #[test]
    fn a_course_says_little_of_the_heading_at_walking_pace() {
        let fixes = read_text("0.1 1 2 3 0 0 0 1\n").unwrap();
        let sigma_deg = |speed_m_s| fixes[&1].heading_at(speed_m_s, &GpsConfig::default()).unwrap().1.to_degrees();
        assert!((1.99..2.5).contains(&sigma_deg(20.0)), "{}", sigma_deg(20.0));
        assert!((18.0..22.0).contains(&sigma_deg(1.0)) && sigma_deg(0.0) > 80.0, "{}", sigma_deg(1.0));
        // A heading that is measured is known at a standstill, too.
        let measured = read_text("1 0 0 5 0 1 0 6 0 0 1 7\n").unwrap();
        assert!((measured[&0].heading_at(0.0, &GpsConfig::default()).unwrap().1.to_degrees() - 2.0).abs() < 1e-9);
    }

    #[test]
    fn a_bad_row_is_named_with_its_line() {
        assert!(matches!(read_text("0.0 1 2 3\n0.1 1 2\n"), Err(Error::GpsRow { line: 2, found: 3, .. })));
        assert!(matches!(read_text("9.0 1 2 3\n"), Err(Error::GpsTime { line: 1, .. })));
        assert!(read_text("0.0 1 x 3\n").unwrap_err().to_string().contains('x'));
        assert!(read_text("nan 1 2 3\n").unwrap_err().to_string().contains("gps.txt:1: `NaN` is not a finite number"));
        for frame in ["-1", "2.5"] {
            let error = read_text(&format!("{frame} 1 0 0 5 0 1 0 6 0 0 1 7\n")).unwrap_err().to_string();
            assert!(error.contains(frame), "{error}");
        }
    }

    #[test]
    fn a_fix_of_no_frame_costs_itself_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("gps.txt");
        // Four frames, a pause of a second, four more.
        let times_s = [0.0, 0.1, 0.2, 0.3, 1.3, 1.4, 1.5, 1.6];
        std::fs::write(&path, "-3 1 2 3\n0.1 1 2 3\n# in the pause\n0.8 1 2 3\n1.4 1 2 3\n99 1 2 3\n").unwrap();
        let file = read(&path, &times_s, &GpsConfig::default()).unwrap();
        assert_eq!(file.fixes.keys().copied().collect::<Vec<_>>(), [1, 5]);
        assert_eq!(file.astray_lines, [1, 4, 6]);
        std::fs::write(&path, "1 1 0 0 5 0 1 0 6 0 0 1 7\n8 1 0 0 5 0 1 0 6 0 0 1 7\n").unwrap();
        let file = read(&path, &times_s, &GpsConfig::default()).unwrap();
        assert_eq!((file.fixes.len(), file.astray_lines), (1, vec![2]));
    }

    #[test]
    fn a_pose_that_is_no_rotation_is_named_with_its_line() {
        let good = "1 0 0 5 0 1 0 6 0 0 1 7";
        let said = |row: &str| read_text(&format!("{row}\n")).unwrap_err().to_string();
        // Twelve other numbers, none at all, a mirror.
        for bad in ["1 2 3 5 0 1 0 6 0 0 1 7", "0 0 0 5 0 0 0 6 0 0 0 7", "1 0 0 5 0 1 0 6 0 0 -1 7"] {
            assert!(said(&format!("{good}\n{bad}")).contains("gps.txt:2: the "), "{bad}");
            assert!(said(&format!("0 {good}\n1 {bad}")).contains("gps.txt:2: the "), "{bad}");
        }
    }

    #[test]
    fn simulated_fixes_repeat_with_their_seed_and_spread_as_stated() {
        let config = GpsConfig::default();
        let truth = vec![Pose::identity(); 4000];
        let fixes = simulate(&truth, &config, 3);
        assert_eq!(fixes, simulate(&truth, &config, 3));
        assert_ne!(fixes, simulate(&truth, &config, 4));
        let spread = |value: fn(&GpsFix) -> f64| {
            (fixes.iter().map(|f| value(f).powi(2)).sum::<f64>() / fixes.len() as f64).sqrt()
        };
        assert!((spread(|f| f.position_map.x) - 1.5).abs() < 0.1);
        assert!((spread(|f| f.position_map.z) - 1.5).abs() < 0.1);
        assert!((spread(|f| f.heading.unwrap().0) - 2.0_f64.to_radians()).abs() < 0.003);
    }
}
