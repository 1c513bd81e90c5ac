//! A file of fixes.

use std::collections::BTreeMap;
use std::path::Path;

use common::earth::OnEarth;

use super::{GpsConfig, GpsFix};
use crate::{Error, Result};

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
/// frame is left out. Of a map that is on the Earth rows are `t latitude longitude
/// altitude`, or with a course behind, as [`GpsFix::of_place`] takes them.
///
/// # Errors
/// [`Error::GpsRow`], [`Error::GpsPlace`] and [`Error::GpsFrame`] at their line,
/// [`Error::GpsTime`] where no fix belongs to any frame, and [`common::Error::Io`],
/// [`common::Error::NotText`], [`common::Error::BadNumber`],
/// [`common::Error::NotARotation`] or [`common::Error::Mirrors`].
pub fn read(path: &Path, times_s: &[f64], config: &GpsConfig, on_earth: Option<&OnEarth>) -> Result<FixFile> {
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
        let (place, mut fix) = match on_earth {
            Some(on_earth) => {
                let fix = GpsFix::of_place(&values, config, on_earth);
                let (time_s, fix) = fix.ok_or_else(|| Error::GpsPlace { path: path.to_path_buf(), line })?;
                (Place::Time(time_s), fix)
            }
            None => in_map((path, line, index), &values, config)?,
        };
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

/// What a row says in the map's own metres: its file, its line, and how many come before it.
///
/// # Errors
/// As [`read`], of this row.
fn in_map((path, line, index): (&Path, usize, usize), row: &[f64], config: &GpsConfig) -> Result<(Place, GpsFix)> {
    if let Some(matrix) = row.last_chunk::<12>().filter(|_| row.len() <= 13) {
        common::pose_of(path, line, matrix)?;
    }
    match *row {
        [_, _, forward_x, x, _, _, _, y, _, _, forward_z, z] => {
            Ok((Place::Frame(index), GpsFix::headed([x, y, z], [forward_x, forward_z], config)))
        }
        [frame, _, _, forward_x, x, _, _, _, y, _, _, forward_z, z] => {
            if frame < 0.0 || frame.fract() != 0.0 {
                return Err(Error::GpsFrame { path: path.to_path_buf(), line, found: frame });
            }
            Ok((Place::Frame(frame as usize), GpsFix::headed([x, y, z], [forward_x, forward_z], config)))
        }
        _ => match GpsFix::of_row(row, config) {
            Some((time_s, fix)) => Ok((Place::Time(time_s), fix)),
            None => Err(Error::GpsRow { path: path.to_path_buf(), line, found: row.len() }),
        },
    }
}

/// Whether a row names columns: `nan` and `inf` are numbers, which are none here.
pub(crate) fn is_of_names(row: &str) -> bool {
    let first = row.split(common::is_separator).next().unwrap_or_default();
    first.trim_start_matches('"').starts_with(char::is_alphabetic) && first.parse::<f64>().is_err()
}

/// The error of a number that is none.
pub(crate) fn bad_number(path: &Path, line: usize, text: &str) -> Error {
    let text = text.chars().take(40).collect();
    common::Error::BadNumber { path: path.to_path_buf(), line, text }.into()
}

/// The numbers of a row, separated by blanks or commas.
pub(crate) fn numbers(path: &Path, line: usize, row: &str) -> Result<Vec<f64>> {
    common::words(row).map(|word| word.parse().map_err(|_| bad_number(path, line, word))).collect()
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
    use common::earth::Projection;
    use nalgebra::{Point3, Vector3};

    use super::*;

    fn read_text(text: &str) -> Result<BTreeMap<usize, GpsFix>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("gps.txt");
        std::fs::write(&path, text).unwrap();
        let file = read(&path, &[0.0, 0.1, 0.2, 0.3], &GpsConfig::default(), None)?;
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
        let file = read(&path, &times_s, &GpsConfig::default(), None).unwrap();
        assert_eq!(file.fixes.keys().copied().collect::<Vec<_>>(), [1, 5]);
        assert_eq!(file.astray_lines, [1, 4, 6]);
        std::fs::write(&path, "1 1 0 0 5 0 1 0 6 0 0 1 7\n8 1 0 0 5 0 1 0 6 0 0 1 7\n").unwrap();
        let file = read(&path, &times_s, &GpsConfig::default(), None).unwrap();
        assert_eq!((file.fixes.len(), file.astray_lines), (1, vec![2]));
    }

    #[test]
    fn fixes_of_a_map_on_the_earth_are_degrees() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("gps.csv");
        let on_earth = OnEarth::new("49,8,100".parse().unwrap(), Projection::Topocentric);
        let read_text = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read(&path, &[0.0, 0.1, 0.2], &GpsConfig::default(), Some(&on_earth))
        };
        let fixes = read_text("time,lat,lon,alt\n0.1,49,8,100\n0.2,49,8,100,90\n").unwrap().fixes;
        assert!(fixes[&1].position_map.coords.norm() < 1e-6 && fixes[&1].heading.is_none());
        assert!((fixes[&2].heading.unwrap().0 - std::f64::consts::FRAC_PI_2).abs() < 1e-6);
        for bad in ["0.1,49,8", "0.1,8,49,100", "0.1 1 0 0 5 0 1 0 6 0 0 1 7"] {
            let said = read_text(&format!("0,49,8,100\n{bad}\n")).unwrap_err().to_string();
            assert!(said.contains("gps.csv line 2 is no place") && said.contains("t latitude longitude"), "{said}");
        }
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
}
