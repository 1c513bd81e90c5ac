//! LAS and LAZ, through `las`.

use std::fs::File;
use std::io::{BufReader, Seek};
use std::path::Path;

use common::atomic_file::is_other;
use common::kitti::ScanPoint;
use las::Reader;

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
        let positions = data.x().zip(data.y()).zip(data.z()).zip(data.intensity());
        all.points.extend(positions.map(|(((x, y), z), intensity)| ScanPoint {
            x_m: x as f32,
            y_m: y as f32,
            z_m: z as f32,
            reflectance: f32::from(intensity),
        }));
    }
    if (all.points.len() as u64) < promised {
        return Err(cut_off(path, promised, all.points.len()));
    }
    Ok(all)
}
