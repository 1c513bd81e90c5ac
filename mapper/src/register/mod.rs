//! Scan registration: the motion between scans, from the scans themselves.

mod align;
mod graph;
mod local_map;
mod odometry;

pub use align::{AlignConfig, Alignment, ScanSurface, align, scan_surfaces};
pub use graph::{GraphConfig, Motion, Refined, refine_poses};
pub use local_map::{LocalMap, Surface, SurfaceConfig};
pub use odometry::{RefineConfig, Registration, Report, refine};
