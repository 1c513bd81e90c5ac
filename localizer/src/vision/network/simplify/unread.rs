//! Channels that nobody reads are not computed.
//!
//! Training pushes the weights of whole channels nearly to zero, and
//! [`denormals`](crate::vision::network::denormals) makes them zero:
//! TwinLiteNet's largest convolution makes 131 channels, of which the next one
//! reads 54. The others cannot be seen in the output. They are dropped from the
//! weights that make them, from the constants of what stands in between, and
//! from the weights that do not read them; all else stays what it is. (Zero
//! times infinity is no number: a network that overflows in such a channel
//! then says what it did not before.)
//!
//! A channel stays where anything reads it that is not understood here.

use std::collections::BTreeMap;

use rten_onnx::onnx::{GraphProto, NodeProto};

use super::constants::Constants;
use super::{is, number};

/// Operators that make each channel of the same channel of their inputs alone.
const CHANNEL_WISE: [&str; 23] = [
    "Abs",
    "Add",
    "AveragePool",
    "BatchNormalization",
    "Clip",
    "Div",
    "Elu",
    "Exp",
    "GlobalAveragePool",
    "GlobalMaxPool",
    "HardSigmoid",
    "HardSwish",
    "Identity",
    "LeakyRelu",
    "MaxPool",
    "Mul",
    "Neg",
    "PRelu",
    "Relu",
    "Sigmoid",
    "Softplus",
    "Sub",
    "Tanh",
];

/// Drops the channels that nobody reads, if there are any; nothing where the
/// graph is not in order.
pub(super) fn drop(graph: &mut GraphProto) -> Option<bool> {
    let mut constants = Constants::of(graph)?;
    let cuts = Channels::of(graph, &constants).cuts();
    for (&(node, input), axes) in &cuts {
        let name = graph.node.get_mut(node)?.input.get_mut(input)?;
        let mut constant = constants.get(name)?.clone();
        for (axis, kept) in axes {
            constant = constant.with(*axis, kept)?;
        }
        // A node gets its own: others may read the same constant.
        *name = constants.new_name(name);
        graph.initializer.push(constant.named(name.clone()));
    }
    Some(!cuts.is_empty())
}

/// What is to stay of the constants of nodes: by node and input, along some
/// axes.
type Cuts = BTreeMap<(usize, usize), Vec<(usize, Vec<bool>)>>;

/// A value with its channels on the second axis. A channel that is handed on
/// keeps its number.
#[derive(Clone)]
struct Value {
    channels: Vec<usize>,
    /// How many axes it has.
    axes: usize,
}

/// An axis of a constant, the input of a node, that lies along channels.
struct Along {
    constant: (usize, usize),
    axis: usize,
    channels: Vec<usize>,
}

/// What is known of the channels of a graph.
struct Channels<'a> {
    constants: &'a Constants,
    /// The values that are understood, by name.
    values: BTreeMap<&'a str, Value>,
    /// Of each channel whether it is kept.
    kept: Vec<bool>,
    /// Channels, and which others each of them needs.
    needs: Vec<(usize, Vec<usize>)>,
    along: Vec<Along>,
}

impl<'a> Channels<'a> {
    fn of(graph: &'a GraphProto, constants: &'a Constants) -> Self {
        let mut channels =
            Self { constants, values: BTreeMap::new(), kept: Vec::new(), needs: Vec::new(), along: Vec::new() };
        let mut read: Vec<&String> = graph.output.iter().filter_map(|output| output.name.as_ref()).collect();
        for (at, node) in graph.node.iter().enumerate() {
            if let Some((output, value)) = channels.made_by(node, at) {
                channels.values.insert(output, value);
            } else {
                read.extend(&node.input);
            }
        }
        for value in read.iter().filter_map(|name| channels.values.get(name.as_str())) {
            value.channels.iter().for_each(|&channel| channels.kept[channel] = true);
        }
        channels.settle();
        channels
    }

    /// What is to stay of the constants of which not all is.
    fn cuts(&self) -> Cuts {
        let mut cuts = Cuts::new();
        for along in &self.along {
            let kept: Vec<bool> = along.channels.iter().map(|&channel| self.kept[channel]).collect();
            if kept.contains(&false) {
                cuts.entry(along.constant).or_default().push((along.axis, kept));
            }
        }
        cuts
    }

    /// Keeps what is needed by what is kept.
    fn settle(&mut self) {
        loop {
            let before = self.kept.clone();
            // What is needed was mostly made before.
            for (channel, needed) in self.needs.iter().rev() {
                if self.kept[*channel] {
                    for &needed in needed {
                        self.kept[needed] = true;
                    }
                }
            }
            if self.kept == before {
                // A value without any channel is for no runtime.
                let is_empty = |value: &&Value| value.channels.iter().all(|&channel| !self.kept[channel]);
                let Some(first) = self.values.values().find(is_empty).and_then(|value| value.channels.first()) else {
                    break;
                };
                self.kept[*first] = true;
            }
        }
    }

