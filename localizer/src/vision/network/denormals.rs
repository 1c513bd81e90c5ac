//! Zeroes the weights of an ONNX file that are so small that they do nothing
//! but slow down.
//!
//! Weights that training pushed towards zero end up as subnormal numbers
//! (TwinLiteNet has tens of thousands), and processors take up to a hundred
//! times longer to multiply those. The processor could be told to flush them,
//! but only by unsafe code; so they are flushed in the file's bytes, once,
//! before the runtime sees them.

use std::ops::Range;

/// Weights below this are zeroed. It is 12 decades below what changes a sum of
/// the usual values in 32 bits, and below every epsilon that networks divide
/// with. Yet it is not lower: a channel of weights of 1e-25 gives values that
/// the next layers multiply down to the subnormals (1.2e-38), a tenth of
/// TwinLiteNet's time.
const FLUSHED_BELOW: f32 = 1e-20;

/// `TensorProto.DataType.FLOAT`.
const FLOAT: u64 = 1;

/// Zeroes tiny 32-bit floats in the initializers of an ONNX model. Bytes that
/// are no ONNX model are left to the runtime, which says what is wrong.
///
/// Field numbers are those of `onnx.proto3`: `ModelProto.graph` 7,
/// `GraphProto.initializer` 5, `TensorProto.data_type` 2, `.float_data` 4
/// (packed), `.raw_data` 9.
pub(super) fn flush(model: &mut [u8]) {
    for payload in float_payloads(model) {
        for bytes in model[payload].chunks_exact_mut(4) {
            let value = f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
            if value.abs() < FLUSHED_BELOW {
                bytes.fill(0);
            }
        }
    }
}

/// Where the 32-bit floats of the initializers lie.
fn float_payloads(model: &[u8]) -> Vec<Range<usize>> {
    let whole = 0..model.len();
    Fields { bytes: model, rest: whole }
        .messages(7)
        .flat_map(|graph| Fields { bytes: model, rest: graph }.messages(5))
        .filter(|tensor| {
            Fields { bytes: model, rest: tensor.clone() }.any(|f| f == Field { number: 2, value: Value::Number(FLOAT) })
        })
        .flat_map(|tensor| {
            Fields { bytes: model, rest: tensor }.filter_map(|field| match field {
                Field { number: 4 | 9, value: Value::Bytes(range) } => Some(range),
                _ => None,
            })
        })
        .collect()
}

#[derive(Debug, PartialEq)]
struct Field {
    number: u64,
    value: Value,
}

#[derive(Debug, PartialEq)]
enum Value {
    Number(u64),
    /// Where in the file they lie.
    Bytes(Range<usize>),
}

/// The fields of a protobuf message, up to the first that makes no sense.
struct Fields<'a> {
    bytes: &'a [u8],
    rest: Range<usize>,
}

impl<'a> Fields<'a> {
    /// The messages in the fields of this number.
    fn messages(self, wanted: u64) -> impl Iterator<Item = Range<usize>> + use<'a> {
        self.filter_map(move |field| match field {
            Field { number, value: Value::Bytes(range) } if number == wanted => Some(range),
            _ => None,
        })
    }

    fn varint(&mut self) -> Option<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = *self.bytes.get(self.rest.next()?)?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }

    fn take(&mut self, length: u64) -> Option<Range<usize>> {
        let length = usize::try_from(length).ok().filter(|&length| length <= self.rest.len())?;
        let taken = self.rest.start..self.rest.start + length;
        self.rest.start = taken.end;
        Some(taken)
    }
}

impl Iterator for Fields<'_> {
    type Item = Field;

    fn next(&mut self) -> Option<Field> {
        let key = self.varint()?;
        let value = match key & 7 {
            0 => Value::Number(self.varint()?),
            1 => Value::Bytes(self.take(8)?),
            2 => {
                let length = self.varint()?;
                Value::Bytes(self.take(length)?)
            }
            5 => Value::Bytes(self.take(4)?),
            _ => return None,
        };
        Some(Field { number: key >> 3, value })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(number: u8, content: &[u8]) -> Vec<u8> {
        [&[number << 3 | 2, content.len() as u8], content].concat()
    }

    fn model(data_type: u8, values: &[f32]) -> Vec<u8> {
        let raw: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let tensor = [vec![2 << 3, data_type], field(9, &raw)].concat();
        [vec![1 << 3, 8], field(7, &field(5, &tensor))].concat()
    }

    #[test]
    fn tiny_weights_become_zero_and_nothing_else_changes() {
        let mut is = model(1, &[1.0, 1e-40, -1e-25, -2e-20]);
        flush(&mut is);
        assert_eq!(is, model(1, &[1.0, 0.0, 0.0, -2e-20]));
    }

    #[test]
    fn other_types_and_no_models_stay_as_they_are() {
        let integers = model(6, &[1e-40; 3]);
        let mut is = integers.clone();
        flush(&mut is);
        assert_eq!(is, integers);
        // Truncated anywhere it must not panic.
        for length in 0..integers.len() {
            flush(&mut model(1, &[1e-40; 3])[..length]);
        }
        flush(&mut [0xff; 40]);
    }
}
