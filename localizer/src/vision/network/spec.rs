//! What one must know of a network to run it on an image: the content of
//! `NAME.toml` beside `NAME.onnx`.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::rows::STRIDE;
use crate::vision::{Class, Error};

/// Order of an input's or output's axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// Batch, channel, row, column: what `torch.onnx` exports.
    #[default]
    Nchw,
    /// Batch, row, column, channel: what `tf2onnx` exports.
    Nhwc,
}

/// Order of an input's colour channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ChannelOrder {
    /// Red first.
    #[default]
    Rgb,
    /// Blue first, as `cv::imread` gives it.
    Bgr,
}

/// How an image of another size comes into the input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fit {
    /// Stretched where the shapes are within a quarter of each other, else padded.
    /// On KITTI 04, cut to 16:9, 4:3 or 2:1, poses are half to three quarters as far off
    /// as stretched; at 2.7:1 and 3.7:1, of 3.25:1, it is all one.
    Near,
    /// Each axis is scaled for itself: every input pixel shows the image. On
    /// KITTI, 2 % apart, this loses nothing; padding raised false signs and
    /// lanes along its edge.
    #[default]
    Stretch,
    /// Both axes are scaled alike and the right or the bottom is black: for
    /// inputs of quite another shape than the image.
    Pad,
}

/// What makes probabilities out of a network's output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Activation {
    /// It gives probabilities.
    #[default]
    None,
    /// It gives logits of independent classes.
    Sigmoid,
    /// It gives logits of classes of which one holds.
    Softmax,
}

/// The description of a network: one image in, one map of class scores out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NetworkSpec {
    /// Name of the input; empty for the only one.
    pub input: String,
    /// Name of the output; empty for the only one.
    pub output: String,
    /// Width of the input, pixels; 0 for the one that the network states.
    pub width: usize,
    /// Height of the input, pixels; 0 for the one that the network states.
    pub height: usize,
    /// Order of the axes, of input and output.
    pub layout: Layout,
    /// Order of the colours.
    pub channels: ChannelOrder,
    /// An input is `(byte * scale - mean) / std`: 1/255 for most networks.
    pub scale: f64,
    /// Mean per channel, in the order of `channels`.
    pub mean: [f64; 3],
    /// Standard deviation per channel, in the order of `channels`.
    pub std: [f64; 3],
    /// How the image comes into the input.
    pub fit: Fit,
    /// What makes probabilities out of the output.
    pub activation: Activation,
    /// Share of the input's rows, from the top, that it is run without, for
    /// its classes hardly ever show there: lines lie below the horizon. Where
    /// what it finds reaches that edge it is run on the whole image, so that
    /// nothing is lost but time. 0 for always.
    pub skip_top: f64,
    /// How far the output lies to the right of and below what it shows,
    /// pixels of the input: some networks learn the misalignment of the labels
    /// that they were trained with.
    pub shift_px: [f64; 2],
    /// Which output channels mean which class.
    pub classes: ClassChannels,
}

/// Output channels per class, counted from 0. The probability of a class is
/// the sum over its channels; one without channels is not told by the network.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClassChannels {
    /// Poles, posts, masts.
    pub pole: Vec<usize>,
    /// Traffic signs.
    pub sign: Vec<usize>,
    /// Traffic lights.
    pub light: Vec<usize>,
    /// Lane lines.
    pub lane: Vec<usize>,
    /// What grows: trees and hedges, not grass. Trunks are found in it.
    pub vegetation: Vec<usize>,
}

impl ClassChannels {
    /// The channels of a class.
    pub fn of(&self, class: Class) -> &[usize] {
        match class {
            Class::Pole => &self.pole,
            Class::Sign => &self.sign,
            Class::Light => &self.light,
            Class::Lane => &self.lane,
            Class::Vegetation => &self.vegetation,
        }
    }
}

impl Default for NetworkSpec {
    fn default() -> Self {
        Self {
            input: String::new(),
            output: String::new(),
            width: 0,
            height: 0,
            layout: Layout::default(),
            channels: ChannelOrder::default(),
            scale: 1.0 / 255.0,
            mean: [0.0; 3],
            std: [1.0; 3],
            fit: Fit::default(),
            activation: Activation::default(),
            skip_top: 0.0,
            shift_px: [0.0; 2],
            classes: ClassChannels::default(),
        }
    }
}

