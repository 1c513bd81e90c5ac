//! Lane lines: paint that is bright for its beam and range, straight
//! lines in windows along the path, joined into chains, cut where what is
//! painted changes, and described as polylines. Kerbs where nothing is painted.

mod chains;
mod config;
mod contrast;
mod decision;
mod fords;
mod kerbs;
mod kinds;
mod marks;
mod paint;
mod pairs;
mod piece;
mod poll;
mod polyline;
mod profile;
mod rhythm;
mod side_streets;
mod simplify;
mod spacing;
mod symbols;
#[cfg(test)]
mod tests;
mod windows;

pub use chains::Chain;
pub use config::LaneConfig;
pub use contrast::{ContrastConfig, Contrasts};
pub use fords::FordConfig;
pub use kerbs::{KerbConfig, kerbs_along};
pub use marks::MarkConfig;
pub use paint::{Paint, PathPoint};
pub use piece::LanePiece;
pub use polyline::lines_along;
pub use rhythm::RhythmConfig;
pub use side_streets::{SideConfig, find_side_lines};
pub use simplify::{fitted, simplify};
pub use spacing::SpacingConfig;
pub use windows::WindowLine;
