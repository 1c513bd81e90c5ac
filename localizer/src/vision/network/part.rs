//! A network as it runs on a part of its images, and what it says.

use super::resample::{self, View};
use super::runtime::{Model, Tensor};
use super::spec::{Activation, Layout, NetworkSpec};
use crate::vision::RgbImage;

/// Over how many rows of the input a part's upper edge is watched: networks
/// say one thing of a few pixels.
const EDGE_ROWS: usize = 8;

/// A probability from which a pixel counts as found, at the edge.
const FOUND: f32 = 0.5;

/// A model that takes the lower rows of a network's input, or all.
pub(super) struct Part {
    model: Box<dyn Model>,
    /// Which input and which output of the model, from 0.
    ends: (usize, usize),
    /// Width and height of the network's input, pixels.
    size: (usize, usize),
    /// The first row that the model takes.
    top: usize,
}

impl Part {
    pub(super) fn new(model: Box<dyn Model>, ends: (usize, usize), size: (usize, usize), top: usize) -> Self {
        Self { model, ends, size, top }
    }

    /// What it says of an image, and how that lies in it; else what the
    /// runtime says.
    pub(super) fn scores(&self, image: &RgbImage, spec: &NetworkSpec) -> Result<(Scores, View), String> {
        let view = View::new(spec, (image.width(), image.height()), self.size);
        self.run(resample::to_input(image, &view, self.top, spec), spec).map(|scores| (scores, view))
    }

    /// Whether it runs, and says something of every row.
    pub(super) fn runs(&self, spec: &NetworkSpec) -> Result<(), String> {
        let (width, height) = (self.size.0, self.size.1 - self.top);
        let scores = self.run(vec![0.0; 3 * width * height], spec)?;
        let (given, wanted) = (scores.size.1 * width, scores.size.0 * height);
        (given == wanted)
            .then_some(())
            .ok_or_else(|| format!("of {width}x{height} pixels its output has {}x{}", scores.size.0, scores.size.1))
    }

    fn run(&self, values: Vec<f32>, spec: &NetworkSpec) -> Result<Scores, String> {
        let (width, height) = (self.size.0, self.size.1 - self.top);
        let shape = match spec.layout {
            Layout::Nchw => [1, 3, height, width],
            Layout::Nhwc => [1, height, width, 3],
        };
        let output = self.model.run(self.ends, shape, values)?;
        let mut scores = Scores::new(output, spec.layout)?;
        scores.top = self.top * scores.size.1 / height;
        scores.edge = (EDGE_ROWS * scores.size.1 / height).max(1);
        Ok(scores)
    }
}

/// The raw output of a network.
pub(super) struct Scores {
    values: Vec<f32>,
    channels: usize,
    /// Width and height.
    size: (usize, usize),
    /// Distance in `values` of neighbouring channels and of neighbouring pixels.
    strides: (usize, usize),
    /// Rows above these that nothing is said of.
    top: usize,
    /// How many rows are the edge to those.
    edge: usize,
}

/// Probabilities of a class over the whole of a network's input, row by row.
pub(super) struct Probabilities {
    pub(super) values: Vec<f32>,
    /// Width and height.
    pub(super) size: (usize, usize),
    /// Whether something is found at the edge to rows that were left out.
    pub(super) reach_edge: bool,
}

impl Scores {
    fn new(output: Tensor, layout: Layout) -> Result<Self, String> {
        let Tensor { shape, values } = output;
        let [1, a, b, c] = shape[..] else {
            return Err(format!("its output has shape {shape:?} where 1 image of 3 axes is needed"));
        };
        let (channels, height, width) = match layout {
            Layout::Nchw => (a, b, c),
            Layout::Nhwc => (c, a, b),
        };
        if channels * height * width == 0 {
            return Err(format!("its output of shape {shape:?} is empty"));
        }
        let strides = match layout {
            Layout::Nchw => (height * width, 1),
            Layout::Nhwc => (1, channels),
        };
        Ok(Self { values, channels, size: (width, height), strides, top: 0, edge: 0 })
    }

    /// The summed probability of some channels, per pixel; 0 where nothing is
    /// said.
    pub(super) fn probabilities(&self, wanted: &[usize], activation: Activation) -> Result<Probabilities, String> {
        if let Some(channel) = wanted.iter().find(|&&channel| channel >= self.channels) {
            return Err(format!(
                "its output has {} channels and the description names channel {channel}",
                self.channels
            ));
        }
        let (channel_stride, pixel_stride) = self.strides;
        let at = |pixel: usize, channel: usize| self.values[pixel * pixel_stride + channel * channel_stride];
        let probability = |pixel: usize| match activation {
            Activation::None => wanted.iter().map(|&c| at(pixel, c)).sum::<f32>(),
            Activation::Sigmoid => wanted.iter().map(|&c| 1.0 / (1.0 + (-at(pixel, c)).exp())).sum(),
            Activation::Softmax => {
                let largest = (0..self.channels).map(|c| at(pixel, c)).fold(f32::MIN, f32::max);
                let exp = |c: usize| (at(pixel, c) - largest).exp();
                wanted.iter().map(|&c| exp(c)).sum::<f32>() / (0..self.channels).map(exp).sum::<f32>()
            }
        };
        let (width, height) = self.size;
        let mut values = vec![0.0; self.top * width];
        values.extend((0..width * height).map(probability));
        let edge = values.iter().skip(self.top * width).take(self.edge * width);
        let reach_edge = self.top > 0 && edge.copied().any(|p| p > FOUND);
        Ok(Probabilities { values, size: (width, self.top + height), reach_edge })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn activations_make_probabilities_of_logits() {
        let scores =
            Scores { values: vec![1.0, 2.0, 0.0], channels: 3, size: (1, 1), strides: (1, 1), top: 0, edge: 1 };
        let softmax = scores.probabilities(&[1], Activation::Softmax).unwrap().values[0];
        assert!((softmax - 2_f32.exp() / (1_f32.exp() + 2_f32.exp() + 1.0)).abs() < 1e-6);
        let sigmoid = scores.probabilities(&[2], Activation::Sigmoid).unwrap().values[0];
        assert!((sigmoid - 0.5).abs() < 1e-6);
        assert!(scores.probabilities(&[3], Activation::None).err().unwrap().contains("channel 3"));
    }
}
