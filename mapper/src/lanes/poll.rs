//! Votes of points of paint for the strips that they lie in.

use std::ops::Range;

/// Votes for all strips of one width, by the cell of their middles: of the
/// points of one bin of the length at most so many count for a strip.
pub struct Poll {
    votes: Vec<u16>,
    /// Points of one bin in each cell, from half a strip before the first one
    /// to half a strip behind the last one.
    // Bytes: twice as many as words are counted at once.
    here: Vec<u8>,
    /// The same in each strip.
    wide: Vec<u8>,
    half: usize,
    most: u8,
}

impl Poll {
    /// Of strips of `2 * half + 1` cells; of a bin at most 255 points count.
    pub fn new(cells: usize, half: usize, most: u16) -> Self {
        let most = u8::try_from(most).unwrap_or(u8::MAX);
        Self { votes: vec![0; cells], here: vec![0; cells + 2 * half], wide: vec![0; cells], half, most }
    }

    /// Takes back all votes.
    pub fn clear(&mut self) {
        self.votes.fill(0);
    }

    /// Votes so far.
    pub fn votes(&self) -> &[u16] {
        &self.votes
    }

    /// Counts the points of a bin, given by their cells; those beyond `range`
    /// do not count. Returns the first of the cells whose strips may have any,
    /// and how many each of these has.
    pub fn count(&mut self, range: Range<usize>, cells: impl Iterator<Item = usize>) -> (usize, &[u8]) {
        let (start, end) = (range.start.min(self.votes.len()), range.end.min(self.votes.len()));
        let here = &mut self.here[start + self.half..end.max(start) + self.half];
        for cell in cells {
            if let Some(count) = here.get_mut(cell.wrapping_sub(start)) {
                *count = count.saturating_add(1);
            }
        }
        let first = start.saturating_sub(self.half);
        let end = (end.max(start) + self.half).min(self.votes.len());
        let wide = &mut self.wide[first..end];
        wide.copy_from_slice(&self.here[first..end]);
        for k in (1..=2 * self.half).step_by(2) {
            let pairs = self.here[first + k..].iter().zip(&self.here[first + k + 1..]);
            wide.iter_mut().zip(pairs).for_each(|(sum, (a, b))| *sum = sum.saturating_add(*a).saturating_add(*b));
        }
        let votes = self.votes[first..end].iter_mut().zip(&*wide);
        votes.for_each(|(sum, n)| *sum = sum.saturating_add(u16::from(*n.min(&self.most))));
        self.here[first..end + 2 * self.half].fill(0);
        (first, wide)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_bin_so_many_points_count_for_each_strip_that_they_lie_in() {
        let mut poll = Poll::new(9, 2, 3);
        assert_eq!(poll.count(0..5, [4, 4, 0].into_iter()), (0, &[1, 1, 3, 2, 2, 2, 2][..]));
        poll.count(4..9, [5, 5, 5, 5, 99, 3].into_iter());
        assert_eq!(poll.votes(), [1, 1, 3, 5, 5, 5, 5, 3, 0]);
        poll.clear();
        poll.count(0..99, std::iter::once(8));
        assert_eq!(poll.votes(), [0, 0, 0, 0, 0, 0, 1, 1, 1]);
    }
}
