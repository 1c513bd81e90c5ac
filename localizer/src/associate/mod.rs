//! Section IV.E: which feature is which landmark, and the pose that follows.

pub mod detection;
pub mod foreseen;
pub mod matching;
pub mod odds;
pub mod paper;
pub mod robust;
pub mod separation;
