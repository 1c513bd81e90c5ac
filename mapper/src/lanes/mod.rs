//! Lane lines: paint that is bright for its beam and range, RANSAC lines in
//! windows along the path, joined across dash gaps into polylines.

mod chains;
mod config;
mod contrast;
mod polyline;
mod windows;

pub use chains::{Chain, join};
pub use config::LaneConfig;
pub use contrast::{ContrastConfig, contrast};
pub use polyline::{LanePiece, describe, simplify};
pub use windows::{Paint, PathPoint, WindowLine, find_lines};
