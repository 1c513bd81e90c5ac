//! LAS and LAZ, through `las`.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use common::kitti::ScanPoint;
use las::Reader;

use super::{Points, bad};
use crate::error::{Error, Result};

/// Points that are read at a time: a header can promise any number.
const CHUNK: u64 = 1 << 16;

/// Opens a LAS or LAZ file.
///
/// # Errors
/// [`common::Error::Io`] where it cannot be opened, [`Error::BadScan`] where
/// it is none.
pub fn reader(path: &Path) -> Result<Reader> {
    // The reader's own message about a missing file does not name it.
    let mut file = File::open(path).map_err(common::Error::io(path))?;
    check_chunks(path, &mut file)?;
    Reader::from_path(path).map_err(|e| Error::las(path, &e))
}

/// That a LAZ file holds no more chunks than it has bytes for, as memory for all
/// that are promised is taken before any is read. What is wrong elsewhere is left
/// to the reader.
///
/// Isenburg, *`LASzip`* (2013): before the points stands where the table of chunks
/// is, or -1 if that stands in the last eight bytes; the table begins with a
/// version and the number of chunks.
fn check_chunks(path: &Path, file: &mut File) -> Result<()> {
    /// Where a header (LAS 1.0 to 1.4) says where the points begin, and their
    /// format, whose highest bits tell that they are compressed.
    const POINTS_AT: u64 = 96;
    const FORMAT_AT: u64 = 104;
    let Ok(length) = file.metadata().map(|of| of.len()) else { return Ok(()) };
    let mut bytes_at = |at: SeekFrom| -> Option<[u8; 8]> {
        let mut bytes = [0; 8];
        file.seek(at).ok()?;
        file.read_exact(&mut bytes).ok()?;
        Some(bytes)
    };
    let mut chunks = || -> Option<u64> {
        let [format, ..] = bytes_at(SeekFrom::Start(FORMAT_AT))?;
        let [a, b, c, d, ..] = bytes_at(SeekFrom::Start(POINTS_AT))?;
        let mut at = i64::from_le_bytes(bytes_at(SeekFrom::Start(u32::from_le_bytes([a, b, c, d]).into()))?);
        if at == -1 {
            at = i64::from_le_bytes(bytes_at(SeekFrom::End(-8))?);
        }
        let [.., a, b, c, d] = bytes_at(SeekFrom::Start(u64::try_from(at).ok()?))?;
        (format & 0xC0 != 0).then_some(u32::from_le_bytes([a, b, c, d]).into())
    };
    match chunks() {
        Some(chunks) if chunks > length => {
            Err(bad(path, format!("its table promises {chunks} chunks, more than the file has bytes; copy it again")))
        }
        _ => Ok(()),
    }
}

/// The error of a file that ends before the points that its header promises.
pub fn cut_off(path: &Path, promised: u64, points: usize) -> Error {
    bad(path, format!("its header promises {promised} points and {points} are there; copy it again"))
}

/// Reads a scan.
pub fn read(path: &Path) -> Result<Points> {
    let mut reader = reader(path)?;
    let promised = reader.header().number_of_points();
    let mut all = Points::default();
    loop {
        let data = reader.read_points(CHUNK).map_err(|e| Error::las(path, &e))?;
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
