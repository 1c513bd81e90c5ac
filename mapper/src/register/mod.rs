//! Scan registration: the motion between scans, from the scans themselves.

mod align;
mod chain;
mod doubt;
mod graph;
mod local_map;
mod odometry;
mod refine;
mod revisits;
mod search;
mod vertical_angle;

pub use align::{AlignConfig, Alignment, ScanSurface, align, scan_surfaces};
pub use graph::{GraphConfig, Motion, Refined, Revisit, refine_poses, squared_sigmas};
pub use local_map::{LocalMap, Surface, SurfaceConfig};
pub use refine::{RefineConfig, Registration, Report, refine};
pub use revisits::{RevisitConfig, RevisitReport};
pub use search::SearchConfig;
pub use vertical_angle::VerticalAngleConfig;

/// The upper median; 0 of nothing.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}
