//! Products with the zeros beside the diagonal of a matrix are left out.
//!
//! A pooling whose windows do not fit (of 3 pixels into 2, say) is exported as
//! two matrices, one for rows and one for columns, that hold the same small
//! matrix again and again along their diagonals. Those of ESPNetv2 have 998
//! zeros in a thousand numbers, and take a twentieth of its time: its values
//! are parted, so that each part is multiplied by the small matrix alone.

use rten_onnx::onnx::{DataType, GraphProto, NodeProto, TensorProto};

use super::constants::{Constant, Constants};
use super::{is, sizes_of};

/// From so many blocks on they are worth the reshaping.
const MANY: usize = 8;

/// Parts what is multiplied by a matrix of blocks, if anything is; nothing
/// where the graph is not in order.
pub(super) fn part(graph: &mut GraphProto) -> Option<bool> {
    let mut constants = Constants::of(graph)?;
    let nodes = std::mem::take(&mut graph.node);
    let count = nodes.len();
    for node in nodes {
        match parted(&node, graph, &mut constants) {
            Some((nodes, tensors)) => {
                graph.node.extend(nodes);
                graph.initializer.extend(tensors);
            }
            None => graph.node.push(node),
        }
    }
    Some(graph.node.len() > count)
}

/// A product with a matrix of blocks as one with a block: reshaping, product,
/// reshaping, and their constants.
fn parted(
    node: &NodeProto,
    graph: &GraphProto,
    constants: &mut Constants,
) -> Option<([NodeProto; 3], [TensorProto; 3])> {
    let ([left, right], [output], true) = (&node.input[..], &node.output[..], is(node, "MatMul")) else { return None };
    let (matrix, value, is_left) = match (constants.get(left), constants.get(right)) {
        (Some(matrix), None) => (matrix, right, true),
        (None, Some(matrix)) => (matrix, left, false),
        _ => return None,
    };
    let (block, count) = block_of(matrix)?;
    let &[rows, columns] = &matrix.sizes[..] else { return None };
    let (block_rows, block_columns) = (block.sizes[0] as i64, block.sizes[1] as i64);
    // In a shape 0 is for an axis that stays, and -1 for what is left.
    let outer = vec![0; sizes_of(graph, value)?.len().checked_sub(2)?];
    let (apart, together) = if is_left {
        ([&outer[..], &[count as i64, block_columns, -1]].concat(), [&outer[..], &[rows as i64, -1]].concat())
    } else {
        ([&outer[..], &[-1, block_rows]].concat(), [&outer[..], &[-1, columns as i64]].concat())
    };
    let mut name = |what: &str| constants.new_name(&format!("{output} {what}"));
    let (parts, products) = (name("parts"), name("products"));
    let (block_name, apart_name, together_name) = (name("block"), name("apart"), name("together"));
    let operator = |kind: &str, inputs: [&String; 2], output: &String| NodeProto {
        op_type: Some(kind.into()),
        input: inputs.map(Clone::clone).to_vec(),
        output: vec![output.clone()],
        ..NodeProto::default()
    };
    let factors = if is_left { [&block_name, &parts] } else { [&parts, &block_name] };
    let nodes = [
        operator("Reshape", [value, &apart_name], &parts),
        operator("MatMul", factors, &products),
        operator("Reshape", [&products, &together_name], output),
    ];
    let tensors = [shape(apart_name, apart), shape(together_name, together), block.named(block_name)];
    Some((nodes, tensors))
}

/// The block that a matrix has along its diagonal, zeros beside it, and how
/// many times.
fn block_of(matrix: &Constant) -> Option<(Constant, usize)> {
    let &[rows, columns] = &matrix.sizes[..] else { return None };
    let is_of = |count: &usize| {
        let (high, wide) = (rows / count, columns / count);
        let expected = |row: usize, column: usize| {
            if row / high == column / wide { matrix.values[row % high * columns + column % wide] } else { 0.0 }
        };
        matrix.values.iter().enumerate().all(|(i, value)| value - expected(i / columns, i % columns) == 0.0)
    };
    let fits = |count: &usize| rows.is_multiple_of(*count) && columns.is_multiple_of(*count);
    let count = (MANY..=rows.min(columns)).rev().filter(fits).find(is_of)?;
    let (high, wide) = (rows / count, columns / count);
    let values = matrix.values.chunks(columns).take(high).flat_map(|row| row.iter().take(wide)).copied().collect();
    Some((Constant { sizes: vec![high, wide], values }, count))
}

fn shape(name: String, sizes: Vec<i64>) -> TensorProto {
    TensorProto {
        dims: vec![sizes.len() as i64],
        data_type: Some(DataType::INT64),
        int64_data: sizes,
        name: Some(name),
        ..TensorProto::default()
    }
}
