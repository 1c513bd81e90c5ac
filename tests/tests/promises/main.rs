//! What Waymark promises, from the command line to the files. The drive that
//! most of it is shown on is the demo's.

// Helpers of tests count as tests: a failed unwrap is a failed test.
#![allow(clippy::unwrap_used)]

mod another_camera;
mod another_lidar;
mod another_way;
mod atlas;
mod bad_images;
mod bad_input;
mod budget;
mod camera_from_map;
mod cloud_with_classes;
mod demo;
mod determinism;
mod drives;
mod exports;
mod inputs;
mod live;
mod map_from_scans;
mod measured_streets;
mod merged_maps;
mod motion;
mod nothing_found;
mod on_earth;
mod real_kitti;
mod refined_poses;
mod settings;
mod support;
mod survey_frame;
mod worlds;
