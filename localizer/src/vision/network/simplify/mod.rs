//! What a network computes for nothing is taken out of its graph, before a
//! runtime sees it.
//!
//! | what | why it is there |
//! |---|---|
//! | [`unread`]: channels that nobody reads | training made their weights zero |
//! | [`blocks`]: products with zeros | a small matrix along the diagonal of a large one |

mod blocks;
mod constants;
mod unread;

use std::collections::HashSet;

use rten_onnx::onnx::{GraphProto, ModelProto, NodeProto};

/// The ONNX model with less to compute, and the same output but for rounding;
/// nothing where there is nothing to leave out, and where the bytes are no
/// model.
pub(super) fn simplified(model: &[u8]) -> Option<Vec<u8>> {
    let mut model = ModelProto::parse_buf(model).ok()?;
    let graph = model.graph.as_mut()?;
    let mut is_simpler = blocks::part(graph)?;
    is_simpler |= unread::drop(graph)?;
    if !is_simpler {
        return None;
    }
    sweep(graph);
    // Sizes in between are for the runtime to find again.
    graph.value_info.clear();
    model.write_buf().ok()
}

/// Removes what makes nothing that is read.
fn sweep(graph: &mut GraphProto) {
    let ends = graph.output.iter().filter_map(|output| output.name.as_ref());
    let mut read: HashSet<String> = ends.cloned().collect();
    // Nodes stand behind those that they read.
    let mut is_read = vec![false; graph.node.len()];
    for (node, is_read) in graph.node.iter().zip(&mut is_read).rev() {
        *is_read = node.output.iter().any(|output| read.contains(output));
        if *is_read {
            read.extend(node.input.iter().cloned());
        }
    }
    let mut is_read = is_read.into_iter();
    graph.node.retain(|_| is_read.next().unwrap_or(true));
    // Those that are inputs, too, are what these are where nothing is given.
    read.extend(graph.input.iter().filter_map(|input| input.name.clone()));
    graph.initializer.retain(|tensor| tensor.name.as_ref().is_none_or(|name| read.contains(name)));
}

/// A whole number that a node is told.
pub(super) fn number(node: &NodeProto, attribute: &str) -> Option<i64> {
    node.attribute.iter().find(|is| is.name.as_deref() == Some(attribute))?.i
}

/// Whether a node is this operator of the standard.
pub(super) fn is(node: &NodeProto, operator: &str) -> bool {
    node.op_type.as_deref() == Some(operator) && matches!(node.domain.as_deref(), None | Some("" | "ai.onnx"))
}

/// The sizes of a value where the graph says them; none for those that are
/// open.
fn sizes_of(graph: &GraphProto, name: &str) -> Option<Vec<Option<i64>>> {
    let mut values = graph.value_info.iter().chain(&graph.input);
    let value = values.find(|value| value.name.as_deref() == Some(name))?;
    let shape = value.r#type.as_ref()?.tensor_type.as_ref()?.shape.as_ref()?;
    Some(shape.dim.iter().map(|axis| axis.dim_value).collect())
}

#[cfg(test)]
mod tests;
