//! PCD of the Point Cloud Library, version 0.7: `ascii`, `binary` and
//! `binary_compressed`.
//!
//! A reader of our own: `pcd-rs` 0.13 brings `regex` and a second `thiserror`.

use std::path::Path;

use common::kitti::ScanPoint;

use super::{INTENSITY, Points, RING, bad, lzf};
use crate::error::{Error, Result};

/// A column.
#[derive(Debug, Clone)]
struct Field {
    name: String,
    /// `F`, `I` or `U`.
    kind: char,
    /// Bytes of one value.
    size: usize,
    /// Values per point.
    count: usize,
}

#[derive(Debug, Default)]
struct Header {
    fields: Vec<Field>,
    points: usize,
    /// Bytes of a point, uncompressed.
    stride: usize,
    data: String,
    /// Bytes of the header.
    length: usize,
    /// Lines of the header.
    lines: usize,
}

/// Reads a scan.
///
/// # Errors
/// [`Error::BadScan`] with the line or byte.
pub fn read(path: &Path) -> Result<Points> {
    let bytes = std::fs::read(path).map_err(common::Error::io(path))?;
    let header = header(path, &bytes)?;
    let body = bytes.get(header.length..).unwrap_or_default();
    let column = |names: &[&str]| header.fields.iter().position(|f| names.contains(&f.name.as_str()));
    let [Some(x), Some(y), Some(z)] = ["x", "y", "z"].map(|name| column(&[name])) else {
        let names: Vec<&str> = header.fields.iter().map(|f| f.name.as_str()).collect();
        return Err(bad(
            path,
            format!("its FIELDS are `{}` and lack x, y or z; export it with positions", names.join(" ")),
        ));
    };
    let wanted = [Some(x), Some(y), Some(z), column(&INTENSITY), column(&RING)];
    let rows = match header.data.as_str() {
        "ascii" => ascii(path, body, &header, &wanted)?,
        "binary" => binary(path, body, &header, &wanted)?,
        "binary_compressed" => compressed(path, body, &header, &wanted)?,
        other => {
            return Err(bad(
                path,
                format!("DATA `{other}` is none of ascii, binary, binary_compressed; export it as one of these"),
            ));
        }
    };
    let ring = if wanted[4].is_some() { rows.iter().map(|row| row[4] as u16).collect() } else { Vec::new() };
    let point = |[x, y, z, intensity, _]: &[f64; 5]| ScanPoint {
        x_m: *x as f32,
        y_m: *y as f32,
        z_m: *z as f32,
        reflectance: *intensity as f32,
    };
    Ok(Points { points: rows.iter().map(point).collect(), ring, noise: 0 })
}

fn header(path: &Path, bytes: &[u8]) -> Result<Header> {
    let mut header = Header::default();
    let (mut sizes, mut kinds, mut counts): (Vec<usize>, Vec<char>, Vec<usize>) = Default::default();
    let mut names: Vec<String> = Vec::new();
    let (mut width, mut height, mut points) = (None, None, None);
    while header.data.is_empty() {
        let rest = bytes.get(header.length..).unwrap_or_default();
        let Some(end) = rest.iter().position(|b| *b == b'\n') else {
            return Err(bad(
                path,
                format!(
                    "it has no line `DATA` after line {}: it is cut off or no PCD file; copy it again",
                    header.lines
                ),
            ));
        };
        header.length += end + 1;
        header.lines += 1;
        let row = String::from_utf8_lossy(&rest[..end]);
        let mut words = row.split_whitespace();
        let key = words.next().unwrap_or_default().to_owned();
        let words: Vec<&str> = words.collect();
        let numbers = || -> Result<Vec<usize>> {
            let all: Option<Vec<usize>> = words.iter().map(|w| w.parse().ok()).collect();
            all.ok_or_else(|| {
                bad(path, format!("line {}: `{key}` should be whole numbers; export it again", header.lines))
            })
        };
        match key.as_str() {
            "FIELDS" | "COLUMNS" => names = words.iter().map(|w| w.to_ascii_lowercase()).collect(),
            "SIZE" => sizes = numbers()?,
            "TYPE" => kinds = words.iter().filter_map(|w| w.chars().next()).collect(),
            "COUNT" => counts = numbers()?,
            "WIDTH" => width = numbers()?.first().copied(),
            "HEIGHT" => height = numbers()?.first().copied(),
            "POINTS" => points = numbers()?.first().copied(),
            "DATA" => header.data = words.first().map_or_else(|| "nothing".into(), |w| w.to_ascii_lowercase()),
            _ => {}
        }
    }
    if counts.is_empty() {
        counts = vec![1; names.len()];
    }
    if sizes.len() != names.len() || kinds.len() != names.len() || counts.len() != names.len() {
        return Err(bad(
            path,
            format!(
                "FIELDS, SIZE, TYPE and COUNT have {}, {}, {} and {} entries and should have as many each; export it again",
                names.len(),
                sizes.len(),
                kinds.len(),
                counts.len()
            ),
        ));
    }
    let fields = names.into_iter().zip(kinds).zip(sizes).zip(counts);
    for (((name, kind), size), count) in fields {
        let known = matches!((kind, size), ('F', 4 | 8) | ('I' | 'U', 1 | 2 | 4 | 8));
        if !known {
            return Err(bad(
                path,
                format!("field `{name}` has type {kind}{size}, which PCD does not know; export it again"),
            ));
        }
        // A field of no values is none, and one of countless values is a lie.
        header.stride = size
            .checked_mul(count)
            .filter(|bytes| *bytes > 0)
            .and_then(|bytes| header.stride.checked_add(bytes))
            .ok_or_else(|| bad(path, format!("field `{name}` has a COUNT of {count}; export it again")))?;
        header.fields.push(Field { name, kind, size, count });
    }
    header.points = points
        .or_else(|| width?.checked_mul(height?))
        .ok_or_else(|| bad(path, "its header has neither POINTS nor WIDTH and HEIGHT; export it again"))?;
    Ok(header)
}

