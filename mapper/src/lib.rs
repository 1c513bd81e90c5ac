//! Builds compact semantic maps from lidar scans.
//!
//! `build` reads like the pipeline: [`register`] makes the survey's poses
//! agree with the scans, [`cloud`] stitches a window of the drive over its
//! [`ground`], [`poles`], [`signs`] and [`lanes`] find the landmarks in it,
//! and [`roads`] cuts the drive into the stretches that they belong to.
//! [`fuse`] makes one landmark of what was seen twice, and [`merge`] one map
//! of the drives of an area; [`diff`] compares maps, [`validate`] doubts them.

pub mod atlas;
pub mod budget;
pub mod build;
mod by_cell;
pub mod cli;
pub mod cloud;
pub mod config;
pub mod diff;
pub mod draw;
pub mod drive;
pub mod error;
pub mod evidence;
pub mod export;
mod extent;
mod frames;
pub mod fuse;
pub mod grid;
pub mod ground;
pub mod input;
pub mod inspect;
pub mod lanes;
pub mod lidar;
mod looks;
pub mod merge;
mod outputs;
pub mod passes;
pub mod path;
pub mod poles;
mod quantile;
pub mod register;
pub mod report;
pub mod roads;
pub mod scan;
mod sheeting;
pub mod signs;
pub mod validate;
pub mod voxel;

#[cfg(test)]
mod testing;

pub use build::{Built, PoseSource, build};
pub use config::Config;
pub use error::{Error, Result};
