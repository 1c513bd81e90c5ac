//! That a LAS or LAZ file can be what its header says, before `las` reads it: it
//! takes memory for what is promised, and relies on what compressed points are
//! said to be made of.
//!
//! LAS 1.4 R15 (ASPRS, 2019), and Isenburg, *`LASzip`* (2013). What ends before it
//! can be looked at is left to the reader, which tells it.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

use laz::laszip::ChunkTable;

/// What is wrong with a file, if anything.
pub fn fault(file: &mut File) -> Option<String> {
    let header = Header::read(file)?;
    if let Some(fault) = header.fault() {
        return Some(fault);
    }
    let laszip = match header.laszip_record(file) {
        Ok(laszip) => laszip,
        Err(fault) => return Some(fault),
    };
    header.extended_fault(file).or_else(|| {
        let laszip = laszip.filter(|_| header.is_compressed)?;
        LasZip::of(&laszip, &header).map_or_else(Some, |laszip| laszip.fault(file, &header))
    })
}

/// What a header promises, bytes counted from the beginning of the file.
struct Header {
    file_bytes: u64,
    version: (u8, u8),
    own_bytes: u64,
    /// Records between the header and the points.
    records: u64,
    points_at: u64,
    points: u64,
    record_bytes: u64,
    format: u8,
    is_compressed: bool,
    /// Where the records behind the points begin, and how many there are.
    extended: (u64, u64),
}

/// A part of a point: how `LASzip` numbers it, and its bytes.
type Part = (u64, u64);

impl Header {
    fn read(file: &mut File) -> Option<Self> {
        let file_bytes = file.seek(SeekFrom::End(0)).ok()?;
        let head = bytes_at(file, 0, 227)?;
        let number = |at: usize, bytes: usize| head.get(at..at + bytes).map(little_endian);
        if !head.starts_with(b"LASF") {
            return None;
        }
        let version = (head[24], head[25]);
        let tail = if version == (1, 4) { bytes_at(file, 235, 20)? } else { vec![0; 20] };
        let legacy_points = number(107, 4)?;
        let least_bytes = match version {
            (1, 0..=2) => 227,
            (1, 3) => 235,
            _ => 375,
        };
        Some(Self {
            file_bytes,
            version,
            own_bytes: number(94, 2)?.max(least_bytes),
            records: number(100, 4)?,
            points_at: number(96, 4)?,
            points: if legacy_points > 0 { legacy_points } else { little_endian(&tail[12..]) },
            record_bytes: number(105, 2)?,
            format: head[104] & 0x3F,
            is_compressed: head[104] & 0x80 != 0,
            extended: (little_endian(&tail[..8]), little_endian(&tail[8..12])),
        })
    }

    fn fault(&self) -> Option<String> {
        let Self { format, record_bytes, points_at, file_bytes, .. } = self;
        let (major, minor) = self.version;
        if major != 1 || minor > 4 {
            return Some(format!("its version is {major}.{minor}, and 1.0 to 1.4 can be read"));
        }
        if *format > 10 {
            return Some(format!("its points have format {format}, and 0 to 10 can be read"));
        }
        let least_bytes: u64 = parts(*format).iter().map(|(_, bytes)| bytes).sum();
        if *record_bytes < least_bytes {
            return Some(format!("its points have {record_bytes} bytes, and format {format} takes {least_bytes}"));
        }
        if points_at > file_bytes {
            return Some(format!("its points should begin at byte {points_at}, and it has {file_bytes} bytes"));
        }
        let room = (file_bytes - points_at) / record_bytes;
        (!self.is_compressed && self.points > room)
            .then(|| format!("its header promises {} points and {room} are there", self.points))
    }

