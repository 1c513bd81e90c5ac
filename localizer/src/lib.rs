//! Localizes a camera against a compact semantic map: from an image's features
//! to a 6-DOF pose with a covariance and a word on how far to trust it.
//!
//! One frame goes through [`prepare`] (features in a comparable form),
//! [`preselect`] (section IV.A: which landmarks may be seen), the association
//! ([`associate`], section IV.E) with the [`solver`] (IV.D) inside, and
//! [`tracker`] carries several hypotheses from frame to frame.

pub mod associate;
pub mod cli;
pub mod config;
pub mod drive;
pub mod error;
pub mod estimate;
pub mod eval;
pub mod features;
pub mod filter;
pub mod gps;
pub mod local_map;
pub mod measurement;
pub mod odometry;
pub mod output;
pub mod overlay;
mod pace;
pub mod paper_tracker;
pub mod prepare;
pub mod preselect;
pub mod projection;
pub mod residual;
pub mod road_index;
pub mod run;
pub mod solver;
pub mod start;
pub mod tracker;
pub mod vision;
pub mod visual_odometry;
pub mod watch;

pub use error::{Error, Result};

#[cfg(test)]
pub(crate) mod testing;
