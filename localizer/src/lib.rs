//! Localizes a camera against a compact semantic map.
pub mod features;