    /// The content of the record that says how the points are compressed, where
    /// all records end before the points.
    fn laszip_record(&self, file: &mut File) -> Result<Option<Vec<u8>>, String> {
        /// Bytes of a record before its content.
        const BEFORE: u64 = 54;
        let (mut at, mut laszip) = (self.own_bytes, None);
        for record in 0..self.records {
            let beyond = || format!("its record {} of {} reaches into its points", record + 1, self.records);
            let Some(head) = bytes_at(file, at, BEFORE) else { return Err(beyond()) };
            let length = little_endian(&head[20..22]);
            if at + BEFORE + length > self.points_at {
                return Err(beyond());
            }
            let user: &[u8] = head[2..18].split(|byte| *byte == 0).next().unwrap_or_default();
            if laszip.is_none() && user == b"laszip encoded" && little_endian(&head[18..20]) == 22204 {
                laszip = bytes_at(file, at + BEFORE, length);
            }
            at += BEFORE + length;
        }
        Ok(laszip)
    }

    /// What is wrong with the records behind the points.
    fn extended_fault(&self, file: &mut File) -> Option<String> {
        /// Bytes of such a record before its content.
        const BEFORE: u64 = 60;
        let (at, count) = self.extended;
        if count == 0 {
            return None;
        }
        let fault = || Some(format!("its {count} records behind the points reach beyond its end"));
        let Some(room) = self.file_bytes.checked_sub(at) else { return fault() };
        if count.saturating_mul(BEFORE) > room {
            return fault();
        }
        let length = little_endian(&bytes_at(file, at, BEFORE)?[20..28]);
        if length > room - BEFORE { fault() } else { None }
    }
}

/// How points are compressed.
struct LasZip {
    /// Most points of a chunk; none where the table of chunks says it.
    chunk_points: Option<u64>,
    chunking: Chunking,
}

#[derive(Clone, Copy)]
enum Chunking {
    /// One chunk, without a table.
    None,
    /// Point by point.
    Pointwise,
    /// So many layers, one after the other.
    Layered(u64),
}

impl LasZip {
    fn of(record: &[u8], header: &Header) -> Result<Self, String> {
        let Header { format, record_bytes, .. } = *header;
        let other =
            || format!("what it says of its compression is not of points of format {format} and {record_bytes} bytes");
        let number = |at: usize, bytes: usize| record.get(at..at + bytes).map(little_endian).ok_or_else(other);
        let mut expected = parts(format);
        let extra_bytes = record_bytes - expected.iter().map(|(_, bytes)| bytes).sum::<u64>();
        if extra_bytes > 0 {
            expected.push((if format < 6 { 0 } else { 14 }, extra_bytes));
        }
        let items = number(32, 2)?;
        if items != expected.len() as u64 {
            return Err(other());
        }
        let mut is_layered = false;
        for (i, part) in expected.iter().enumerate() {
            let at = 34 + 6 * i;
            if (number(at, 2)?, number(at + 2, 2)?) != *part {
                return Err(other());
            }
            is_layered |= number(at + 4, 2)? >= 3;
        }
        let layers = |(kind, bytes): &Part| match kind {
            10 => 9,
            12 => 2,
            14 => *bytes,
            _ => 1,
        };
        let chunking = match (number(0, 2)?, is_layered) {
            (1, false) => Chunking::None,
            (2, false) => Chunking::Pointwise,
            (3, true) => Chunking::Layered(expected.iter().map(layers).sum()),
            _ => return Err(other()),
        };
        let chunk_points = Some(number(12, 4)?).filter(|points| !matches!(points, 0 | 0xFFFF_FFFF));
        Ok(Self { chunk_points, chunking })
    }

    /// What is wrong with the chunks.
    fn fault(&self, file: &mut File, header: &Header) -> Option<String> {
        let layers = match self.chunking {
            Chunking::None => return None,
            Chunking::Pointwise => None,
            Chunking::Layered(layers) => Some(layers),
        };
        let table = match table(file, header, self.chunk_points.is_none()) {
            Ok(table) => table,
            Err(fault) => return Some(fault),
        };
        let chunks = if let Some(points) = self.chunk_points {
            header.points.div_ceil(points)
        } else {
            let (mut chunks, mut points) = (0, 0_u64);
            for chunk in table.as_ref() {
                if points < header.points {
                    points = points.saturating_add(chunk.point_count);
                    chunks += 1;
                }
            }
            if points < header.points {
                return Some(format!("its header promises {} points and its chunks hold {points}", header.points));
            }
            chunks
        };
        layers_fault(file, header, chunks, layers?)
    }
}

