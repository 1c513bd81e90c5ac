use super::SemanticMap;

/// The numbers by which the landmarks of a map are told to people, in exports and
/// in reports: poles from 1, then signs, then lane lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Numbering {
    signs_from: usize,
    lanes_from: usize,
    /// The first number that no landmark has.
    pub end: usize,
}

impl Numbering {
    /// The numbers in a map with so many landmarks of each kind.
    pub fn new(poles: usize, signs: usize, lanes: usize) -> Self {
        let signs_from = 1 + poles;
        let lanes_from = signs_from + signs;
        Self { signs_from, lanes_from, end: lanes_from + lanes }
    }

    /// The numbers in a map as it is read from its file.
    pub fn of(map: &SemanticMap) -> Self {
        Self::new(map.poles.len(), map.signs.len(), map.lanes.len())
    }

    /// The number of a pole, by its place in the map.
    pub fn pole(self, index: usize) -> usize {
        1 + index
    }

    /// The number of a sign, by its place in the map.
    pub fn sign(self, index: usize) -> usize {
        self.signs_from + index
    }

    /// The number of a lane line, by its place in the map.
    pub fn lane(self, index: usize) -> usize {
        self.lanes_from + index
    }
}
