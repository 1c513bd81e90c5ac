//! Networks run by `rten`, in this program.

use rten::{Dimension, NodeId, NodeInfo, Value};
use rten_tensor::NdTensor;
use rten_tensor::prelude::{AsView as _, Layout as _};

use super::{Model, Signature, Tensor};

pub(super) fn load(bytes: Vec<u8>) -> Result<rten::Model, String> {
    rten::Model::load(bytes).map_err(|e| e.to_string())
}

impl Model for rten::Model {
    fn signature(&self) -> Signature {
        let describe = |&id: &NodeId| {
            let info = self.node_info(id);
            let name = info.as_ref().and_then(NodeInfo::name).unwrap_or_default().to_owned();
            let shape = info.and_then(|info| info.shape()).unwrap_or_default();
            let fixed = |d: &Dimension| if let Dimension::Fixed(size) = d { *size } else { 0 };
            (name, shape.iter().map(fixed).collect())
        };
        Signature {
            inputs: self.input_ids().iter().map(describe).collect(),
            outputs: self.output_ids().iter().map(describe).collect(),
        }
    }

    fn run(&self, ends: (usize, usize), shape: [usize; 4], values: Vec<f32>) -> Result<Tensor, String> {
        let (Some(&input), Some(&output)) = (self.input_ids().get(ends.0), self.output_ids().get(ends.1)) else {
            return Err("it has fewer inputs or outputs than it said".into());
        };
        let values = NdTensor::from_data(shape, values);
        let outputs =
            Self::run(self, vec![(input, values.view().into())], &[output], None).map_err(|e| e.to_string())?;
        let tensor: rten_tensor::Tensor<f32> =
            outputs.into_iter().next().and_then(Value::into_tensor).ok_or("its output holds no 32-bit floats")?;
        Ok(Tensor { shape: tensor.shape().to_vec(), values: tensor.into_data() })
    }
}