/// The parts of a point of a format, without extra bytes.
fn parts(format: u8) -> Vec<Part> {
    const TIME: Part = (7, 8);
    const COLOR: Part = (8, 6);
    const WAVE: Part = (9, 29);
    let more: &[Part] = match format {
        1 => &[TIME],
        2 => &[COLOR],
        3 => &[TIME, COLOR],
        4 => &[TIME, WAVE],
        5 => &[TIME, COLOR, WAVE],
        7 => &[(11, 6)],
        8 => &[(12, 8)],
        9 => &[(13, 29)],
        10 => &[(12, 8), (13, 29)],
        _ => &[],
    };
    let core: Part = if format < 6 { (6, 20) } else { (10, 30) };
    [&[core], more].concat()
}

/// The table of chunks. Where it is stands before the points, or, where that was not
/// known when they were written, in the last eight bytes.
fn table(file: &mut File, header: &Header, has_points: bool) -> Result<ChunkTable, String> {
    let place = |file: &mut File, at: u64| {
        let at = little_endian(&bytes_at(file, at, 8)?);
        (at > header.points_at && i64::try_from(at).is_ok()).then_some(at)
    };
    let nowhere = || "it says of no place that its table of chunks is there".to_owned();
    let last = header.file_bytes.saturating_sub(8);
    let at = place(file, header.points_at).or_else(|| place(file, last)).ok_or_else(nowhere)?;
    let cut = || format!("its table of chunks at byte {at} cannot be read");
    let chunks = little_endian(&bytes_at(file, at, 8).ok_or_else(cut)?[4..]);
    // The first point of each is not compressed.
    if chunks > header.file_bytes / header.record_bytes {
        return Err(format!("its table promises {chunks} chunks, more than the file has bytes for"));
    }
    file.seek(SeekFrom::Start(at)).map_err(|_| cut())?;
    ChunkTable::read(file, has_points).map_err(|_| cut())
}

/// What is wrong with the sizes of layers, which stand behind the first point of each
/// chunk and the number of its points.
fn layers_fault(file: &mut File, header: &Header, chunks: u64, layers: u64) -> Option<String> {
    let mut at = header.points_at + 8;
    for chunk in 1..=chunks {
        at += header.record_bytes;
        let sizes = bytes_at(file, at, 4 + 4 * layers)?;
        at += 4 + 4 * layers;
        at += sizes[4..].chunks(4).map(little_endian).sum::<u64>();
        if at > header.file_bytes {
            return Some(format!("its chunk {chunk} of {chunks} reaches beyond its end"));
        }
    }
    None
}

/// Some bytes of a file; none where it ends before.
fn bytes_at(file: &mut File, at: u64, length: u64) -> Option<Vec<u8>> {
    file.seek(SeekFrom::Start(at)).ok()?;
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes).ok()?;
    (bytes.len() as u64 == length).then_some(bytes)
}

