//! What the demo, the scores and the end-to-end tests share.

pub mod data;
pub mod map_score;
pub mod matching;
pub mod pole_map;
pub mod realism;
pub mod truth;
