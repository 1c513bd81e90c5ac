//! The 32-bit floats that stand in a graph.

use std::cell::RefCell;
use std::collections::{HashMap, HashSet};

use rten_onnx::onnx::{DataLocation, DataType, GraphProto, TensorProto};

/// A tensor that stands in the graph.
#[derive(Clone)]
pub(super) struct Constant {
    pub(super) sizes: Vec<usize>,
    pub(super) values: Vec<f32>,
}

/// The tensors that stand in a graph, by name.
pub(super) struct Constants {
    tensors: HashMap<String, Constant>,
    /// All names in the graph.
    names: HashSet<String>,
}

impl Constants {
    /// Nothing where a name is read before it stands for something, stands for
    /// two things, or may be read where nobody looks here: by the graph of an
    /// operator that has its own.
    pub(super) fn of(graph: &GraphProto) -> Option<Self> {
        let inputs: HashSet<&String> = graph.input.iter().filter_map(|input| input.name.as_ref()).collect();
        let mut names: HashSet<String> = inputs.iter().map(|&name| name.clone()).collect();
        let mut tensors = HashMap::new();
        for tensor in &graph.initializer {
            let name = tensor.name.as_ref()?;
            // What is an input, too, is but a default.
            if inputs.contains(name) {
                continue;
            }
            tensors.extend(Constant::read(tensor).map(|constant| (name.clone(), constant)));
            names.insert(name.clone()).then_some(())?;
        }
        for node in &graph.node {
            let is_known = |name: &String| name.is_empty() || names.contains(name);
            if !node.input.iter().all(is_known) || node.attribute.iter().any(|attribute| attribute.g.is_some()) {
                return None;
            }
            if node.op_type.as_deref() == Some("Constant") {
                let value = node.attribute.iter().find_map(|attribute| attribute.t.as_ref());
                tensors.extend(node.output.first().cloned().zip(value.and_then(Constant::read)));
            }
            let is_new = node.output.iter().filter(|name| !name.is_empty()).all(|name| names.insert(name.clone()));
            is_new.then_some(())?;
        }
        Some(Self { tensors, names })
    }

    pub(super) fn get(&self, name: &str) -> Option<&Constant> {
        self.tensors.get(name)
    }

    /// A name like this that stands for nothing else.
    pub(super) fn new_name(&mut self, like: &str) -> String {
        let mut name = like.to_owned();
        while !self.names.insert(name.clone()) {
            name.push('+');
        }
        name
    }
}

impl Constant {
    fn read(tensor: &TensorProto) -> Option<Self> {
        let is_elsewhere = tensor.data_location.is_some_and(|location| location != DataLocation::DEFAULT);
        if tensor.data_type != Some(DataType::FLOAT) || is_elsewhere {
            return None;
        }
        let values = if let Some(raw) = &tensor.raw_data {
            let raw = raw.borrow();
            let (values, []) = raw.as_chunks() else { return None };
            values.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect()
        } else {
            tensor.float_data.clone()
        };
        let sizes: Vec<usize> = tensor.dims.iter().map(|&size| usize::try_from(size)).collect::<Result<_, _>>().ok()?;
        let count = sizes.iter().try_fold(1_usize, |count, &size| count.checked_mul(size))?;
        (count > 0 && count == values.len()).then_some(Self { sizes, values })
    }

    pub(super) fn named(self, name: String) -> TensorProto {
        TensorProto {
            dims: self.sizes.iter().map(|&size| size as i64).collect(),
            data_type: Some(DataType::FLOAT),
            raw_data: Some(RefCell::new(self.values.iter().flat_map(|value| value.to_le_bytes()).collect())),
            name: Some(name),
            ..TensorProto::default()
        }
    }

    /// The numbers at each place of an axis and of those before it.
    pub(super) fn slices(&self, axis: usize) -> std::slice::Chunks<'_, f32> {
        self.values.chunks(self.sizes.iter().skip(axis + 1).product())
    }

    /// Only what is kept along an axis.
    pub(super) fn with(&self, axis: usize, kept: &[bool]) -> Option<Self> {
        let mut sizes = self.sizes.clone();
        let size = sizes.get_mut(axis).filter(|size| **size == kept.len())?;
        *size = kept.iter().filter(|&&kept| kept).count();
        let slices = self.slices(axis).zip(kept.iter().cycle()).filter(|(_, kept)| **kept);
        Some(Self { sizes, values: slices.flat_map(|(slice, _)| slice).copied().collect() })
    }
}
