//! What a network says about its inputs and outputs, and whether that fits
//! its description.

use super::spec::{Layout, NetworkSpec};
use crate::vision::Class;

/// Largest width and height of an input, pixels: several times those of vehicle
/// cameras. What is more takes all memory.
const LARGEST_PX: usize = 16384;

/// The inputs and outputs of a network: name and shape (0 where open).
pub(super) struct Signature {
    pub(super) inputs: Vec<(String, Vec<usize>)>,
    pub(super) outputs: Vec<(String, Vec<usize>)>,
}

/// Input and output, from 0; width and height of the input, pixels.
pub(super) type Matched = ((usize, usize), (usize, usize));

impl Signature {
    pub(super) fn known(&self) -> Option<NetworkSpec> {
        match (&self.inputs[..], &self.outputs[..]) {
            ([(_, input)], [(output, shape)]) if matches!(input[..], [1, 3, _, _]) => NetworkSpec::known(output, shape),
            _ => None,
        }
    }

    /// Which input and which output, and the input's width and height; else
    /// what does not fit.
    pub(super) fn matched(&self, spec: &NetworkSpec) -> Result<Matched, String> {
        if let Some(message) = spec.contradiction() {
            return Err(message);
        }
        let (input, shape) = pick(&self.inputs, &spec.input, "input")?;
        let (output, output_shape) = pick(&self.outputs, &spec.output, "output")?;
        let &[batch, a, b, c] = shape else {
            return Err(format!("the input has {} axes where 4 are needed", shape.len()));
        };
        let (channels, height, width) = match spec.layout {
            Layout::Nchw => (a, b, c),
            Layout::Nhwc => (c, a, b),
        };
        if batch > 1 || (channels != 3 && channels != 0) {
            return Err(format!(
                "with this `layout` the input takes {batch} images of {channels} channels where 1 of 3 is needed"
            ));
        }
        let size = (size_of("width", spec.width, width)?, size_of("height", spec.height, height)?);
        if let &[_, a, _, c] = output_shape {
            let channels = if spec.layout == Layout::Nchw { a } else { c };
            let largest = Class::ALL.iter().flat_map(|&class| spec.classes.of(class)).max();
            if let Some(largest) = largest.filter(|&&largest| channels > 0 && largest >= channels) {
                return Err(format!("`classes` names channel {largest} and the output has {channels}, counted from 0"));
            }
        }
        Ok(((input, output), size))
    }
}

fn pick<'a>(nodes: &'a [(String, Vec<usize>)], wanted: &str, what: &str) -> Result<(usize, &'a [usize]), String> {
    let mut fitting = nodes.iter().enumerate().filter(|(_, (name, _))| wanted.is_empty() || name == wanted);
    match (fitting.next(), fitting.next()) {
        (Some((index, (_, shape))), None) => Ok((index, shape)),
        (None, _) => Err(format!("it has no {what} `{wanted}`")),
        (Some(_), Some(_)) => Err(format!("it has {} {what}s and `{what}` names none of them", nodes.len())),
    }
}

fn size_of(key: &str, described: usize, stated: usize) -> Result<usize, String> {
    match (described, stated) {
        (0, 0) => Err(format!("the network leaves its {key} open and the description gives no `{key}`")),
        (described, stated) if described != 0 && stated != 0 && described != stated => {
            Err(format!("the network's {key} is {stated} and the description says {described}"))
        }
        (described, stated) if described.max(stated) > LARGEST_PX => {
            Err(format!("a {key} of {} pixels is more than the {LARGEST_PX} that are taken", described.max(stated)))
        }
        (described, stated) => Ok(described.max(stated)),
    }
}

impl std::fmt::Display for Signature {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (i, (name, shape)) in self.inputs.iter().chain(&self.outputs).enumerate() {
            let separator = if i == 0 { "" } else { ", " };
            let shape: Vec<String> =
                shape.iter().map(|&d| if d == 0 { "?".to_owned() } else { d.to_string() }).collect();
            write!(f, "{separator}{name} {}", shape.join("x"))?;
        }
        Ok(())
    }
}
