//! A network of fixed size for fewer rows of its images.
//!
//! A network of convolutions works at any size. What fixes the size of its
//! input, where it is exported with one, is what the export wrote down: the
//! shapes of input and output, and those that operators reshape to.

use rten_onnx::onnx::{DataType, GraphProto, ModelProto, TensorProto, ValueInfoProto};

/// Operators that take a shape, as their second input or later.
const SHAPED: [&str; 3] = ["Reshape", "Resize", "Expand"];

/// The most that a network makes an image smaller, each way, and what its
/// rows must be a multiple of.
pub(super) const STRIDE: usize = 32;

/// The ONNX model with an input of `rows` rows instead of `size.1`, of
/// `size.0` columns; nothing where the bytes are no model.
pub(super) fn cut(model: &[u8], size: (usize, usize), rows: usize) -> Option<Vec<u8>> {
    let mut model = ModelProto::parse_buf(model).ok()?;
    let graph = model.graph.as_mut()?;
    // Sizes in between are for the runtime to find again.
    graph.value_info.clear();
    graph.input.iter_mut().chain(&mut graph.output).for_each(open);
    for shape in shapes(graph) {
        reshape(shape, size, rows);
    }
    model.write_buf().ok()
}

/// Leaves the extent of the planes of an input or output open.
fn open(end: &mut ValueInfoProto) {
    let tensor = end.r#type.as_mut().and_then(|kind| kind.tensor_type.as_mut());
    let Some(shape) = tensor.and_then(|tensor| tensor.shape.as_mut()) else { return };
    // As many channels are left open, too: they are known from the whole model.
    for axis in shape.dim.iter_mut().filter(|axis| axis.dim_value.is_some_and(|size| size >= STRIDE as i64)) {
        axis.dim_value = None;
    }
}

/// The constants that are shapes.
fn shapes(graph: &mut GraphProto) -> impl Iterator<Item = &mut TensorProto> {
    let takes_shape = |operator: &Option<String>| SHAPED.iter().any(|&shaped| operator.as_deref() == Some(shaped));
    let named: Vec<String> = graph
        .node
        .iter()
        .filter(|node| takes_shape(&node.op_type))
        .flat_map(|node| node.input.iter().skip(1).cloned())
        .collect();
    let initializers = graph.initializer.iter_mut().map(|tensor| (tensor.name.clone(), tensor));
    let constants = graph.node.iter_mut().filter(|node| node.op_type.as_deref() == Some("Constant"));
    let constants = constants.filter_map(|node| {
        let value = node.attribute.iter_mut().find_map(|attribute| attribute.t.as_mut())?;
        Some((node.output.first().cloned(), value))
    });
    let is_shape = move |name: &Option<String>| name.as_ref().is_some_and(|name| named.contains(name));
    initializers.chain(constants).filter(move |(name, _)| is_shape(name)).map(|(_, tensor)| tensor)
}

/// Gives the planes in a shape, rows and columns one after the other or as
/// one number, their new extent.
fn reshape(shape: &mut TensorProto, size: (usize, usize), rows: usize) {
    if shape.data_type != Some(DataType::INT64) {
        return;
    }
    let mut sizes = shape.int64_data.clone();
    if let Some(raw) = &shape.raw_data {
        sizes = raw
            .borrow()
            .chunks_exact(8)
            .map(|bytes| bytes.iter().rev().fold(0, |n, &b| n << 8 | i64::from(b)))
            .collect();
    }
    let strides = (0..).map(|power| 1 << power).take_while(|&stride| stride <= STRIDE);
    let planes: Vec<[i64; 3]> = strides
        .filter(|stride| size.0.is_multiple_of(*stride) && size.1.is_multiple_of(*stride))
        .map(|stride| [size.0, size.1, rows].map(|extent| (extent / stride) as i64))
        .collect();
    let mut at = 0;
    while at < sizes.len() {
        let next = sizes.get(at + 1).copied();
        if let Some([_, _, fewer]) = planes.iter().find(|plane| plane[1] == sizes[at] && Some(plane[0]) == next) {
            sizes[at] = *fewer;
            at += 1;
        } else if let Some([width, _, fewer]) =
            planes.iter().find(|plane| plane[0].saturating_mul(plane[1]) == sizes[at])
        {
            sizes[at] = fewer.saturating_mul(*width);
        }
        at += 1;
    }
    shape.raw_data = None;
    shape.int64_data = sizes;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_in_a_shape_get_their_rows_and_nothing_else_changes() {
        let cut = |sizes: &[i64]| {
            let mut shape = TensorProto { data_type: Some(DataType::INT64), ..TensorProto::default() };
            shape.raw_data = Some(std::cell::RefCell::new(sizes.iter().flat_map(|size| size.to_le_bytes()).collect()));
            reshape(&mut shape, (1248, 384), 256);
            shape.int64_data
        };
        assert_eq!(cut(&[1, 32, 7488]), [1, 32, 32 * 156]);
        assert_eq!(cut(&[1, 32, 48, 156]), [1, 32, 32, 156]);
        assert_eq!(cut(&[1, 384, 1248]), [1, 256, 1248]);
        assert_eq!(cut(&[0, -1, 48, 8]), [0, -1, 48, 8]);
    }
}
