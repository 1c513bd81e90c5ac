//! Generated drives side by side with real ones: what the sensors give.

pub mod features;
pub mod scans;
