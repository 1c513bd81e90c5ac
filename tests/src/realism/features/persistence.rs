//! How long faults last.

use std::collections::BTreeMap;

use nalgebra::Point2;

use super::table::{Row, Samples, Share};

/// Which landmarks were seen in which frames.
#[derive(Debug, Default)]
pub struct Sightings {
    last: BTreeMap<usize, (usize, bool, usize)>,
    missed_again: Share,
    lost: Share,
    misses: Samples,
}

impl Sightings {
    /// A landmark that should be seen in a frame was found or not; frames
    /// ascend.
    pub fn add(&mut self, landmark: usize, frame: usize, found: bool) {
        let mut length = usize::from(!found);
        if let Some(&(before, was_found, missed)) = self.last.get(&landmark)
            && before + 1 == frame
        {
            if was_found {
                self.lost.add(!found);
            } else {
                self.missed_again.add(!found);
                if found {
                    self.misses.push(missed as f64);
                } else {
                    length += missed;
                }
            }
        }
        self.last.insert(landmark, (frame, found, length));
    }

    /// Their rows.
    pub fn rows(&self, class: &str) -> Vec<Row> {
        vec![
            self.lost.row(format!("{class} lost in a frame after one that had it, share")),
            self.missed_again.row(format!("{class} missed again after a miss, share")),
            self.misses.mean(format!("{class} found again after misses, frames")),
        ]
    }
}

/// False features from frame to frame.
#[derive(Debug, Default)]
pub struct Tracks {
    frame: usize,
    before: Vec<Point2<f64>>,
    now: Vec<Point2<f64>>,
    again: Share,
}

impl Tracks {
    /// How far a feature moves from a frame to the next at most, pixels: what
    /// is 20 m ahead and 5 m aside moves by 12.
    const REACH_PX: f64 = 12.0;

    /// A false feature in a frame; frames ascend.
    pub fn add(&mut self, frame: usize, place: Point2<f64>) {
        if frame != self.frame {
            self.before = if frame == self.frame + 1 { std::mem::take(&mut self.now) } else { Vec::new() };
            self.now.clear();
            self.frame = frame;
        }
        if frame > 0 {
            self.again.add(self.before.iter().any(|p| (p - place).norm() < Self::REACH_PX));
        }
        self.now.push(place);
    }

    /// Its row.
    pub fn row(&self, class: &str) -> Row {
        self.again.row(format!("{class} false that were there a frame before, share"))
    }
}

/// How a figure of the same landmark changes from frame to frame: what is left
/// of an error when that of the map and of the poses, which change slowly, is
/// taken away.
#[derive(Debug, Default)]
pub struct Changes {
    last: BTreeMap<usize, (usize, f64)>,
    changes: Samples,
}

impl Changes {
    /// The figure of a landmark in a frame; frames ascend.
    pub fn add(&mut self, landmark: usize, frame: usize, value: f64) {
        if let Some((before, last)) = self.last.insert(landmark, (frame, value))
            && before + 1 == frame
        {
            // Of two values that err independently.
            self.changes.push((value - last) * std::f64::consts::FRAC_1_SQRT_2);
        }
    }

    /// Its rows.
    pub fn rows(&self, name: &str) -> [Row; 2] {
        self.changes.magnitudes(name)
    }
}