/// Columns that are wanted, and where they are: x, y, z, intensity, ring.
type Wanted = [Option<usize>; 5];

fn ascii(path: &Path, body: &[u8], header: &Header, wanted: &Wanted) -> Result<Vec<[f64; 5]>> {
    let text = String::from_utf8_lossy(body);
    // The first value of each field.
    let starts: Vec<usize> = starts(header, |f| f.count);
    let expected: usize = header.fields.iter().map(|f| f.count).sum();
    let mut rows = Vec::new();
    for (i, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let at = header.lines + i + 1;
        let words: Vec<&str> = line.split_whitespace().collect();
        if words.len() != expected {
            return Err(bad(
                path,
                format!("line {at} has {} values and should have {expected}; copy it again", words.len()),
            ));
        }
        let mut row = [0.0; 5];
        for (slot, field) in row.iter_mut().zip(wanted) {
            let Some(word) = field.and_then(|f| starts.get(f)).and_then(|s| words.get(*s)) else { continue };
            *slot =
                word.parse().map_err(|_| bad(path, format!("line {at}: `{word}` is not a number; copy it again")))?;
        }
        rows.push(row);
    }
    if rows.len() == header.points { Ok(rows) } else { Err(cut_off(path, header, rows.len())) }
}

fn binary(path: &Path, body: &[u8], header: &Header, wanted: &Wanted) -> Result<Vec<[f64; 5]>> {
    let starts = starts(header, |f| f.size * f.count);
    let stride = header.stride.max(1);
    let there = body.len() / stride;
    if there < header.points {
        return Err(cut_off(path, header, there));
    }
    let value = |point: &[u8], field: Option<usize>| {
        let (field, start) = header.fields.get(field?).zip(starts.get(field?))?;
        scalar(field, point.get(*start..start + field.size)?)
    };
    Ok(body.chunks_exact(stride).take(header.points).map(|p| wanted.map(|f| value(p, f).unwrap_or(0.0))).collect())
}

fn compressed(path: &Path, body: &[u8], header: &Header, wanted: &Wanted) -> Result<Vec<[f64; 5]>> {
    let size = |at: usize| body.get(at..at + 4).and_then(|b| Some(u32::from_le_bytes(b.try_into().ok()?) as usize));
    let unpacked = size(0)
        .zip(size(4))
        .and_then(|(packed, unpacked)| lzf::decompress(body.get(8..8_usize.checked_add(packed)?)?, unpacked));
    let bytes = unpacked.ok_or_else(|| {
        bad(path, format!("its compressed data (from byte {}) are cut off or damaged; copy it again", header.length))
    })?;
    if header.stride.checked_mul(header.points).is_none_or(|n| bytes.len() < n) {
        return Err(cut_off(path, header, bytes.len() / header.stride.max(1)));
    }
    // Field by field, not point by point.
    let starts = starts(header, |f| f.size * f.count * header.points);
    let value = |point: usize, field: Option<usize>| {
        let (field, start) = header.fields.get(field?).zip(starts.get(field?))?;
        let at = start + point * field.size * field.count;
        scalar(field, bytes.get(at..at + field.size)?)
    };
    Ok((0..header.points).map(|p| wanted.map(|f| value(p, f).unwrap_or(0.0))).collect())
}

/// Where each field begins, if a field takes so much.
fn starts(header: &Header, length: impl Fn(&Field) -> usize) -> Vec<usize> {
    let mut at = 0_usize;
    let step = |field: &Field| {
        let start = at;
        at += length(field);
        start
    };
    header.fields.iter().map(step).collect()
}

fn scalar(field: &Field, bytes: &[u8]) -> Option<f64> {
    Some(match (field.kind, field.size) {
        ('F', 4) => f64::from(f32::from_le_bytes(bytes.try_into().ok()?)),
        ('F', 8) => f64::from_le_bytes(bytes.try_into().ok()?),
        ('I', 1) => f64::from(i8::from_le_bytes(bytes.try_into().ok()?)),
        ('I', 2) => f64::from(i16::from_le_bytes(bytes.try_into().ok()?)),
        ('I', 4) => f64::from(i32::from_le_bytes(bytes.try_into().ok()?)),
        ('I', 8) => i64::from_le_bytes(bytes.try_into().ok()?) as f64,
        ('U', 1) => f64::from(u8::from_le_bytes(bytes.try_into().ok()?)),
        ('U', 2) => f64::from(u16::from_le_bytes(bytes.try_into().ok()?)),
        ('U', 4) => f64::from(u32::from_le_bytes(bytes.try_into().ok()?)),
        ('U', 8) => u64::from_le_bytes(bytes.try_into().ok()?) as f64,
        _ => return None,
    })
}

fn cut_off(path: &Path, header: &Header, there: usize) -> Error {
    bad(path, format!("its header promises {} points and {there} are there; copy it again", header.points))
}