    /// What a node makes, and its name; nothing where that is not understood.
    fn made_by(&mut self, node: &'a NodeProto, at: usize) -> Option<(&'a str, Value)> {
        let [output] = &node.output[..] else { return None };
        let value = if is(node, "Conv") {
            self.convolution(node, at, 0)
        } else if is(node, "ConvTranspose") {
            self.convolution(node, at, 1)
        } else if is(node, "Concat") {
            self.concatenation(node)
        } else if CHANNEL_WISE.iter().any(|operator| is(node, operator)) {
            self.channel_wise(node, at)
        } else {
            None
        };
        Some((output, value?))
    }

    /// Of a convolution that has the channels that it makes on this axis of
    /// its weights, the first or the second, and those that it reads on the
    /// other.
    fn convolution(&mut self, node: &NodeProto, at: usize, made: usize) -> Option<Value> {
        let [input, weights, bias @ ..] = &node.input[..] else { return None };
        let weights = self.constants.get(weights)?;
        let axes = weights.sizes.len();
        let (&makes, &reads) = (weights.sizes.get(made)?, weights.sizes.get(1 - made)?);
        let bias = bias.first().filter(|name| !name.is_empty());
        let fits = bias.is_none_or(|name| self.constants.get(name).is_some_and(|bias| bias.sizes == [makes]));
        if !fits || number(node, "group").is_some_and(|groups| groups != 1) {
            return None;
        }
        let from = match self.values.get(input.as_str()) {
            Some(from) if (from.channels.len(), from.axes) != (reads, axes) => return None,
            from => from.map(|from| from.channels.clone()),
        };
        let first = self.kept.len();
        let to: Vec<usize> = (first..first + makes).collect();
        self.kept.resize(first + makes, false);
        self.along.push(Along { constant: (at, 1), axis: made, channels: to.clone() });
        if bias.is_some() {
            self.along.push(Along { constant: (at, 2), axis: 0, channels: to.clone() });
        }
        if let Some(from) = from {
            let mut needed = vec![Vec::new(); makes];
            for (pair, weights) in weights.slices(1).enumerate() {
                let (to, read) = if made == 0 { (pair / reads, pair % reads) } else { (pair % makes, pair / makes) };
                if weights.iter().any(|&weight| weight != 0.0) {
                    needed[to].push(from[read]);
                }
            }
            self.needs.extend(to.iter().copied().zip(needed));
            self.along.push(Along { constant: (at, 1), axis: 1 - made, channels: from });
        }
        Some(Value { channels: to, axes })
    }

    fn concatenation(&self, node: &NodeProto) -> Option<Value> {
        let values: Vec<&Value> =
            node.input.iter().map(|name| self.values.get(name.as_str())).collect::<Option<_>>()?;
        let axes = values.first()?.axes;
        let is_of_channels = number(node, "axis") == Some(1) && values.iter().all(|value| value.axes == axes);
        let channels = values.iter().flat_map(|value| &value.channels).copied().collect();
        is_of_channels.then_some(Value { channels, axes })
    }

    fn channel_wise(&mut self, node: &NodeProto, at: usize) -> Option<Value> {
        let value = node.input.iter().find_map(|name| self.values.get(name.as_str()))?.clone();
        // How constants lay along their values was once told by attributes.
        if number(node, "axis").is_some() || number(node, "broadcast").is_some() {
            return None;
        }
        let (mut along, mut needs) = (Vec::new(), Vec::new());
        for (input, name) in node.input.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
            if let Some(other) = self.values.get(name.as_str()) {
                if (other.channels.len(), other.axes) != (value.channels.len(), value.axes) {
                    return None;
                }
                // One cannot be dropped without the other.
                let pairs = value.channels.iter().zip(&other.channels).filter(|(one, other)| one != other);
                needs.extend(pairs.flat_map(|(&one, &other)| [(one, vec![other]), (other, vec![one])]));
            } else {
                let constant = self.constants.get(name)?;
                // Constants of fewer axes lie along the last ones.
                let is_list = node.op_type.as_deref() == Some("BatchNormalization");
                let axis = if is_list { Some(0) } else { (constant.sizes.len() + 1).checked_sub(value.axes) };
                match axis.and_then(|axis| Some((axis, *constant.sizes.get(axis)?))) {
                    Some((axis @ 0..=1, size)) if size == value.channels.len() => {
                        along.push(Along { constant: (at, input), axis, channels: value.channels.clone() });
                    }
                    Some((0..=1, 1)) => {}
                    None if constant.values.len() == 1 => {}
                    _ => return None,
                }
            }
        }
        self.along.extend(along);
        self.needs.extend(needs);
        Some(value)
    }
}
