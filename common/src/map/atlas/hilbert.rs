//! The Hilbert curve: an order of places in which neighbours in the file are
//! neighbours on the ground.

/// How far along the curve of order 32 the cell (x, z) comes.
///
/// The curve runs through all cells of the plane and never jumps: cells that
/// follow each other share an edge.
pub(super) fn index(x: i32, z: i32) -> u64 {
    // The smallest coordinate becomes 0.
    let unsigned = |value: i32| value.cast_unsigned() ^ (1 << 31);
    let (mut x, mut z) = (unsigned(x), unsigned(z));
    let mut index = 0;
    for bit in (0..32).rev() {
        let (right, up) = (u64::from(x >> bit & 1), u64::from(z >> bit & 1));
        index |= ((3 * right) ^ up) << (2 * bit);
        // Each quarter holds the same curve, turned so that the ends meet.
        if up == 0 {
            if right == 1 {
                (x, z) = (!x, !z);
            }
            (x, z) = (z, x);
        }
    }
    index
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_that_follow_each_other_are_neighbours() {
        for (left, low) in [(0, 0), (-16, -16), (i32::MAX - 15, i32::MIN), (-16, 0)] {
            let cells = (0..16).flat_map(|x| (0..16).map(move |z| (left + x, low + z)));
            let mut sorted: Vec<_> = cells.map(|(x, z)| (index(x, z), x, z)).collect();
            sorted.sort_unstable();
            for pair in sorted.windows(2) {
                let [(i, x0, z0), (j, x1, z1)] = [pair[0], pair[1]];
                assert_eq!(j - i, 1);
                assert_eq!((x1 - x0).abs() + (z1 - z0).abs(), 1);
            }
        }
    }

    #[test]
    fn the_corners_of_the_plane_have_indices_too() {
        let corners = [(i32::MIN, i32::MIN), (i32::MIN, i32::MAX), (i32::MAX, i32::MAX), (i32::MAX, i32::MIN)];
        let indices = corners.map(|(x, z)| index(x, z));
        assert_eq!(indices[0], 0);
        assert_eq!(indices[3], u64::MAX);
        assert!(indices.is_sorted());
    }
}
