//! What the mapper and the localizer share: geometry, KITTI input and output,
//! trajectories, configuration files, and the compact semantic map.
//!
//! Frames are in the names: `a_from_b` takes coordinates in frame `b` to frame
//! `a`, so `a_from_b * b_from_c = a_from_c`. The frames are
//!
//! | name | axes | origin |
//! |---|---|---|
//! | `map` | as `camera` | the reference camera of the first frame of the survey |
//! | `camera` | x right, y down, z forward | the reference camera (KITTI: camera 0, left grey) |
//! | `velodyne` | x forward, y left, z up | the lidar |
//! | image | u right, v down, pixels | centre of the top-left pixel |
//!
//! Lengths are metres, angles radians, times seconds, image distances pixels.

pub mod atomic_file;
pub mod config;
pub mod earth;
pub mod error;
pub mod geometry;
pub mod kitti;
pub mod map;
pub mod output;
mod text;
pub mod trajectory;

pub use error::{Error, Result};
pub use text::{coordinates_m, is_separator, pose_of, read as read_text, words};
