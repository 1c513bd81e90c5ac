//! Text files of numbers, read with the line of every fault.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{Matrix3, Matrix3x4, Translation3, UnitQuaternion, Vector3};

use crate::geometry::{Pose, nearest_rotation};
use crate::{Error, Result};

/// The largest difference between an entry of a given rotation matrix and the
/// nearest rotation. KITTI prints seven digits; a thousandth is a rotation of
/// 0.06 degrees or a scale of 0.1 %, which no such file should have.
pub(crate) const ROTATION_LIMIT: f64 = 1e-3;

/// The largest distance of two sensors of a vehicle, metres: a tram is shorter. In
/// millimetres, those of a car are more apart.
pub(crate) const MOUNTING_LIMIT_M: f64 = 100.0;

/// What some editors begin text with.
const BYTE_ORDER_MARK: char = '\u{feff}';

/// The whole file as text, without a byte order mark.
///
/// # Errors
/// [`Error::Io`] where it cannot be read, [`Error::NotText`] where it is not UTF-8.
pub fn read(path: &Path) -> Result<String> {
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    let mut text = String::from_utf8(bytes)
        .map_err(|e| Error::NotText { path: path.to_path_buf(), at: e.utf8_error().valid_up_to() })?;
    if text.starts_with(BYTE_ORDER_MARK) {
        text.drain(..BYTE_ORDER_MARK.len_utf8());
    }
    Ok(text)
}

/// The lines that hold something, each with its number (from 1). Comments
/// begin with `#`.
pub(crate) fn rows(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .map(|(index, row)| (index + 1, row.trim()))
        .filter(|(_, row)| !row.is_empty() && !row.starts_with('#'))
}

/// The same without a first line that names the columns, as tables have it: as many words as a
/// pose may have, of which none is a number.
pub(crate) fn rows_below_names(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut rows = rows(text).peekable();
    rows.next_if(|(_, row)| words(row).count() >= 8 && words(row).all(|word| word.parse::<f64>().is_err()));
    rows
}

/// What stands between the words of a row.
pub fn is_separator(letter: char) -> bool {
    letter == ',' || letter.is_whitespace()
}

/// The words of a row, with blanks or commas between them.
pub fn words(row: &str) -> impl Iterator<Item = &str> {
    row.split(is_separator).filter(|word| !word.is_empty())
}

/// The finite numbers of a word of the command line, with commas between them; else the first
/// that is none.
pub fn comma_separated(text: &str) -> std::result::Result<Vec<f64>, &str> {
    let number = |word: &'_ str| word.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    text.split(',').map(|word| number(word).ok_or(word)).collect()
}

/// Three coordinates, metres, as a command line has them.
///
/// # Errors
/// What to give instead of what is none.
pub fn coordinates_m(text: &str) -> std::result::Result<Vector3<f64>, String> {
    match comma_separated(text).as_deref() {
        Ok(&[x, y, z]) => Ok(Vector3::new(x, y, z)),
        _ => Err("give three finite numbers, in metres".into()),
    }
}

/// Exactly `N` finite numbers.
pub(crate) fn numbers<const N: usize>(path: &Path, line: usize, row: &str) -> Result<[f64; N]> {
    let mut values = [0.0; N];
    let mut found = 0;
    for text in words(row) {
        let value = text.parse::<f64>().ok().filter(|v| v.is_finite());
        let Some(value) = value else {
            return Err(Error::BadNumber { path: path.to_path_buf(), line, text: text.chars().take(40).collect() });
        };
        if let Some(slot) = values.get_mut(found) {
            *slot = value;
        }
        found += 1;
    }
    if found != N {
        return Err(Error::BadRow { path: path.to_path_buf(), line, found, expected: N });
    }
    Ok(values)
}

/// A pose from a 3x4 matrix `[R | t]`, row by row; the printed `R` is replaced
/// by the rotation nearest to it.
pub(crate) fn pose(path: &Path, line: usize, row: &str) -> Result<Pose> {
    pose_of(path, line, &numbers(path, line, row)?)
}

/// The same of numbers that were read already.
///
/// # Errors
/// [`Error::NotARotation`] or [`Error::Mirrors`] where `R` is no rotation.
pub fn pose_of(path: &Path, line: usize, values: &[f64; 12]) -> Result<Pose> {
    let matrix = Matrix3x4::from_row_slice(values);
    let rotation = rotation(path, line, &matrix.fixed_columns::<3>(0).into_owned())?;
    Ok(Pose::from_parts(Translation3::from(Vector3::new(values[3], values[7], values[11])), rotation))
}

/// A pose that leads from one sensor of a vehicle to another.
pub(crate) fn mounting(path: &Path, line: usize, pose: Pose) -> Result<Pose> {
    let distance_m = pose.translation.vector.norm();
    if distance_m > MOUNTING_LIMIT_M {
        return Err(Error::FarSensor { path: path.to_path_buf(), line, distance_m, limit_m: MOUNTING_LIMIT_M });
    }
    Ok(pose)
}

/// The rotation nearest to a printed one.
pub(crate) fn rotation(path: &Path, line: usize, printed: &Matrix3<f64>) -> Result<UnitQuaternion<f64>> {
    let file = || path.to_path_buf();
    let nearest = nearest_rotation(printed).ok_or_else(|| Error::Mirrors { path: file(), line })?;
    let deviation = (nearest.matrix() - printed).amax();
    if deviation > ROTATION_LIMIT {
        return Err(Error::NotARotation { path: file(), line, deviation, limit: ROTATION_LIMIT });
    }
    Ok(UnitQuaternion::from_rotation_matrix(&nearest))
}

/// A pose as the twelve numbers of its 3x4 matrix, row by row.
pub(crate) fn pose_row(pose: &Pose) -> String {
    let matrix = pose.to_homogeneous();
    let mut row = String::new();
    for (index, value) in matrix.fixed_rows::<3>(0).transpose().iter().enumerate() {
        if index > 0 {
            row.push(' ');
        }
        // Writing to a string cannot fail.
        let _ = write!(row, "{value:.9e}");
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_byte_order_mark_is_no_part_of_the_text() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("times.txt");
        std::fs::write(&path, "\u{feff}0.0\n0.1\u{feff}\n").unwrap();
        assert_eq!(read(&path).unwrap(), "0.0\n0.1\u{feff}\n");
        std::fs::write(&path, b"\xef\xbb\xbf0.0\n\xff").unwrap();
        assert!(matches!(read(&path), Err(Error::NotText { at: 7, .. })));
    }
}
