//! LZF, the compression of `binary_compressed` PCD.
//!
//! A control byte below 32 is followed by that many and one literal bytes. In
//! any other the upper three bits are a length less 2 (7: plus the next byte),
//! and the lower five with the next byte a distance back, less 1.

/// Decompresses to exactly `length` bytes; none where the input does not say
/// so many.
pub fn decompress(input: &[u8], length: usize) -> Option<Vec<u8>> {
    // What is promised may be a lie: no more than the input can hold.
    let mut out = Vec::with_capacity(length.min(input.len().saturating_mul(264)));
    let mut rest = input.iter().copied();
    while let Some(control) = rest.next() {
        let control = usize::from(control);
        if control < 32 {
            for _ in 0..=control {
                out.push(rest.next()?);
            }
        } else {
            let more = if control >> 5 == 7 { usize::from(rest.next()?) } else { 0 };
            let count = (control >> 5) + more + 2;
            let back = ((control & 31) << 8) + usize::from(rest.next()?) + 1;
            let from = out.len().checked_sub(back)?;
            for at in from..from + count {
                let byte = *out.get(at)?;
                out.push(byte);
            }
        }
        if out.len() > length {
            return None;
        }
    }
    (out.len() == length).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_and_runs() {
        // "ab", then 10 bytes from 2 back.
        let packed = [1, b'a', b'b', (7 << 5), 1, 1];
        assert_eq!(decompress(&packed, 12).unwrap(), b"abababababab");
        assert_eq!(decompress(&packed, 11), None);
        assert_eq!(decompress(&packed[..5], 12), None);
        assert_eq!(decompress(&[1 << 5, 7], 3), None);
    }
}
