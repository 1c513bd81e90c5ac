//! Networks run by ONNX Runtime, from a library that is found at run time.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::path::PathBuf;
use std::sync::{Mutex, OnceLock, PoisonError};

use ort::environment::Environment;
use ort::ep::CUDA;
use ort::ep::cuda::ConvAlgorithmSearch;
use ort::session::Session;
use ort::session::builder::SessionBuilder;
use ort::value::{Outlet, TensorRef};

use super::{Model, Signature, Tensor};

pub(super) const REMEDY: &str = "name the library of ONNX Runtime, 1.17 or newer, in `ORT_DYLIB_PATH` (it lies in \
     `capi` of the Python package onnxruntime, for ort-cuda onnxruntime-gpu, which needs a GPU, and CUDA and cuDNN \
     where libraries are found)";

/// The library: one for the whole program, which is what ONNX Runtime allows.
fn environment() -> Result<&'static Environment, String> {
    static ENVIRONMENT: OnceLock<Result<Environment, String>> = OnceLock::new();
    let load = || {
        let named = std::env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty());
        let library = named.map_or_else(|| format!("{DLL_PREFIX}onnxruntime{DLL_SUFFIX}").into(), PathBuf::from);
        let builder = ort::init_from(library).map_err(|e| e.to_string())?;
        builder.with_telemetry(false).build().map_err(|e| e.to_string())
    };
    ENVIRONMENT.get_or_init(load).as_ref().map_err(Clone::clone)
}

/// Where networks are to run, with all that this needs; else what is missing.
pub(super) fn device(cuda: bool) -> Result<Device, String> {
    let builder = Session::builder(environment()?).map_err(|e| e.to_string())?;
    if !cuda {
        return Ok(Device(builder));
    }
    // TF32 takes 10 bits of each factor, which moves probabilities by up to
    // 6/255 and is no faster here. An exhaustive search tries all algorithms
    // on the first image: three seconds, for the same time a frame.
    let cuda = CUDA::default().with_tf32(false).with_conv_algorithm_search(ConvAlgorithmSearch::Heuristic);
    // Else it would run on the processor and say nothing.
    let provider = cuda.build().error_on_failure();
    builder.with_execution_providers([provider]).map(Device).map_err(|e| brief(&e.to_string()))
}

pub(super) struct Device(SessionBuilder);

impl Device {
    pub(super) fn load(mut self, bytes: &[u8]) -> Result<OrtModel, String> {
        let session = self.0.commit_from_memory(bytes).map_err(|e| brief(&e.to_string()))?;
        Ok(OrtModel(Mutex::new(session)))
    }
}

/// What ONNX Runtime says, without where in its source it says so: what CUDA
/// answered, or what stands behind `[ONNXRuntimeError] : 1 : FAIL : `.
fn brief(message: &str) -> String {
    let told = if let Some(at) = message.find("CUDA failure") {
        message[at..].split(" ;").next().unwrap_or_default()
    } else {
        let behind = message.split_once("[ONNXRuntimeError] : ").and_then(|(_, behind)| behind.splitn(3, " : ").nth(2));
        behind.unwrap_or(message)
    };
    told.split_whitespace().collect::<Vec<_>>().join(" ").trim_end_matches('.').to_owned()
}

/// A session, which runs one image at a time.
pub(super) struct OrtModel(Mutex<Session>);

impl Model for OrtModel {
    fn signature(&self) -> Signature {
        let session = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let describe = |end: &Outlet| {
            let shape = end.dtype().tensor_shape();
            // Open axes are -1 there.
            let sizes = shape.map(|shape| shape.iter().map(|&size| usize::try_from(size).unwrap_or(0)).collect());
            (end.name().to_owned(), sizes.unwrap_or_default())
        };
        Signature {
            inputs: session.inputs().iter().map(describe).collect(),
            outputs: session.outputs().iter().map(describe).collect(),
        }
    }

    fn run(&self, ends: (usize, usize), shape: [usize; 4], values: Vec<f32>) -> Result<Tensor, String> {
        let mut session = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let name = |ends: &[Outlet], index: usize| ends.get(index).map(|end| end.name().to_owned());
        let (Some(input), Some(output)) = (name(session.inputs(), ends.0), name(session.outputs(), ends.1)) else {
            return Err("it has fewer inputs or outputs than it said".into());
        };
        let tensor = TensorRef::from_array_view((shape, &values[..])).map_err(|e| e.to_string())?;
        let outputs = session.run(ort::inputs![input => tensor]).map_err(|e| e.to_string())?;
        let (shape, values) = outputs
            .get(&output)
            .ok_or("it gave no output")?
            .try_extract_tensor::<f32>()
            .map_err(|e| format!("its output holds no 32-bit floats ({e})"))?;
        let shape = shape.iter().map(|&size| usize::try_from(size).unwrap_or(0)).collect();
        Ok(Tensor { shape, values: values.to_vec() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_it_says_is_one_sentence() {
        let no_library = "/a/b.cc:2043 A& A::Get() [ONNXRuntimeError] : 1 : FAIL : Failed to load library /x.so with \
            error: libcublasLt.so.13: cannot open shared object file\n";
        let expected = "Failed to load library /x.so with error: libcublasLt.so.13: cannot open shared object file";
        assert_eq!(brief(no_library), expected);
        let no_gpu = "/a/b.cc:154 A(ERR) [with A = cudaError] CUDA failure 100: no CUDA-capable device is detected ; \
            GPU=-1 ; hostname=vm ; \n\n";
        assert_eq!(brief(no_gpu), "CUDA failure 100: no CUDA-capable device is detected");
        assert_eq!(brief("Protobuf parsing failed."), "Protobuf parsing failed");
    }
}
