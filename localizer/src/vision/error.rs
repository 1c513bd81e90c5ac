//! What can go wrong between an image file and its features.

use std::path::PathBuf;

/// Errors of images, probability maps and networks. Each message is one
/// sentence: the file, what is wrong with it, what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Reading or writing failed, or a settings file is wrong.
    #[error(transparent)]
    Common(#[from] common::Error),
    /// An image that cannot be decoded.
    #[error("{}: {}; give an intact {expected} image", path.display(), source.to_string().trim_end_matches('.'))]
    Decode {
        /// The image.
        path: PathBuf,
        /// What the decoder says.
        source: Box<dyn std::error::Error + Send + Sync>,
        /// The formats that are read there.
        expected: &'static str,
    },
    /// A PNG that cannot be written.
    #[error("{} cannot be written as PNG: {source}; check the disk and the folder", path.display())]
    Encode {
        /// The image.
        path: PathBuf,
        /// What the encoder says.
        source: png::EncodingError,
    },
    /// A PNG of another kind than needed.
    #[error("{} is a PNG of kind {found}, and {expected} is needed; convert it", path.display())]
    PixelKind {
        /// The image.
        path: PathBuf,
        /// Its colour type and bit depth.
        found: String,
        /// What is needed.
        expected: &'static str,
    },
    /// An image of another size than the others of its sequence.
    #[error(
        "{} has {}x{} px where {}x{} px are expected; give images (and probability maps) of one size, \
         the one that the calibration was made for",
        path.display(), found.0, found.1, expected.0, expected.1
    )]
    ImageSize {
        /// The image.
        path: PathBuf,
        /// Its width and height, pixels.
        found: (usize, usize),
        /// The width and height that belong there, pixels.
        expected: (usize, usize),
    },
    /// An image that cannot be the one that was calibrated.
    #[error(
        "{} has {}x{} px, but the calibration puts the optical axis at ({:.1}, {:.1}) px, far off its centre; \
         give the images that `calib.txt` was made for, neither scaled nor cropped",
        path.display(), found.0, found.1, principal_point_px.0, principal_point_px.1
    )]
    OffCentre {
        /// The image.
        path: PathBuf,
        /// Its width and height, pixels.
        found: (usize, usize),
        /// Principal point of the calibration, pixels.
        principal_point_px: (f64, f64),
    },
    /// A probability map of another size than the other maps.
    #[error("the probability map of class {class} has {}x{} px and the others have {}x{}; give maps of one size", found.0, found.1, expected.0, expected.1)]
    PlaneSize {
        /// The class.
        class: &'static str,
        /// Its width and height, pixels.
        found: (usize, usize),
        /// Width and height of the others, pixels.
        expected: (usize, usize),
    },
    /// A folder without the map of any class for a frame.
    #[error("{} holds no probability map of frame {frame:06} (looked for pole, sign, light, lane and vegetation/{frame:06}.png); give the folder above them, or run with networks", folder.display())]
    NoLabels {
        /// The folder.
        folder: PathBuf,
        /// The frame.
        frame: usize,
    },
    /// A class that has maps, but none for a frame.
    #[error("{} is missing beside the maps of other frames; add it, or remove the folder of a class that has none", path.display())]
    MissingLabel {
        /// The map.
        path: PathBuf,
    },
    /// A network that cannot be loaded.
    #[error("{} cannot be loaded as an ONNX network: {message}; give an intact .onnx file", path.display())]
    LoadNetwork {
        /// The network.
        path: PathBuf,
        /// What the runtime says.
        message: String,
    },
    /// A runtime that this program or this machine does not have.
    #[error("networks cannot be run with `--runtime {runtime}`: {message}; {remedy}, or leave the option out")]
    NoRuntime {
        /// The value of `--runtime`.
        runtime: &'static str,
        /// What is missing.
        message: String,
        /// What to do about it.
        remedy: &'static str,
    },
    /// A network that nothing is known about.
    #[error("{} is no known network (its inputs and outputs are {signature}); describe it in {}", path.display(), description.display())]
    UnknownNetwork {
        /// The network.
        path: PathBuf,
        /// Its inputs and outputs, with shapes.
        signature: String,
        /// The file in which to describe it.
        description: PathBuf,
    },
    /// A description of a network that says what there is not, or says it wrong.
    #[error("{}:{line}: {message}; a description has {known}", path.display())]
    BadDescription {
        /// The file with the description.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// What is wrong there.
        message: String,
        /// All that may stand in one.
        known: String,
    },
    /// A network and its description that contradict each other.
    #[error("{} does not fit its description: {message} (its inputs and outputs are {signature}); correct {}", path.display(), description.display())]
    NetworkMismatch {
        /// The network.
        path: PathBuf,
        /// What does not fit.
        message: String,
        /// Its inputs and outputs, with shapes.
        signature: String,
        /// The file with the description.
        description: PathBuf,
    },
    /// A network that failed while running.
    #[error("{} failed while running: {message}; check its description", path.display())]
    RunNetwork {
        /// The network.
        path: PathBuf,
        /// What the runtime says.
        message: String,
    },
}
