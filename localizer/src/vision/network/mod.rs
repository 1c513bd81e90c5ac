//! ONNX networks: an image in, probability maps out.
//!
//! A network is described by `NAME.toml` beside `NAME.onnx` ([`NetworkSpec`]);
//! the two networks that Waymark is tested with are known without one:
//!
//! | output | shape | classes |
//! |---|---|---|
//! | `class_probabilities` | 1x19xHxW | Cityscapes: 5 pole, 6 light, 7 sign, 8 vegetation |
//! | `lane_probability` | 1x1xHxW | lane |

mod denormals;
mod part;
mod resample;
mod rows;
mod runtime;
mod signature;
mod simplify;
mod softmax;
mod spec;

use std::path::{Path, PathBuf};

pub use runtime::Runtime;
pub use spec::{Activation, ChannelOrder, ClassChannels, Fit, Layout, NetworkSpec};

use super::{Class, Error, Plane, ProbabilityMaps, RgbImage};
use part::Part;

/// A network that is ready to run.
pub struct Network {
    path: PathBuf,
    spec: NetworkSpec,
    /// What runs on the rows below `skip_top`.
    below: Option<Part>,
    /// What runs on all rows: where there is no other, and where what that
    /// one finds goes on above.
    whole: Part,
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
        // One that cannot be loaded so is loaded as it is.
        let simplified = simplify::simplified(&bytes);
        let simplified = simplified.and_then(|bytes| Some((runtime.load(path, bytes.clone()).ok()?, bytes)));
        let (model, bytes) = match simplified {
            Some(simplified) => simplified,
            None => (runtime.load(path, bytes.clone())?, bytes),
        };
        let signature = model.signature();
        let description = path.with_extension("toml");
        let spec = if description.exists() {
            NetworkSpec::read(&description)?
        } else {
            signature.known().ok_or_else(|| Error::UnknownNetwork {
                path: path.into(),
                signature: signature.to_string(),
                description: description.clone(),
            })?
        };
        let mismatch = |message| Error::NetworkMismatch {
            path: path.into(),
            message,
            signature: signature.to_string(),
            description: description.clone(),
        };
        let (ends, size) = signature.matched(&spec).map_err(mismatch)?;
        let whole = Part::new(model, ends, size, 0);
        let rows = spec.rows(size.1);
        let below = (rows < size.1).then(|| -> Result<Part, Error> {
            let unfit = |message| mismatch(format!("it does not run with `skip_top` ({message})"));
            let fewer = rows::cut(&bytes, size, rows).ok_or_else(|| unfit("its graph cannot be read".into()))?;
            let part = Part::new(runtime.load(path, fewer)?, ends, size, size.1 - rows);
            part.runs(&spec).map_err(unfit)?;
            Ok(part)
        });
        // A known network that is none runs as it is.
        let below = if description.exists() { below.transpose()? } else { below.and_then(Result::ok) };
        Ok(Self { path: path.into(), spec, below, whole })
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
        let (mut planes, reach_edge) = self.planes(self.below.as_ref().unwrap_or(&self.whole), image)?;
        if reach_edge {
            (planes, _) = self.planes(&self.whole, image)?;
        }
        planes.into_iter().try_for_each(|(class, plane)| maps.set(class, plane))
    }

    /// What a part gives for each class, and whether that reaches rows that it
    /// leaves out.
    fn planes(&self, part: &Part, image: &RgbImage) -> Result<(Vec<(Class, Plane)>, bool), Error> {
        let failed = |message: String| Error::RunNetwork { path: self.path.clone(), message };
        let (scores, view) = part.scores(image, &self.spec).map_err(failed)?;
        let mut reach_edge = false;
        let mut plane = |class: Class| {
            let found = scores.probabilities(self.spec.classes.of(class), self.spec.activation).map_err(failed)?;
            reach_edge |= found.reach_edge;
            let plane = resample::to_plane(&found.values, found.size, &view, (image.width(), image.height()));
            Ok((class, plane))
        };
        let planes = self.classes().map(&mut plane).collect::<Result<_, Error>>()?;
        Ok((planes, reach_edge))
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

#[cfg(test)]
mod graphs;
#[cfg(test)]
mod tests;
