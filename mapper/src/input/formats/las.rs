//! LAS and LAZ, through `las`.

use std::fs::File;
use std::io::{BufReader, Seek};
use std::path::Path;

use common::atomic_file::is_other;
use common::kitti::ScanPoint;
use las::{PointData, Reader};

use super::{Points, bad, las_check};
use crate::error::{Error, Result};

/// Bytes of points that are read at a time: a header can promise any number, of
/// any length.
const BYTES_AT_A_TIME: u64 = 8 << 20;

/// Opens a LAS or LAZ file.
///
/// # Errors
/// [`common::Error::Io`] where it cannot be opened, [`common::Error::NoFile`] where it
/// could not be read again, [`Error::BadScan`] where it is none.
pub fn reader(path: &Path) -> Result<Reader> {
    if is_other(path) {
        return Err(common::Error::NoFile { path: path.to_path_buf() }.into());
    }
    // The reader's own message about a missing file does not name it.
    let mut file = File::open(path).map_err(common::Error::io(path))?;
    if let Some(fault) = las_check::fault(&mut file) {
        return Err(bad(path, format!("{fault}; copy or export it again")));
    }
    file.rewind().map_err(common::Error::io(path))?;
    Reader::new(BufReader::new(file)).map_err(|e| Error::las(path, &e))
}

/// The error of a file that ends before the points that its header promises.
pub fn cut_off(path: &Path, promised: u64, points: usize) -> Error {
    bad(path, format!("its header promises {promised} points and {points} are there; copy it again"))
}

/// How many points of a file are read at a time.
pub fn at_a_time(reader: &Reader) -> u64 {
    let format = reader.header().point_format();
    BYTES_AT_A_TIME / u64::from(format.len()).max(1)
}

/// Classes of noise, LAS 1.4 R15, table 17: low and high points.
const NOISE: [u8; 2] = [7, 18];

/// The byte of a record that says whether it is withheld, in all formats.
const FLAGS: usize = 15;

/// Of each of some points whether the file says that it is withheld, or of a class of noise.
pub fn are_noise(data: &PointData) -> impl Iterator<Item = bool> {
    // The third of the bits of flags, or in older formats the last bit of the class.
    let bit = if data.format().is_extended { 0b100 } else { 0b1000_0000 };
    let records = data.raw_bytes().chunks_exact(data.record_len().max(1));
    records.zip(data.classification()).map(move |(record, class)| {
        let is_withheld = record.get(FLAGS).is_some_and(|flags| flags & bit != 0);
        is_withheld || NOISE.contains(&class)
    })
}

/// Reads a scan.
pub fn read(path: &Path) -> Result<Points> {
    let mut reader = reader(path)?;
    let promised = reader.header().number_of_points();
    let mut all = Points::default();
    loop {
        let data = reader.read_points(at_a_time(&reader)).map_err(|e| Error::las(path, &e))?;
        if data.is_empty() {
            break;
        }
        let before = all.points.len();
        let positions = data.x().zip(data.y()).zip(data.z()).zip(data.intensity()).zip(are_noise(&data));
        let kept = positions.filter_map(|(position, is_noise)| (!is_noise).then_some(position));
        all.points.extend(kept.map(|(((x, y), z), intensity)| ScanPoint {
            x_m: x as f32,
            y_m: y as f32,
            z_m: z as f32,
            reflectance: f32::from(intensity),
        }));
        all.noise += data.len() - (all.points.len() - before);
    }
    let there = all.points.len() + all.noise;
    if (there as u64) < promised {
        return Err(cut_off(path, promised, there));
    }
    Ok(all)
}
