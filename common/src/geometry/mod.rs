//! Cameras, poses and projections.

mod camera;
mod line;
mod pose;

pub use camera::PinholeCamera;
pub use line::ImageLine;
pub use pose::{Pose, PoseParameters, Tangent, interpolate, local, retract};
