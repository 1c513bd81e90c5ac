//! Scan registration: the motion between scans, from the scans themselves.

mod align;
mod chain;
mod doubt;
mod graph;
mod jumps;
mod local_map;
mod odometry;
mod refine;
mod revisits;
mod search;
mod vertical_angle;
mod weak;

pub use align::{AlignConfig, Alignment, ScanSurface, align, scan_surfaces};
pub use graph::{GraphConfig, Motion, Refined, Revisit, refine_poses, squared_sigmas};
pub use jumps::{JumpConfig, JumpWitness, SurveyJump, jumps_by_times, jumps_text};
pub use local_map::{LocalMap, Surface, SurfaceConfig};
pub use refine::{RefineConfig, Registration, Report, refine};
pub use revisits::{RevisitConfig, RevisitReport};
pub use search::SearchConfig;
pub use vertical_angle::VerticalAngleConfig;
