//! Integers of the map file: seven bits per byte, lowest first, the top bit
//! set on every byte but the last; signed ones zigzag-coded before.
//!
//! `bincode`'s own variable-length integers go from one byte to three at 251,
//! which would cost a map a third of its size, and accept several spellings of
//! the same number. Here a number has exactly one.

use bincode::de::Decoder;
use bincode::enc::Encoder;
use bincode::enc::write::Writer;
use bincode::error::{DecodeError, EncodeError};
use bincode::{Decode, Encode};

/// Longest number, bytes: 35 bits, where the difference of two 32-bit
/// coordinates takes 34 with its sign.
const MAX_BYTES: usize = 5;

/// A number that is never negative, below 2^35.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Unsigned(pub u64);

/// A number of either sign, in [-2^34, 2^34).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Signed(pub i64);

impl Unsigned {
    /// How many bytes it takes.
    pub fn len(self) -> usize {
        (64 - self.0.leading_zeros() as usize).div_ceil(7).max(1)
    }
}

impl Signed {
    /// How many bytes it takes.
    pub fn len(self) -> usize {
        self.zigzag().len()
    }

    /// 0, -1, 1, -2, .. becomes 0, 1, 2, 3, ..
    fn zigzag(self) -> Unsigned {
        Unsigned(((self.0 << 1) ^ (self.0 >> 63)) as u64)
    }
}

impl Encode for Unsigned {
    fn encode<E: Encoder>(&self, encoder: &mut E) -> Result<(), EncodeError> {
        let (mut bytes, length) = ([0; MAX_BYTES], self.len());
        if length > MAX_BYTES {
            return Err(EncodeError::Other("a number takes more than 35 bits"));
        }
        for (index, byte) in bytes.iter_mut().take(length).enumerate() {
            let more = if index + 1 < length { 0x80 } else { 0 };
            *byte = ((self.0 >> (7 * index)) & 0x7f) as u8 | more;
        }
        encoder.writer().write(&bytes[..length])
    }
}

impl<Context> Decode<Context> for Unsigned {
    fn decode<D: Decoder<Context = Context>>(decoder: &mut D) -> Result<Self, DecodeError> {
        let mut value = 0;
        for index in 0..MAX_BYTES {
            let byte = u8::decode(decoder)?;
            value |= u64::from(byte & 0x7f) << (7 * index);
            if byte & 0x80 == 0 {
                // A last byte of zero adds nothing: the same number is shorter.
                return if byte == 0 && index > 0 {
                    Err(DecodeError::Other("a number is longer than it needs to be"))
                } else {
                    Ok(Self(value))
                };
            }
        }
        Err(DecodeError::Other("a number takes more than 5 bytes"))
    }
}

impl Encode for Signed {
    fn encode<E: Encoder>(&self, encoder: &mut E) -> Result<(), EncodeError> {
        self.zigzag().encode(encoder)
    }
}

impl<Context> Decode<Context> for Signed {
    fn decode<D: Decoder<Context = Context>>(decoder: &mut D) -> Result<Self, DecodeError> {
        let Unsigned(zigzag) = Unsigned::decode(decoder)?;
        Ok(Self((zigzag >> 1).cast_signed() ^ -(zigzag & 1).cast_signed()))
    }
}

bincode::impl_borrow_decode!(Unsigned);
bincode::impl_borrow_decode!(Signed);

#[cfg(test)]
mod tests {
    use super::*;
    use bincode::config::standard;
    use bincode::{decode_from_slice, encode_to_vec};
    use proptest::prelude::*;

    #[test]
    fn numbers_are_spelt_as_the_format_says() {
        let unsigned = |v| encode_to_vec(Unsigned(v), standard()).unwrap();
        let signed = |v| encode_to_vec(Signed(v), standard()).unwrap();
        assert_eq!(unsigned(0), [0x00]);
        assert_eq!(unsigned(127), [0x7f]);
        assert_eq!(unsigned(128), [0x80, 0x01]);
        assert_eq!(unsigned(10_000), [0x90, 0x4e]);
        assert_eq!(unsigned((1 << 35) - 1), [0xff, 0xff, 0xff, 0xff, 0x7f]);
        assert_eq!(signed(-1), [0x01]);
        assert_eq!(signed(63), [0x7e]);
        assert_eq!(signed(-64), [0x7f]);
        assert_eq!(signed(64), [0x80, 0x01]);
        assert!(encode_to_vec(Unsigned(1 << 35), standard()).is_err());
    }

    #[test]
    fn a_number_has_only_one_spelling() {
        let read = |bytes: &[u8]| decode_from_slice::<Unsigned, _>(bytes, standard());
        assert!(read(&[0x80, 0x00]).is_err());
        assert!(read(&[0xff, 0xff, 0xff, 0xff, 0xff, 0x00]).is_err());
        assert!(read(&[0x80]).is_err());
    }

    proptest! {
        #[test]
        fn signed_numbers_survive(value in -(1_i64 << 34)..(1_i64 << 34)) {
            let bytes = encode_to_vec(Signed(value), standard()).unwrap();
            prop_assert_eq!(bytes.len(), Signed(value).len());
            let (back, read) = decode_from_slice::<Signed, _>(&bytes, standard()).unwrap();
            prop_assert_eq!((back.0, read), (value, bytes.len()));
        }
    }
}
