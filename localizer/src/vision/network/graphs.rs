//! Graphs written by hand, for tests.

use std::cell::RefCell;

use rten_onnx::onnx::{
    AttributeProto, AttributeType, DataType, Dimension, GraphProto, ModelProto, NodeProto, OperatorSetIdProto,
    TensorProto, TensorShapeProto, TypeProto, TypeProtoTensor, ValueInfoProto,
};

/// An operator with its whole numbers: an axis, strides.
pub(super) fn node(operator: &str, inputs: &[&str], output: &str, numbers: &[(&str, &[i64])]) -> NodeProto {
    let attribute = |&(name, numbers): &(&str, &[i64])| {
        let attribute = AttributeProto { name: Some(name.into()), ..AttributeProto::default() };
        match numbers {
            &[number] => AttributeProto { i: Some(number), r#type: Some(AttributeType::INT), ..attribute },
            _ => AttributeProto { ints: numbers.to_vec(), r#type: Some(AttributeType::INTS), ..attribute },
        }
    };
    NodeProto {
        op_type: Some(operator.into()),
        name: Some(output.into()),
        input: inputs.iter().map(|&input| input.into()).collect(),
        output: vec![output.into()],
        attribute: numbers.iter().map(attribute).collect(),
        ..NodeProto::default()
    }
}

pub(super) fn floats(name: &str, sizes: &[usize], values: &[f32]) -> TensorProto {
    TensorProto {
        dims: sizes.iter().map(|&size| size as i64).collect(),
        data_type: Some(DataType::FLOAT),
        raw_data: Some(RefCell::new(values.iter().flat_map(|value| value.to_le_bytes()).collect())),
        name: Some(name.into()),
        ..TensorProto::default()
    }
}

/// A value of four axes.
pub(super) fn value(name: &str, sizes: [i64; 4]) -> ValueInfoProto {
    let axis = |&size: &i64| Dimension { dim_value: Some(size), ..Dimension::default() };
    let shape = TensorShapeProto { dim: sizes.iter().map(axis).collect() };
    let tensor_type = TypeProtoTensor { elem_type: Some(DataType::FLOAT), shape: Some(shape) };
    let kind = TypeProto { tensor_type: Some(tensor_type), ..TypeProto::default() };
    ValueInfoProto { name: Some(name.into()), r#type: Some(kind) }
}

/// The input is `image`.
pub(super) fn model(size: [i64; 4], node: Vec<NodeProto>, tensors: Vec<TensorProto>, outputs: &[&str]) -> ModelProto {
    let output = |name: &&str| ValueInfoProto { name: Some((*name).into()), ..ValueInfoProto::default() };
    let graph = GraphProto {
        node,
        initializer: tensors,
        input: vec![value("image", size)],
        output: outputs.iter().map(output).collect(),
        ..GraphProto::default()
    };
    let operators = OperatorSetIdProto { version: Some(17), ..OperatorSetIdProto::default() };
    ModelProto { ir_version: Some(8), graph: Some(graph), opset_import: vec![operators], ..ModelProto::default() }
}
