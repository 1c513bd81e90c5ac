//! ONNX networks: an image in, probability maps out.
//!
//! A network is described by `NAME.toml` beside `NAME.onnx` ([`NetworkSpec`]);
//! the two networks that Waymark is tested with are known without one:
//!
//! | output | shape | classes |
//! |---|---|---|
//! | `class_probabilities` | 1x19xHxW | Cityscapes: 5 pole, 6 light, 7 sign |
//! | `lane_probability` | 1x1xHxW | lane |

mod denormals;
mod resample;
mod runtime;
mod signature;
mod softmax;
mod spec;

use std::path::{Path, PathBuf};

pub use runtime::Runtime;
pub use spec::{Activation, ChannelOrder, ClassChannels, Fit, Layout, NetworkSpec};

use super::{Class, Error, ProbabilityMaps, RgbImage};
use resample::View;
use runtime::{Model, Tensor};

/// A network that is ready to run.
pub struct Network {
    path: PathBuf,
    model: Box<dyn Model>,
    spec: NetworkSpec,
    /// Which input and which output of the model, from 0.
    ends: (usize, usize),
    /// Width and height of the input, pixels.
    size: (usize, usize),
}

impl Network {
    /// Loads `NAME.onnx`, with `NAME.toml` where there is one.
    ///
    /// # Errors
    /// [`common::Error`] where a file cannot be read or the description has an
    /// unknown key, [`Error::NoRuntime`] where there is no such runtime,
    /// [`Error::LoadNetwork`] where it cannot read the network,
    /// [`Error::UnknownNetwork`] where it has no description and is
    /// none of the known ones, [`Error::NetworkMismatch`] where it and its
    /// description contradict each other.
    pub fn load(path: impl AsRef<Path>, runtime: Runtime) -> Result<Self, Error> {
        let path = path.as_ref();
        let mut bytes = std::fs::read(path).map_err(common::Error::io(path))?;
        denormals::flush(&mut bytes);
        let model = runtime.load(path, bytes)?;
        let signature = model.signature();
        let description = path.with_extension("toml");
        let spec = if description.exists() {
            common::config::load::<NetworkSpec>(&description)?
        } else {
            signature.known().ok_or_else(|| Error::UnknownNetwork {
                path: path.into(),
                signature: signature.to_string(),
                description: description.clone(),
            })?
        };
        let (ends, size) = signature.matched(&spec).map_err(|message| Error::NetworkMismatch {
            path: path.into(),
            message,
            signature: signature.to_string(),
            description,
        })?;
        Ok(Self { path: path.into(), model, spec, ends, size })
    }

    /// The classes that it tells about.
    pub fn classes(&self) -> impl Iterator<Item = Class> + '_ {
        Class::ALL.into_iter().filter(|&class| !self.spec.classes.of(class).is_empty())
    }

    /// Runs it on an image and puts the probabilities of its classes into
    /// `maps`, at the image's size.
    ///
    /// # Errors
    /// [`Error::RunNetwork`] where the runtime fails or the output is not what
    /// the description says; [`Error::PlaneSize`] where `maps` has another
    /// size than the image.
    pub fn run(&self, image: &RgbImage, maps: &mut ProbabilityMaps) -> Result<(), Error> {
        let image_size = (image.width(), image.height());
        let view = View::new(&self.spec, image_size, self.size);
        let data = resample::to_input(image, &view, &self.spec);
        let shape = match self.spec.layout {
            Layout::Nchw => [1, 3, self.size.1, self.size.0],
            Layout::Nhwc => [1, self.size.1, self.size.0, 3],
        };
        let failed = |message: String| Error::RunNetwork { path: self.path.clone(), message };
        let output = self.model.run(self.ends, shape, data).map_err(failed)?;
        let scores = Scores::new(output, self.spec.layout).map_err(failed)?;
        for class in self.classes() {
            let values = scores.probabilities(self.spec.classes.of(class), self.spec.activation).map_err(failed)?;
            maps.set(class, resample::to_plane(&values, scores.size, &view, image_size))?;
        }
        Ok(())
    }
}

/// Runs all networks on an image; where two tell about a class, the later one
/// counts.
///
/// # Errors
/// As [`Network::run`].
pub fn run_all(networks: &[Network], image: &RgbImage) -> Result<ProbabilityMaps, Error> {
    let mut maps = ProbabilityMaps::zeros(image.width(), image.height());
    networks.iter().try_for_each(|network| network.run(image, &mut maps))?;
    Ok(maps)
}

/// The raw output of a network.
struct Scores {
    values: Vec<f32>,
    channels: usize,
    /// Width and height.
    size: (usize, usize),
    /// Distance in `values` of neighbouring channels and of neighbouring pixels.
    strides: (usize, usize),
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
        Ok(Self { values, channels, size: (width, height), strides })
    }

    /// The summed probability of some channels, per pixel, row by row.
    fn probabilities(&self, wanted: &[usize], activation: Activation) -> Result<Vec<f32>, String> {
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
        Ok((0..self.size.0 * self.size.1).map(probability).collect())
    }
}

#[cfg(test)]
mod tests;
