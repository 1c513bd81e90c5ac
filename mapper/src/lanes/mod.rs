//! Lane lines: paint that is bright for its beam and range, straight
//! lines in windows along the path, joined into chains, cut where what is
//! painted changes, and described as polylines.

mod chains;
mod config;
mod contrast;
mod fords;
mod kinds;
mod marks;
mod paint;
mod pairs;
mod piece;
mod polyline;
mod profile;
mod simplify;
#[cfg(test)]
mod tests;
mod windows;

pub use chains::{Chain, join};
pub use config::LaneConfig;
pub use contrast::{ContrastConfig, Contrasts};
pub use paint::{Paint, PathPoint};
pub use piece::{LanePiece, without_doubles};
pub use polyline::describe;
pub use simplify::{fitted, simplify};
pub use windows::{WindowLine, find_lines};
