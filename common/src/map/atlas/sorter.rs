//! Sorts the roads of any number of maps along the Hilbert curve, in bounded
//! memory: what does not fit is sorted in runs, written to one temporary file,
//! and merged from there.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fs::File;
use std::io::{self, BufWriter, Write};

use super::file::PositionedFile;

/// Bytes read at a time from each run.
const READ_BYTES: u64 = 1 << 16;

/// Where a road stands: along the curve, then by its number.
pub(super) type Key = (u64, u32);

/// A road with what is on it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Record {
    /// Its place in the order.
    pub key: Key,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// Bytes of a record before its content: key and length.
const HEAD_BYTES: usize = 16;

/// Collects records.
#[derive(Debug)]
pub(super) struct Sorter {
    memory_bytes: usize,
    held_bytes: usize,
    held: Vec<Record>,
    spill: Option<BufWriter<File>>,
    /// The first byte after each run.
    ends: Vec<u64>,
}

impl Sorter {
    /// A sorter that holds about `memory_bytes` and writes what is more to a
    /// nameless file that `create` makes when it is needed.
    pub fn new(memory_bytes: usize) -> Self {
        Self { memory_bytes, held_bytes: 0, held: Vec::new(), spill: None, ends: Vec::new() }
    }

    /// Takes a record.
    pub fn push(&mut self, record: Record, create: impl FnOnce() -> io::Result<File>) -> io::Result<()> {
        self.held_bytes += record.bytes.len() + size_of::<Record>();
        self.held.push(record);
        if self.held_bytes < self.memory_bytes {
            return Ok(());
        }
        self.held.sort_unstable();
        let spill = match &mut self.spill {
            Some(spill) => spill,
            none => none.insert(BufWriter::with_capacity(READ_BYTES as usize, create()?)),
        };
        let mut end = self.ends.last().copied().unwrap_or(0);
        for Record { key: (place, number), bytes } in self.held.drain(..) {
            spill.write_all(&place.to_le_bytes())?;
            spill.write_all(&number.to_le_bytes())?;
            spill.write_all(&(bytes.len() as u32).to_le_bytes())?;
            spill.write_all(&bytes)?;
            end += (HEAD_BYTES + bytes.len()) as u64;
        }
        self.ends.push(end);
        self.held_bytes = 0;
        Ok(())
    }

    /// Gives all records in order to `each`.
    pub fn finish<E: From<io::Error>>(mut self, mut each: impl FnMut(Record) -> Result<(), E>) -> Result<(), E> {
        self.held.sort_unstable();
        let mut held = self.held.into_iter();
        let Some(spill) = self.spill else { return held.try_for_each(each) };
        let file = PositionedFile::new(spill.into_inner().map_err(io::IntoInnerError::into_error)?)?;
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        let mut runs: Vec<Run<'_>> = starts
            .zip(&self.ends)
            .map(|(at, &end)| Run { file: &file, at, end, buffer: Vec::new(), used: 0 })
            .collect();
        // The run that is still in memory comes last.
        let last = runs.len();
        let mut next = |run: usize| match runs.get_mut(run) {
            Some(run) => run.next(),
            None => Ok(held.next()),
        };
        let mut heads = BinaryHeap::new();
        for run in 0..=last {
            heads.extend(next(run)?.map(|record| Reverse((record, run))));
        }
        while let Some(Reverse((record, run))) = heads.pop() {
            heads.extend(next(run)?.map(|record| Reverse((record, run))));
            each(record)?;
        }
        Ok(())
    }
}

/// One sorted run in the temporary file.
struct Run<'a> {
    file: &'a PositionedFile,
    at: u64,
    end: u64,
    buffer: Vec<u8>,
    used: usize,
}

impl Run<'_> {
    fn next(&mut self) -> io::Result<Option<Record>> {
        if self.used == self.buffer.len() && self.at == self.end {
            return Ok(None);
        }
        let [a, b] = [self.take::<8>()?, self.take::<8>()?];
        let [n0, n1, n2, n3, l0, l1, l2, l3] = b;
        let length = u32::from_le_bytes([l0, l1, l2, l3]) as usize;
        self.fill(length)?;
        let end = self.used + length;
        let bytes = self.buffer.get(self.used..end).ok_or(io::ErrorKind::UnexpectedEof)?.to_vec();
        self.used = end;
        Ok(Some(Record { key: (u64::from_le_bytes(a), u32::from_le_bytes([n0, n1, n2, n3])), bytes }))
    }

    fn take<const N: usize>(&mut self) -> io::Result<[u8; N]> {
        self.fill(N)?;
        let bytes = self.buffer.get(self.used..).and_then(|rest| rest.first_chunk());
        self.used += N;
        bytes.copied().ok_or_else(|| io::ErrorKind::UnexpectedEof.into())
    }

    /// Makes sure that the buffer has so many bytes more.
    fn fill(&mut self, bytes: usize) -> io::Result<()> {
        if self.buffer.len() - self.used < bytes {
            self.buffer.drain(..self.used);
            self.used = 0;
            let more = READ_BYTES.max(bytes as u64).min(self.end - self.at);
            self.buffer.extend(self.file.read(self.at, more as usize)?);
            self.at += more;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_was_spilled_comes_back_in_order(
            lengths in prop::collection::vec((any::<u8>(), 0..300_usize), 0..80),
            memory_bytes in 1..20_000_usize,
        ) {
            let mut sorter = Sorter::new(memory_bytes);
            let mut expected = Vec::new();
            for (number, (place, length)) in (0..).zip(lengths) {
                let record = Record { key: (u64::from(place) << 40, number), bytes: vec![place; length] };
                expected.push(record.clone());
                sorter.push(record, tempfile::tempfile).unwrap();
            }
            expected.sort();
            let mut found = Vec::new();
            sorter.finish(|record| -> io::Result<()> { found.push(record); Ok(()) }).unwrap();
            prop_assert_eq!(found, expected);
        }
    }
}