impl NetworkSpec {
    /// Reads `NAME.toml`.
    ///
    /// # Errors
    /// [`Error::BadDescription`] at its line, and [`common::Error`] where it cannot be
    /// read.
    pub(super) fn read(path: &Path) -> Result<Self, Error> {
        common::config::load(path).map_err(|error| {
            // What is said of settings names an option that prints those of the localizer.
            let (path, line, message) = match error {
                common::Error::UnknownKey { path, line, key, nearest } => {
                    let meant = nearest.map_or_else(String::new, |nearest| format!(" (did you mean `{nearest}`?)"));
                    (path, line, format!("there is no key `{key}`{meant}"))
                }
                common::Error::BadConfig { path, line, message } => (path, line, message),
                other => return other.into(),
            };
            Error::BadDescription { path, line, message, known: Self::keys() }
        })
    }

    /// All that may stand in a description, as words.
    fn keys() -> String {
        let all = serde_json::to_value(Self::default()).unwrap_or_default();
        let of = |table: Option<&serde_json::Value>| {
            let keys = table.and_then(serde_json::Value::as_object).into_iter().flatten();
            keys.map(|(key, _)| format!("`{key}`")).collect::<Vec<_>>().join(", ")
        };
        format!("{}, and under `[classes]` {}", of(Some(&all)), of(all.get("classes")))
    }

    /// What a channel's byte is multiplied with, and what is added then.
    pub(super) fn gain_and_bias(&self, channel: usize) -> (f32, f32) {
        let (mean, std) = (self.mean[channel], self.std[channel]);
        ((self.scale / std) as f32, (-mean / std) as f32)
    }

    /// How many of the input's rows it is run on: those below `skip_top`, and
    /// above them as many as make a multiple of [`STRIDE`].
    pub(super) fn rows(&self, height: usize) -> usize {
        let wanted = height as f64 * (1.0 - self.skip_top);
        height.min((wanted.round() as usize).next_multiple_of(STRIDE))
    }

    /// What is wrong with it by itself, in words.
    pub(super) fn contradiction(&self) -> Option<String> {
        let usable = |v: &f64| v.is_finite() && *v > 0.0;
        if !usable(&self.scale)
            || !self.std.iter().all(usable)
            || !self.mean.iter().chain(&self.shift_px).all(|v| v.is_finite())
        {
            return Some("`scale` and `std` must be positive numbers, `mean` and `shift_px` finite".into());
        }
        if !(0.0..1.0).contains(&self.skip_top) {
            return Some("`skip_top` must be at least 0 and below 1".into());
        }
        if Class::ALL.iter().all(|&class| self.classes.of(class).is_empty()) {
            return Some("`classes` names no output channel for any of pole, sign, light, lane and vegetation".into());
        }
        None
    }

    /// The description of a known network, by the name and the shape of its
    /// output (batch, channel, row, column).
    pub(super) fn known(output: &str, shape: &[usize]) -> Option<Self> {
        match (output, shape) {
            // ESPNetv2 on Cityscapes: 19 train ids, 5 pole, 6 light, 7 sign,
            // 8 vegetation;
            // normalised with the means of ImageNet.
            ("class_probabilities", [1, 19, _, _]) => Some(Self {
                mean: [0.485, 0.456, 0.406],
                std: [0.229, 0.224, 0.225],
                fit: Fit::Near,
                classes: ClassChannels {
                    pole: vec![5],
                    light: vec![6],
                    sign: vec![7],
                    vegetation: vec![8],
                    ..ClassChannels::default()
                },
                ..Self::default()
            }),
            // TwinLiteNet on BDD100K, its lane head only. Against the paint at
            // 2,000 places of KITTI images its masks lie 0.6 pixels too low,
            // by as much near and far, stretched and padded. The horizon of a
            // camera that looks ahead is in the middle; a sixth of the image
            // above it is for slopes and for cameras that look down.
            ("lane_probability", [1, 1, _, _]) => Some(Self {
                shift_px: [0.0, 0.6],
                skip_top: 1.0 / 3.0,
                fit: Fit::Near,
                classes: ClassChannels { lane: vec![0], ..ClassChannels::default() },
                ..Self::default()
            }),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_normalised_as_described() {
        let spec = NetworkSpec::known("class_probabilities", &[1, 19, 384, 1248]).unwrap();
        let (gain, bias) = spec.gain_and_bias(2);
        assert!((f64::from(51.0 * gain + bias) - (0.2 - 0.406) / 0.225).abs() < 1e-6);
        assert!(NetworkSpec::known("class_probabilities", &[1, 20, 384, 1248]).is_none());
    }

    #[test]
    fn contradictions_are_told() {
        assert!(NetworkSpec::default().contradiction().unwrap().contains("`classes`"));
        let spec =
            NetworkSpec { std: [1.0, 0.0, 1.0], ..NetworkSpec::known("lane_probability", &[1, 1, 4, 4]).unwrap() };
        assert!(spec.contradiction().unwrap().contains("`std`"));
    }
}
