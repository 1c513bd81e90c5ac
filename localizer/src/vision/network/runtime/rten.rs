//! Networks run by `rten`, in this program.

use rten::{Dimension, NodeId, NodeInfo, Value};
use rten_onnx::onnx::{GraphProto, ModelProto};
use rten_tensor::TensorView;
use rten_tensor::prelude::Layout as _;

use super::{Model, Signature, Tensor};
use crate::vision::network::simplify::{is, number};
use crate::vision::network::softmax;

/// A network, and what of it is computed here.
pub(super) struct RtenModel {
    model: rten::Model,
    /// What each output ends with, if that is one.
    softmax: Vec<Option<ChannelSoftmax>>,
}

/// A softmax over channels with nothing behind it but what needs it alone, a
/// slice, say. `rten` takes it pixel by pixel, which is a sixth of the time of
/// a network.
struct ChannelSoftmax {
    logits: NodeId,
    probabilities: NodeId,
}

pub(super) fn load(bytes: Vec<u8>) -> Result<RtenModel, String> {
    // What cannot be read is for `rten` to say.
    let graph = ModelProto::parse_buf(&bytes).ok().and_then(|model| model.graph);
    let model = rten::Model::load(bytes).map_err(|e| e.to_string())?;
    let softmax_of = |&output: &NodeId| {
        let output = model.node_info(output)?.name()?;
        let (logits, probabilities) = channel_softmax(graph.as_ref()?, output)?;
        Some(ChannelSoftmax { logits: model.find_node(logits)?, probabilities: model.find_node(probabilities)? })
    };
    let softmax = model.output_ids().iter().map(softmax_of).collect();
    Ok(RtenModel { model, softmax })
}

/// Names of the input and output of the softmax over channels that an output
/// ends with.
fn channel_softmax<'a>(graph: &'a GraphProto, output: &'a str) -> Option<(&'a str, &'a str)> {
    let maker = |name: &str| graph.node.iter().find(|node| node.output.iter().any(|o| o == name));
    let is_computed = |name: &&String| maker(name).is_some_and(|node| !is(node, "Constant"));
    let mut name = output;
    // No way is longer than the graph.
    for _ in &graph.node {
        let node = maker(name)?;
        let mut inputs = node.input.iter().filter(is_computed);
        let (Some(input), None) = (inputs.next(), inputs.next()) else { return None };
        if is(node, "Softmax") {
            return (number(node, "axis") == Some(1)).then_some((input, name));
        }
        name = input;
    }
    None
}

impl RtenModel {
    /// What `wanted` is where `given` is this.
    fn value(&self, given: NodeId, tensor: &Tensor, wanted: NodeId) -> Result<Tensor, String> {
        let tensor = TensorView::from_data(&tensor.shape, &tensor.values[..]);
        let outputs = self.model.run(vec![(given, tensor.into())], &[wanted], None).map_err(|e| e.to_string())?;
        let output: rten_tensor::Tensor<f32> =
            outputs.into_iter().next().and_then(Value::into_tensor).ok_or("its output holds no 32-bit floats")?;
        Ok(Tensor { shape: output.shape().to_vec(), values: output.into_data() })
    }
}

impl Model for RtenModel {
    fn signature(&self) -> Signature {
        let describe = |&id: &NodeId| {
            let info = self.model.node_info(id);
            let name = info.as_ref().and_then(NodeInfo::name).unwrap_or_default().to_owned();
            let shape = info.and_then(|info| info.shape()).unwrap_or_default();
            let fixed = |d: &Dimension| if let Dimension::Fixed(size) = d { *size } else { 0 };
            (name, shape.iter().map(fixed).collect())
        };
        Signature {
            inputs: self.model.input_ids().iter().map(describe).collect(),
            outputs: self.model.output_ids().iter().map(describe).collect(),
        }
    }

    fn run(&self, ends: (usize, usize), shape: [usize; 4], values: Vec<f32>) -> Result<Tensor, String> {
        let (Some(&input), Some(&output)) = (self.model.input_ids().get(ends.0), self.model.output_ids().get(ends.1))
        else {
            return Err("it has fewer inputs or outputs than it said".into());
        };
        let image = Tensor { shape: shape.to_vec(), values };
        let softmax = self.softmax.get(ends.1).and_then(Option::as_ref);
        // It gives no logits where it computes them and their softmax in one.
        let logits = softmax.and_then(|softmax| Some((softmax, self.value(input, &image, softmax.logits).ok()?)));
        let Some((softmax, mut scores)) = logits else { return self.value(input, &image, output) };
        softmax::over_channels(&mut scores.values, scores.shape.get(1).copied().unwrap_or_default());
        if softmax.probabilities == output {
            return Ok(scores);
        }
        self.value(softmax.probabilities, &scores, output)
    }
}
