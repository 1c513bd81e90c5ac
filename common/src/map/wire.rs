//! What stands in the file (first form): quantised coordinates.

use bincode::{Decode, Encode};

/// A point in quanta.
pub(super) type Point = [i32; 3];

/// The content of a map file.
#[derive(Encode, Decode)]
pub(super) struct Content {
    pub quantum_um: u32,
    pub frame_note: String,
    pub roads: Vec<Vec<Point>>,
    pub poles: Vec<(u8, u32, Point, Point)>,
    pub signs: Vec<(u8, u32, Point, u32)>,
    pub lanes: Vec<(u8, u32, Vec<Point>)>,
}