fn little_endian(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of points, compressed or not, and where in it its records end.
    fn written(points: usize, is_compressed: bool) -> (Vec<u8>, usize) {
        written_as(6, 0, points, is_compressed)
    }

    fn written_as(format: u8, extra_bytes: u16, points: usize, is_compressed: bool) -> (Vec<u8>, usize) {
        let mut builder = las::Builder::from((1, 4));
        let mut format = las::point::Format::new(format).unwrap();
        (format.is_compressed, format.extra_bytes) = (is_compressed, extra_bytes);
        builder.point_format = format;
        let file = std::io::Cursor::new(Vec::new());
        let mut writer = las::Writer::new(file, builder.into_header().unwrap()).unwrap();
        for i in 0..points {
            let point = las::Point {
                x: i as f64,
                gps_time: format.has_gps_time.then_some(0.0),
                color: format.has_color.then(las::Color::default),
                nir: format.has_nir.then_some(0),
                extra_bytes: vec![7; extra_bytes.into()],
                ..las::Point::default()
            };
            writer.write_point(point).unwrap();
        }
        let bytes = writer.into_inner().unwrap().into_inner();
        let points_at = little_endian(&bytes[96..100]) as usize;
        (bytes, points_at)
    }

    fn said(bytes: &[u8]) -> Option<String> {
        let mut file = tempfile::tempfile().unwrap();
        std::io::Write::write_all(&mut file, bytes).unwrap();
        fault(&mut file)
    }

    /// What is said where `new` stands at a byte.
    fn changed(bytes: &[u8], at: usize, new: &[u8]) -> String {
        let mut bytes = bytes.to_vec();
        bytes[at..at + new.len()].copy_from_slice(new);
        said(&bytes).unwrap_or_else(|| format!("nothing, where {new:?} stands at {at}"))
    }

    #[test]
    fn a_sound_file_has_no_fault() {
        for points in [0, 1, 60_000] {
            for is_compressed in [false, true] {
                assert_eq!(said(&written(points, is_compressed).0), None, "{points} {is_compressed}");
            }
        }
        for format in [0, 1, 2, 3, 6, 7, 8] {
            for (extra_bytes, is_compressed) in [(0, true), (5, true), (5, false)] {
                assert_eq!(
                    said(&written_as(format, extra_bytes, 100, is_compressed).0),
                    None,
                    "{format} {extra_bytes}"
                );
            }
        }
    }

    #[test]
    fn promises_that_a_file_cannot_hold_are_told_before_memory_is_taken_for_them() {
        let (plain, _) = written(100, false);
        assert!(changed(&plain, 107, &[255; 4]).contains("promises 4294967295 points and 100 are there"));
        assert!(changed(&plain, 105, &[255; 2]).contains("promises 100 points and 0 are there"));
        assert!(changed(&plain, 105, &[29, 0]).contains("have 29 bytes, and format 6 takes 30"));
        assert!(changed(&plain, 104, &[11]).contains("format 11, and 0 to 10"));
        assert!(changed(&plain, 25, &[5]).contains("version is 1.5"));
        assert!(changed(&plain, 96, &[255; 4]).contains("begin at byte 4294967295"));
        assert!(changed(&plain, 100, &[255; 4]).contains("record 1 of 4294967295 reaches into its points"));
        // One record behind the points, which begins there and is too long.
        let mut behind = plain.clone();
        behind[235..247].copy_from_slice(&[&(plain.len() as u64).to_le_bytes()[..], &[1, 0, 0, 0]].concat());
        behind.extend([0; 60]);
        assert_eq!(said(&behind), None);
        assert!(changed(&behind, plain.len() + 20, &[255; 8]).contains("its 1 records behind the points reach beyond"));
        assert!(changed(&behind, 243, &[255; 4]).contains("its 4294967295 records behind the points"));
    }

    #[test]
    fn what_is_compressed_otherwise_than_it_says_is_told() {
        let (packed, points_at) = written(100, true);
        // The record of the compression ends where the points begin, with its one item.
        let items_at = points_at - 8;
        assert_eq!(packed[items_at..items_at + 4], [1, 0, 10, 0]);
        let other = "its compression is not of points of format 6 and 30 bytes";
        for (at, new) in [(items_at, 0), (items_at, 2), (items_at + 2, 6), (items_at + 4, 3), (items_at - 32, 1)] {
            assert!(changed(&packed, at, &[new]).contains(other), "{at} {new}");
        }
        assert!(changed(&packed, 105, &[255; 2]).contains("of points of format 6 and 65535 bytes"));
        // Nine layers begin behind the first point and the number of all.
        assert!(changed(&packed, points_at + 8 + 30 + 4, &[255; 4]).contains("its chunk 1 of 1 reaches beyond"));
        let table_at = little_endian(&packed[points_at..points_at + 8]) as usize;
        assert!(changed(&packed, table_at + 4, &[255; 4]).contains("promises 4294967295 chunks"));
        assert!(changed(&packed, points_at, &[255, 255, 255, 15]).contains("table of chunks at byte 268435455"));
    }
}
