//! What the demo, the scores and the end-to-end tests share.

pub mod ablation;
pub mod budget_curve;
pub mod cli;
pub mod data;
pub mod drives;
pub mod evidence_score;
pub mod faults;
pub mod figures;
pub mod labels;
pub mod map_score;
pub mod matching;
pub mod pole_map;
pub mod realism;
pub mod trial;
pub mod truth;
pub mod turned;
pub mod weather;
