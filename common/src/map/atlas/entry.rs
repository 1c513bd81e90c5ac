//! What the index says of one of its parts: the box around it, where it
//! stands in the file, and how much is in it.

use super::super::Bounds;
use super::super::grid::Grid;
use super::Counts;

/// Bytes of an entry.
pub(super) const ENTRY_BYTES: usize = 60;

/// A tile, or a node of the index.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Entry {
    /// Smallest x, y, z of any point in it, quanta.
    pub min: [i32; 3],
    /// Largest x, y, z, quanta.
    pub max: [i32; 3],
    /// Where it begins in the file, bytes.
    pub offset: u64,
    /// How long it is, bytes.
    pub length: u32,
    /// CRC-32C of its bytes.
    pub checksum: u32,
    /// What is in it.
    pub counts: Counts,
}

impl Entry {
    /// The first byte after it; none where no file is that long.
    pub fn end(&self) -> Option<u64> {
        self.offset.checked_add(u64::from(self.length))
    }

    /// The box around it, metres.
    pub fn bounds(&self, grid: Grid) -> Bounds {
        Bounds { min_map: grid.point_m(self.min.map(i64::from)), max_map: grid.point_m(self.max.map(i64::from)) }
    }

    /// The box of `other` lies within this one.
    pub fn contains(&self, other: &Self) -> bool {
        let axis =
            |i: usize| self.min[i] <= other.min[i] && other.min[i] <= other.max[i] && other.max[i] <= self.max[i];
        (0..3).all(axis)
    }

    /// An entry for all of `children`, that is nowhere yet; none for no
    /// children, or where they hold more than can be counted.
    pub fn over(children: &[Self]) -> Option<Self> {
        let (first, rest) = children.split_first()?;
        let mut all = Self { offset: 0, length: 0, checksum: 0, ..*first };
        for child in rest {
            all.min = [0, 1, 2].map(|i| all.min[i].min(child.min[i]));
            all.max = [0, 1, 2].map(|i| all.max[i].max(child.max[i]));
            all.counts = all.counts.checked_add(child.counts)?;
        }
        Some(all)
    }

    /// Appends its bytes.
    pub fn write(&self, bytes: &mut Vec<u8>) {
        for coordinate in self.min.iter().chain(&self.max) {
            bytes.extend_from_slice(&coordinate.to_le_bytes());
        }
        bytes.extend_from_slice(&self.offset.to_le_bytes());
        let Counts { tiles, roads, poles, signs, lanes } = self.counts;
        for number in [self.length, self.checksum, tiles, roads, poles, signs, lanes] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
    }

    /// Takes one off the front of `bytes`.
    pub fn read(bytes: &mut &[u8]) -> Option<Self> {
        let (mut min, mut max) = ([0; 3], [0; 3]);
        for coordinate in min.iter_mut().chain(&mut max) {
            *coordinate = i32::from_le_bytes(take(bytes)?);
        }
        let offset = u64::from_le_bytes(take(bytes)?);
        let mut number = || Some(u32::from_le_bytes(take(bytes)?));
        let (length, checksum) = (number()?, number()?);
        let counts =
            Counts { tiles: number()?, roads: number()?, poles: number()?, signs: number()?, lanes: number()? };
        Some(Self { min, max, offset, length, checksum, counts })
    }
}

/// Takes some bytes off the front.
pub(super) fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (taken, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*taken)
}
