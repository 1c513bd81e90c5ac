//! Builds compact semantic maps from lidar scans.
