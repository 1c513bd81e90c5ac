//! What runs a network: `rten`, which is built in, or ONNX Runtime.
//!
//! A runtime gets the bytes of a model and numbers in, and gives its signature
//! and numbers out; images and classes are not its business.

#[cfg(feature = "ort")]
mod onnx_runtime;
mod rten;

use std::path::Path;

use super::signature::Signature;
use crate::vision::Error;

/// What runs the networks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Runtime {
    /// Built in, needs nothing.
    #[default]
    Rten,
    /// ONNX Runtime on the processor.
    Ort,
    /// ONNX Runtime on an NVIDIA GPU, from a library that was built for it.
    OrtCuda,
}

/// Numbers with their axes, the last one densest.
pub(super) struct Tensor {
    pub(super) shape: Vec<usize>,
    pub(super) values: Vec<f32>,
}

/// A network as a runtime has it.
pub(super) trait Model: Send + Sync {
    /// Its inputs and outputs.
    fn signature(&self) -> Signature;

    /// What the output `ends.1` says to `values` of this shape at the input
    /// `ends.0`; else what the runtime says.
    fn run(&self, ends: (usize, usize), shape: [usize; 4], values: Vec<f32>) -> Result<Tensor, String>;
}

impl Runtime {
    /// The model in the bytes of an ONNX file, which `path` was read from.
    pub(super) fn load(self, path: &Path, bytes: Vec<u8>) -> Result<Box<dyn Model>, Error> {
        let unreadable = |message| Error::LoadNetwork { path: path.into(), message };
        match self {
            Self::Rten => Ok(Box::new(rten::load(bytes).map_err(unreadable)?)),
            #[cfg(feature = "ort")]
            Self::Ort | Self::OrtCuda => {
                let device =
                    |runtime| self.missing(onnx_runtime::device(runtime == Self::OrtCuda), onnx_runtime::REMEDY);
                let model = device(self)?.load(&bytes);
                // Whether there is a GPU is known here first: a model that
                // the processor takes is not what is wrong.
                let is_intact = model.is_err() && self == Self::OrtCuda && device(Self::Ort)?.load(&bytes).is_ok();
                let model =
                    if is_intact { self.missing(model, onnx_runtime::REMEDY)? } else { model.map_err(unreadable)? };
                Ok(Box::new(model))
            }
            #[cfg(not(feature = "ort"))]
            Self::Ort | Self::OrtCuda => self.missing(
                Err("this program was built without ONNX Runtime".into()),
                "build it with `--features localizer/ort`",
            ),
        }
    }

    fn missing<T>(self, found: Result<T, String>, remedy: &'static str) -> Result<T, Error> {
        let runtime = match self {
            Self::Rten => "rten",
            Self::Ort => "ort",
            Self::OrtCuda => "ort-cuda",
        };
        found.map_err(|message| Error::NoRuntime { runtime, message, remedy })
    }
}
