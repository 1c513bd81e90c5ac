//! Cameras, poses and projections.

mod camera;
mod line;
mod polyline;
mod pose;

pub use camera::PinholeCamera;
pub use line::ImageLine;
pub use polyline::{above, distance_from_above_m, distance_to_polyline, distance_to_segment};
pub use pose::{Pose, PoseParameters, Tangent, interpolate, local, nearest_rotation, retract};
